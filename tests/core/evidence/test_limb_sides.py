"""The sides of limbs: where they are seen, how brightness changes across them, and what key poses teach of that."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from kfmocap.core.body import Body, human
from kfmocap.core.evidence.limb_sides import BONE_POSITIONS, PartSides, SideRatios, SlopeImages
from kfmocap.core.evidence.rendering.label_images import render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.numerics import rotations
from synthetic import look_at, part

Array = np.ndarray
BAR = part("bar", -1, (0, 0, 0.9), (0, 0, 1.3), 0.05, 0.03)
"""Upright, 10 cm wide and 6 cm deep at its foot, a fifth narrower at its head."""
CAMERA = look_at("front", (0.0, -2.5, 1.1), (0, 0, 1.1), size=(400, 300), focal=500.0)
CENTRE = (-CAMERA.R_cam_world[0].T @ CAMERA.t_cam_world[0]).astype(np.float32)[None]
FRAME = slice(0, 1)


def standing(turn: float = 0.0, shift: float = 0.0) -> tuple[Array, Array]:
    """The bar turned about the camera's axis and moved aside, as poses on one frame."""
    R = rotations.exp(np.array([0, turn, 0])) @ BAR.R_world_rest
    return R[None, None].astype(np.float32), (BAR.head_world + [shift, 0, 0])[None, None].astype(np.float32)


def pictures(step: int) -> Array:
    """The bar `step` grey levels brighter than all else."""
    R, T = (pose.astype(float) for pose in standing())
    labels = render_labels(Geometry.of([Body((BAR,), {})]), CAMERA, 0, R, T).part
    return np.where(labels >= 0, 100 + step, 100).astype(np.uint8)


def changes(poses: tuple[Array, Array], step: int = 40) -> Array:
    slopes = SlopeImages.of(CAMERA, 0, pictures(step))
    return slopes.steepest(FRAME, *PartSides.of(BAR).seen_from(CENTRE, *poses))[0]


@pytest.mark.parametrize("name", ["upper_arm.L", "forearm.R", "thigh.L", "shin.R"])
@pytest.mark.parametrize("seed", range(3))
def test_the_points_lie_on_the_outline_of_a_limb_from_every_direction(name: str, seed: int) -> None:
    body, rng = human(1.75), np.random.default_rng(seed)
    limb = body.parts[body.index(name)]
    R = rotations.exp(rng.normal(size=3))[None, None].astype(np.float32)
    T = np.array([0.1, 0.2, 1.0], np.float32)[None, None]
    points, _ = PartSides.of(limb).seen_from(CENTRE, R, T)
    outline = cv2.convexHull(_pixels(limb.vertices @ R[0, 0].T + T[0, 0]).astype(np.float32))
    width = max(cv2.minAreaRect(outline)[1])
    for place in _pixels(points[0].reshape(3, -1).T):
        assert abs(cv2.pointPolygonTest(outline, place.tolist(), measureDist=True)) < 0.08 * width


def _pixels(points_world: Array) -> Array:
    own = (points_world @ CAMERA.R_cam_world[0].T + CAMERA.t_cam_world[0]) @ CAMERA.matrix.T
    return own[:, :2] / own[:, 2:]


def test_the_two_sides_are_as_far_apart_as_the_part_is_wide() -> None:
    points, across = PartSides.of(BAR).seen_from(CENTRE, *standing())
    apart = points[0, :, 0] - points[0, :, 1]
    assert np.allclose(np.abs(across[0, :, 0]), [1, 0, 0], atol=1e-6)
    assert np.allclose(np.linalg.norm(apart, axis=0)[:, 0], 0.1 * (1 - 0.2 * BONE_POSITIONS), atol=1e-6)
    assert np.allclose(points[0, 2, 0, :, 0], 0.9 + 0.4 * BONE_POSITIONS, atol=1e-6)


def test_brightness_changes_most_where_the_sides_are() -> None:
    there, beside = changes(standing()), changes(standing(shift=0.03))
    # The steepest slope of a step that was smoothed by a Gaussian of one pixel and differentiated over three.
    assert there.min() > 0.2 * 40 and there.max() < 0.45 * 40
    assert beside.max() < 0.5 * there.min()


def test_a_change_along_the_side_is_none_across_it() -> None:
    across, along = changes(standing()), changes(standing(turn=np.pi / 2))
    middle = along[:, :, 1]  # its other places may lie on the bar's sides
    assert middle.max() < 0.1 * across.min()


def test_twice_the_step_is_twice_the_change() -> None:
    assert np.allclose(changes(standing(), 60), 2 * changes(standing(), 30), rtol=0.1)


def test_what_sides_show_more_often_than_other_lines_counts_for_a_limb() -> None:
    rng = np.random.default_rng(0)
    sides, elsewhere = rng.normal(15, 3, 200), np.abs(rng.normal(0, 4, 2000))
    ratios = SideRatios.learned(sides, elsewhere)
    seen = np.ones((1, 2, 3, 1), bool)
    assert (ratios.of(np.full(seen.shape, 15.0, np.float32), seen) > 1).all()
    assert (ratios.of(np.full(seen.shape, 0.5, np.float32), seen) < -1).all()
    assert (ratios.of(np.full(seen.shape, 15.0, np.float32), ~seen) == 0).all(), "what is hidden says nothing"


def test_sides_that_look_like_everything_else_say_nothing() -> None:
    found = np.abs(np.random.default_rng(1).normal(0, 6, 5000))
    assert np.abs(SideRatios.learned(found[:2500], found[2500:]).ratio[:6]).max() < 0.2


def test_few_sides_teach_little() -> None:
    elsewhere = np.abs(np.random.default_rng(1).normal(0, 4, 2000))
    few, many = (SideRatios.learned(np.full(n, 15.0), elsewhere).ratio for n in (1, 100))
    assert 0 < few.max() < many.max() - 1
