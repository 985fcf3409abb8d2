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
from kfmocap.core.cameras.fisheye_warning import fisheye_warning
from kfmocap.core.errors import CalibrationError
from kfmocap.core.formats.calibrations.calibration_files import load_cameras
from kfmocap.core.formats.calibrations.toml_cameras import save_cameras
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


def test_toml_of_aniposelib_and_pose2sim_is_read(tmp_path: Path) -> None:
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


CALISCOPE = """
[cameras.0]
cam_id = 0
rotation_count = 0
error = 0.19
exposure = -7.0
grid_count = 24
ignore = false
size = [1280, 720]
matrix = [[894.5288733178912, 0.0, 624.011791468827], [0.0, 896.877811780321, 361.28189843593503], [0.0, 0.0, 1.0]]
distortions = [-0.3383569013465177, 0.09672714756989992, -0.0013512226751077358, 0.003155760325647937, -0.0037489]
translation = [-0.6425176710599999, 0.2628680995431283, 1.4515383168392715]
rotation = [[0.028454458274723926, -0.8200005191342249, 0.571655046705523],
            [-0.9915778577174362, -0.0954406312087065, -0.0875467760627629],
            [0.12634752031121108, -0.5643493904790591, -0.8158100695487417]]
verified_resolutions = [[640, 480], [1280, 720], [1920, 1080]]
[cameras.4]
cam_id = 4
size = [1280, 720]
rotation_count = 1
fisheye = false
"""
"""As Caliscope's own sample sessions have it: the rotation as a matrix, and a camera that is not calibrated yet."""


def test_caliscope_rotations_may_be_matrices(tmp_path: Path) -> None:
    path = tmp_path / "camera_array.toml"
    path.write_text(CALISCOPE)
    [camera] = load_cameras(path).values()
    R = camera.R_cam_world[0]
    assert camera.name == "cam_0" and camera.size == (1280, 720)
    np.testing.assert_allclose(R[0], [0.028454458274723926, -0.8200005191342249, 0.571655046705523], atol=1e-9)
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
    np.testing.assert_allclose(camera.t_cam_world, [[-0.6425176710599999, 0.2628680995431283, 1.4515383168392715]])


MATRIX = rotations.exp(ROTATION)


@pytest.mark.parametrize("suffix", [".toml", ".json"])
@pytest.mark.parametrize(
    "rotation",
    [ROTATION, ROTATION[None], ROTATION[:, None], MATRIX, MATRIX.ravel()],
    ids=["3", "1x3", "3x1", "3x3", "9"],
)
@pytest.mark.parametrize("translation", [TRANSLATION, TRANSLATION[:, None]], ids=["3", "3x1"])
def test_a_rotation_is_read_in_every_shape(tmp_path: Path, rotation, translation, suffix: str) -> None:
    """Vectors as OpenCV's functions return them (3x1), flat or in a row; matrices nested or row by row."""
    path = tmp_path / f"cam01{suffix}"
    values = {"size": list(SIZE), "matrix": K.tolist(), "distortions": [DISTORTIONS]}
    values |= {"rotation": rotation.tolist(), "translation": translation.tolist()}
    lines = [f"{key} = {json.dumps(value)}" for key, value in values.items()]
    path.write_text(json.dumps(values) if suffix == ".json" else "\n".join(["[cam01]", *lines]))
    assert_same(load_cameras(path)["cam01"], one_camera())


def test_three_poses_of_a_moving_camera_are_not_a_matrix(tmp_path: Path) -> None:
    path = tmp_path / "Calib.toml"
    turns, places = np.diag([0.1, 0.2, 0.3]), np.eye(3)
    text = toml_table("[cam01]").replace(f"{ROTATION.tolist()}", f"{turns.tolist()}")
    path.write_text(text.replace(f"{TRANSLATION.tolist()}", f"{places.tolist()}"))
    camera = load_cameras(path)["cam01"]
    np.testing.assert_allclose(camera.R_cam_world, rotations.exp(turns))
    path.write_text(path.read_text().replace(f"{turns.tolist()}", f"{rotations.exp(turns).tolist()}"))
    np.testing.assert_allclose(load_cameras(path)["cam01"].R_cam_world, camera.R_cam_world)


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        ([91.5, 0.0, -40.0], "Rodrigues vector of 100 radians.*degrees"),
        ([0.7, 0.1, 0.5, 0.5], "quaternions are not read"),
        (np.diag([1.0, 1.0, -1.0]).tolist(), "mirrors.*x right, y down, z forward"),
        ((2 * MATRIX).tolist(), "is not a rotation"),
        (np.eye(4).tolist(), r"has shape \(4, 4\), not 3, 3x1, 1x3 or 3x3"),
        ([[1.0, 0.0], [0.0]], "'rotation' must be numbers"),
    ],
)
def test_a_matrix_that_is_not_a_rotation_is_refused(tmp_path: Path, rotation, message: str) -> None:
    path = tmp_path / "Calib.toml"
    path.write_text(toml_table("[cam01]").replace(f"{ROTATION.tolist()}", json.dumps(rotation)))
    with pytest.raises(CalibrationError, match=rf"Calib\.toml camera cam01: .*{message}"):
        load_cameras(path)


POSE2SIM = """[int_cam01_img]
name = "int_cam01_img"
size = [ 1088.0, 1920.0]
matrix = [ [ 1671.5012042021037, 0.0, 564.6403499852015], [ 0.0, 1671.3866928599075, 933.0074897877159], [ 0.0, 0.0, 1.0]]
distortions = [ -0.05310342256182765, 0.1510044676505964, -0.00011989435671705446, 0.0006503403122568441]
rotation = [ 1.678784562972848, 1.031972654261743, -0.3910235872501538]
translation = [ 0.2609476905995074, 0.9641586618892432, 2.932963441842366]
fisheye = false

[metadata]
adjusted = false
error = 0.0
"""  # noqa: E501


def test_a_calibration_that_pose2sim_wrote_is_read(tmp_path: Path) -> None:
    path = tmp_path / "Calib_scene.toml"
    path.write_text(POSE2SIM)
    [camera] = load_cameras(path).values()
    assert camera.name == "int_cam01_img" and camera.size == (1088, 1920) and len(camera.distortions) == 4
    np.testing.assert_allclose(
        rotations.log(camera.R_cam_world[0]), [1.678784562972848, 1.031972654261743, -0.39102359]
    )


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
def test_opencv_files_with_a_node_per_camera_are_read(tmp_path: Path, suffix: str) -> None:
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


def test_an_opencv_file_may_hold_integers_of_more_than_32_bits(tmp_path: Path) -> None:
    """OpenCV itself never ends with one, as of a time in milliseconds."""
    path = tmp_path / "front.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in {
        "image_width": SIZE[0],
        "image_height": SIZE[1],
        "camera_matrix": K,
        "rvec": ROTATION,
        "tvec": TRANSLATION,
    }.items():
        storage.write(key, value)
    storage.release()
    text = path.read_text()
    path.write_text(text + "calibrated: 1700000000000\nframes: [ 1700000000000, 5 ]\n")
    np.testing.assert_array_equal(load_cameras(path)["front"].matrix, K)


@pytest.mark.parametrize(
    ("before", "after", "message"),
    [
        ("dt: d", "dt: q", "3 x 3 values of type q"),
        ("rows: 3\n   cols: 3", "rows: 90000\n   cols: 90000", "90000 x 90000 values of type d"),
        ("rows: 3\n   cols: 3", "rows: 3\n   cols: 0", "3 x 0 values of type d"),
        ("rows: 3\n   cols: 3", "rows: 3\n   cols: 4", "a matrix of 3 x 4 has 9 values"),
    ],
)
def test_a_matrix_that_opencv_would_stumble_over_is_refused_before_it_is_read(
    tmp_path: Path, before: str, after: str, message: str
) -> None:
    """It allocates memory for as many values as are stated, and stops the program at an unknown type."""
    path = tmp_path / "front.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("camera_matrix", K)
    storage.release()
    text = path.read_text()
    assert before in text
    path.write_text(text.replace(before, after))
    with pytest.raises(CalibrationError, match=message):
        load_cameras(path)


def test_opencvs_values_in_plain_json_are_a_camera(tmp_path: Path) -> None:
    path = tmp_path / "front.json"
    values = {"size": SIZE, "matrix": K.tolist(), "distortions": DISTORTIONS}
    path.write_text(json.dumps(values | {"rvec": ROTATION.tolist(), "tvec": TRANSLATION.tolist()}))
    assert_same(load_cameras(path)["front"], one_camera("front"))


@pytest.mark.parametrize("together", [True, False])
def test_easymocaps_one_file_or_two_are_the_same_cameras(tmp_path: Path, together: bool) -> None:
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
        ("700.5", "30", "focal length of 30 pixels, shorter .* in millimetres"),
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
def test_files_that_are_not_calibrations_are_refused(tmp_path: Path, name: str, text: str | None) -> None:
    if text is not None:
        (tmp_path / name).write_text(text)
    with pytest.raises(CalibrationError, match=name.replace(".", r"\.")):
        load_cameras(tmp_path / name)


@pytest.mark.parametrize(
    ("line", "fisheye"),
    [
        ("fisheye = true", True),
        ("fisheye = 1", True),
        ('fisheye = "false"', False),
        ('distortion_model = "equidistant"', True),
        ('distortion_model = "plumb_bob"', False),
    ],
)
def test_the_lens_model_is_told_by_a_flag_or_by_its_name(tmp_path: Path, line: str, fisheye: bool) -> None:
    path = tmp_path / "calibration.toml"
    table = toml_table('[cam_1]\nname = "cam01"', line).replace(
        f"distortions = {DISTORTIONS}", "distortions = [0, 0, 0, 0]"
    )
    path.write_text(table)
    assert load_cameras(path)["cam01"].fisheye == fisheye


def test_a_flag_that_is_neither_true_nor_false_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "calibration.toml"
    path.write_text(toml_table('[cam_1]\nname = "cam01"', 'fisheye = "maybe"'))
    with pytest.raises(CalibrationError, match=r"camera cam01: 'fisheye' must be true or false, not 'maybe'"):
        load_cameras(path)


@pytest.mark.parametrize(
    ("distortions", "fisheye", "doubted"),
    [
        ((-0.03, 0.02, -0.04, 0.02), False, True),
        ((-0.03, 0.02, -0.04, 0.02), True, False),
        ((-0.3, 0.1, 0.001, -0.002), False, False),
        ((-0.3, 0.1, -0.04, 0.02, 0.0), False, False),
    ],
)
def test_four_coefficients_that_may_be_a_fisheye_s_are_doubted(
    distortions: tuple[float, ...], fisheye: bool, doubted: bool
) -> None:
    camera = Camera.create(
        "front", (640, 360), np.diag([500, 500, 1]), np.eye(3), np.zeros(3), distortions=distortions, fisheye=fisheye
    )
    assert ("fisheye" in fisheye_warning(camera)) == doubted
