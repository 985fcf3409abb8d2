"""Keypoint files: whatever detector wrote them, the same picture gives the same landmarks; what is broken is named."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ROOT
from kfmocap.core.errors import KeypointError
from kfmocap.core.formats import load_cameras, read_trc
from kfmocap.core.formats.keypoint_files import read_keypoints
from kfmocap.core.formats.keypoint_layouts import (
    BODY_25,
    COCO_17,
    HALPE_26,
    LAYOUTS,
    MEDIAPIPE_33,
    landmark_of,
    mirrored_name,
)

SIZE = (640, 480)
JOINTS = ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
SIDED = [side + joint for joint in JOINTS for side in "LR"]


def place(name: str, frame: int = 0, person: int = 0) -> tuple[float, float, float]:
    """Where a detector saw a landmark, to two decimals, and how surely."""
    rng = np.random.default_rng([sum(map(ord, name)), frame, person])
    u, v = rng.uniform(10, [SIZE[0] - 10, SIZE[1] - 10])
    return round(u, 2), round(v, 2), round(rng.uniform(0.3, 1.0), 3)


def flat(layout: list[str], frame: int = 0, person: int = 0) -> list[float]:
    """x, y, confidence of a layout's keypoints; those not used are somewhere as well."""
    return [v for i, n in enumerate(layout) for v in place(n if n != "-" else f"other{i}", frame, person)]


def openpose(frame: int, people: int = 1, layout: list[str] = BODY_25) -> dict[str, Any]:
    bodies = [
        {
            "person_id": [-1],
            "pose_keypoints_2d": flat(layout, frame, person),
            "face_keypoints_2d": [],
            "hand_left_keypoints_2d": [],
            "hand_right_keypoints_2d": [],
            "pose_keypoints_3d": [],
        }
        for person in range(people)
    ]
    return {"version": 1.3, "people": bodies}


def coco(layout: list[str], frames: int, name: str | None = None) -> list[dict[str, Any]]:
    """COCO's results, or AlphaPose's, whose image_id is a name."""
    return [
        {
            "image_id": f if name is None else name % f,
            "category_id": 1,
            "keypoints": flat(layout, f),
            "score": 2.9,
            **({"box": [10.0, 20.0, 300.0, 400.0], "idx": 1} if name else {}),
        }
        for f in range(frames)
    ]


def instances(layout: list[str], frame: int) -> list[dict[str, Any]]:
    points = [place(n if n != "-" else f"other{i}", frame) for i, n in enumerate(layout)]
    return [
        {
            "keypoints": [[u, v] for u, v, _ in points],
            "keypoint_scores": [c for *_, c in points],
            "bbox": [[10.0, 20.0, 300.0, 400.0]],
            "bbox_score": 0.93,
        }
    ]


COCO_NAMES = ["nose"] + [
    f"{side}_{joint}"
    for joint in ("eye", "ear", "shoulder", "elbow", "wrist", "hip", "knee", "ankle")
    for side in ("left", "right")
]


def mediapipe(frame: int) -> list[dict[str, float]]:
    """Normalised landmarks: shares of the picture from edge to edge."""
    points = [place(n if n != "-" else f"other{i}", frame) for i, n in enumerate(MEDIAPIPE_33)]
    return [{"x": (u + 0.5) / SIZE[0], "y": (v + 0.5) / SIZE[1], "z": -0.1, "visibility": c} for u, v, c in points]


def ultralytics(frame: int) -> list[dict[str, Any]]:
    u, v, c = zip(*(place(n, frame) for n in COCO_17), strict=True)
    box = {"x1": 1.0, "y1": 2.0, "x2": 3.0, "y2": 4.0}
    keypoints = {"x": u, "y": v, "visible": c}
    return [{"name": "person", "class": 0, "confidence": 0.9, "box": box, "keypoints": keypoints}]


SINGLE_FILES: dict[str, Any] = {
    "COCO results": coco(COCO_17, 3),
    "COCO results, HALPE_26": coco(HALPE_26, 3),
    "COCO predictions by table": {"predictions": coco(COCO_17, 3)},
    "AlphaPose": coco(COCO_17, 3, "%d.jpg"),
    "AlphaPose, HALPE_26, padded names": coco(HALPE_26, 3, "cam01_%06d.png"),
    "AlphaPose, Cmu": {
        f"{f}.jpg": {"version": "AlphaPose v0.3", "bodies": [{"joints": flat(BODY_25, f)}]} for f in range(3)
    },
    "AlphaPose, Open": {f"{f}.jpg": openpose(f) for f in range(3)},
    "MMPose inferencer": [{"frame_id": f, "instances": instances(COCO_17, f)} for f in range(3)],
    "MMPose demo": {
        "meta_info": {"dataset_name": "coco", "keypoint_id2name": dict(enumerate(COCO_NAMES))},
        "instance_info": [{"frame_id": f + 1, "instances": instances(COCO_17, f)} for f in range(3)],
    },
    "RTMPose, HALPE_26": [{"frame_id": f, "instances": instances(HALPE_26, f)} for f in range(3)],
    "MediaPipe lists": [mediapipe(f) for f in range(3)],
    "MediaPipe results": [{"pose_landmarks": [mediapipe(f)], "pose_world_landmarks": []} for f in range(3)],
    "MediaPipe messages": [{"landmark": mediapipe(f)} for f in range(3)],
    "MediaPipe by table": {"fps": 30, "frames": [{"frame": f, "landmarks": mediapipe(f)} for f in range(3)]},
}
PER_PICTURE: dict[str, Any] = {
    "OpenPose, BODY_25": openpose,
    "OpenPose, COCO_18": lambda f: openpose(f, layout=LAYOUTS[18]),
    "OpenPose, HALPE_26 of RTMLib": lambda f: openpose(f, layout=HALPE_26),
    "MMPose inferencer of pictures": lambda f: instances(COCO_17, f),
    "MediaPipe": lambda f: {"pose_landmarks": mediapipe(f)},
    "YOLO": ultralytics,
}


def assert_shows_the_picture(path: Path) -> None:
    found = read_keypoints(path, SIZE)
    assert found.frames.tolist() == [0, 1, 2]
    for f in range(3):
        for name in SIDED:
            u, v, c = place(name, f)
            column = found.names.index(name)
            np.testing.assert_allclose(found.points[f, column], [u, v], atol=1e-9)
            assert found.confidence[f, column] == pytest.approx(c)


@pytest.mark.parametrize("name", SINGLE_FILES)
def test_a_file_of_any_detector_gives_the_same_landmarks(tmp_path: Path, name: str) -> None:
    path = tmp_path / "keypoints.json"
    path.write_text(json.dumps(SINGLE_FILES[name]))
    assert_shows_the_picture(path)


@pytest.mark.parametrize("name", PER_PICTURE)
def test_a_folder_of_any_detector_gives_the_same_landmarks(tmp_path: Path, name: str) -> None:
    for f in range(3):
        (tmp_path / f"cam01_{f:012d}_keypoints.json").write_text(json.dumps(PER_PICTURE[name](f)))
    assert_shows_the_picture(tmp_path)


def test_ground_truth_of_coco_is_numbered_by_its_pictures_and_hidden_points_count_half(tmp_path: Path) -> None:
    keypoints = flat(COCO_17)
    keypoints[2::3] = [2] * 15 + [1, 0]
    document = {
        "images": [{"id": 4711, "file_name": "frame_0007.jpg"}],
        "annotations": [{"image_id": 4711, "id": 1, "category_id": 1, "num_keypoints": 16, "keypoints": keypoints}],
    }
    (tmp_path / "person_keypoints.json").write_text(json.dumps(document))
    found = read_keypoints(tmp_path / "person_keypoints.json")
    assert found.frames.tolist() == [7]
    confidence = dict(zip(found.names, found.confidence[0], strict=True))
    assert (confidence["LKnee"], confidence["LAnkle"], confidence["RAnkle"]) == (1.0, 0.5, 0.0)


def test_a_picture_may_show_several_people_or_nobody(tmp_path: Path) -> None:
    for f, people in enumerate((2, 0, 3)):
        (tmp_path / f"{f}.json").write_text(json.dumps(openpose(f, people)))
    found = read_keypoints(tmp_path)
    assert found.frames.tolist() == [0, 0, 2, 2, 2]
    assert (found.tracks == -1).all()


def test_numbers_of_people_are_kept(tmp_path: Path) -> None:
    document = openpose(0, 2)
    for i, person in enumerate(document["people"]):
        person["person_id"] = [i]
    (tmp_path / "0.json").write_text(json.dumps(document))
    assert read_keypoints(tmp_path).tracks.tolist() == [0, 1]


def test_what_was_not_found_is_missing(tmp_path: Path) -> None:
    document = openpose(0)
    values = document["people"][0]["pose_keypoints_2d"]
    wrist, knee = BODY_25.index("RWrist"), BODY_25.index("LKnee")
    values[3 * wrist : 3 * wrist + 3] = [0.0, 0.0, 0.0]
    values[3 * knee + 2] = 0.0
    (tmp_path / "0.json").write_text(json.dumps(document))
    found = read_keypoints(tmp_path)
    for name in ("RWrist", "LKnee"):
        assert np.isnan(found.points[0, found.names.index(name)]).all()
        assert found.confidence[0, found.names.index(name)] == 0
    assert np.isfinite(found.points[0, found.names.index("LWrist")]).all()


def test_confidence_is_at_most_one(tmp_path: Path) -> None:
    document = openpose(0)
    document["people"][0]["pose_keypoints_2d"][2] = 3.7  # as logits of some networks
    (tmp_path / "0.json").write_text(json.dumps(document))
    assert read_keypoints(tmp_path).confidence.max() == 1.0


BROKEN = [
    ("{", "is not a JSON file"),
    ('{"people": [{"pose_keypoints_2d": [1, 2]}]}', "a person has 2 numbers"),
    ('{"people": [{"pose_keypoints_2d": [1, 2, 3]}]}', "a person has 3 numbers"),
    ('{"people": [{}]}', "not whole"),
    ('{"people": 3}', "not whole"),
    ('{"cars": []}', "holds no keypoints"),
    (json.dumps(openpose(0)).replace("[-1], ", '["a"], '), "not whole"),
    (json.dumps({"people": [{"pose_keypoints_2d": ["x"] * 75}]}), "not a number"),
]


@pytest.mark.parametrize(("text", "message"), BROKEN)
def test_a_broken_file_is_named_and_refused_or_skipped(tmp_path: Path, text: str, message: str) -> None:
    for f in (0, 2):
        (tmp_path / f"cam_{f}.json").write_text(json.dumps(openpose(f)))
    (tmp_path / "cam_1.json").write_text(text)
    with pytest.raises(KeypointError, match=rf"cam_1\.json: .*{message}"):
        read_keypoints(tmp_path)
    found = read_keypoints(tmp_path, skip_broken=True)
    assert found.frames.tolist() == [0, 2]
    (skipped,) = found.skipped
    assert "cam_1.json" in skipped and message in skipped


def test_nothing_to_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(KeypointError, match=r"there is no \.json file"):
        read_keypoints(tmp_path)
    with pytest.raises(KeypointError, match="none: keypoints cannot be read"):
        read_keypoints(tmp_path / "none")
    (tmp_path / "first.json").write_text(json.dumps(openpose(0)))
    with pytest.raises(KeypointError, match=r"first\.json: its name has no number"):
        read_keypoints(tmp_path)
    (tmp_path / "first.json").write_text("?")
    with pytest.raises(KeypointError, match="none of the 1 files can be read"):
        read_keypoints(tmp_path, skip_broken=True)


def test_shares_of_a_picture_need_its_size(tmp_path: Path) -> None:
    (tmp_path / "pose.json").write_text(json.dumps([mediapipe(0)]))
    with pytest.raises(KeypointError, match="unknown size"):
        read_keypoints(tmp_path / "pose.json")


def test_names_are_mapped_to_ours() -> None:
    assert [landmark_of(n) for n in COCO_NAMES] == COCO_17
    assert landmark_of("left_big_toe") == "LBigToe" and landmark_of("small toe") == ""
    assert [mirrored_name(n) for n in ("LKnee", "RHeel", "Neck", "Nose", "Hip")] == [
        "RKnee",
        "LHeel",
        "Neck",
        "Nose",
        "Hip",
    ]


@pytest.mark.parametrize("count", LAYOUTS)
def test_a_layout_names_no_keypoint_twice_and_has_both_sides(count: int) -> None:
    names = [name for name in LAYOUTS[count] if name]
    assert len(set(names)) == len(names) and len(LAYOUTS[count]) == count
    assert {mirrored_name(name) for name in names} == set(names)
    assert set(SIDED) <= set(names)


def test_a_detectors_keypoints_of_real_footage_are_near_the_reference() -> None:
    """Each on its own landmark: were the order another, or left for right, they would be far off."""
    folder = ROOT / "examples" / "beam"
    truth, cameras = read_trc(folder / "landmarks.trc"), load_cameras(folder / "calibration.toml")
    for name in ("cam01", "cam03"):
        found = read_keypoints(folder / f"{name}_keypoints.json")
        assert found.frames.tolist() == list(range(100))
        for landmark in SIDED:
            at = np.stack([cameras[name].project(points[truth.names.index(landmark)]) for points in truth.points_world])
            miss = np.linalg.norm(found.points[:, found.names.index(landmark)] - at, axis=1)
            assert np.nanmedian(miss) < 40, landmark  # pixels of 1080 x 1920


def test_two_thousand_frames_are_read_in_a_second(tmp_path: Path) -> None:
    """That is 10,000 in five, of this process's own time."""
    text = json.dumps(openpose(0))
    for f in range(2000):
        (tmp_path / f"video_{f:012d}_keypoints.json").write_text(text)
    begin = time.process_time()
    assert len(read_keypoints(tmp_path)) == 2000
    assert time.process_time() - begin < 1.0


def test_tables_and_landmarks_say_what_to_do_with_them(tmp_path: Path) -> None:
    for name, todo in (
        ("dlc.csv", "COCO's JSON"),
        ("dlc.h5", "COCO's JSON"),
        ("a.trc", r"landmarks of a \[\[performer"),
    ):
        (tmp_path / name).write_bytes(b"x")
        with pytest.raises(KeypointError, match=todo):
            read_keypoints(tmp_path / name)
