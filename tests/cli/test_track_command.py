"""What `kfmocap track` writes and prints: all that was asked for, and the exit code is 0."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.cli import track_command, tracked_files
from kfmocap.core.body import human
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.fitting.camera_fits.camera_refinement import RefinedCamera, Refinement
from kfmocap.core.fitting.camera_fits.resection import adjusted
from kfmocap.core.fitting.checks.view_findings import CameraFit, FootageMatch
from kfmocap.core.formats import load_cameras, read_trc
from kfmocap.core.review.suggestions import KeySuggestion
from kfmocap.core.shot.footage_faults.footage_damage import FootageDamage
from kfmocap.core.tracking.results.track_result import TrackResult
from tiny_shot import FRAMES, SHOT, made_result, track

pytest_plugins = ("tiny_shot_fixtures",)

STEP = np.array([0.02, 0, 0, 0.01, 0, 0, 0])


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

    monkeypatch.setattr(tracked_files, "track", tracked)
    assert track(folder) == 0
    said = capsys.readouterr().err
    assert "cam01: the footage is damaged at or near frames 4 of the file" in said
    assert "its pictures between frames 4 and 11 may be wrong: they were given no weight" in said


def test_cameras_that_do_not_fit_are_printed_and_reported(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    fits = (CameraFit(3.0, 1.0, 5.0, "cam01", "keypoints"), CameraFit(12.4, 2.0, 5.0, "cam01", "key poses"))
    monkeypatch.setattr(tracked_files, "camera_fits", lambda *_: fits)
    assert track(folder) == 0
    assert capsys.readouterr().err.splitlines()[:2] == [
        "kfmocap: cam01: its picture is 12 px off the key poses; up to 5 px could be chance",
        "kfmocap: if their offsets are right, refine the cameras: kfmocap track --refine, or Refine Cameras in Blender",
    ]
    [view] = json.loads((folder / "out" / "report.json").read_text())["views"]
    assert [fit["off"] for fit in view["fits"]] == [False, True] and view["fits"][1]["shift"] == 12.4
    assert view["refined"] is None


def test_footage_that_is_not_the_key_poses_is_printed_without_advice_to_refine(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracked_files, "camera_fits", lambda *_: (FootageMatch("cam01", 0.571),))
    assert track(folder) == 0
    said = capsys.readouterr().err
    assert "kfmocap: cam01: its pictures do not change where the key poses move (agreement 0.57, of at most 1" in said
    assert "refine the cameras" not in said
    [view] = json.loads((folder / "out" / "report.json").read_text())["views"]
    assert [(fit["by"], fit["off"], fit["match"]) for fit in view["fits"]] == [("movement", True, 0.57)]


def test_footage_that_does_not_match_is_printed_before_the_results(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def tracked(shot, *_, run, **__) -> TrackResult:
        run.first_pictures.seen([{}])
        return made_result(shot)

    monkeypatch.setattr(tracked_files, "track", tracked)
    monkeypatch.setattr(tracked_files, "early_misfits", lambda *_: [FootageMatch("cam01", 0.6, offset=4.0)])
    assert track(folder) == 0
    said = capsys.readouterr().err.splitlines()[0]
    assert "offset of about 4: write it" in said and said.endswith(
        "--offset cam01=4 (tracking goes on; Ctrl-C ends it)"
    )


def test_an_offset_that_fits_better_is_printed_with_the_option_that_takes_it(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tracked_files, "camera_fits", lambda *_: (FootageMatch("cam01", 0.9, offset=-6.0),))
    offsets = []
    monkeypatch.setattr(
        tracked_files, "track", lambda shot, *_, **__: offsets.append(shot.views[0].offset) or made_result(shot)
    )
    assert track(folder) == 0
    said = capsys.readouterr().err
    assert "with an offset of about -6: write it into the [[view]], or track with --offset cam01=-6\n" in said
    assert track(folder, "--offset", "cam01=0.25") == 0
    assert offsets == [0.0, 0.25]


def test_refining_first_tracks_with_the_refined_cameras_and_writes_them(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refined(shot, _progress):
        camera = adjusted(shot.views[0].camera, STEP)
        return Refinement((RefinedCamera(camera, 7.5, 2.0, clearness=1.0),), np.array([0]))

    def tracked(shot, progress=None, pictures=(), **_):
        seen.append(shot.views[0].camera)
        return made_result(shot)

    seen: list[Camera] = []
    monkeypatch.setattr(track_command, "refine_shot_cameras", refined)
    monkeypatch.setattr(tracked_files, "track", tracked)
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
    monkeypatch.setattr(tracked_files, "track", half_blind)
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
