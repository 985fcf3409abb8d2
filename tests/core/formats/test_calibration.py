"""Calibrations of all programs become the same cameras."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import CalibrationError
from kfmocap.core.formats.calibration_files import load_cameras
from kfmocap.core.formats.toml_cameras import save_cameras
from kfmocap.core.numerics import rotations

K = np.array([[700.5, 0, 319.5], [0, 698.25, 239.5], [0, 0, 1]])
DISTORTIONS = [-0.05, 0.1, 0.001, -0.002, 0.01]
ROTATION, TRANSLATION = np.array([1.2, -0.4, 0.7]), np.array([0.3, 0.9, 3.5])
SIZE = (640, 480)


def one_camera(name: str = "cam01") -> Camera:
    return Camera.create(name, SIZE, K, rotations.exp(ROTATION), TRANSLATION, distortions=DISTORTIONS)


def assert_same(found: Camera, expected: Camera, tolerance: float = 1e-12) -> None:
    assert (found.name, found.size, found.fisheye) == (expected.name, expected.size, expected.fisheye)
    for key in ("matrix", "distortions", "R_cam_world", "t_cam_world"):
        np.testing.assert_allclose(getattr(found, key), getattr(expected, key), rtol=0, atol=tolerance)


@given(
    poses=st.integers(1, 4).flatmap(lambda n: arrays(float, (n, 6), elements=st.floats(-1.7, 1.7))),
    focal=st.floats(10, 5000),
    distortions=st.sampled_from([4, 5, 8, 12, 14]).flatmap(
        lambda n: st.lists(st.floats(-1, 1), min_size=n, max_size=n)
    ),
    name=st.text(st.characters(min_codepoint=32, exclude_categories=["C"]), min_size=1, max_size=8),
)
def test_our_own_toml_gives_the_same_cameras_back(
    tmp_path_factory: pytest.TempPathFactory, poses, focal, distortions, name
) -> None:
    path = tmp_path_factory.mktemp("calibration") / "cameras.toml"
    matrix = [[focal, 0, 3.5], [0, focal * 1.01, 2.5], [0, 0, 1]]
    moving = Camera.create(name, (8, 6), matrix, rotations.exp(poses[:, :3]), poses[:, 3:], distortions=distortions)
    fisheye = Camera.create(
        name + "2", (8, 6), matrix, np.eye(3), np.zeros(3), distortions=distortions[:4], fisheye=True
    )
    save_cameras(path, [moving, fisheye])
    back = load_cameras(path)
    assert list(back) == [name, name + "2"]
    for camera in (moving, fisheye):
        assert_same(back[camera.name], camera)


def toml_table(head: str, more: str = "") -> str:
    return (
        f"{head}\nsize = [640.0, 480.0]\nmatrix = {K.tolist()}\ndistortions = {DISTORTIONS}\n"
        f"rotation = {ROTATION.tolist()}\ntranslation = {TRANSLATION.tolist()}\n{more}\n"
    )


def test_aniposelib_and_pose2sim_toml(tmp_path: Path) -> None:
    path = tmp_path / "Calib.toml"
    path.write_text(toml_table('[cam_1]\nname = "cam01"', "fisheye = false") + "[metadata]\nadjusted = false\n")
    assert_same(load_cameras(path)["cam01"], one_camera())


def test_caliscope_toml_leaves_out_cameras_without_a_pose(tmp_path: Path) -> None:
    path = tmp_path / "camera_array.toml"
    unposed = f'[cameras.2]\ncam_id = 2\nsize = [640, 480]\nmatrix = {K.tolist()}\nrotation = "null"\n'
    path.write_text(toml_table("[cameras.1]\ncam_id = 1\nrotation_count = 0") + unposed)
    cameras = load_cameras(path)
    assert list(cameras) == ["cam_1"]
    assert_same(cameras["cam_1"], one_camera("cam_1"))


def qualisys(R: np.ndarray, centre_mm: np.ndarray, **changes: str) -> str:
    turn = " ".join(f'r{i + 1}{j + 1}="{R[i, j]!r}"' for i in range(3) for j in range(3))
    place = " ".join(f'{axis}="{c!r}"' for axis, c in zip("xyz", centre_mm, strict=True))
    intrinsic = {
        "focalLengthU": K[0, 0] * 64,
        "focalLengthV": K[1, 1] * 64,
        "centerPointU": (K[0, 2] + 16) * 64,
        "centerPointV": (K[1, 2] + 8) * 64,
        "skew": 0.0,
        "radialDistortion1": DISTORTIONS[0],
        "radialDistortion2": DISTORTIONS[1],
        "radialDistortion3": DISTORTIONS[4],
        "tangentalDistortion1": DISTORTIONS[2],
        "tangentalDistortion2": DISTORTIONS[3],
    } | changes
    values = " ".join(f'{key}="{value}"' for key, value in intrinsic.items())
    return (
        (
            '<?xml version="1.0"?><calibration><cameras>'
            '<camera active="1" model="Oqus 7+" serial="1234"/>'
            '<camera active="1" model="Miqus Video" serial="cam01" viewrotation="0">'
            '<fov_video left="16" top="8" right="655" bottom="487"/>'
            f"<transform {turn} {place}/><intrinsic {values}/></camera></cameras></calibration>"
        )
        .replace("np.float64(", "")
        .replace(")", "")
    )


def test_qualisys_cameras_look_along_their_own_minus_z(tmp_path: Path) -> None:
    # Straight down on the floor from 3 m: no rotation at all in Qualisys' terms, x right and y up in the picture.
    path = tmp_path / "session.qca.txt"
    path.write_text(qualisys(np.eye(3), np.array([100.0, 200.0, 3000.0])))
    camera = load_cameras(path)["cam01"]
    assert camera.size == SIZE
    np.testing.assert_allclose(camera.centre_world(), [0.1, 0.2, 3.0])
    flat = camera.rectified()
    np.testing.assert_allclose(flat.project([0.1, 0.2, 0.0]), K[:2, 2])
    np.testing.assert_allclose(flat.project([0.4, 0.2, 0.0]), K[:2, 2] + [0.1 * K[0, 0], 0])
    np.testing.assert_allclose(flat.project([0.1, 0.5, 0.0]), K[:2, 2] - [0, 0.1 * K[1, 1]])


def test_qualisys_gives_the_same_camera_as_toml(tmp_path: Path) -> None:
    camera = one_camera()
    R = np.diag([1.0, -1.0, -1.0]) @ camera.R_cam_world[0]
    path = tmp_path / "session.qca.txt"
    path.write_text(qualisys(R, 1000 * camera.centre_world()))
    assert_same(load_cameras(path)["cam01"], camera, 1e-9)


def test_qualisys_errors_name_the_value(tmp_path: Path) -> None:
    path = tmp_path / "session.qca.txt"
    path.write_text(qualisys(np.eye(3), np.zeros(3), focalLengthU="long"))
    with pytest.raises(CalibrationError, match=r"session\.qca\.txt camera cam01: intrinsic focalLengthU is 'long'"):
        load_cameras(path)


@pytest.mark.parametrize("suffix", [".yml", ".json"])
def test_opencv_files_with_a_node_per_camera(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"rig{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name in ("cam01", "cam02"):
        storage.startWriteStruct(name, cv2.FILE_NODE_MAP)
        storage.write("image_width", SIZE[0])
        storage.write("image_height", SIZE[1])
        storage.write("camera_matrix", K)
        storage.write("distortion_coefficients", np.array([DISTORTIONS]))
        storage.write("R", rotations.exp(ROTATION))
        storage.write("T", TRANSLATION)
        storage.endWriteStruct()
    storage.release()
    cameras = load_cameras(path)
    assert list(cameras) == ["cam01", "cam02"]
    assert_same(cameras["cam01"], one_camera(), 1e-12)


def test_plain_json(tmp_path: Path) -> None:
    path = tmp_path / "front.json"
    values = {"size": SIZE, "matrix": K.tolist(), "distortions": DISTORTIONS}
    path.write_text(json.dumps(values | {"rvec": ROTATION.tolist(), "tvec": TRANSLATION.tolist()}))
    assert_same(load_cameras(path)["front"], one_camera("front"))


@pytest.mark.parametrize("together", [True, False])
def test_easymocap_files(tmp_path: Path, together: bool) -> None:
    names = ["1", "2"]
    parts: dict[str, dict[str, object]] = {"intri": {}, "extri": {}}
    for name in names:
        parts["intri"] |= {f"K_{name}": K, f"dist_{name}": np.array([DISTORTIONS]), f"W_{name}": SIZE[0]}
        parts["intri"] |= {f"H_{name}": SIZE[1]}
        parts["extri"] |= {f"R_{name}": ROTATION, f"T_{name}": TRANSLATION}
    if together:
        parts = {"intri": parts["intri"] | parts["extri"]}
    for part, values in parts.items():
        storage = cv2.FileStorage(str(tmp_path / f"{part}.yml"), cv2.FILE_STORAGE_WRITE)
        storage.startWriteStruct("names", cv2.FILE_NODE_SEQ)
        for name in names:
            storage.write("", name)
        storage.endWriteStruct()
        for key, value in values.items():
            storage.write(key, value)
        storage.release()
    cameras = load_cameras(tmp_path / "intri.yml")
    assert list(cameras) == names
    assert_same(cameras["2"], one_camera("2"), 1e-9)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("size = [640.0, 480.0]\n", "", "'size' is missing"),
        ("size = [640.0, 480.0]", "size = [640.5, 480.0]", "whole numbers"),
        ("size = [640.0, 480.0]", 'size = "big"', "'size' must be numbers"),
        ("rotation = [1.2", "rotation = [nan", "'rotation' holds a value that is not a finite number"),
        ("rotation = [1.2,", "rotation = [", r"'rotation' has shape \(2,\), not 3"),
        ("700.5", "-700.5", "positive focal lengths"),
        ("distortions = [-0.05,", "distortions = [1, 2, -0.05,", "7 distortions, not 4 or 5"),
    ],
)
def test_errors_name_file_camera_and_field(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = toml_table('[cam_1]\nname = "cam01"')
    assert old in text
    path = tmp_path / "calibration.toml"
    path.write_text(text.replace(old, new))
    with pytest.raises(CalibrationError, match=message) as caught:
        load_cameras(path)
    assert "cam01" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("missing.toml", None),
        ("missing.yml", None),
        ("missing.qca.txt", None),
        ("broken.toml", "[cam"),
        ("broken.qca.txt", "<calibration>"),
        ("broken.json", "{]"),
        ("broken.yml", "nothing"),
        ("empty.toml", ""),
        ("unknown.xcp", ""),
        ("twice.toml", toml_table('[a]\nname = "A"') + toml_table('[b]\nname = "A"')),
    ],
)
def test_files_that_are_no_calibration_are_refused(tmp_path: Path, name: str, text: str | None) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(CalibrationError, match=name.replace(".", r"\.")):
        load_cameras(tmp_path / name)
