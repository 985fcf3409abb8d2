"""With a single camera, movement across the line of sight is expected to be faster than movement in depth."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import part_poses
from kfmocap.core.body.acceleration_by_sight import ACROSS_RATIO, precision_by_sight
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.smoothness import SecondDifferences, smoothness
from kfmocap.core.body.smoothness_estimate import axis_mobility, group_sizes
from kfmocap.core.shot.acceleration_prior import usual_variances
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers.equations.problem import AccelerationSearch, SegmentProblem
from kfmocap.core.tracking.solvers.equations.smoothness_factor import SegmentSmoothness
from synthetic import at_rest, dark, figure, look_at, numeric_jacobian, random_motion

BODY = figure()
FRAMES = 5
EYE = np.array([0.0, -4.0, 1.0])
RATIO = 3.0


def cost(precision: np.ndarray, turn: np.ndarray, part: int) -> float:
    """Cost of a part's acceleration, given in the world, at rest on the frame in the middle."""
    R = part_poses(BODY, at_rest(BODY))[0][0, part]
    own = R.T @ turn
    return float(own @ precision[FRAMES // 2, 1 + part] @ own)


@pytest.mark.parametrize("part", range(len(BODY)))
def test_a_part_may_turn_faster_across_the_line_of_sight_than_in_depth(part: int) -> None:
    motion = at_rest(BODY, FRAMES)
    precision = precision_by_sight(np.ones((FRAMES, BODY.dof)), BODY, motion, np.tile(EYE, (FRAMES, 1)), RATIO)
    T = part_poses(BODY, at_rest(BODY))[1][0, part]
    along = BODY.parts[part].tail_world - BODY.parts[part].head_world
    along /= np.linalg.norm(along)
    sight = (T - EYE) / np.linalg.norm(T - EYE)
    in_depth = np.cross(along, sight)
    length = np.linalg.norm(in_depth)
    in_depth /= length
    assert cost(precision, along, part) == pytest.approx(1.0)
    assert cost(precision, np.cross(along, in_depth), part) == pytest.approx(RATIO**-2)
    assert cost(precision, in_depth, part) == pytest.approx(RATIO**-2 + (1 - RATIO**-2) * length**2)


def test_the_root_may_be_accelerated_more_across_the_line_of_sight() -> None:
    motion = at_rest(BODY, FRAMES)
    precision = precision_by_sight(np.ones((FRAMES, BODY.dof)), BODY, motion, np.tile(EYE, (FRAMES, 1)), RATIO)[:, 0]
    sight = part_poses(BODY, motion)[1][0, 0] - EYE
    np.testing.assert_allclose(precision @ sight, np.tile(sight, (FRAMES, 1)), atol=1e-12)
    across = np.cross(sight, [0.0, 0.0, 1.0])
    np.testing.assert_allclose(precision @ across, np.tile(RATIO**-2 * across, (FRAMES, 1)), atol=1e-12)


def test_a_ratio_of_one_changes_nothing() -> None:
    motion = random_motion(BODY, 7, turn=0.2)
    weights = np.random.default_rng(0).uniform(1, 9, (5, BODY.dof))
    by_sight = precision_by_sight(weights, BODY, motion[1:-1], np.tile(EYE, (5, 1)), 1.0)
    one, other = smoothness(motion, weights), smoothness(motion, by_sight)
    assert one.energy == pytest.approx(other.energy)
    for name in ("diagonal", "first", "second", "gradient"):
        np.testing.assert_allclose(getattr(other, name), getattr(one, name), atol=1e-9)


def test_the_gradient_is_that_of_the_energy() -> None:
    motion = random_motion(BODY, 5, seed=5, turn=0.1)
    weights = precision_by_sight(np.ones((3, BODY.dof)), BODY, motion[1:-1], np.tile(EYE, (3, 1)), RATIO)

    def energy(step: np.ndarray) -> np.ndarray:
        return np.array([smoothness(motion.moved(step.reshape(5, -1)), weights).energy / 2])

    gradient = numeric_jacobian(energy, np.zeros(5 * BODY.dof))[0].reshape(5, -1)
    np.testing.assert_allclose(smoothness(motion, weights).gradient, gradient, atol=1e-6)


def leaning(axis: np.ndarray) -> Motion:
    """The trunk leans about an axis of the world for a moment."""
    delta = np.zeros((FRAMES, BODY.dof))
    delta[FRAMES // 2, 3:6] = 0.1 * BODY.parts[0].R_world_rest.T @ axis
    return at_rest(BODY, FRAMES).moved(delta)


@pytest.mark.parametrize(
    ("views", "search", "faster"),
    [
        (1, AccelerationSearch.SCALE_THEN_JOINTS, False),
        (1, AccelerationSearch.KEPT, True),
        (1, AccelerationSearch.JOINTS, False),
        (2, AccelerationSearch.KEPT, False),
    ],
)
def test_settled_accelerations_are_larger_across_the_line_of_sight_of_a_single_view(
    views: int, search: AccelerationSearch, faster: bool
) -> None:
    camera = look_at("front", EYE, (0.0, 0.0, 1.0))
    usual = usual_variances(BODY, 30.0, Settings())
    problem = SegmentProblem(
        dark(camera, FRAMES) * views,
        (BODY,),
        0,
        30.0,
        (np.zeros((FRAMES, BODY.dof), bool),),
        typical_variances=(usual,),
        search=search,
    )
    smooth = SegmentSmoothness.start(problem)
    precision = 1 / np.repeat(usual, group_sizes(BODY.dof)) / axis_mobility(BODY) ** 2
    for axis, ratio in (([0.0, 1.0, 0.0], ACROSS_RATIO), ([1.0, 0.0, 0.0], 1.0)):
        motion = leaning(np.array(axis))
        known = float(np.sum(precision * SecondDifferences.of(motion).values ** 2))
        found = smooth.blocks(problem, 0, motion).energy
        assert found == pytest.approx(known / (ratio**2 if faster else 1.0), rel=0.1)
