"""Excerpts of files that detectors and their tools wrote (tests/data/keypoints/README.md names the sources)."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from kfmocap.core.errors import KeypointError
from kfmocap.core.formats import load_cameras, read_trc
from kfmocap.core.formats.keypoint_files import read_keypoints
from kfmocap.core.formats.keypoint_layouts import BODY_25, BODY_25B
from kfmocap.core.shot.detections import Detections

SAMPLES = ROOT / "tests" / "data" / "keypoints"
BEAM = ROOT / "examples" / "beam"
PORTRAIT = (1080, 1920)


def sample(name: str) -> Detections:
    return read_keypoints(SAMPLES / f"{name}.json", PORTRAIT)


def seen(found: Detections, person: int, name: str) -> tuple[float, float, float]:
    column = found.names.index(name)
    return (*found.points[person, column], found.confidence[person, column])


def test_alphaposes_26_keypoints_are_read_in_halpes_order() -> None:
    found = sample("alphapose")
    assert found.frames.tolist() == [0, 1] and found.tracks.tolist() == [1, 1]
    assert np.isfinite(found.points).all()
    assert seen(found, 0, "LShoulder") == (477.9331970214844, 117.40147399902344, 0.914650022983551)
    assert seen(found, 0, "Head") == (457.4602966308594, 73.04349517822266, 0.8887571096420288)
    assert seen(found, 1, "Hip") == (497.3816833496094, 223.19192504882812, 0.871438205242157)
    assert seen(found, 1, "RHeel") == (549.4737548828125, 359.9336853027344, 0.9009984135627747)


def test_hidden_joints_of_coco_annotations_have_half_the_confidence() -> None:
    found = sample("coco_annotations")
    assert found.frames.tolist() == [785, 40083]
    assert np.isfinite(found.points[..., 0]).sum(axis=1).tolist() == [17, 14]  # as their `num_keypoints`
    assert seen(found, 0, "LWrist") == (449, 165, 1.0)
    assert seen(found, 1, "RAnkle") == (158, 296, 0.5)
    assert not np.isfinite(found.points[1, found.names.index("RWrist")]).any()


def test_coco_results_give_people_by_picture() -> None:
    found = sample("coco_results")
    assert found.frames.tolist() == [139, 192, 192]
    assert np.isfinite(found.points[..., 0]).sum(axis=1).tolist() == [15, 12, 11]
    assert seen(found, 0, "LShoulder") == (443, 177, 1.0)
    assert seen(found, 1, "RElbow") == (481, 350, 1.0)
    assert seen(found, 2, "RAnkle") == (496, 450, 1.0)


def test_mediapipes_fractions_of_the_picture_become_pixels() -> None:
    found = sample("mediapipe")
    assert found.frames.tolist() == [0]
    u, v = 0.42014033 * 1080 - 0.5, 0.47778308 * 1920 - 0.5
    np.testing.assert_allclose(seen(found, 0, "LKnee"), [u, v, 0.9829754])
    u, v = 0.31138647 * 1080 - 0.5, 0.55742395 * 1920 - 0.5
    np.testing.assert_allclose(seen(found, 0, "RBigToe"), [u, v, 0.95782036])


def test_mmpose_demo_with_names_of_its_own() -> None:
    """Counted from 1; of 53 keypoints those are used whose names are known."""
    found = sample("mmpose_demo")
    assert found.frames.tolist() == [0] and len(found.names) == 17
    assert seen(found, 0, "Nose") == (365.30419450532645, 446.53306202699116, 0.8206726312637329)
    assert seen(found, 0, "RShoulder") == (322.69981483921094, 496.7055096117159, 0.9368283748626709)
    assert seen(found, 0, "RAnkle") == (338.9213267574087, 800.8061960482348, 0.8926659226417542)


def test_mmpose_inferencer_of_a_body_is_read_and_of_another_thing_refused(tmp_path: Path) -> None:
    """The inferencer writes the people of a picture as the demo program does, without names and frame."""
    with pytest.raises(KeypointError, match="a person has 15 numbers"):
        sample("mmpose_inferencer")
    (person,) = json.loads((SAMPLES / "mmpose_demo.json").read_text())["instance_info"][0]["instances"]
    for key in ("keypoints", "keypoint_scores"):
        person[key] = person[key][:17]
    (tmp_path / "cam01_0007.json").write_text(json.dumps([person]))
    found = read_keypoints(tmp_path)
    assert found.frames.tolist() == [7]
    assert seen(found, 0, "RAnkle") == (338.9213267574087, 800.8061960482348, 0.8926659226417542)


def test_a_pose_in_three_dimensions_is_refused(tmp_path: Path) -> None:
    """MMPose's inferencer of 3D poses writes metres under the same names."""
    person = {"keypoints": [[-0.0, 0.0, 0.65599]] * 17, "keypoint_scores": [1.0] * 17}
    (tmp_path / "img_002.json").write_text(json.dumps([person]))
    with pytest.raises(KeypointError, match=r"img_002\.json: .*3D pose"):
        read_keypoints(tmp_path)


def test_openposes_second_order_of_25_keypoints_is_recognised() -> None:
    found = sample("openpose_body25b")
    assert found.frames.tolist() == [0, 0]
    assert seen(found, 0, "LKnee") == (468.482, 999.354, 0.645111)
    assert seen(found, 0, "Neck") == (636.708, 557.695, 0.659631)
    assert seen(found, 1, "RBigToe") == (13.6141, 736.473, 0.287541)
    assert not np.isfinite(found.points[1, found.names.index("RHeel")]).any()


def test_the_two_orders_of_openpose_are_recognised_from_the_people(tmp_path: Path) -> None:
    """The same people in the other order are the same people."""
    document = json.loads((SAMPLES / "openpose_body25b.json").read_text())
    second = sample("openpose_body25b")
    shared = [name for name in second.names if name in BODY_25]
    for person in document["people"]:
        values = np.array(person["pose_keypoints_2d"]).reshape(-1, 3)
        other = [values[BODY_25B.index(name)] if name in shared else np.zeros(3) for name in BODY_25]
        person["pose_keypoints_2d"] = np.concatenate(other).tolist()
    (tmp_path / "cam01.0000.json").write_text(json.dumps(document))
    first = read_keypoints(tmp_path)
    for name in shared:
        assert np.array_equal(
            first.points[:, first.names.index(name)], second.points[:, second.names.index(name)], equal_nan=True
        )


@pytest.mark.parametrize(("name", "frame"), [("mediapipe", 0), ("openpose_body25b", 30)])
def test_detections_of_the_real_clip_are_near_its_reference(name: str, frame: int) -> None:
    """Landmarks of another order, or left for right, would be hundreds of pixels off."""
    found, truth = sample(name), read_trc(BEAM / "landmarks.trc")
    at = load_cameras(BEAM / "calibration.toml")["cam01"].project(truth.points_world[frame])
    for landmark, place in zip(truth.names, at, strict=True):
        assert np.linalg.norm(seen(found, 0, landmark)[:2] - place) < 20, landmark  # pixels
