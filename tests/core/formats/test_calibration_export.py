"""Calibrations go out in the form of every program they come in from, and come back the same."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.choices import CALIBRATION_ENDINGS
from kfmocap.core.errors import CalibrationError, OutputError
from kfmocap.core.formats.calibrations.calibration_files import FORMATS, export_cameras, load_cameras
from kfmocap.core.numerics import rotations

FILES = [
    ("camera_array.toml", "caliscope"),
    *((f"out{ending}", None) for ending in dict.fromkeys(chain(*CALIBRATION_ENDINGS.values()))),
]


def cameras(pose: np.ndarray, focal: float, distortions: list[float]) -> list[Camera]:
    matrix = [[focal, 0.0, 950.5], [0, focal * 1.002, 530.25], [0, 0, 1]]
    R = rotations.exp(pose[:, :3])
    return [
        Camera.create(f"cam_{i}", (1920, 1080), matrix, R[i], pose[i, 3:], distortions=distortions)
        for i in range(len(pose))
    ]


def test_every_format_has_endings_and_every_ending_a_format() -> None:
    assert set(FORMATS) == set(CALIBRATION_ENDINGS)


@pytest.mark.parametrize(("name", "kind"), FILES)
@given(
    pose=arrays(float, (2, 6), elements=st.floats(-1.7, 1.7)),
    focal=st.floats(100, 5000),
    distortions=st.lists(st.floats(-1, 1), min_size=5, max_size=5),
)
def test_what_goes_out_comes_back(
    tmp_path_factory: pytest.TempPathFactory, name: str, kind: str | None, pose, focal, distortions
) -> None:
    path = tmp_path_factory.mktemp("calibration") / name
    given_cameras = cameras(pose, focal, distortions)
    export_cameras(path, given_cameras, kind)
    back = load_cameras(path)
    assert list(back) == [camera.name for camera in given_cameras]
    points = np.random.default_rng(0).normal(0, 1, (20, 3))
    for camera in given_cameras:
        other = back[camera.name]
        assert other.size == camera.size
        np.testing.assert_allclose(other.matrix, camera.matrix, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(other.distortions[:5], camera.distortions, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.R_cam_world, camera.R_cam_world, atol=1e-9)
        np.testing.assert_allclose(other.t_cam_world, camera.t_cam_world, atol=1e-9)
        np.testing.assert_allclose(
            other.rectified().project(points), camera.rectified().project(points), rtol=1e-7, atol=1e-3, equal_nan=True
        )


def plain(**changes: object) -> Camera:
    values = {"name": "front", "R_cam_world": np.eye(3), "t_cam_world": np.zeros(3)} | changes
    return Camera.create(size=(64, 48), matrix=np.diag([50.0, 50, 1]), **values)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("camera", "kind", "message"),
    [
        (plain(R_cam_world=np.stack([np.eye(3)] * 2), t_cam_world=np.zeros((2, 3))), "qualisys", "moving"),
        (replace(plain(), zooms=np.array([1.2])), "opencv", "zoom"),
        (plain(fisheye=True), "caliscope", "fisheye"),
        (plain(distortions=[0, 0, 0, 0, 0, 0.1, 0, 0]), "qualisys", "coefficients"),
        (plain(), "nothing", "unknown kind of calibration 'nothing'"),
    ],
)
def test_what_a_kind_has_no_place_for_is_refused(tmp_path: Path, camera: Camera, kind: str, message: str) -> None:
    with pytest.raises(CalibrationError, match=message):
        export_cameras(tmp_path / "out", [camera], kind)
    assert not list(tmp_path.iterdir())


def test_a_lens_that_zooms_comes_back_from_our_own_format(tmp_path: Path) -> None:
    turned = replace(plain(), R_cam_world=np.stack([np.eye(3)] * 3), t_cam_world=np.ones((3, 3)))
    zooming = replace(turned, zooms=np.array([1.0, 1.1, 1 / 3]))
    export_cameras(path := tmp_path / "cameras.toml", [zooming, plain(name="fixed")])
    back = load_cameras(path)
    np.testing.assert_array_equal(back["front"].zooms, zooming.zooms)
    assert back["fixed"].zooms is None
    path.write_text(path.read_text().replace("zooms = [1.0, ", "zooms = ["))
    with pytest.raises(CalibrationError, match=r"front: 'zooms' has shape \(2,\), not 3"):
        load_cameras(path)


def test_an_unknown_ending_is_refused(tmp_path: Path) -> None:
    with pytest.raises(CalibrationError, match=r"\.qca\.txt"):
        export_cameras(tmp_path / "cameras.xcp", [plain()])


def test_calibrations_of_other_programs_say_what_to_do(tmp_path: Path) -> None:
    for name, todo in (("a.xcp", "Pose2Sim"), ("a.xml", r"OpenCV write \.yml"), ("theia.txt", r"end in \.qca\.txt")):
        with pytest.raises(CalibrationError, match=todo):
            load_cameras(tmp_path / name)


def test_a_fisheye_and_long_lists_of_coefficients_go_out_as_opencv(tmp_path: Path) -> None:
    long = plain(distortions=[0.1, 0, 0, 0, 0, 0.1, 0, 0])
    export_cameras(tmp_path / "long.yml", [long])
    export_cameras(tmp_path / "fish.yml", [plain(fisheye=True, distortions=[0.1, 0, 0, 0])])
    np.testing.assert_allclose(load_cameras(tmp_path / "long.yml")["front"].distortions, long.distortions)
    assert load_cameras(tmp_path / "fish.yml")["front"].fisheye


def test_names_that_are_not_numbers_are_numbered_for_caliscope(tmp_path: Path) -> None:
    values = [plain(), Camera.create("back", (64, 48), np.diag([50.0, 50, 1]), np.eye(3), np.ones(3))]
    export_cameras(tmp_path / "a.toml", values, "caliscope")
    assert list(load_cameras(tmp_path / "a.toml")) == ["cam_1", "cam_2"]


@pytest.mark.parametrize("name", ["cameras.toml", "cameras.qca.txt", "cameras.yml"])
def test_a_folder_that_is_not_there_is_an_output_error(tmp_path: Path, name: str) -> None:
    with pytest.raises(OutputError):
        export_cameras(tmp_path / "nowhere" / name, [plain()])
