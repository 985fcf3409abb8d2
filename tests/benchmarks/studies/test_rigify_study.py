"""The study of a person on a generated Rigify rig: the rig has the person's joints and skin."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("bpy")

from kfmocap.benchmarks.studies import rigify_study
from kfmocap.core.body import human, landmark_positions
from kfmocap.core.review.scoring import Score

pytestmark = pytest.mark.blender

BODY = human(1.7)


def test_elbows_and_knees_of_the_rig_are_bent_as_people_bend_them():
    pose = rigify_study.bent_pose(BODY)
    names = [f"{side}{joint}" for joint in ("Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle") for side in "LR"]
    points = dict(zip(names, landmark_positions(BODY, pose, names)[0], strict=True))
    for side, sign in (("L", 1.0), ("R", -1.0)):
        for start, middle, end, forward in (("Shoulder", "Elbow", "Wrist", 1.0), ("Hip", "Knee", "Ankle", -1.0)):
            a, b, c = (points[f"{side}{joint}"] for joint in (start, middle, end))
            straight = a + (c - a) * np.linalg.norm(b - a) / (np.linalg.norm(b - a) + np.linalg.norm(c - b))
            assert forward * (b - straight)[1] > 0.01, "elbows lie behind the line, knees before it; it faces -Y"
        assert sign * points[f"{side}Wrist"][0] > 0.4


def test_the_skin_of_a_part_is_divided_among_its_bones():
    corners = np.array([[x, y, z] for x in (-0.1, 0.1) for y in (-0.1, 0.1) for z in (1.0, 1.6)])
    along = {name: (np.array([0, 0, a]), np.array([0, 0, b])) for name, a, b in (("low", 1.0, 1.2), ("high", 1.2, 1.6))}
    divided = dict(rigify_study.divided(corners, ("low", "high"), along))
    assert divided["low"][:, 2].max() <= 1.2 <= divided["high"][:, 2].min()
    both = np.concatenate([divided["low"], divided["high"]])
    assert np.array_equal(both.min(axis=0), corners.min(axis=0)) and np.array_equal(
        both.max(axis=0), corners.max(axis=0)
    )


def test_a_row_has_the_mean_of_both_sides():
    errors = {f"{side}{joint}": k + (side == "R") for k, joint in enumerate(rigify_study.SHOWN) for side in "LR"}
    score = Score(60, 3.0, 2.5, errors)
    assert rigify_study.cells("Rigify", 19, score) == ["Rigify", "19", "3.00", "3.5", "4.5", "5.5", "0.5", "1.5", "2.5"]
