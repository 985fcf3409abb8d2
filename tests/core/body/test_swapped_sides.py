"""Key poses with left and right exchanged are told by their feet, however the legs are bent."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.body.inverse_kinematics import fit_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.swapped_sides import swapped_sides
from kfmocap.core.review.pretracking_warnings import warnings_before_tracking
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot
from scipy.spatial.transform import Rotation
from synthetic import at_rest, figure

BODY = human(1.8)
NAMES = [name for name in BODY.landmarks if name not in ("Nose", "Head")]


def bent(knees: float, hips: float, seed: int) -> Motion:
    """Three poses with legs bent by angles (radians), feet stretched, and hips turned out at random."""
    rng, poses = np.random.default_rng(seed), at_rest(BODY, 3)
    rotations = poses.rotations.copy()
    for side in "LR":
        turns = Rotation.from_euler("xyz", np.column_stack([np.full(3, hips), rng.uniform(-0.6, 0.6, (3, 2))]))
        rotations[:, BODY.index(f"thigh.{side}")] = turns.as_matrix()
        rotations[:, BODY.index(f"shin.{side}")] = Rotation.from_euler("x", knees).as_matrix()
        rotations[:, BODY.index(f"foot.{side}")] = Rotation.from_euler("x", rng.uniform(-0.5, 0.5)).as_matrix()
    return replace(poses, rotations=rotations)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("knees", "hips"), [(0.0, 0.0), (2.0, 0.0), (-2.0, 0.0), (1.5, 1.5), (-1.5, -1.5), (2.0, -1.0)]
)
def test_legs_may_be_bent_in_any_way(knees: float, hips: float, seed: int) -> None:
    assert not swapped_sides(BODY, bent(knees, hips, seed)).any()


def test_a_pose_fitted_to_exchanged_landmarks_is_told_and_named_before_tracking() -> None:
    poses = at_rest(BODY, 3)
    points = landmark_positions(BODY, poses, NAMES)
    other = [{"R": "L", "L": "R"}.get(name[0], name[0]) + name[1:] for name in NAMES]
    points[1] = points[1, [NAMES.index(name if name in NAMES else own) for name, own in zip(other, NAMES, strict=True)]]
    fitted = fit_poses(BODY, NAMES, points)
    assert swapped_sides(BODY, fitted).tolist() == [False, True, False]
    shot = Shot("walk", 30.0, (100, 140), (), (Performer("woman", BODY, KeyPoses.whole([0, 20, 40], fitted)),))
    [said] = warnings_before_tracking(shot)
    assert said.startswith("woman: left and right seem to be exchanged at key frames 120,")
    assert not warnings_before_tracking(
        replace(shot, performers=(replace(shot.performers[0], key_poses=KeyPoses.proposed([0, 20, 40], fitted)),))
    )


def test_a_body_without_toes_tells_nothing() -> None:
    assert not swapped_sides(figure(), at_rest(figure(), 2)).any()
