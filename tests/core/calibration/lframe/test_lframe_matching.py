"""The L-frame told by all views together, among other things of its colour."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.calibration.lframe.lframe_matching import identified_together, lframe_by_all_views, of_another_size
from kfmocap.core.calibration.lframe.lframe_pose import check_size, place_lframe, resting
from kfmocap.core.calibration.solving.camera_rig import rig_of
from kfmocap.core.capture.capture import Capture, CaptureView, Markers
from kfmocap.core.errors import CaptureError
from kfmocap.core.numerics import rotations
from render.drawn_takes import VGA_CAMERAS

MEASURES = np.array([[0, 0, 0], [0.3, 0, 0], [0.6, 0, 0], [0, 0.2, 0]])
RIG = rig_of(list(VGA_CAMERAS))
TURN, SHIFT = rotations.exp(np.array([0.4, -1.1, 0.8])), np.array([2.0, 0.5, -3.0])
ELSEWHERE = RIG.in_world(TURN, SHIFT)
"""The wand alone does not say where the floor is."""


def seen_by_all(seed: int, clutter: int = 12, noise: float = 0.8) -> tuple[list[np.ndarray], np.ndarray]:
    """Pixels of the L-frame's balls among others on the floor and anywhere, and which they are, shape (V, 4)."""
    rng = np.random.default_rng(seed)
    about = np.column_stack([rng.uniform(-2, 2, (5, 2)), np.full(5, 0.02)])
    views, places = [], []
    for camera in VGA_CAMERAS:
        stray = rng.uniform(0, 1, (clutter, 2)) * camera.size
        pixels = camera.project(np.concatenate([MEASURES, about])) + rng.normal(0, noise, (9, 2))
        order = rng.permutation(9 + clutter)
        views.append(np.concatenate([pixels, stray])[order])
        places.append(np.argsort(order)[:4])
    return views, np.array(places)


@pytest.mark.parametrize("seed", range(8))
def test_the_lframe_is_identified_among_other_things(seed):
    views, places = seen_by_all(seed)
    told = identified_together(ELSEWHERE, views, MEASURES)
    for view, own, true in zip(views, told, places, strict=True):
        assert (own >= 0).all()
        assert np.linalg.norm(view[own] - view[true], axis=1).max() < 4  # a thing right beside it may be nearer
    assert (told == places).sum() >= 15


def test_the_lframe_is_identified_in_a_room_full_of_its_colour():
    views, places = seen_by_all(5, clutter=36)
    told = identified_together(ELSEWHERE, views, MEASURES)
    off = [np.linalg.norm(view[own] - view[true], axis=1) for view, own, true in zip(views, told, places, strict=True)]
    assert np.max(off) < 4


@pytest.mark.parametrize("seed", range(6))
def test_a_ball_that_is_covered_is_left_out_rather_than_replaced(seed):
    views, places = seen_by_all(seed)
    covered, ball = seed % 4, (seed // 2) % 4
    views[covered] = np.delete(views[covered], places[covered, ball], axis=0)
    told = identified_together(ELSEWHERE, views, MEASURES)
    other = views[covered][told[covered, ball]] if told[covered, ball] >= 0 else None
    true = VGA_CAMERAS[covered].project(MEASURES[ball])
    assert other is None or np.linalg.norm(other - true) < 4
    assert (told[[v for v in range(4) if v != covered]] >= 0).all()


def test_things_that_lie_like_no_lframe_are_none():
    views, places = seen_by_all(3)
    views = [np.delete(view, own, axis=0) for view, own in zip(views, places, strict=True)]
    assert identified_together(ELSEWHERE, views, MEASURES) is None


def capture_of(views: list[np.ndarray], alone: dict[int, np.ndarray]) -> Capture:
    nothing = Markers(np.zeros(0, int), np.zeros((0, 4, 2)), np.zeros((0, 4)))
    wand = Markers(np.zeros(0, int), np.zeros((0, 2, 2)), np.zeros((0, 2)))

    def row(points: np.ndarray) -> Markers:
        return Markers(np.zeros(1, int), points[None], np.full((1, len(points)), 0.2))

    return Capture(
        MEASURES,
        0.5,
        tuple(
            CaptureView(
                camera.name,
                camera.size,
                None,
                row(alone[v]) if v in alone else nothing,
                wand,
                lframe_candidates=row(views[v]),
            )
            for v, camera in enumerate(VGA_CAMERAS)
        ),
    )


def test_a_view_that_was_wrong_alone_is_put_right_and_one_of_a_moved_camera_is_kept():
    views, places = seen_by_all(1)
    wrong = np.delete(views[0], places[0], axis=0)[:4]
    moved = replace(VGA_CAMERAS[2], t_cam_world=VGA_CAMERAS[2].t_cam_world + [[0.3, 0.1, 0.0]])
    aside = moved.project(MEASURES)
    views[2] = aside
    told = lframe_by_all_views(capture_of(views, {0: wrong, 2: aside}), ELSEWHERE)
    np.testing.assert_allclose(told.views[0].lframe.points[0], views[0][places[0]], atol=4)
    np.testing.assert_array_equal(told.views[2].lframe.points[0], aside)
    for v in (1, 3):
        np.testing.assert_allclose(told.views[v].lframe.points[0], views[v][places[v]], atol=4)


def test_captures_without_candidates_stay_as_they_are():
    views, _ = seen_by_all(1)
    capture = capture_of(views, {})
    capture = replace(capture, views=tuple(replace(view, lframe_candidates=None) for view in capture.views))
    assert lframe_by_all_views(capture, ELSEWHERE) is capture


@pytest.mark.parametrize("size", [0.55, 0.8, 1.25, 2.0])
def test_an_lframe_is_found_in_another_size_than_the_wands_length_makes_it(size):
    """By a wand that is said to be longer than it is, the cameras stand farther apart, and all they see is larger."""
    views, places = seen_by_all(2)
    rig = rig_of([replace(c, t_cam_world=size * c.t_cam_world) for c in VGA_CAMERAS])
    found = of_another_size(capture_of(views, {}), rig.in_world(TURN, SHIFT))
    for view, told, true in zip(views, found.views, places, strict=True):
        np.testing.assert_allclose(told.lframe.points[0], view[true], atol=4)


def test_a_wand_whose_length_is_far_off_is_named_though_something_else_was_taken_for_the_lframe():
    views, _ = seen_by_all(2)
    rig = rig_of([replace(c, t_cam_world=1.25 * c.t_cam_world) for c in VGA_CAMERAS])
    sized = of_another_size(capture_of(views, {}), rig)
    seen = resting([view.lframe for view in sized.views])
    with pytest.raises(CaptureError, match=r"the wand is 0\.4\d* m long, not 0\.5000 m") as refused:
        check_size(place_lframe(rig, seen, MEASURES, 1.0), MEASURES, 0.5)
    assert refused.value.name == "wand-length-wrong"
