"""Calibrations of other worlds: in millimetres, or with another axis pointing up, cameras see the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.cameras.world_axes import AXES, METRES, FileWorld, upward_axis, upward_axis_warning
from kfmocap.core.errors import CalibrationError
from kfmocap.core.numerics import rotations
from synthetic import look_at

CAMERAS = [look_at("cam01", (3, -4, 1.5)), look_at("cam02", (-4, -2, 2)), look_at("cam03", (1, 5, 0.8))]


def filed(camera: Camera, unit: str, up: str) -> Camera:
    """A camera as a file of another world has it."""
    axes = np.array(AXES[up], float)
    return replace(camera, R_cam_world=camera.R_cam_world @ axes, t_cam_world=camera.t_cam_world / METRES[unit])


@pytest.mark.parametrize("unit", METRES)
@pytest.mark.parametrize("up", AXES)
def test_a_camera_of_another_world_sees_the_same_in_ours(unit: str, up: str) -> None:
    axes = np.array(AXES[up], float)
    assert np.linalg.det(axes) == pytest.approx(1)
    for camera in CAMERAS:
        found = FileWorld(unit, up).ours(filed(camera, unit, up))
        np.testing.assert_allclose(found.project([[0.2, 0.1, 0.9]]), camera.project([[0.2, 0.1, 0.9]]), atol=1e-9)


@pytest.mark.parametrize("up", AXES)
def test_the_axis_that_points_up_is_named(up: str) -> None:
    cameras = [filed(camera, "m", up) for camera in CAMERAS]
    assert upward_axis(cameras) == up
    assert FileWorld().ours(cameras[0]) is cameras[0]
    assert upward_axis_warning(cameras).endswith("" if up == "z" else f"the world's {up} axis, not z, pointed up")
    assert not upward_axis_warning([FileWorld(up=up).ours(camera) for camera in cameras])


def test_millimetres_that_pass_for_metres_are_refused_unless_the_unit_is_given() -> None:
    cameras = [filed(camera, "mm", "z") for camera in CAMERAS]
    with pytest.raises(CalibrationError, match=r"up to \d{4} m apart.*\(state it\)"):
        FileWorld().check(cameras, "state it")
    FileWorld("m").check(cameras, "")
    FileWorld("mm").check([FileWorld("mm").ours(camera) for camera in cameras], "")


def test_one_camera_in_another_unit_than_the_others_is_named() -> None:
    cameras = [*CAMERAS[:-1], filed(CAMERAS[-1], "mm", "z")]
    with pytest.raises(CalibrationError, match=rf"'{CAMERAS[-1].name}' is \d{{4}} m from the others.*correct it"):
        FileWorld().check(cameras, "state it")


def test_cameras_that_look_down_or_stand_on_their_sides_in_different_ways_are_left_alone() -> None:
    down = [look_at(f"cam{i}", place, (0, 0, 0)) for i, place in enumerate([(0.5, 0, 4), (0, 0.5, 4), (-0.5, 0, 4)])]
    rolled = [
        replace(camera, R_cam_world=rotations.exp(np.array([0, 0, np.pi / 2])) @ camera.R_cam_world)
        for camera in CAMERAS
    ]
    for cameras in (CAMERAS, down, rolled, CAMERAS[:1], rolled[:1]):
        assert not upward_axis_warning(cameras)
