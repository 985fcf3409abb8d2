"""Poses that look alike from one camera: all of them are found, and the likeliest is first."""

from __future__ import annotations

import numpy as np
from keypoint_shots import cameras, person, strolling
from kfmocap.core.body import landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.posing.alternatives import (
    CLEAR_MARGIN,
    LIMB_LANDMARKS,
    Alternatives,
    Neighbour,
    alternative_poses,
    implausibility,
)
from synthetic import at_rest

BODY = person()
WALK = strolling(BODY, 60)
VIEW = cameras(2)[1]
R, t = VIEW.pose(0)
CENTRE = -R.T @ t
JOINTS = [name for names in LIMB_LANDMARKS for name in names]


def joints(poses: Motion) -> np.ndarray:
    return landmark_positions(BODY, poses, JOINTS)


def error(pose: Motion, truth: Motion) -> float:
    return float(np.linalg.norm(joints(pose) - joints(truth), axis=-1).mean())


def deceptions(pose: Motion, count: int = 3) -> list[Motion]:
    """Poses that look like a pose, those that are farthest from it."""
    found = alternative_poses(BODY, pose, CENTRE, count=60).poses
    alike = [found[[i]] for i in range(len(found))]
    return sorted(alike, key=lambda one: -error(one, pose))[:count]


def test_all_alternatives_look_alike_and_differ_in_depth():
    found = alternative_poses(BODY, WALK[[20]], CENTRE)
    seen = np.array([VIEW.project(points) for points in joints(found.poses)])
    places, true = joints(found.poses), joints(WALK[[20]])
    # A wrist can be out of reach on its ray from the other place of the elbow: it is then as near as the arm reaches.
    assert np.median(np.linalg.norm(seen - VIEW.project(true[0]), axis=-1)) < 1e-6
    assert np.linalg.norm(seen - VIEW.project(true[0]), axis=-1).max() < 5
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1).max(axis=-1)
    assert apart[~np.eye(len(apart), dtype=bool)].min() > 0.05
    assert len(found.poses) > 4 and (np.diff(found.energy) >= 0).all()


def test_with_a_known_pose_nearby_the_likeliest_alternative_is_nearly_the_true_pose():
    """A limb that is nearly across the view may be flipped: both of its places are then near the neighbour's."""
    before, after = [], []
    for frame in (8, 33):
        truth, near = WALK[[frame]], [Neighbour(WALK[[frame - 6]], 0.2)]
        for start in deceptions(truth):
            found = alternative_poses(BODY, start, CENTRE, near)
            before.append(error(start, truth))
            after.append(error(found.poses[[0]], truth))
    assert np.mean(after) < 0.25 * np.mean(before)


def test_the_present_pose_is_shown_first_unless_another_is_clearly_likelier():
    """Of poses that were clicked, the likeliest is no nearer to the truth unless it is much likelier."""
    found = alternative_poses(BODY, WALK[[20]], CENTRE)
    now = found.number_of(found.poses[[2]])
    assert now == 2 and found.number_of(WALK[[40]]) is None
    for less_likely, first in ((CLEAR_MARGIN - 1, 2), (CLEAR_MARGIN + 1, 0)):
        energy = np.linspace(0, less_likely, 3)
        assert Alternatives(found.poses[[0, 1, 2]], energy).first_to_show(now) == first
    assert found.first_to_show(None) == 0


def test_without_a_neighbour_limits_and_balance_alone_bring_limbs_nearer_to_the_truth():
    before, after = [], []
    for frame in range(0, 60, 20):
        [start] = deceptions(WALK[[frame]], 1)
        before.append(error(start, WALK[[frame]]))
        after.append(error(alternative_poses(BODY, start, CENTRE).poses[[0]], WALK[[frame]]))
    assert np.mean(after) < 0.5 * np.mean(before)


def test_hands_and_feet_lie_as_they_did():
    """What is not clicked looks alike, too."""
    found = alternative_poses(BODY, WALK[[20]], CENTRE)
    R, before = (part_poses(BODY, poses)[0] for poses in (found.poses, WALK[[20]]))
    ends = [BODY.index(f"{part}.{side}") for part in ("hand", "foot") for side in "LR"]
    np.testing.assert_allclose(R[:, ends], np.repeat(before[:, ends], len(R), axis=0), atol=1e-6)


def test_knees_bend_backwards_alone():
    bent = at_rest(BODY)
    turns = np.zeros((len(BODY), 3))
    turns[BODY.index("thigh.L"), 0], turns[BODY.index("shin.L"), 0] = 0.5, -0.9
    good = bent.moved(np.concatenate([np.zeros(3), turns.ravel()])[None])
    turns[BODY.index("shin.L"), 0] = 0.9
    bad = bent.moved(np.concatenate([np.zeros(3), turns.ravel()])[None])
    assert implausibility(BODY, bad)[0] > implausibility(BODY, good)[0] + 50


def test_a_body_that_leans_over_its_feet_is_likelier_than_one_that_would_fall():
    upright, falling = at_rest(BODY), at_rest(BODY).moved(np.array([0, 0, 0, 0.6, *np.zeros(BODY.dof - 4)])[None])
    assert implausibility(BODY, falling)[0] > implausibility(BODY, upright)[0] + 4


def test_a_limb_that_is_held_stays():
    held = np.ones(BODY.dof, bool)
    for part in ("upper_arm.L", "forearm.L"):
        held[3 + 3 * BODY.index(part) : 6 + 3 * BODY.index(part)] = False
    found = alternative_poses(BODY, WALK[[20]], CENTRE, held=held)
    moved = np.abs(WALK[[20] * len(found.poses)].difference(found.poses)).max(axis=0)
    assert 1 < len(found.poses) <= 4 and moved[held].max() < 1e-9
