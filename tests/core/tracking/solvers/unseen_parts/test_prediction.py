"""Prediction of parts that no camera sees: the model of a series, what it foretells, and motion across gaps."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.keypose_spline import spline
from kfmocap.core.shot.shot import KeyPoses
from kfmocap.core.tracking.solvers.unseen_parts.prediction import (
    FILTER_STEPS,
    MAX_ORDER,
    autocovariance,
    autoregression,
    levinson,
    observation_noise,
    predict,
    predict_unseen,
)
from render.motions import MOTIONS
from scipy.linalg import solve_toeplitz
from synthetic import at_rest, figure, random_motion, swing

FPS = 30.0


def noisy_waves(samples: int, seed: int = 0) -> np.ndarray:
    t, rng = np.arange(samples), np.random.default_rng(seed)
    return np.sin(0.3 * t) + 0.4 * np.sin(0.71 * t + 1) + 0.05 * rng.normal(size=samples)


@pytest.mark.parametrize("order", [1, 2, 5, 12])
def test_levinson_solves_the_toeplitz_equations(order: int) -> None:
    r = autocovariance([noisy_waves(80)], order)
    a, variance = levinson(r)
    np.testing.assert_allclose(a, solve_toeplitz(r[:-1], r[1:]), rtol=1e-8, atol=1e-10)
    assert variance == pytest.approx(r[0] - a @ r[1:])


def test_levinson_stops_where_the_series_is_predicted_exactly() -> None:
    a, variance = levinson(np.cos(0.4 * np.arange(6)))  # y_j = 2 cos(0.4) y_{j-1} - y_{j-2}
    np.testing.assert_allclose(a, [2 * np.cos(0.4), -1], atol=1e-9)
    assert abs(variance) < 1e-9


def test_the_model_of_a_series_is_the_one_that_made_it() -> None:
    rng, y = np.random.default_rng(1), np.zeros(20000)
    for j in range(2, len(y)):
        y[j] = 1.6 * y[j - 1] - 0.8 * y[j - 2] + 0.1 * rng.normal()
    model = autoregression([y[:9000], y[9000:]], order=2)
    np.testing.assert_allclose(model.coefficients, [1.6, -0.8], atol=0.02)
    assert model.variance == pytest.approx(0.01, rel=0.03)


def test_runs_are_not_joined_across_their_gap() -> None:
    runs = [np.array([1.0, 2.0, 3.0]), np.array([-4.0, 5.0])]
    np.testing.assert_allclose(autocovariance(runs, 2), [55 / 5, (2 + 6 - 20) / 5, 3 / 5])


def test_observation_noise_is_that_of_the_poses_and_not_the_motion() -> None:
    rng, t = np.random.default_rng(2), np.arange(4000)
    poses = np.sin(2 * np.pi * t / 30) + rng.normal(0, 0.01, len(t))
    assert observation_noise([np.diff(poses)]) == pytest.approx(2 * 0.01**2, rel=0.15)


def test_prediction_is_the_recursion_of_the_model_and_its_variance() -> None:
    y = noisy_waves(60)
    model = autoregression([y], order=2)
    exact = type(model)(model.coefficients, model.variance, 1e-14, model.covariance)
    mean, variance = predict(y[:, None], 3, [exact])
    a1, a2 = model.coefficients
    one = a1 * y[-1] + a2 * y[-2]
    two = a1 * one + a2 * y[-1]
    np.testing.assert_allclose(mean[:, 0], [one, two, a1 * two + a2 * one], atol=1e-9)
    gains = [1, a1, a1**2 + a2]
    np.testing.assert_allclose(variance[:, 0], model.variance * np.cumsum(np.square(gains)), rtol=1e-6)


def test_where_nothing_was_seen_the_series_varies_as_ever() -> None:
    model = autoregression([noisy_waves(60)])
    mean, variance = predict(np.zeros((0, 1)), 4, [model])
    np.testing.assert_allclose(mean, 0)
    np.testing.assert_allclose(variance[:, 0], model.covariance[0], rtol=1e-6)


def test_noise_that_is_observed_is_not_predicted() -> None:
    y = np.zeros((40, 1))
    y[:-1, 0], y[-1] = noisy_waves(39), 30.0  # the last one is an outlier
    model = autoregression([y[:-1, 0]])
    trusting, doubting = (
        predict(y, 1, [type(model)(model.coefficients, model.variance, noise, model.covariance)])[0][0, 0]
        for noise in (1e-12, 1e3)
    )
    assert abs(doubting) < 0.1 * abs(trusting)


def test_a_periodic_motion_goes_on_while_it_is_hidden() -> None:
    t = np.arange(132)
    y = np.stack([np.sin(2 * np.pi * t / 30), 0.5 * np.cos(2 * np.pi * t / 22)], axis=1)
    mean, variance = predict(y[:120], 12)
    assert np.abs(mean - y[120:]).max() < 0.2
    assert (np.diff(variance, axis=0) > 0).all()


@pytest.mark.parametrize("samples", range(8))
@pytest.mark.parametrize("value", [0.0, 0.3])
def test_short_and_constant_series_are_predicted_without_failure(samples: int, value: float) -> None:
    mean, variance = predict(np.full((samples, 2), value), 5)
    assert mean.shape == variance.shape == (5, 2)
    assert (variance > 0).all()
    assert (np.abs(mean) <= abs(value) + 1e-9).all()


def hidden(motion: Motion, parts: list[int], first: int, last: int) -> np.ndarray:
    mask = np.zeros(motion.rotations.shape[:2], dtype=bool)
    mask[first : last + 1, parts] = True
    return mask


def test_seen_frames_and_other_parts_stay_as_they_are() -> None:
    motion = swing(figure(), 40)
    mask = hidden(motion, [2], 12, 20)
    filled = predict_unseen(motion, mask)
    np.testing.assert_array_equal(filled.rotations[~mask], motion.rotations[~mask])
    np.testing.assert_array_equal(filled.translations, motion.translations)


def test_what_stood_in_the_gap_does_not_count() -> None:
    motion, noise = swing(figure(), 40), random_motion(figure(), 40, seed=5)
    mask = hidden(motion, [0, 2], 12, 18) | hidden(motion, [0, 2], 22, 26)
    Q = np.where(mask[..., None, None], noise.rotations, motion.rotations)
    T = np.where(mask[:, :1], noise.translations, motion.translations)
    ours, theirs = predict_unseen(motion, mask), predict_unseen(Motion(T, Q), mask)
    np.testing.assert_array_equal(ours.rotations, theirs.rotations)
    np.testing.assert_array_equal(ours.translations, theirs.translations)


def test_gaps_that_changed_poses_do_not_reach_stay_as_they_were_filled() -> None:
    """Following a motion fills the same gaps again and again: only what lies at the end of it changes."""
    motion = swing(figure(), 90)
    mask = hidden(motion, [1], 12, 18) | hidden(motion, [1], 70, 75)
    every, late = predict_unseen(motion, mask), predict_unseen(motion, mask, since=18 + FILTER_STEPS + 2)
    np.testing.assert_array_equal(late.rotations[:40], motion.rotations[:40])
    np.testing.assert_array_equal(late.rotations[40:], every.rotations[40:])
    np.testing.assert_array_equal(predict_unseen(motion, mask, since=18 + FILTER_STEPS + 1).rotations, every.rotations)


def test_a_part_that_is_never_seen_is_left_alone() -> None:
    motion = swing(figure(), 20)
    filled = predict_unseen(motion, hidden(motion, [1], 0, 19))
    np.testing.assert_array_equal(filled.rotations, motion.rotations)


def test_reversed_time_gives_the_reversed_motion() -> None:
    motion = swing(figure(), 50, seed=3).moved(np.random.default_rng(4).normal(0, 0.01, (50, figure().dof)))
    mask = hidden(motion, [0, 3], 15, 24) | hidden(motion, [1], 30, 49) | hidden(motion, [3], 40, 44)
    there, back = predict_unseen(motion, mask), predict_unseen(motion[::-1], mask[::-1])[::-1]
    # Of two turns, that from the one to the other in unequal parts is the reverse only to the second order.
    np.testing.assert_allclose(there.rotations, back.rotations, atol=1e-3)
    np.testing.assert_allclose(there.translations, back.translations, atol=1e-9)


def test_a_root_that_walks_on_while_hidden_keeps_its_pace() -> None:
    rest = at_rest(figure(), 40)
    walking = Motion(rest.translations + 0.04 * np.arange(40)[:, None] * [1, 0, 0], rest.rotations)
    filled = predict_unseen(walking, hidden(walking, [0], 25, 39))
    np.testing.assert_allclose(filled.translations, walking.translations, atol=1e-6)


def test_a_single_seen_frame_is_held() -> None:
    motion = random_motion(figure(), 6)
    filled = predict_unseen(motion, hidden(motion, [1], 1, 5))
    np.testing.assert_allclose(filled.rotations[:, 1], np.tile(motion.rotations[0, 1], (6, 1, 1)), atol=1e-9)


def test_near_each_end_of_a_gap_that_end_has_the_say() -> None:
    """A part that stood still before and after, elsewhere: of the way between, each frame has its share."""
    rest = at_rest(figure(), 60)
    turned = rest.rotations.copy()
    turned[30:, 1] = rotations.exp(np.array([0.0, 0.0, 1.0]))
    motion = Motion(rest.translations, turned).moved(np.random.default_rng(6).normal(0, 1e-4, (60, figure().dof)))
    filled = predict_unseen(motion, hidden(motion, [1], 26, 34))
    angle = rotations.log(filled.rotations[26:35, 1])[:, 2]
    np.testing.assert_allclose(angle, np.arange(1, 10) / 10, atol=0.05)


LIMBS = {"walk": (["upper_arm.R", "forearm.R", "hand.R"], ["thigh.R", "shin.R", "foot.R"]),
         "whirl": (["upper_arm.L", "forearm.L", "hand.L"],)}  # fmt: skip


def gaps(length: int, until_the_end: bool) -> list[tuple[str, Motion, list[int], int, int]]:
    body, cases = human(), []
    for name, limbs in LIMBS.items():
        truth = MOTIONS[name](body, 97, FPS)
        for limb in limbs:
            for first in (30, 38, 46, 54):
                last = first + length - 1
                motion = truth[: last + 1] if until_the_end else truth
                cases.append((name, motion, [body.index(part) for part in limb], first, last))
    return cases


def joint_error(found: Motion, truth: Motion, parts: list[int], first: int, last: int) -> float:
    """Mean distance of the limb's inner joints and its outermost part's place, millimetres."""
    T, T_true = (part_poses(human(), motion)[1][first : last + 1, parts[1:]] for motion in (found, truth))
    return 1000 * float(np.linalg.norm(T - T_true, axis=-1).mean())


def through_seen_frames(motion: Motion, mask: np.ndarray) -> Motion:
    seen = np.flatnonzero(~mask.any(axis=1))
    return spline(KeyPoses.whole(seen, motion[seen]), len(motion))


def held(motion: Motion, mask: np.ndarray) -> Motion:
    last = int(np.flatnonzero(~mask.any(axis=1))[-1])
    return Motion(motion.translations, np.where(mask[..., None, None], motion.rotations[last], motion.rotations))


@pytest.mark.parametrize("length", [6, 11, 16])
def test_across_a_gap_a_limb_is_predicted_better_than_by_a_spline(length: int) -> None:
    errors = []
    for _, motion, parts, first, last in gaps(length, until_the_end=False):
        mask = hidden(motion, parts, first, last)
        errors.append([joint_error(fill(motion, mask), motion, parts, first, last)
                       for fill in (predict_unseen, through_seen_frames)])  # fmt: skip
    ours, theirs = np.mean(errors, axis=0)
    assert ours < 0.9 * theirs


def test_before_an_open_gap_a_limb_is_predicted_twice_as_well_as_by_holding_still() -> None:
    errors = []
    for _, motion, parts, first, last in gaps(12, until_the_end=True):
        mask = hidden(motion, parts, first, last)
        errors.append([joint_error(fill(motion, mask), motion, parts, first, last) for fill in (predict_unseen, held)])
    ours, theirs = np.mean(errors, axis=0)
    assert ours < 0.5 * theirs


def test_filled_poses_join_the_seen_ones() -> None:
    motion = MOTIONS["walk"](human(), 97, FPS)
    parts = [human().index(part) for part in LIMBS["walk"][1]]
    filled = predict_unseen(motion, hidden(motion, parts, 40, 51))
    step, true_step = (
        np.linalg.norm(rotations.log(np.swapaxes(m.rotations[:-1], -1, -2) @ m.rotations[1:]), axis=-1)[:, parts]
        for m in (filled, motion)
    )
    assert step[[39, 51]].max() < 1.3 * true_step[35:56].max()


def test_the_order_is_at_most_a_third_of_the_samples() -> None:
    assert len(autoregression([noisy_waves(100)]).coefficients) == MAX_ORDER
    assert len(autoregression([noisy_waves(10), noisy_waves(5)]).coefficients) == 5
    assert len(autoregression([noisy_waves(100)], order=4).coefficients) == 4
