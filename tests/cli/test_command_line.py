"""The command line: all that was asked for is written and the exit code is 0, or one line says why not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import closing
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import cv2
import job_functions
import numpy as np
import pytest
from kfmocap.__main__ import _BlenderProcess, main
from kfmocap.cli import command_line, example_footage, progress_bar, track_command
from kfmocap.cli.arguments import parser
from kfmocap.cli.services import Services, blender_needed
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import CancelledError, FootageError
from kfmocap.core.fitting.camera_refinement import RefinedCamera, Refinement
from kfmocap.core.fitting.resection import adjusted
from kfmocap.core.fitting.shot_cameras import CameraFit
from kfmocap.core.formats import load_cameras, read_trc, save_cameras, write_trc
from kfmocap.core.numerics import rotations
from kfmocap.core.review.suggestions import KeySuggestion
from kfmocap.core.runtime import files
from kfmocap.core.shot.footage_faults.footage_damage import FootageDamage
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking import journal
from kfmocap.core.tracking.expected_errors.uncertainty import JointErrors
from kfmocap.core.tracking.track_result import TrackResult
from made_capture import made_capture

SIZE = (96, 72)
FRAMES = 6
SHOT = """
[shot]
name = "tiny"
fps = 30.0
frames = [0, 5]

[calibration]
file = "calibration.toml"

[[view]]
camera = "cam01"
footage = "footage_%02d.png"

[[performer]]
name = "man"
landmarks = "landmarks.trc"
keyframes = [0, 5]
"""


def motion_of(body, frames: int = FRAMES) -> Motion:
    Q = np.tile(np.eye(3), (frames, len(body), 1, 1))
    Q[:, body.index("upper_arm.R")] = rotations.exp(np.linspace([0, 0, 0], [0, 0.5, 0.8], frames))
    return Motion(np.linspace([0, 0, 1], [0.3, 0, 1], frames), Q)


def made_result(shot: Shot) -> TrackResult:
    """What the tracker hands back, without its work."""
    counts = [(len(shot.views), shot.length, len(p.body)) for p in shot.performers]
    return TrackResult(
        motions=tuple(motion_of(p.body) for p in shot.performers),
        seconds={"footage": 1.0, "solve": 3.0},
        camera_frames=len(shot.views) * shot.length,
        segments=(),
        visible=tuple(np.ones(count) for count in counts),
        residual=tuple(np.linspace(0, 0.1, shot.length) for _ in shot.performers),
        errors=tuple(JointErrors(*np.zeros((3, *count[1:]))) for count in counts),
        unknown=tuple(() for _ in shot.performers),
    )


STEP = np.array([0.02, 0, 0, 0.01, 0, 0, 0])


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A shot that loads, beside an output folder that holds somebody's file; the tracker is a stand-in."""
    body = human(1.8)
    names = list(body.landmarks)
    write_trc(tmp_path / "landmarks.trc", names, landmark_positions(body, motion_of(body), names), 30)
    K = [[70, 0, 47.5], [0, 70, 35.5], [0, 0, 1]]
    camera = Camera.create("cam01", SIZE, K, rotations.exp(np.array([np.pi / 2, 0, 0])), [0, 1, 3])
    save_cameras(tmp_path / "calibration.toml", [camera])
    for f in range(FRAMES):
        image = np.full((SIZE[1], SIZE[0], 3), 40 + 20 * f, np.uint8)
        cv2.imwrite(str(tmp_path / f"footage_{f:02d}.png"), image)
    (tmp_path / "shot.toml").write_text(SHOT)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes.txt").write_text("mine")
    monkeypatch.setattr(track_command, "track", lambda shot, progress=None, **_: made_result(shot))
    return tmp_path


def track(folder: Path, *arguments: str, out: str = "out") -> int:
    return main(["track", str(folder / "shot.toml"), "--out", str(folder / out), "--no-blender", *arguments])


def assert_refused(folder: Path, capsys: pytest.CaptureFixture[str], code: int, *words: str) -> None:
    """One line on standard error with these words, and the output folder as it was."""
    captured = capsys.readouterr()
    assert code == 1
    assert captured.out == ""
    assert captured.err.startswith("kfmocap: error: ")
    assert captured.err.count("\n") == 1
    for word in words:
        assert word in captured.err
    assert [file.name for file in (folder / "out").iterdir()] == ["notes.txt"]
    assert not list(folder.glob(".kfmocap-*"))


def test_every_result_is_written_and_named(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert track(folder) == 0
    written = sorted(file.name for file in (folder / "out").iterdir())
    assert written == ["notes.txt", "overlay.png", "report.json", "tiny.trc"]
    printed = capsys.readouterr().out.split()
    assert printed == [str(folder / "out" / name) for name in written[1:]]


def test_landmarks_written_are_those_of_the_motion(folder: Path) -> None:
    track(folder)
    landmarks = read_trc(folder / "out" / "tiny.trc")
    truth = read_trc(folder / "landmarks.trc")
    assert landmarks.fps == 30
    error = landmarks.points_world - truth.points_world[:, [truth.names.index(n) for n in landmarks.names]]
    assert len(landmarks) == FRAMES
    assert np.linalg.norm(error, axis=2).mean() < 0.05


def test_the_report_is_json_with_times_and_versions(folder: Path) -> None:
    track(folder, "--solver", "relaxation")
    report = json.loads((folder / "out" / "report.json").read_text())
    assert report["camera_frames_per_second"] == pytest.approx(FRAMES / 4.0)
    assert {"footage", "solve", "shot", "overlay"} <= set(report["seconds"])
    assert report["settings"]["solver"] == "relaxation"
    assert report["performers"][0]["worst_frames"][0]["frame"] == FRAMES - 1


def test_damaged_footage_is_put_down_to_its_view(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def tracked(shot, *_, **__) -> TrackResult:
        return replace(made_result(shot), damage=(FootageDamage((4,), "error while decoding", stretches=((4, 11),)),))

    monkeypatch.setattr(track_command, "track", tracked)
    assert track(folder) == 0
    said = capsys.readouterr().err
    assert "cam01: the footage is damaged at or near frames 4 of the file" in said
    assert "its pictures between frames 4 and 11 may be wrong: they were given no weight" in said


def test_cameras_that_do_not_fit_are_printed_and_reported(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fits = (CameraFit(3.0, 1.0, 5.0, "cam01", "keypoints"), CameraFit(12.4, 2.0, 5.0, "cam01", "key poses"))
    monkeypatch.setattr(track_command, "camera_fits", lambda *_: fits)
    assert track(folder) == 0
    assert capsys.readouterr().err.splitlines()[:2] == [
        "kfmocap: cam01: its picture is 12 px off the key poses; up to 5 px could be chance",
        "kfmocap: refine the cameras: kfmocap track --refine, or Refine Cameras in Blender",
    ]
    [view] = json.loads((folder / "out" / "report.json").read_text())["views"]
    assert [fit["off"] for fit in view["fits"]] == [False, True] and view["fits"][1]["shift"] == 12.4
    assert view["refined"] is None


def test_refining_first_tracks_with_the_refined_cameras_and_writes_them(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refined(shot, _progress):
        camera = adjusted(shot.views[0].camera, STEP)
        return Refinement((RefinedCamera(camera, 7.5, 2.0, 0, 0, 0, clearness=1.0),), np.array([0]))

    def tracked(shot, progress=None, pictures=(), **_):
        seen.append(shot.views[0].camera)
        return made_result(shot)

    seen: list[Camera] = []
    monkeypatch.setattr(track_command, "refine_shot_cameras", refined)
    monkeypatch.setattr(track_command, "track", tracked)
    [before] = load_cameras(folder / "calibration.toml").values()
    assert track(folder, "--refine") == 0
    captured = capsys.readouterr()
    assert "kfmocap: cam01: refined, its picture moved by 7.5 px" in captured.err
    assert str(folder / "out" / "refined.toml") in captured.out
    [written] = load_cameras(folder / "out" / "refined.toml").values()
    for camera in (written, seen[0]):
        np.testing.assert_allclose(camera.t_cam_world, adjusted(before, STEP).t_cam_world)
    [view] = json.loads((folder / "out" / "report.json").read_text())["views"]
    assert view["refined"] == {"shift": 7.5, "deviation": 2.0, "lost": False}


def test_what_no_camera_saw_is_printed_apart_from_the_list_of_files(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def half_blind(shot, progress=None, pictures=(), **_):
        result = made_result(shot)
        result.visible[0][:, 1:3, shot.performers[0].body.index("hand.L")] = 0.1
        return result

    track(folder)
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(track_command, "track", half_blind)
    assert track(folder) == 0
    captured = capsys.readouterr()
    assert captured.err == "kfmocap: man: frames on which no camera sees a part: hand.L 2\n"
    assert len(captured.out.split()) == 3
    monkeypatch.setattr(
        "kfmocap.core.review.track_report.suggest_keys_beside_hidden",
        lambda *_: [KeySuggestion(4, (human().index("hand.L"),), (1, 2))],
    )
    assert track(folder) == 0
    assert "kfmocap: man: key poses would help at 4 (hand.L hidden 1-2)\n" in capsys.readouterr().err


def test_a_new_output_folder_is_made_and_results_are_replaced(folder: Path) -> None:
    assert track(folder, out="new/deep") == 0
    (folder / "new" / "deep" / "tiny.trc").write_text("old")
    assert track(folder, out="new/deep") == 0
    assert read_trc(folder / "new" / "deep" / "tiny.trc").fps == 30


def test_several_performers_get_a_file_each(folder: Path) -> None:
    second = SHOT[SHOT.index("[[performer]]") :].replace('"man"', '"woman"')
    (folder / "shot.toml").write_text(SHOT + second)
    assert track(folder) == 0
    assert (folder / "out" / "tiny_man.trc").is_file()
    assert (folder / "out" / "tiny_woman.trc").is_file()


BAD_INPUT = [
    ("missing footage", '"footage_%02d.png"', '"none.mp4"', ["shot.toml", "'cam01' footage", "none.mp4"]),
    (
        "unreadable footage",
        '"footage_%02d.png"',
        '"broken.mp4"',
        ["'cam01' footage", "broken.mp4", "cannot be read"],
    ),
    ("footage of another size", '"footage_%02d.png"', '"small.png"', ["small.png", "20x10", "96x72"]),
    ("too few frames", "frames = [0, 5]", "frames = [0, 50]", ["footage_%02d.png", "only 6 frames", "cam01"]),
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
    ("too few landmarks", '"landmarks.trc"', '"legs.trc"', ["legs.trc", "only 3 of the main joints", "key frame 0"]),
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
        (["--keyframes", "0,9"], ["--keyframes", "key frame 9", "0 to 5"]),
        (["--keyframes", "0,x"], ["--keyframes", "'0,x'"]),
        (["--keyframes", "auto"], ["[[performer]] 1", "nothing to take the key poses from"]),
        (["--solver", "magic"], ["solver", "'magic'", "gauss-newton"]),
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
    monkeypatch.setattr(track_command, "track", lambda *_: pytest.fail("tracking began"))
    assert_refused(folder, capsys, track(folder, out=out), out)


@pytest.mark.parametrize("result", ["tiny.trc", "tiny.bvh", "report.json"])
def test_results_take_the_place_of_nothing_that_they_are_made_of(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, result: str
) -> None:
    """The results' folder may be that of the input, and a shot may be called as its landmarks are."""
    monkeypatch.setattr(track_command, "track", lambda *_: pytest.fail("tracking began"))
    (folder / "landmarks.trc").rename(folder / result)
    (folder / "shot.toml").write_text(SHOT.replace("landmarks.trc", result))
    before = (folder / result).read_bytes()
    assert_refused(folder, capsys, track(folder, out="."), result, "would be replaced by the results")
    assert (folder / result).read_bytes() == before


def test_cameras_take_the_place_of_nothing_that_they_are_made_of(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shot = str(folder / "shot.toml")
    assert_refused(folder, capsys, main(["calibrate", "--refine", shot, "--out", shot]), "would be replaced")
    wand = str(made_capture(folder))
    assert_refused(folder, capsys, main(["calibrate", wand, "--out", wand]), "wand.toml", "would be replaced")


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
    monkeypatch.setattr(track_command, "track", lambda *_, **__: pytest.fail("tracking began"))
    (folder / "out" / taken).mkdir()
    assert track(folder) == 1
    assert f"{taken}: a folder is in the way" in capsys.readouterr().err


@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_signals_end_a_run_and_leave_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str, code: int
) -> None:
    number = getattr(signal, name)
    before = signal.getsignal(number)
    monkeypatch.setattr(track_command, "track", lambda *_, **__: signal.raise_signal(number))
    assert track(folder) == code
    assert signal.getsignal(number) is before
    assert capsys.readouterr().err == "kfmocap: interrupted, nothing was written\n"
    assert [file.name for file in (folder / "out").iterdir()] == ["notes.txt"]
    assert not list(folder.glob(".kfmocap-*"))


def test_an_interrupt_that_a_library_turns_into_an_error_of_its_own_remains_one(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """NumPy says that arrays cannot be compared where a signal comes while it compares records."""

    def compared(*_: object, **__: object) -> None:
        try:
            signal.raise_signal(signal.SIGTERM)
        except KeyboardInterrupt as interrupt:
            raise TypeError("Cannot compare structured arrays") from interrupt

    monkeypatch.setattr(track_command, "track", compared)
    assert track(folder) == 143
    assert capsys.readouterr().err == "kfmocap: interrupted, nothing was written\n"
    monkeypatch.setattr(track_command, "track", broken(TypeError("a fault of ours")))
    with pytest.raises(TypeError, match="a fault of ours"):
        track(folder)


def test_an_interrupt_after_the_results_says_so(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(track_command, "report_lines", lambda *_: signal.raise_signal(signal.SIGINT))
    assert track(folder) == 130
    assert "kfmocap: interrupted when the results had been written" in capsys.readouterr().err
    assert (folder / "out" / "tiny.trc").is_file()


def test_an_interrupt_while_the_report_is_still_temporary_says_that_nothing_was_written(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    put = files.put_file
    monkeypatch.setattr(files, "put_file", lambda *args: (signal.raise_signal(signal.SIGTERM), put(*args))[1])
    assert track(folder) == 143
    assert "interrupted, nothing was written" in capsys.readouterr().err
    assert not (folder / "out" / "report.json").exists()


def test_an_interrupt_just_after_the_results_were_put_in_place_says_that_they_were(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    discard, came = journal.Journal.discard, []

    def interrupted(self: journal.Journal) -> None:
        discard(self)
        if (folder / "out" / "report.json").exists() and not came:
            came.append(signal.raise_signal(signal.SIGTERM))

    monkeypatch.setattr(journal.Journal, "discard", interrupted)
    assert track(folder) == 143
    assert "interrupted when the results had been written" in capsys.readouterr().err


def broken(error: BaseException):
    def fail(shot, progress=None, pictures=(), **_):
        raise error

    return fail


def test_an_error_while_tracking_leaves_nothing(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(track_command, "track", broken(FootageError("it breaks off at frame 3", where="a.mp4")))
    assert_refused(folder, capsys, track(folder), "a.mp4: it breaks off at frame 3")
    monkeypatch.setattr(track_command, "track", broken(CancelledError()))
    assert_refused(folder, capsys, track(folder), "cancelled")


def test_an_interrupt_exits_with_130_and_leaves_nothing(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(track_command, "track", broken(KeyboardInterrupt()))
    assert track(folder) == 130
    assert [file.name for file in (folder / "out").iterdir()] == ["notes.txt"]


def test_without_bpy_the_error_says_how_to_get_it(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "bpy", None)
    code = main(["track", str(folder / "shot.toml"), "--out", str(folder / "out")])
    assert_refused(folder, capsys, code, "pip install 'kfmocap[blender]'", "--no-blender")


class UnloadableBlender:
    """Blender's module, started in a process, whose libraries are missing."""

    closed = False

    def check(self) -> None:
        with blender_needed():
            raise ImportError("libX11.so.6: cannot open shared object file")

    def write_outputs(self, *_: object) -> list[Path]:
        raise AssertionError("nothing can be written")

    def close(self) -> None:
        self.closed = True


def test_a_blender_that_does_not_load_is_said_before_the_tracking(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    blender = UnloadableBlender()
    monkeypatch.setattr(track_command, "track", broken(AssertionError("it was tracked")))
    arguments = ["track", str(folder / "shot.toml"), "--out", str(folder / "out")]
    code = command_line.main(arguments, Services(start_blender=lambda: blender))
    assert_refused(folder, capsys, code, "libX11.so.6", "--no-blender")
    assert blender.closed


def test_blender_is_started_before_the_libraries_are_loaded_and_once(folder: Path) -> None:
    """Both take the better part of a second, on a core each."""
    code = """
import sys
from contextlib import closing
from kfmocap.cli import command_line
from kfmocap.cli.services import Services

class Blender:
    def __init__(self): started.append("numpy" in sys.modules)
    def check(self): raise SystemExit(0 if started == [False] else f"{started}")
    def close(self): closed.append(True)

started, closed = [], []
try:
    command_line.main(["track", sys.argv[1], "--out", sys.argv[2]], Services(start_blender=Blender))
finally:
    assert closed
"""
    arguments = [str(folder / "shot.toml"), str(folder / "out")]
    subprocess.run([sys.executable, "-c", code, *arguments], check=True)


def test_a_worker_is_started_before_the_libraries_are_loaded_unless_one_thread_is_asked_for(folder: Path) -> None:
    code = """
import sys
from contextlib import closing
from kfmocap.cli import command_line
from kfmocap.core.runtime.worker_memory import WorkerMemory

started, closed = [], []
WorkerMemory.start_workers = lambda memory, workers, imports: started.append((workers, imports, "numpy" in sys.modules))
WorkerMemory.close = lambda memory: closed.append(True)
command_line.os.cpu_count = lambda: 2
assert command_line.main(["track", "none.toml", "--out", sys.argv[1], "--threads", sys.argv[2]]) == 1
if sys.argv[2] == "1":
    assert not started
else:
    [(workers, imports, late)] = started
    assert (workers, late) == (2, False) and closed
    for module in imports:
        __import__(module)
"""
    for threads in ("1", "2"):
        subprocess.run([sys.executable, "-c", code, str(folder / "out"), threads], check=True)


@pytest.mark.skipif(find_spec("bpy") is None, reason="needs Blender's module")
def test_files_with_which_blender_crashes_are_named(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    monkeypatch.setattr("kfmocap.__main__._loaded_blender", job_functions.silently)
    monkeypatch.setattr("kfmocap.__main__._retargeted", job_functions.crashing)
    motion, character = folder / "take.bvh", folder / "hero.blend"
    motion.touch()
    character.touch()
    code = main(["retarget", str(motion), "--to", str(character), "--out", str(folder / "moved.blend")])
    assert_refused(folder, capsys, code, "take.bvh", "hero.blend: Blender ended while it worked on them")


@pytest.mark.skipif(find_spec("bpy") is None, reason="needs Blender's module")
def test_blender_is_ended_as_soon_as_its_files_are_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """It takes a tenth of a second to end, during which the other results are put in place."""
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    monkeypatch.setattr("kfmocap.__main__._loaded_blender", job_functions.silently)
    monkeypatch.setattr("kfmocap.__main__._written_outputs", job_functions.writing_nothing)
    with closing(_BlenderProcess()) as blender:
        assert blender.write_outputs(None, job_functions.Tracked(), None) == []  # type: ignore[arg-type]
        blender._process._process.wait(10)


def test_a_blender_that_is_missing_is_said_after_what_is_wrong_with_the_shot(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def missing() -> UnloadableBlender:
        raise ImportError("No module named 'bpy'")

    arguments = ["track", str(folder / "none.toml"), "--out", str(folder / "out")]
    assert command_line.main(arguments, Services(start_blender=missing)) == 1
    assert "none.toml" in capsys.readouterr().err


def test_without_a_shot_file_outside_blender_one_is_asked_for(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "bpy", raising=False)
    code = main(["track", "--out", str(folder / "out"), "--no-blender"])
    assert_refused(folder, capsys, code, "no shot file is named")


def test_the_progress_bar_is_drawn_on_terminals_alone(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    with progress_bar.progress_bar() as progress:
        assert progress is None
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True, raising=False)
    with progress_bar.progress_bar() as progress:
        assert progress is not None
        assert progress("solve", 0.5)
    drawn = capsys.readouterr().err
    assert "solve" in drawn
    assert "50%" in drawn


def test_the_program_starts_without_blender_and_the_libraries() -> None:
    """`kfmocap --help` answers at once, and the libraries are loaded after they have been told to be quiet."""
    code = "import sys, kfmocap.__main__\nassert not {'bpy', 'numpy', 'cv2'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


ENDING = (
    "import atexit, kfmocap.__main__ as m\n"
    "atexit.register(print, 'taken apart')\n"
    "m.main = lambda: print('written') or 3\n"
    "m.program()"
)
"""A program whose command prints a word and has the exit code 3."""


def test_the_program_ends_at_once_with_its_exit_code() -> None:
    """To take the libraries apart takes a tenth of a second, when all is written."""
    run = subprocess.run([sys.executable, "-c", ENDING], capture_output=True, text=True)
    assert (run.returncode, run.stdout) == (3, "written\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_a_program_whose_output_is_lost_ends_as_python_does_then() -> None:
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with open("/dev/full", "w") as full:
        run = subprocess.run([sys.executable, "-c", ENDING], env=buffered, stdout=full, stderr=subprocess.PIPE)
    assert run.returncode == 120


@pytest.fixture
def examples(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The demo's examples, played by the tiny shot, with an empty cache."""
    root = folder / "examples"
    for name in ("beam", "walk"):
        (root / name).mkdir(parents=True)
        for file in ("shot.toml", "calibration.toml", "landmarks.trc"):
            (root / name / file).write_bytes((folder / file).read_bytes())
    for image in folder.glob("footage_*.png"):
        (root / "walk" / image.name).write_bytes(image.read_bytes())
    (root / "beam" / "SHA256SUMS").write_text("00  footage_00.png\n")
    monkeypatch.setattr(example_footage, "_EXAMPLES", root)
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
    return root


def test_the_demo_falls_back_to_the_rendered_example(
    folder: Path, examples: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def offline(command, **_):
        return subprocess.CompletedProcess(command, 1, "", "ERROR: no network\n")

    monkeypatch.setattr(example_footage.subprocess, "run", offline)
    assert main(["demo", "--no-blender", "--out", str(folder / "out")]) == 0
    captured = capsys.readouterr()
    assert "no network" in captured.err
    assert "rendered example instead" in captured.err
    assert "mm (mean) from the reference" in captured.out
    assert (folder / "out" / "tiny.trc").is_file()


def test_the_demo_fetches_its_footage_once_and_checks_it(
    folder: Path, examples: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    import hashlib
    import zipfile

    calls = []

    def pip(command, **_):
        calls.append(command)
        with zipfile.ZipFile(Path(command[command.index("--dest") + 1]) / "package.whl", "w") as wheel:
            for image in folder.glob("footage_*.png"):
                wheel.write(image, f"Pose2Sim/Demo_SinglePerson/videos/{image.name}")
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(example_footage.subprocess, "run", pip)
    images = sorted(folder.glob("footage_*.png"))
    sums = [f"{hashlib.sha256(i.read_bytes()).hexdigest()}  {i.name}\n" for i in images]
    (examples / "beam" / "SHA256SUMS").write_text("".join(sums))
    for _ in range(2):
        assert main(["demo", "--no-blender", "--out", str(folder / "out")]) == 0
    assert len(calls) == 1
    assert "pose2sim==0.10.49" in calls[0]
    assert "instead" not in capsys.readouterr().err

    (examples / "beam" / "SHA256SUMS").write_text("".join(sums).replace(sums[0][:64], "0" * 64))
    assert main(["demo", "--no-blender", "--out", str(folder / "out")]) == 0
    assert "another file than expected" in capsys.readouterr().err
