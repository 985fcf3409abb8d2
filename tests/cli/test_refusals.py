"""What the command line refuses: one line says why, nothing changes, and the exit code is 1."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from kfmocap.__main__ import main
from kfmocap.cli import tracked_files
from kfmocap.cli.arguments import parser
from kfmocap.core.formats import read_trc, write_trc
from made_capture import made_capture
from tiny_shot import SHOT, assert_refused, track

pytest_plugins = ("tiny_shot_fixtures",)

BAD_INPUT = [
    ("missing footage", '"footage_%02d.png"', '"none.mp4"', ["shot.toml", "'cam01' footage", "none.mp4"]),
    (
        "unreadable footage",
        '"footage_%02d.png"',
        '"broken.mp4"',
        ["'cam01' footage", "broken.mp4", "cannot be read"],
    ),
    ("footage of another size", '"footage_%02d.png"', '"small.png"', ["small.png", "20x10", "96x72"]),
    (
        "too few frames",
        "frames = [0, 5]",
        "frames = [0, 50]",
        ["%02d.png", "cam01", "only 6 frames, 0 to 5", "first 6 frames, in a shot file frames = [0, 5]"],
    ),
    (
        "camera that matches nothing",
        'camera = "cam01"',
        'camera = "left"',
        ["[[view]] 1 camera", "'left'", "cam01"],
    ),
    (
        "key frame outside",
        "keyframes = [0, 5]",
        "keyframes = [0, 6]",
        ["[[performer]] 1 keyframes", "key frame 6"],
    ),
    ("no key frame", "keyframes = [0, 5]", "keyframes = []", ["[[performer]] 1 keyframes", "at least one"]),
    ("unknown key", "fps = 30.0", "fps = 30.0\nfsp = 3", ["shot.toml [shot]", "'fsp'", "'fps'"]),
    ("unknown table", "[calibration]", "[camera]\n[calibration]", ["shot.toml", "unknown key 'camera'"]),
    ("broken TOML", "[shot]", "[shot", ["shot.toml", "TOML", "line"]),
    ("missing calibration", '"calibration.toml"', '"no.toml"', ["[calibration] file", "no.toml"]),
    ("missing landmarks", '"landmarks.trc"', '"no.trc"', ["[[performer]] 1 landmarks", "no.trc"]),
    (
        "too few landmarks",
        '"landmarks.trc"',
        '"legs.trc"',
        ["legs.trc", "only 3 of its 5 landmarks", "it has Nose, RHip"],
    ),
    ("NaN landmarks", '"landmarks.trc"', '"holes.trc"', ["holes.trc", "only 2 of the main joints", "key frame 5"]),
]


@pytest.mark.parametrize(("what", "old", "new", "words"), BAD_INPUT, ids=[case[0] for case in BAD_INPUT])
def test_bad_input_is_one_line_and_changes_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], what: str, old: str, new: str, words: list[str]
) -> None:
    (folder / "broken.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(200))
    cv2.imwrite(str(folder / "small.png"), np.zeros((10, 20, 3), np.uint8))
    landmarks = read_trc(folder / "landmarks.trc")
    keep = [i for i, name in enumerate(landmarks.names) if name in ("RHip", "RKnee", "RAnkle", "RHeel", "Nose")]
    names = [landmarks.names[i] for i in keep]
    write_trc(folder / "legs.trc", names, landmarks.points_world[:, keep], 30)
    hidden = [i for i, name in enumerate(landmarks.names) if name not in ("LElbow", "RWrist", "Nose", "Head", "LHand")]
    landmarks.points_world[5, hidden] = np.nan
    write_trc(folder / "holes.trc", landmarks.names, landmarks.points_world, 30)
    (folder / "shot.toml").write_text(SHOT.replace(old, new, 1))
    assert_refused(folder, capsys, track(folder), *words)


def test_the_libraries_below_add_nothing_to_the_message(folder: Path) -> None:
    (folder / "broken.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(200))
    (folder / "shot.toml").write_text(SHOT.replace("footage_%02d.png", "broken.mp4"))
    code = "import sys; from kfmocap.__main__ import main; sys.exit(main())"
    command = [sys.executable, "-c", code, "track", "shot.toml", "--out", "out", "--no-blender"]
    run = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert run.returncode == 1
    assert run.stderr.count("\n") == 1
    assert "broken.mp4: the footage cannot be read as a video" in run.stderr


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--views", "cam07"], ["--views", "'cam07'", "cam01"]),
        (["--views", ","], ["--views"]),
        (["--offset", "cam07=3"], ["--offset", "'cam07'", "cam01"]),
        (["--offset", "cam01"], ["--offset", "'cam01'", "cam02=3"]),
        (["--offset", "cam01=nan"], ["--offset", "'cam01=nan'"]),
        (["--keyframes", "0,9"], ["--keyframes", "key frame 9", "0 to 5"]),
        (["--keyframes", "0,x"], ["--keyframes", "'0,x'"]),
        (["--keyframes", "auto"], ["[[performer]] 1", "nothing to take the key poses from"]),
        (["--solver", "magic"], ["error: --solver: unknown solver 'magic'", "gauss-newton"]),
        (["--threads", "0"], ["error: --threads: it is 0"]),
    ],
)
def test_bad_arguments_are_one_line_and_change_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], words: list[str]
) -> None:
    assert_refused(folder, capsys, track(folder, *arguments), *words)


def test_a_missing_shot_file_is_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "shot.toml").unlink()
    assert_refused(folder, capsys, track(folder), "shot.toml", "cannot be read")


@pytest.mark.parametrize("out", ["out/notes.txt", "out/notes.txt/deeper", "/proc/kfmocap"])
def test_an_output_folder_that_cannot_be_written_is_refused_before_tracking(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, out: str
) -> None:
    monkeypatch.setattr(tracked_files, "track", lambda *_: pytest.fail("tracking began"))
    assert_refused(folder, capsys, track(folder, out=out), out)


@pytest.mark.parametrize("result", ["tiny.trc", "tiny.bvh", "report.json"])
def test_results_take_the_place_of_nothing_that_they_are_made_of(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, result: str
) -> None:
    """The results' folder may be that of the input, and a shot may be called as its landmarks are."""
    monkeypatch.setattr(tracked_files, "track", lambda *_: pytest.fail("tracking began"))
    (folder / "landmarks.trc").rename(folder / result)
    (folder / "shot.toml").write_text(SHOT.replace("landmarks.trc", result))
    before = (folder / result).read_bytes()
    assert_refused(folder, capsys, track(folder, out="."), result, "would be replaced by the results")
    assert (folder / result).read_bytes() == before


def test_cameras_take_the_place_of_nothing_that_they_are_made_of(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shot = str(folder / "shot.toml")
    for kind in ("--refine", "--performer"):
        assert_refused(folder, capsys, main(["calibrate", kind, shot, "--out", shot]), "would be replaced")
    wand = made_capture(folder)
    arguments = ["calibrate", str(wand), "--out"]
    assert_refused(folder, capsys, main([*arguments, str(wand)]), "wand.toml", "would be replaced")
    arguments += [str(folder / "new.toml"), "--points", str(folder / "points.csv")]
    assert_refused(folder, capsys, main(arguments), "points.csv", "would be replaced")


def test_a_folder_in_the_way_of_a_result_is_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (folder / "out" / "notes.txt").unlink()
    (folder / "out" / "tiny.trc").mkdir()
    assert track(folder) == 1
    assert "tiny.trc: a folder is in the way" in capsys.readouterr().err
    assert [file.name for file in (folder / "out").iterdir()] == ["tiny.trc"]


@pytest.mark.parametrize("arguments", [["track", "a.toml", "--out", ""], ["calibrate", "", "--out", "b.toml"]])
def test_an_empty_path_is_an_error(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "the path is empty" in capsys.readouterr().err


def test_no_argument_takes_an_empty_path() -> None:
    """An empty one, as an unset variable of a shell leaves it, would be the working folder."""
    commands = next(action for action in parser()._actions if action.dest == "command").choices
    assert [f"{name} {a.dest}" for name, one in commands.items() for a in one._actions if a.type is Path] == []


@pytest.mark.parametrize("taken", ["tiny.trc", "report.json"])
def test_a_folder_in_the_way_is_seen_before_tracking(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, taken: str
) -> None:
    monkeypatch.setattr(tracked_files, "track", lambda *_, **__: pytest.fail("tracking began"))
    (folder / "out" / taken).mkdir()
    assert track(folder) == 1
    assert f"{taken}: a folder is in the way" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "hint"),
    [
        ("--views cam01 cam02", "cam02; for several: --views cam01,cam02"),
        ("--offset cam01=1 cam02=2", "cam02=2; for several: --offset cam01=3 --offset cam02=-2"),
        ("--views cam01 --wrong", "--wrong"),
    ],
)
def test_values_one_after_the_other_are_told_how_they_are_written(
    arguments: str, hint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        parser().parse_args(["track", "shot.toml", "--out", "results", *arguments.split()])
    assert capsys.readouterr().err.endswith(f"unrecognized arguments: {hint}\n")
