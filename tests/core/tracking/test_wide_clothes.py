"""Limbs in wide clothes may be anywhere in them, and the expected errors say so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from kfmocap.core.body.body import Body
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.tracking.expected_errors.uncertainty import SegmentUncertainty, joint_errors
from kfmocap.core.tracking.expected_errors.wide_clothes import widths_of_clothes
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from synthetic import at_rest, figure, look_at, poses_of, silhouette

BODY = figure()
P, F, KEYS = len(BODY), 5, [0, 4]
ARM = [BODY.index("upper_arm.L"), BODY.index("forearm.L")]
CAMERAS = (look_at("front", (0.3, -2.4, 1.4)), look_at("side", (-2.2, -1.2, 1.5)))


def in_sleeves(times: float) -> Body:
    """The figure with an arm so many times as wide and deep."""
    parts = list(BODY.parts)
    for part in ARM:
        parts[part] = replace(parts[part], vertices=parts[part].vertices * [times, 1, times])
    return replace(BODY, parts=tuple(parts))


def problem_of(worn: Body, keys: list[int] = KEYS, performers: int = 1) -> SegmentProblem:
    """The figure stands still, and the pictures show it in what it wears."""
    fixed = np.zeros((F, BODY.dof), bool)
    fixed[keys] = True
    views = []
    for camera in CAMERAS:
        seen = np.stack([silhouette([worn], poses_of([worn], [at_rest(worn)]), 0, camera, samples=2)] * F)
        views.append(ViewFrames(camera, np.zeros_like(seen), 0, foreground=np.stack([seen] * performers)))
    return SegmentProblem(tuple(views), (BODY,) * performers, 0, 30.0, (fixed,) * performers)


def widths(problem: SegmentProblem) -> np.ndarray:
    return widths_of_clothes(problem, [at_rest(BODY, F)] * len(problem.bodies))[0]


def test_the_width_of_a_sleeve_beside_an_arm_is_measured_and_no_other_part_has_any() -> None:
    found = widths(problem_of(in_sleeves(4.0)))
    beside = 2 * (4 * 0.07 - 0.07)  # on both sides of the upper arm
    assert 0.8 * beside < found[ARM[0]] < 1.2 * beside
    assert found[ARM[1]] >= found[ARM[0]]  # it hangs on the upper arm
    assert not np.delete(found, ARM).any()


def test_clothes_that_fit_leave_no_room() -> None:
    for times in (1.0, 1.5):
        assert not widths(problem_of(in_sleeves(times))).any()


def test_somebody_beside_a_limb_on_one_key_pose_is_no_sleeve() -> None:
    wide, fitting = problem_of(in_sleeves(4.0)), problem_of(BODY)
    views = []
    for one, other in zip(wide.views, fitting.views, strict=True):
        assert one.foreground is not None and other.foreground is not None
        views.append(
            replace(other, foreground=np.concatenate([one.foreground[:, :1], other.foreground[:, 1:]], axis=1))
        )
    assert not widths(replace(fitting, views=tuple(views))).any()


def test_damaged_pictures_show_no_clothes() -> None:
    wide, fitting = problem_of(in_sleeves(4.0)), problem_of(BODY)
    one = replace(wide.views[0], damaged=np.isin(np.arange(F), KEYS[:1]))
    assert widths(replace(wide, views=(one, wide.views[1]))).any()  # the other key frame shows them
    damaged = replace(wide.views[0], damaged=np.ones(F, bool))
    assert not widths(replace(fitting, views=(damaged, fitting.views[1]))).any()
    assert not widths(replace(fitting, views=(damaged,))).any()


def test_nothing_is_said_without_key_poses_or_of_several_performers() -> None:
    assert not widths(problem_of(in_sleeves(4.0), keys=[])).any()
    assert not widths(problem_of(in_sleeves(4.0), performers=2)).any()


def test_limbs_in_wide_clothes_may_be_off_by_their_width_but_on_key_poses() -> None:
    held = np.zeros(F, bool)
    held[KEYS] = True
    covariances, clothes = np.tile(1e-6 * np.eye(3), (F, P, 1, 1)), np.zeros(P)
    clothes[ARM] = 0.2
    one = SegmentUncertainty(0, held, covariances, np.zeros((0, P)), np.zeros(F), np.zeros((F, P)), clothes)
    found = joint_errors(BODY, [one], np.zeros((F, P, 3, 3)))
    assert (found.deviation[1:-1][:, ARM] > 0.19).all()
    assert np.delete(found.deviation, ARM, axis=1).max() < 0.01
    assert not found.deviation[KEYS].any()
