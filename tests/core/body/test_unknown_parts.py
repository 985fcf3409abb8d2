"""Which parts landmarks show, and what is done with those that nothing shows."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.unknown_parts import (
    known_landmarks,
    resting_parts,
    unknown_parts,
    unknown_reach,
    without_hidden_solids,
)
from synthetic import figure

ARMS = [side + joint for side in "LR" for joint in ("Shoulder", "Elbow", "Wrist")]
HIPS, KNEES, ANKLES = (["L" + joint, "R" + joint] for joint in ("Hip", "Knee", "Ankle"))


def of_both(*names: str) -> set[str]:
    return {f"{name}.{side}" for name in names for side in "LR"}


@pytest.mark.parametrize(
    ("shown", "unknown"),
    [
        ([*ARMS, *HIPS, *KNEES, *ANKLES, "Nose"], set()),
        ([*ARMS, *HIPS, *KNEES, "Nose"], of_both("shin", "foot")),
        ([*ARMS, *HIPS, "Nose"], of_both("thigh", "shin", "foot")),
        ([*ARMS, "Nose"], {"pelvis", "spine", *of_both("thigh", "shin", "foot")}),
        ([*HIPS, *KNEES, *ANKLES], {"spine", "chest", "head", *of_both("shoulder", "upper_arm", "forearm", "hand")}),
        (["LWrist", *HIPS, *ANKLES], {"head", "shoulder.R", "upper_arm.R", "forearm.R", "hand.R"}),
        ([], set()),
    ],
)
def test_a_part_is_shown_by_landmarks_on_it_or_beyond(shown: list[str], unknown: set[str]) -> None:
    assert set(unknown_parts(human(), shown)) == unknown


def test_below_an_unknown_root_the_first_known_part_rests_too() -> None:
    """The chest's turn against the pelvis cannot be told from the pelvis's own."""
    body = human()
    resting = {body.names[i] for i in resting_parts(body, unknown_parts(body, [*ARMS, "Nose"]))}
    assert resting == {"spine", "chest", *of_both("thigh", "shin", "foot")}
    assert resting_parts(body, ()) == []


def test_pictures_say_nothing_of_hidden_solids_and_joints_stay() -> None:
    body = human()
    unknown = unknown_parts(body, [*ARMS, "Nose"])
    hidden = without_hidden_solids(body, unknown)
    size = {part.name: float(np.ptp(part.vertices, axis=0).max()) for part in hidden.parts}
    assert all(size[name] < 0.005 for name in of_both("thigh", "shin", "foot"))
    assert size["pelvis"] > 0.1 and size["chest"] > 0.1
    np.testing.assert_array_equal(hidden.offsets, body.offsets)
    assert all(len(part.faces) for part in hidden.parts)
    assert without_hidden_solids(body, ()) is body


def test_landmarks_of_unknown_parts_are_left_out() -> None:
    body = human()
    left_out = set(body.landmarks) - set(known_landmarks(body, of_both("thigh", "shin", "foot")))
    assert left_out == {side + joint for side in "LR" for joint in ("Knee", "Ankle", "BigToe", "Heel")}


def test_the_tip_of_an_unknown_limb_may_be_anywhere_in_reach() -> None:
    body = figure()
    reach = unknown_reach(body, ("upper_arm.L", "forearm.L"))
    lengths = [float(np.linalg.norm(part.tail_world - part.head_world)) for part in body.parts]
    assert reach == pytest.approx({1: lengths[1], 2: lengths[1] + lengths[2]})
