"""The gap between the outlines of performers and of the model."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from kfmocap.core.body.limbs import numbered_limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.misfit import bare_shares, measured_misfit
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics.rotations import exp
from synthetic import at_rest, figure, look_at, poses_of, silhouette

Array = np.ndarray
BODY = figure()
CAMERAS = [look_at("front", (0.3, -2.4, 1.4)), look_at("side", (-2.2, -1.2, 1.5))]
P = len(BODY)
HALF_TURN = exp(np.array([0.0, 0.0, 1.2]))


def arm_out_of_place(frames: int, wrong: list[int]) -> tuple[Motion, Motion]:
    """The true motion, and one with an arm turned away on some frames."""
    truth = at_rest(BODY, frames)
    Q = truth.rotations.copy()
    Q[wrong, 1] = Q[wrong, 1] @ HALF_TURN
    return truth, Motion(truth.translations, Q)


def gaps(truth: Motion, found: Motion, known: list[int], cameras: list = CAMERAS) -> Array:
    poses = poses_of([BODY], [truth])
    views = []
    for camera in cameras:
        seen = np.stack([silhouette([BODY], poses, 0, camera, samples=2)] * len(truth))  # the true pose stands still
        views.append(ViewFrames(camera, np.zeros_like(seen), 0, foreground=seen[None]))
    at = {0.0: poses_of([BODY], [found])}
    misfit = measured_misfit(views, Geometry.of([BODY]), at, first=0, spans=[slice(0, P)])
    (row,) = misfit.mean_gaps([np.array(known, int)])
    return row


def test_an_uncovered_limb_leaves_a_gap_on_its_frames_alone() -> None:
    row = gaps(*arm_out_of_place(5, [2, 3]), known=[0, 4])
    assert (row[[2, 3]] > 0.003).all()
    assert (row[[0, 1, 4]] < 1e-3).all()


def test_the_gap_of_a_model_beside_the_performer_is_its_mean_distance_from_the_outline() -> None:
    """Of a shift s the area uncovered is s times the width across it; a closed outline is some pi times as long."""
    truth = at_rest(BODY, 3)
    shift = 0.05
    found = replace(truth, translations=truth.translations + np.array([[0, 0, 0], [0, 0, shift], [0, 0, 0]]))
    row = gaps(truth, found, [0, 2])
    assert 0.15 * shift < row[1] < 0.5 * shift


def test_what_a_model_lacks_on_its_key_frames_does_not_count_as_a_gap() -> None:
    wide = replace(BODY, parts=tuple(replace(part, vertices=1.15 * part.vertices) for part in BODY.parts))
    truth = at_rest(BODY, 4)
    poses = poses_of([wide], [truth])
    views = [
        ViewFrames(
            c, np.zeros((4, 120, 160), np.uint8), 0, np.stack([silhouette([wide], poses, 0, c, samples=2)] * 4)[None]
        )
        for c in CAMERAS
    ]
    at = {0.0: poses_of([BODY], [truth])}
    misfit = measured_misfit(views, Geometry.of([BODY]), at, first=0, spans=[slice(0, P)])
    unknown, known = (misfit.mean_gaps([np.array(keys, int)]) for keys in ([], [0, 3]))
    assert (unknown > 1e-3).all()
    np.testing.assert_allclose(known, 0, atol=1e-9)


def test_a_view_that_sees_nobody_or_has_no_foreground_changes_no_gap() -> None:
    truth, found = arm_out_of_place(4, [2])
    away = look_at("away", (-2.4, -1.4, 1.3), (-5.0, -3.0, 1.3))
    alone = gaps(truth, found, [0, 3])
    np.testing.assert_allclose(gaps(truth, found, [0, 3], [*CAMERAS, away]), alone)
    blind = ViewFrames(CAMERAS[0], np.zeros((4, 120, 160), np.uint8), 0)
    at = {0.0: poses_of([BODY], [found])}
    misfit = measured_misfit([blind], Geometry.of([BODY]), at, first=0, spans=[slice(0, P)])
    assert not misfit.mean_gaps([np.array([0, 3])]).any()


def test_an_arm_beside_the_trunk_is_bare_and_one_in_front_of_it_is_not() -> None:
    """The arms point to the sides: one camera sees them beside the trunk, the other one looks along them."""
    poses = poses_of([BODY], [at_rest(BODY, 2)])
    cameras = [look_at("front", (0, -3, 1.2)), look_at("left", (3, 0, 1.3))]
    views = []
    for camera in cameras:
        seen = np.full((2, *camera.size[::-1]), 128, np.uint8)
        views.append(ViewFrames(camera, np.zeros_like(seen), 0, foreground=seen[None]))
    front, left = bare_shares(views, Geometry.of([BODY]), {0.0: poses}, first=0, limb_of=numbered_limbs([BODY]))
    arm = [BODY.index("upper_arm.L"), BODY.index("forearm.L")]
    assert front[:, arm].min() > 0.9 and left[:, arm].max() < 0.1
