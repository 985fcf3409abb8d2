"""Gauss-Newton over a segment: its parts add up, and its minima are those of the energy."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.body.smoothness import MAX_STEP, acceleration, limited, smoothness
from kfmocap.core.body.smoothness_estimate import MIN_MOBILITY
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.segment_evidence import BY_PART_SHARE, SegmentEvidence
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded import BandedFactor
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.shot.acceleration_prior import USUAL_JOINT, USUAL_ROOT, acceleration_precision
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers import gauss_newton
from kfmocap.core.tracking.solvers.approach import approach
from kfmocap.core.tracking.solvers.descent_stages import (
    COARSE_STAGES,
    FINE_STAGES,
    MIN_JOINT_MOVE,
    OUTLINE_REACH,
    POLISH,
    POLISHED_AT_ONCE,
    REFINEMENT,
    RESUMED,
    STAGES,
    UNCONVERGED_MOVE,
    DescentStage,
)
from kfmocap.core.tracking.solvers.equations import segment_equations
from kfmocap.core.tracking.solvers.equations.measurement import MeasuredMotion, Workspace, hidden_parts
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, frame_residual
from kfmocap.core.tracking.solvers.equations.smoothness_factor import SegmentSmoothness
from kfmocap.core.tracking.solvers.equations.weighted_evidence import WeightedEvidence
from kfmocap.core.tracking.solvers.joint_moves import at_rest as at_rest_within
from kfmocap.core.tracking.solvers.joint_moves import farthest_joint
from kfmocap.core.tracking.solvers.view_subsets import view_subset
from made_evidence import AlteredWorkspace, Landscape, no_evidence, with_share
from numpy.typing import NDArray
from synthetic import CAMERAS, at_rest, coloured, dark, ends_held, figure, picture, poses_of, random_motion, swing

BODY = figure()
D = BODY.dof
SETTINGS = Settings()
FPS = 30.0
CONVERGED = (DescentStage(Sampling(1.0, 1.0, 2, OUTLINE_REACH), 20, small=1e-4),)
"""How soon it comes there is not what is tested here."""


def smooth_blocks(problem: SegmentProblem, motion: Motion, expected: np.ndarray | None = None) -> BandedBlocks:
    """Normal equations of the first performer's smoothness before the pictures are looked at."""
    return SegmentSmoothness.start(problem).blocks(problem, 0, motion, expected)


def filmed(motion: Motion) -> tuple[ViewFrames, ...]:
    poses = poses_of([BODY], [motion])
    return tuple(
        ViewFrames(c, np.stack([picture([BODY], poses, f, c) for f in range(len(motion))]), 0) for c in CAMERAS
    )


def with_smoothness(
    problem: SegmentProblem, measured: MeasuredMotion, hidden: list[np.ndarray] | tuple[()] = ()
) -> list[BandedBlocks]:
    """The evidence at motions, with the smoothness before any picture is looked at."""
    images = segment_equations.evidence_equations(problem, measured, hidden)
    return segment_equations.with_priors(problem, measured.motions, images, SegmentSmoothness.start(problem))


def systems(problem: SegmentProblem, motion: Motion) -> tuple[list[BandedBlocks], SegmentEvidence]:
    measured = Workspace().measure(problem, [motion], Sampling(1.0, 1.0, 2))
    return with_smoothness(problem, measured), measured.evidence


def test_without_evidence_the_motion_between_key_poses_is_the_smoothest() -> None:
    """Held at both ends, that is uniform motion: no acceleration at all."""
    F = 9
    start = swing(BODY, F, 0.3)
    uniform = start[:1].difference(start[-1:])[0] / (F - 1)
    problem = SegmentProblem(dark(CAMERAS[0], F), (BODY,), 0, FPS, (ends_held(BODY, F),))
    found = gauss_newton.descend(problem, [start], Workspace(), CONVERGED).motions[0]
    expected = stacked([start[:1].moved(j * uniform[None]) for j in range(F)])
    np.testing.assert_allclose(expected.difference(found), 0, atol=2e-3)
    np.testing.assert_array_equal(found.translations[[0, -1]], start.translations[[0, -1]])


def test_views_add_to_the_normal_equations() -> None:
    motion = swing(BODY, 4, 0.1)
    views = filmed(motion)

    def gradients(chosen: tuple[ViewFrames, ...]) -> BandedBlocks:
        problem = SegmentProblem(chosen, (BODY,), 0, FPS, (ends_held(BODY, 4),))
        smooth = smooth_blocks(problem, motion)
        [system], _ = systems(problem, motion)
        return replace(
            system,
            diagonal=system.diagonal - smooth.diagonal,
            first=system.first - smooth.first,
            gradient=system.gradient - smooth.gradient,
            energy=system.energy - smooth.energy,
        )

    both, one, other = gradients(views), gradients(views[:1]), gradients(views[1:])
    for name in ("diagonal", "first", "gradient"):
        a, b, c = (getattr(system, name) for system in (both, one, other))
        np.testing.assert_allclose(a, b + c, atol=1e-9 * np.abs(a).max())
    assert both.energy == pytest.approx(one.energy + other.energy)


def test_normal_equations_of_a_long_segment_are_the_same_in_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    F, motion = 8, swing(BODY, 8, 0.1)
    problem = SegmentProblem(filmed(motion), (BODY,), 0, FPS, (ends_held(BODY, F),))
    measured = Workspace().measure(problem, [motion], Sampling(1.0, 1.0, 2))
    hidden = np.zeros((F, len(BODY)), bool)
    hidden[2:4, 1] = True
    [whole] = segment_equations.evidence_equations(problem, measured, [hidden])
    monkeypatch.setattr(segment_equations, "PAIRS_AT_ONCE", 3)
    [runs] = segment_equations.evidence_equations(problem, measured, [hidden])
    assert whole.diagonal.any() and runs.energy == whole.energy
    for name in ("diagonal", "first", "second", "gradient"):
        np.testing.assert_array_equal(getattr(runs, name), getattr(whole, name))


def test_smoothness_reaches_into_the_frames_known_around() -> None:
    """With the poses before and after it, a segment has the blocks that it has within the whole motion."""
    motion = random_motion(BODY, 8, turn=0.3)
    precision = np.random.default_rng(0).uniform(1, 2, D)
    whole = smoothness(motion, precision)
    problem = SegmentProblem((), (BODY,), 2, FPS, (ends_held(BODY, 4),), (motion[[1]],), (motion[[6]],))
    problem = replace(problem, acceleration_precision=(precision,))
    part = smooth_blocks(problem, motion[2:6])
    inner = smoothness(motion[1:7], precision)
    np.testing.assert_array_equal(part.diagonal, inner.diagonal[1:5])
    np.testing.assert_array_equal(part.gradient, inner.gradient[1:5])
    np.testing.assert_allclose(part.second, whole.second[2:4])
    alone = smooth_blocks(replace(problem, before=None, after=None), motion[2:6])
    np.testing.assert_array_equal(alone.gradient, smoothness(motion[2:6], precision).gradient)


def test_a_segment_leaves_a_known_frame_with_its_speed() -> None:
    """The frame before the first says how fast the motion comes in."""
    F = 6
    step = np.zeros(D)
    step[0], step[8] = 0.02, 0.05
    whole = stacked([at_rest(BODY).moved(j * step[None]) for j in range(-1, F)])
    start = stacked([whole[[1]]] * F)
    fixed = np.zeros((F, D), bool)
    fixed[0] = True
    problem = SegmentProblem(dark(CAMERAS[0], 1 + F), (BODY,), 1, FPS, (fixed,), (whole[[0]],))
    found = gauss_newton.descend(problem, [start], Workspace(), CONVERGED).motions[0]
    np.testing.assert_allclose(whole[1:].difference(found), 0, atol=5e-3)


def test_at_the_true_motion_it_stays_and_from_another_smooth_one_it_comes_back() -> None:
    truth, names = swing(BODY, 6, 0.15), list(BODY.landmarks)
    problem = SegmentProblem(filmed(truth), (BODY,), 0, 12.0, (ends_held(BODY, 6),))
    bow = np.sin(np.pi * np.arange(6) / 5)[:, None]
    wrong = truth.moved(0.05 * bow * np.random.default_rng(1).normal(0, 1, D))

    def error_mm(motion: Motion) -> float:
        true, found = (landmark_positions(BODY, m, names) for m in (truth, motion))
        return 1000 * float(np.linalg.norm(found - true, axis=-1)[1:-1].mean())

    stayed, returned = (gauss_newton.descend(problem, [m], Workspace(), CONVERGED).motions[0] for m in (truth, wrong))
    assert error_mm(stayed) < 0.2 * error_mm(wrong)
    assert error_mm(returned) < 0.25 * error_mm(wrong)


def test_steps_are_limited_joint_by_joint_and_keep_their_direction() -> None:
    step = np.zeros((2, D))
    step[0, 3:6], step[1, 6:9] = [3.0, 0, 4.0], [0.1, 0.2, 0.2]
    cut = limited(step)
    longest = MAX_STEP
    np.testing.assert_allclose(cut[0, 3:6], longest * np.array([0.6, 0, 0.8]))
    np.testing.assert_array_equal(cut[1], step[1])


def test_precision_of_acceleration_is_per_frame_squared() -> None:
    """Twice the frames a second: a quarter of the acceleration a frame, sixteen times the precision."""
    slow, fast = (acceleration_precision(BODY, fps, SETTINGS) for fps in (30, 60))
    np.testing.assert_allclose(fast, 16 * slow)
    assert slow[0] == pytest.approx((900 / USUAL_ROOT) ** 2)
    assert slow[3] == pytest.approx((900 / USUAL_JOINT) ** 2)


def test_residuals_of_frames_are_those_of_the_pairs_on_both_sides() -> None:
    evidence = no_evidence(views=2, frames=3, parts=1)
    energy, weight = np.array([[4.0, 0.0], [12.0, 0.0]]), np.array([[1.0, 2.0], [3.0, 2.0]])
    evidence = replace(evidence, gradients=replace(evidence.gradients, energy=energy, weight=weight))
    np.testing.assert_allclose(frame_residual(evidence), [2.0, np.sqrt(16 / 8), 0.0])


def test_the_acceleration_that_is_weighed_is_that_of_the_motion() -> None:
    motion = swing(BODY, 6)
    motion.rotations[:, 1] = rotations.exp(np.linspace(0, 1, 6)[:, None] ** 2 * np.array([0, 0, 1.0]))
    precision = acceleration_precision(BODY, FPS, SETTINGS)
    problem = SegmentProblem(dark(CAMERAS[0], 6), (BODY,), 0, FPS, (ends_held(BODY, 6),))
    [system], evidence = systems(problem, motion)
    assert system.energy == pytest.approx(float(np.sum(precision * acceleration(motion) ** 2)))
    assert evidence.gradients.energy.max() < 1e-9


def test_a_joint_that_hardly_turns_is_accelerated_the_less() -> None:
    limits = np.array([[-np.pi / 2, np.pi / 2], [0.0, 0.0], [-np.pi / 8, np.pi / 8]])
    parts = (*BODY.parts[:2], replace(BODY.parts[2], limits=limits), BODY.parts[3])
    free, hinge = (acceleration_precision(b, FPS, SETTINGS) for b in (BODY, replace(BODY, parts=parts)))
    np.testing.assert_allclose(hinge[9:12] / free[9:12], [1, MIN_MOBILITY**-2, 16])
    np.testing.assert_array_equal(np.delete(hinge, range(9, 12)), np.delete(free, range(9, 12)))


def test_precision_may_differ_from_frame_to_frame() -> None:
    """The same on all frames, it is as one for all; on one frame more, that frame's acceleration counts more."""
    motion = random_motion(BODY, 8, turn=0.3)
    precision = np.random.default_rng(0).uniform(1, 2, D)
    problem = SegmentProblem((), (BODY,), 1, FPS, (ends_held(BODY, 6),), (motion[[0]],), (motion[[7]],))

    def smooth(precision: np.ndarray) -> BandedBlocks:
        return smooth_blocks(replace(problem, acceleration_precision=(precision,)), motion[1:7])

    one, each = smooth(precision), smooth(np.tile(precision, (6, 1)))
    np.testing.assert_allclose(each.diagonal, one.diagonal)
    np.testing.assert_allclose(each.gradient, one.gradient)
    more = np.tile(precision, (6, 1))
    more[2] *= 2
    gained = smooth(more).energy - one.energy
    assert gained == pytest.approx(float(np.sum(precision * acceleration(motion)[2] ** 2)))


@pytest.mark.parametrize("around", [False, True])
def test_accelerations_that_are_expected_cost_nothing(around: bool) -> None:
    motion = random_motion(BODY, 8, turn=0.3)
    precision = np.random.default_rng(0).uniform(1, 2, D)
    if around:
        problem = SegmentProblem((), (BODY,), 1, FPS, (ends_held(BODY, 6),), (motion[[0]],), (motion[[7]],))
        inner, expected = motion[1:7], acceleration(motion)
    else:
        problem, inner = SegmentProblem((), (BODY,), 0, FPS, (ends_held(BODY, 8),)), motion
        expected = np.pad(acceleration(motion), ((1, 1), (0, 0)))
    problem = replace(problem, acceleration_precision=(precision,))
    met = smooth_blocks(problem, inner, expected)
    assert met.energy == pytest.approx(0, abs=1e-20)
    np.testing.assert_allclose(met.gradient, 0, atol=1e-12)
    usual = smooth_blocks(problem, inner)
    assert usual.energy > 1
    np.testing.assert_array_equal(met.diagonal, usual.diagonal)
    nothing = smooth_blocks(problem, inner, np.zeros_like(expected))
    np.testing.assert_array_equal(nothing.gradient, usual.gradient)


def test_the_rows_of_hidden_parts_alone_are_dropped() -> None:
    V, F, P = 2, 5, len(BODY)
    rng = np.random.default_rng(0)
    evidence = no_evidence(V, F, P)
    evidence = replace(
        evidence,
        gradients=replace(
            evidence.gradients, H=rng.normal(0, 1, (V, F - 1, P, 12, 12)), g=rng.normal(0, 1, (V, F - 1, P, 12))
        ),
        outlines=replace(evidence.outlines, H=rng.normal(0, 1, (V, F, P, 6, 6)), g=rng.normal(0, 1, (V, F, P, 6))),
    )
    hidden = np.zeros((F, P), bool)
    hidden[2, 1] = True
    left = evidence.without(hidden)
    for sums, frames in (("gradients", [1, 2]), ("outlines", [2])):
        for name in ("H", "g"):
            before, after = (getattr(getattr(e, sums), name) for e in (evidence, left))
            assert not after[:, frames, 1].any()
            before = before.copy()
            before[:, frames, 1] = 0
            np.testing.assert_array_equal(after, before)
    np.testing.assert_array_equal(left.share, evidence.share)
    problem = SegmentProblem(dark(CAMERAS[0], F) * V, (BODY,), 0, FPS, (ends_held(BODY, F),))
    pairs = [WeightedEvidence.of(problem, *of).paired_sums([0, 1]) for of in ((evidence, [hidden]), (left,))]
    for masked, removed in zip(*pairs, strict=True):
        np.testing.assert_array_equal(masked, removed)
    nowhere = evidence.without(np.zeros((F, P), bool))
    np.testing.assert_array_equal(nowhere.gradients.H, evidence.gradients.H)


def test_a_part_is_hidden_where_no_view_sees_it_and_no_key_pose_holds_it() -> None:
    share = np.ones((2, 6, len(BODY)))
    share[:, 2:5, 1] = 0.1  # neither view sees the upper arm
    share[0, 1:4, 3] = 0.1  # one view sees the right arm
    fixed = ends_held(BODY, 6)
    fixed[3, 6:9] = True
    [hidden] = hidden_parts(SegmentProblem((), (BODY,), 0, FPS, (fixed,)), share)
    expected = np.zeros((6, len(BODY)), bool)
    expected[[2, 4], 1] = True
    np.testing.assert_array_equal(hidden, expected)


HIDDEN = slice(30, 42)
FOREARM = slice(9, 12)


def unseen_forearm(_problem: SegmentProblem, share: np.ndarray) -> np.ndarray:
    """No view sees the forearm while it is hidden."""
    share = np.ones_like(share)
    share[:, HIDDEN, BODY.index("forearm.L")] = 0
    return share


def waving(frames: int) -> Motion:
    """The forearm swings to and fro three times while the upper arm rises and falls."""
    t, motion = np.arange(frames), at_rest(BODY, frames)
    zero = np.zeros(frames)
    motion.rotations[:, 1] = rotations.exp(np.stack([zero, zero, 0.25 * np.sin(2 * np.pi * t / 30)], axis=1))
    motion.rotations[:, 2] = rotations.exp(np.stack([zero, zero, 0.4 * np.sin(2 * np.pi * (t - 30) / 24)], axis=1))
    return motion


def forearm_mm(found: Motion, truth: Motion) -> np.ndarray:
    a, b = (landmark_positions(BODY, m, ["forearm.L tip"])[:, 0] for m in (found, truth))
    return 1000 * np.linalg.norm(a - b, axis=1)


def test_a_part_that_nobody_sees_moves_as_predicted() -> None:
    """Hidden for 12 frames while it swings out and back; the frames beside them are known."""
    F = 72
    truth = waving(F)
    free = np.zeros((F, D), bool)
    free[HIDDEN, FOREARM] = True
    gap = np.linspace(0, 1, 14)[1:-1, None] * truth[[29]].difference(truth[[42]])
    start = truth.replaced(30, stacked([truth[[29]]] * 12).moved(gap))
    start = truth.moved(np.where(free, truth.difference(start), 0.0))
    errors = {}
    for prediction in (True, False):
        settings = replace(SETTINGS, prediction=prediction)
        problem = SegmentProblem(dark(CAMERAS[0], F), (BODY,), 0, FPS, (~free,), settings=settings)
        found = gauss_newton.descend(problem, [start], with_share(unseen_forearm))
        errors[prediction] = forearm_mm(found.motions[0], truth)
    assert forearm_mm(start, truth).max() > 100
    assert errors[True].max() < 30 and errors[True].max() < 0.7 * errors[False].max()


def test_where_a_part_is_seen_nothing_is_expected_of_it() -> None:
    motion = waving(72)
    hidden = np.zeros((72, len(BODY)), bool)
    hidden[HIDDEN, BODY.index("forearm.L")] = True
    [expected] = segment_equations.predicted_accelerations([motion], [hidden], [0])
    found = expected[HIDDEN, FOREARM]
    true = np.pad(acceleration(motion), ((1, 1), (0, 0)))[HIDDEN, FOREARM]
    assert np.abs(found - true).max() < 0.4 * np.abs(true).max()
    expected[HIDDEN, FOREARM] = 0
    assert not expected.any()
    [none] = segment_equations.predicted_accelerations([motion], [np.zeros_like(hidden)], [0])
    assert not none.any() and none.shape == (72, D)


def test_views_take_turns_and_are_never_fewer_than_asked() -> None:
    def turns(count: int) -> list[list[int]]:
        problem = SegmentProblem(tuple(range(count)), (BODY,), 0, FPS, (ends_held(BODY, 5),))
        return [list(view_subset(problem, 2, turn).views) for turn in range(3)]

    assert turns(1) == [[0]] * 3 and turns(3) == [[0, 1, 2]] * 3
    assert turns(4) == [[0, 2], [1, 3], [0, 2]]
    assert turns(5) == [[0, 2, 4], [1, 3], [0, 2, 4]]
    for count in range(2, 12):
        assert min(len(views) for views in turns(count)) >= 2


def test_more_views_have_fewer_pixels_each() -> None:
    fine, coarse = (DescentStage(Sampling(1.0, 1.0, stride), 1) for stride in (2, 6))
    assert [fine.sampling_of(views).stride for views in (1, 2, 3, 4, 9)] == [2, 2, 3, 4, 4]
    assert [coarse.sampling_of(views).stride for views in (1, 4)] == [6, 6]


@pytest.mark.parametrize("stages", [POLISH, POLISHED_AT_ONCE])
def test_the_last_steps_use_as_many_pixels_of_each_of_many_views_as_of_one(stages: tuple[DescentStage, ...]) -> None:
    assert stages[-1].sampling_of(8) == stages[-1].sampling_of(1)


def test_what_is_returned_was_measured_at_the_motions_that_are_returned() -> None:
    truth = swing(BODY, 6, 0.2)
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, 6),))
    found = gauss_newton.descend(problem, [stacked([truth[[0]]] * 5 + [truth[[5]]])], Workspace())
    sampling = STAGES[-1].sampling_of(2)
    measured = Workspace().measure(problem, found.motions, sampling)
    np.testing.assert_array_equal(found.explained, measured.evidence.explained.sum(axis=0))
    np.testing.assert_array_equal(found.share, measured.evidence.share)
    hidden = hidden_parts(problem, measured.evidence.share)
    assert not any(mask.any() for mask in hidden)
    [system] = with_smoothness(problem, measured, hidden)
    # All gradients are zero here: the noise makes no difference to the cost.
    assert found.energy[-1] == pytest.approx(system.energy)


def test_the_covariance_of_every_pose_can_be_had() -> None:
    F = 9
    truth = swing(BODY, F, 0.2)
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, F),))
    [system], _ = systems(problem, gauss_newton.descend(problem, [truth], Workspace()).motions[0])
    factor = BandedFactor(system, problem.fixed[0])
    assert not factor.covariance(0).any() and not factor.covariance(F - 1).any()
    sigmas = []
    for f in range(1, F - 1):
        C = factor.covariance(f)
        assert C.shape == (D, D)
        np.testing.assert_allclose(C, C.T, atol=1e-9 * np.abs(C).max())
        assert np.linalg.eigvalsh(C).min() > 0
        sigmas.append(np.sqrt(np.diag(C)).mean())
    assert max(sigmas) > sigmas[0] and max(sigmas) > sigmas[-1]  # surest beside the key poses


def test_a_step_of_the_last_stage_that_raises_the_cost_is_refused() -> None:
    """Whether steps go four times too far or the wrong way: they are shortened until they gain, or not taken."""
    truth = swing(BODY, 6, 0.2)
    bow = np.sin(np.pi * np.arange(6) / 5)[:, None]
    wrong = truth.moved(0.05 * bow * np.random.default_rng(1).normal(0, 1, D))
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS), (BODY,), 0, 12.0, (ends_held(BODY, 6),))

    def misled(factor: float) -> AlteredWorkspace:
        def alter(_: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
            outlines = measured.evidence.outlines
            return replace(
                measured, evidence=replace(measured.evidence, outlines=replace(outlines, g=factor * outlines.g))
            )

        return AlteredWorkspace(alter=alter)

    for factor in (1.0, 4.0, -1.0):
        found = gauss_newton.descend(problem, [wrong], misled(factor), CONVERGED)
        assert all(b <= a for a, b in pairwise(found.energy))
        assert factor != 1 or found.energy[-1] < 0.5 * found.energy[0]


def test_costs_under_one_noise_are_those_of_the_same_problem() -> None:
    """The noise at a wrong motion is more than at the true one: under its own, each seems as good as it can be."""
    truth = swing(BODY, 6, 0.15)
    problem = SegmentProblem(filmed(truth), (BODY,), 0, 12.0, (ends_held(BODY, 6),))
    stages = (replace(CONVERGED[0], iterations=1),)
    noise = segment_equations.SegmentNoise.of(
        Workspace().measure(problem, [truth], stages[0].sampling_of(2)).evidence, SETTINGS
    )
    bow = np.sin(np.pi * np.arange(6) / 5)[:, None]
    wrong = truth.moved(0.03 * bow * np.random.default_rng(1).normal(0, 1, D))
    under_one, under_own = (
        [gauss_newton.descend(problem, [m], Workspace(), stages, n).energy[0] for m in (truth, wrong)]
        for n in (noise, None)
    )
    assert under_one[0] == pytest.approx(under_own[0])
    assert under_one[1] / under_one[0] > 1.5 * under_own[1] / under_own[0]


@pytest.mark.parametrize(("tolerance", "by_part"), [(4.0, False), (1.0, False), (1.0, True)])
def test_frames_with_more_noise_count_less_near_the_solution(tolerance: float, by_part: bool) -> None:
    """A fast frame is blurred. Far from the solution its residuals are large because its pose is wrong: there all
    frames of a view count the same.
    """
    made = no_evidence(2, 6, len(BODY))
    noise = np.full((2, 5, 1 + len(BODY)), 0.01)
    noise[1, 3] = 0.04
    gradients = replace(made.gradients, noise=noise, density=np.full((2, 5), 1e4))
    sampling = replace(made.sampling, tolerance=tolerance, by_part=by_part)
    precision = segment_equations.pixel_precision(replace(made, gradients=gradients, sampling=sampling), SETTINGS)
    others = np.delete(precision.ravel(), 8)
    whole = replace(made, gradients=gradients, sampling=replace(sampling, by_part=False))
    alone = segment_equations.pixel_precision(whole, SETTINGS)[0, 0]
    assert others[0] == pytest.approx((BY_PART_SHARE if by_part else 1) * alone)
    np.testing.assert_allclose(others, others[0])
    assert precision[1, 3] == pytest.approx(others[0] / (1 if tolerance > 1 else 16))


def test_gradients_favour_following_a_moving_limb_and_are_neutral_about_one_that_stands_still() -> None:
    """An arm swings: one that is followed is worth what it would cost if it stood still, one at rest aside nothing."""
    frames = 6
    turns = np.zeros((frames, D))
    turns[:, 3 + 3 * BODY.index("upper_arm.L")] = np.linspace(-0.6, 0.6, frames)
    truth, aside = (at_rest(BODY, frames).moved(turn) for turn in (turns, np.tile(3 * turns[-1], (frames, 1))))
    problem = SegmentProblem(filmed(truth), (BODY,), 0, 12.0, (ends_held(BODY, frames),))
    sampling = CONVERGED[0].sampling_of(2)
    noise = segment_equations.SegmentNoise.of(Workspace().measure(problem, [truth], sampling).evidence, SETTINGS)
    followed, still = (
        Workspace().measure(problem, [m], sampling, noise.sigma).evidence.gradients for m in (truth, aside)
    )
    np.testing.assert_allclose(still.gain, 0, atol=1e-9)
    assert (followed.gain.sum(axis=1) > (followed.cost * followed.count).sum(axis=1)).all()


def arm_to_be_turned() -> tuple[Motion, NDArray[np.float64], SegmentProblem, Landscape]:
    """A body at rest, a turn of its arm between the first and the last frame, and a problem whose energy is least at
    rest.
    """
    truth, turn = at_rest(BODY, 5), np.zeros((5, D))
    turn[1:-1, 3 * BODY.index("upper_arm.L") + 3] = 1.0
    problem = SegmentProblem((), (BODY,), 0, FPS, (ends_held(BODY, 5),))
    return truth, turn, problem, Landscape(truth=truth, reach=np.pi)


def test_the_last_stage_continues_while_a_joint_still_moves() -> None:
    truth, turn, problem, landscape = arm_to_be_turned()
    once = (replace(CONVERGED[0], iterations=1),)
    for share, least in ((4.0 * MAX_STEP, 4), (0.001, 1)):
        found = gauss_newton.descend(problem, [truth.moved(share * turn)], landscape, once)
        assert found.iterations >= least and (least > 1 or found.iterations == 1)
        assert np.abs(found.motions[0].difference(truth)).max() < 0.05


def test_a_refinement_ends_once_a_step_leaves_all_joints_nearly_still() -> None:
    truth, turn, problem, landscape = arm_to_be_turned()
    (stage,) = REFINEMENT
    on = (replace(stage, small=0.0, still=0.0),)
    for angle in (0.004, 0.2):
        start = [truth.moved(angle * turn)]
        far = farthest_joint(problem, start, [truth])
        assert (far < MIN_JOINT_MOVE) == (angle < 0.1)
        found, further = (gauss_newton.descend(problem, start, landscape, stages) for stages in ((stage,), on))
        assert found.iterations < further.iterations
        assert farthest_joint(problem, found.motions, further.motions) < MIN_JOINT_MOVE


def test_nothing_is_polished_while_a_joint_still_moves_far() -> None:
    """A limb that is far off would pass for one with much noise, and stay there."""
    truth, turn, problem, landscape = arm_to_be_turned()
    start = [truth.moved(1.0 * turn)]
    found = gauss_newton.descend(problem, start, landscape, POLISHED_AT_ONCE)
    polished = [motion for motion, by_part in zip(landscape.measured, landscape.by_part, strict=True) if by_part]
    assert farthest_joint(problem, start, polished[:1]) > 10 * UNCONVERGED_MOVE
    assert farthest_joint(problem, polished[:1], found.motions) < UNCONVERGED_MOVE


@pytest.mark.parametrize("coarse_steps", [6, 1])
def test_only_the_last_stage_of_a_refinement_is_repeated_and_only_if_it_moves_far(coarse_steps: int) -> None:
    """The stage before it has another noise, and leads away from where it ended."""
    truth, turn, problem, landscape = arm_to_be_turned()
    coarse, polish = POLISHED_AT_ONCE
    stages = (replace(coarse, iterations=coarse_steps), replace(polish, iterations=1))
    start = [truth.moved(3.0 * MAX_STEP * turn)]
    once = gauss_newton.descend(problem, start, landscape, stages)
    assert (once.moved.max() > UNCONVERGED_MOVE) == (coarse_steps == 1)
    stages_once = list(landscape.by_part)
    landscape.by_part.clear()
    gauss_newton.refine(problem, start, landscape, stages)
    assert landscape.by_part.count(False) == stages_once.count(False)
    assert (landscape.by_part.count(True) > stages_once.count(True)) == (coarse_steps == 1)


@pytest.mark.parametrize("stages", [POLISH, RESUMED])
def test_a_polish_and_a_correction_end_before_a_step_that_hardly_moves_any_joint(stages: tuple[DescentStage]) -> None:
    truth, turn, problem, landscape = arm_to_be_turned()
    for angle in (0.004, 0.2):
        start = [truth.moved(angle * turn)]
        landscape.measured.clear()
        found = gauss_newton.descend(problem, start, landscape, stages)
        left = farthest_joint(problem, found.motions, [truth])
        if angle < 0.1:
            assert found.motions[0] is start[0] and len(landscape.measured) == 1
        else:
            assert left < stages[-1].negligible < farthest_joint(problem, start, found.motions)


def test_a_descent_continues_where_its_coarse_stages_have_led_as_if_it_had_made_them() -> None:
    truth = swing(BODY, 6, 0.2)
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, 6),))
    start = [stacked([truth[[0]]] * 5 + [truth[[5]]])]
    at_once = gauss_newton.descend(problem, start, Workspace(), STAGES)
    begun = approach(problem, start, Workspace(), COARSE_STAGES)
    continued = gauss_newton.descend(problem, begun, Workspace(), FINE_STAGES)
    uncounted = gauss_newton.descend(problem, begun.counted(), Workspace(), FINE_STAGES)
    for found in (continued, uncounted):
        np.testing.assert_array_equal(found.motions[0].rotations, at_once.motions[0].rotations)
        np.testing.assert_array_equal(found.motions[0].translations, at_once.motions[0].translations)
    assert continued.energy == at_once.energy and continued.iterations == at_once.iterations
    assert uncounted.energy == at_once.energy[len(begun.energies) :]
    assert uncounted.iterations == at_once.iterations - len(begun.energies)


@pytest.mark.parametrize("stages", [REFINEMENT, POLISH, RESUMED])
def test_an_end_of_a_limb_that_still_turns_far_is_not_left_though_all_joints_stay(stages: tuple[DescentStage]) -> None:
    truth, turn, problem, landscape = arm_to_be_turned()
    problem = replace(problem, views=dark(CAMERAS[0], 5) * 2)
    turn = np.roll(turn, 3 * (BODY.index("forearm.L") - BODY.index("upper_arm.L")), axis=1)
    for angle in (0.03, 1.0):
        start = [truth.moved(angle * turn)]
        assert farthest_joint(problem, start, [truth]) < 1e-9
        found = gauss_newton.descend(problem, start, landscape, (replace(stages[-1], small=0.0),))
        if angle == 1.0:
            assert np.abs(found.motions[0].difference(truth)).max() < 0.1
        elif stages[-1].negligible:
            assert found.motions[0] is start[0]


def test_in_a_single_view_only_joints_keep_a_stage_from_its_end() -> None:
    """It hardly shows how a hand turns, and limbs drift in depth with every step."""
    truth, turn, problem, _ = arm_to_be_turned()
    hand = np.roll(turn, 3 * (BODY.index("forearm.L") - BODY.index("upper_arm.L")), axis=1)
    for views, moved, resting in ((2, hand, False), (1, hand, True), (1, turn, False)):
        seen = replace(problem, views=dark(CAMERAS[0], 5) * views)
        assert at_rest_within(seen, [truth], [truth.moved(moved)], MIN_JOINT_MOVE) == resting


def test_coarse_stages_end_early_and_the_last_looks_at_every_view() -> None:
    truth = swing(BODY, 5, 0.2)
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS) * 2, (BODY,), 0, FPS, (ends_held(BODY, 5),))
    looked: list[tuple[int, float]] = []

    def note(problem: SegmentProblem, measured: MeasuredMotion) -> MeasuredMotion:
        looked.append((len(problem.views), measured.evidence.sampling.tolerance))
        return measured

    gauss_newton.descend(problem, [truth], AlteredWorkspace(alter=note))
    assert looked[0] == (2, 8.0) and looked[-1] == (4, 1.0)
    assert [views for views, _ in looked].count(2) < sum(stage.iterations for stage in STAGES[:-1])
