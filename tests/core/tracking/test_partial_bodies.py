"""People who are not wholly in the picture: from a shot file to the files that are written."""

from __future__ import annotations

import json
import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, joint_errors, seen_places, strolling, write_openpose
from kfmocap.cli.command_line import main
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.formats import save_cameras, write_trc
from kfmocap.core.formats.trc import read_trc
from kfmocap.core.review.report_text import report_lines
from kfmocap.core.review.track_report import report
from kfmocap.core.shot.fixed_degrees import fixed_degrees
from kfmocap.core.shot.shot import Shot
from kfmocap.core.tracking.prepare import load_shot
from kfmocap.core.tracking.tracker import track

FRAMES, FPS = 18, 30.0
LEGS = tuple(side + joint for side in "LR" for joint in ("Knee", "Ankle", "BigToe", "Heel"))
HIPS = ("Hip", "LHip", "RHip")
LEG_PARTS = [f"{part}.{side}" for side in "LR" for part in ("thigh", "shin", "foot")]
BODY = human(1.8)
TRUTH = strolling(BODY, FRAMES)
VIEW = '[[view]]\ncamera = "{0}"\nfootage = "{0}_%04d.png"\nkeypoints = "pose/{0}"\n\n'
SHOT = f"""calibration.file = "calibration.toml"
shot = {{name = "waist", fps = 30.0, frames = [0, 17]}}

{VIEW.format("cam01")}{VIEW.format("cam02")}[[performer]]
name = "man"
"""
WAIST_UP = 120
"""Height of a picture that ends below the belt, pixels."""


def written(
    folder: Path, performer: str, hidden: Collection[str], seen_on: Collection[int] = (), height: int = WAIST_UP
) -> Path:
    """A shot of which keypoints are found but for the hidden ones, which are found on some frames alone."""
    half = np.diag([0.5, 0.5, 1.0])
    used = [replace(camera, size=(320, height), matrix=half @ camera.matrix) for camera in cameras(2)]
    save_cameras(folder / "calibration.toml", used)
    for camera in used:
        points = seen_places(BODY, TRUTH)
        gone = np.ix_(np.setdiff1d(np.arange(FRAMES), list(seen_on)), [NAMES.index(name) for name in hidden])
        points[gone] = np.nan
        write_openpose(folder / "pose" / camera.name, camera, [points], 0.4)
        for f in range(FRAMES):
            cv2.imwrite(str(folder / f"{camera.name}_{f:04d}.png"), np.full((height, 320), 90, np.uint8))
    (folder / "shot.toml").write_text(SHOT + performer)
    return folder / "shot.toml"


def upper_error(shot: Shot, motion: object, joints: tuple[str, ...] = ("Shoulder", "Elbow", "Wrist")) -> float:
    names = [side + joint for side in "LR" for joint in joints]
    found = landmark_positions(shot.performers[0].body, motion, names)
    return float(np.linalg.norm(found - landmark_positions(BODY, TRUTH, names), axis=-1).max())


@pytest.mark.parametrize("hidden", [LEGS, LEGS + HIPS])
def test_parts_that_no_keypoint_shows_rest_and_are_reported(tmp_path: Path, hidden: tuple[str, ...]) -> None:
    shot = load_shot(written(tmp_path, 'keyframes = "auto"', hidden))
    (performer,) = shot.performers
    leading = ["pelvis", "spine"] if "LHip" in hidden else []
    assert list(performer.unknown) == [name for name in BODY.names if name in leading + LEG_PARTS]
    result = track(shot)
    assert upper_error(shot, result.motions[0]) < 0.05
    parts = [BODY.index(name) for name in LEG_PARTS]
    np.testing.assert_array_equal(result.motions[0].rotations[:, parts], np.broadcast_to(np.eye(3), (FRAMES, 6, 3, 3)))
    values = report(shot, result)
    unknown = set(values["performers"][0]["unknown"])
    assert set(performer.unknown) <= unknown <= {*performer.unknown, "hand.L", "hand.R"}  # hands may be too low as well
    assert not set(values["performers"][0]["unseen"]) & unknown
    assert any(line.startswith("man: unknown") and "shin.R" in line for line in report_lines(values))
    assert max(values["performers"][0]["expected_error"]) < 65  # mm: without what is unknown, a hand at its limit with
    assert (result.deviation[0][:, BODY.index("shin.L")] > 0.7).all()


def test_legs_that_are_seen_on_some_frames_are_posed_there_and_stay_near(tmp_path: Path) -> None:
    shot = load_shot(written(tmp_path, 'keyframes = "auto"', LEGS, range(4, 10), height=240))
    assert shot.performers[0].unknown == ()
    motion = track(shot).motions[0]
    errors = joint_errors(shot.performers[0].body, motion, BODY, TRUTH)
    assert errors[4:10].max() < 0.05
    assert errors.max() < 0.65  # nobody saw them for a quarter of a second


def write_landmarks(folder: Path, with_legs_on: Collection[int] = ()) -> None:
    """Landmarks of the upper body, and on some frames of the legs."""
    names = list(BODY.landmarks)
    points = landmark_positions(BODY, TRUTH, names)
    without = np.setdiff1d(np.arange(FRAMES), list(with_legs_on))
    points[np.ix_(without, [i for i, name in enumerate(names) if name in LEGS])] = np.nan
    write_trc(folder / "upper.trc", names, points, FPS)


def test_key_poses_need_no_legs(tmp_path: Path) -> None:
    """Landmarks of the upper body pose it; where a key frame shows the legs, they are held."""
    path = written(tmp_path, 'keyframes = [0, 17]\nlandmarks = "upper.trc"', LEGS)
    write_landmarks(tmp_path)
    shot = load_shot(path)
    assert list(shot.performers[0].unknown) == [name for name in BODY.names if name in LEG_PARTS]
    assert shot.performers[0].key_poses.full().tolist() == [0, 17]
    assert upper_error(shot, track(shot).motions[0]) < 0.03
    write_landmarks(tmp_path, [0])
    shot = load_shot(path)
    held = fixed_degrees(shot.performers[0], 0, FRAMES - 1)[:, 3 + 3 * BODY.index("shin.L")]
    assert shot.performers[0].unknown == () and held[0] and not held[1:].any()


def test_the_command_writes_such_a_shot_with_and_without_what_is_unknown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = written(tmp_path, 'keyframes = [0, 17]\nlandmarks = "upper.trc"', LEGS)
    text = re.sub(r"^keypoints = .*\n", "", path.read_text(), flags=re.MULTILINE)  # a first pass takes longer
    path.write_text(text.replace("17]", "3]"))
    write_landmarks(tmp_path)
    for name, option in (("all", []), ("known", ["--leave-out-unknown"])):
        assert main(["track", str(path), "--out", str(tmp_path / name), "--no-blender", *option]) == 0
        assert "man: unknown" in capsys.readouterr().err
    whole, known = (set(read_trc(tmp_path / name / "waist.trc").names) for name in ("all", "known"))
    assert set(LEGS) <= whole - known <= {*LEGS, "LHand", "RHand"}
    assert json.loads((tmp_path / "known" / "report.json").read_text())["performers"][0]["unknown"]


def test_guesses_beyond_the_picture_show_nothing(tmp_path: Path) -> None:
    """Detectors that name every keypoint put the legs below the picture's edge, or are unsure of them."""
    path = written(tmp_path, 'keyframes = "auto"', ())
    for file in (tmp_path / "pose").rglob("*.json"):
        document = json.loads(file.read_text())
        values = document["people"][0]["pose_keypoints_2d"]
        for k in (10, 13):  # the knees: in the picture, but unsure
            values[3 * k : 3 * k + 3] = [160.0, 110.0, 0.1]
        file.write_text(json.dumps(document))
    assert set(LEG_PARTS) <= set(load_shot(path).performers[0].unknown)
