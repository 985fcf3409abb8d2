"""Contact: performers who are in each other are pushed apart, and those who touch or hold hands are left alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.kinematics import scene_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded import BandedFactor
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot
from kfmocap.core.tracking.scheduling.segment_stages import SegmentData, segment_problem
from kfmocap.core.tracking.solvers.equations.contact_factor import FREE_DEPTH, ContactFactor
from kfmocap.core.tracking.track_state import TrackState

Array = np.ndarray
BODIES = (human(1.8), human(1.65))
FRAMES = 4
FACTOR = ContactFactor.of(Geometry.of(BODIES), BODIES)
FREE = tuple(np.zeros((FRAMES, body.dof), bool) for body in BODIES)


def side_by_side(apart: float) -> list[Motion]:
    """Two who stand with their arms hanging, one behind the other, a little turned on every frame."""
    motions = []
    for i, body in enumerate(BODIES):
        turns = np.random.default_rng(i).normal(0, 0.03, (FRAMES, len(body), 3))
        place = body.parts[0].head_world + i * np.array([0.1, apart, 0.0])
        motions.append(Motion(np.tile(place, (FRAMES, 1)), rotations.exp(turns)))
    return motions


def with_joint_at(motions: list[Motion], part: str, point: Array) -> list[Motion]:
    """The second performer moved as a whole until a joint of its is at a point (F, 3)."""
    joint = part_poses(BODIES[1], motions[1])[1][:, BODIES[1].index(part)]
    return [motions[0], replace(motions[1], translations=motions[1].translations + point - joint)]


def deepest(motions: list[Motion]) -> Array:
    """Return the largest depth by which the performers penetrate each other on each frame, metres, shape (F,)."""
    poses, found = scene_poses(BODIES, motions), np.zeros(FRAMES)
    for i, j in ((0, 1), (1, 0)):
        for part, other, near in FACTOR._near(poses, i, j):
            frames, depth, _ = FACTOR._deepest(poses, part, other, near)
            found[frames] = np.maximum(found[frames], depth)
    return found


def energy(motions: list[Motion]) -> float:
    return sum(blocks.energy for blocks in FACTOR.blocks(BODIES, scene_poses(BODIES, motions)))


@pytest.mark.parametrize("performer", [0, 1])
def test_its_gradient_is_the_slope_of_its_energy(performer: int) -> None:
    motions = side_by_side(0.14)
    assert deepest(motions).min() > FREE_DEPTH + 0.01
    way, step = np.random.default_rng(5).normal(0, 1, (FRAMES, BODIES[performer].dof)), 1e-6

    def moved(size: float) -> list[Motion]:
        return [m.moved(size * way) if i == performer else m for i, m in enumerate(motions)]

    slope = (energy(moved(step)) - energy(moved(-step))) / (2 * step)
    gradient = FACTOR.blocks(BODIES, scene_poses(BODIES, motions))[performer].gradient
    assert slope == pytest.approx(2 * float(np.sum(gradient * way)), rel=1e-4)


def test_performers_who_are_in_each_other_both_give_way() -> None:
    """Against a weak prior on the poses as they are."""
    begin = side_by_side(0.14)
    motions, sigma = begin, 0.2
    for _ in range(8):
        blocks = FACTOR.blocks(BODIES, scene_poses(BODIES, motions))
        for i, (body, own) in enumerate(zip(BODIES, blocks, strict=True)):
            precision = np.broadcast_to(np.eye(body.dof) / sigma**2, (FRAMES, body.dof, body.dof))
            pull = begin[i].difference(motions[i]) / sigma**2
            system = own + replace(BandedBlocks.zeros(FRAMES, body.dof), diagonal=precision, gradient=pull)
            motions[i : i + 1] = [motions[i].moved(-BandedFactor(system, FREE[i]).solve(system.gradient))]
    assert deepest(side_by_side(0.14)).min() > 0.045
    assert deepest(motions).max() < FREE_DEPTH + 0.005
    for before, after in zip(side_by_side(0.14), motions, strict=True):
        assert np.abs(before.difference(after)).max() > 0.005


@pytest.mark.parametrize("performer", [0, 1])
def test_who_is_given_is_not_pushed_and_who_is_solved_for_is_pushed_as_with_all(performer: int) -> None:
    poses = scene_poses(BODIES, side_by_side(0.14))
    both, alone = FACTOR.blocks(BODIES, poses), FACTOR.blocks(BODIES, poses, [performer])
    for name in ("diagonal", "first", "second", "gradient", "energy"):
        np.testing.assert_array_equal(getattr(alone[performer], name), getattr(both[performer], name))
        assert not np.any(getattr(alone[1 - performer], name))
    assert both[performer].energy > 1


def test_a_forearm_in_a_trunk_costs_and_one_beside_it_does_not() -> None:
    motions = side_by_side(0.6)
    assert energy(motions) == 0
    chest = part_poses(BODIES[0], motions[0])[1][:, BODIES[0].index("chest")]
    assert energy(with_joint_at(motions, "hand.L", chest)) > 1
    assert energy(with_joint_at(motions, "hand.L", chest + [0.0, -0.7, 0.0])) == 0


def test_hands_may_hold_each_other() -> None:
    motions = [replace(m, rotations=np.broadcast_to(np.eye(3), m.rotations.shape)) for m in side_by_side(0.6)]
    hand = BODIES[0].parts[BODIES[0].index("hand.L")]
    held = with_joint_at(motions, "hand.R", hand.tail_world + 0.02 * np.array([1.0, 0.0, 0.0]))
    assert deepest(held).min() > 0.01
    assert energy(held) == 0


@pytest.mark.parametrize(("count", "contact", "expected"), [(2, True, True), (2, False, False), (1, True, False)])
def test_the_setting_switches_it_off_and_one_alone_has_none(count: int, contact: bool, expected: bool) -> None:
    keys = KeyPoses.whole([0, FRAMES - 1], side_by_side(0.6)[0][[0, FRAMES - 1]])
    performers = tuple(Performer(body.names[0], body, keys) for body in BODIES[:count])
    shot = Shot("two", 30.0, (0, FRAMES - 1), (), performers, Settings(contact=contact))
    data = SegmentData((0, FRAMES - 1), (), FREE[:count])
    problem = segment_problem(shot, data, TrackState(tuple(side_by_side(0.6)[:count])))
    assert (problem.contact is not None) == expected
