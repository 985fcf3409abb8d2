"""Arms at rest in other poses than a T: bent elbows, palms that face anywhere, hands whose bones point elsewhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.numerics import rotations
from kfmocap.core.retargeting.bone_roles.roles import SIDES, BoneMap
from kfmocap.core.retargeting.rest_poses.palms import axes_of_palm, palm_axes
from kfmocap.core.retargeting.rest_poses.rest_alignment import alignments
from made_rigs import made_rig

PLAIN = made_rig("kfmocap", human(1.75))
JOINTS = ("forearm", "hand", "index", "middle", "pinky")


def with_fingers() -> tuple[RestSkeleton, BoneMap]:
    """The human in a T pose, palms down, with the first joints of three fingers."""
    rest, bones = PLAIN.rest, dict(PLAIN.bones.bones)
    names, parents, heads = [*rest.names], [*rest.parents], [*rest.heads]
    for side, x in (("L", 1.0), ("R", -1.0)):
        for finger, y in (("index", -0.03), ("middle", 0.0), ("pinky", 0.04)):
            bones[f"{finger}.{side}"] = (f"{finger}.{side}",)
            names.append(f"{finger}.{side}")
            parents.append(PLAIN.index(f"hand.{side}"))
            heads.append(rest.heads[parents[-1]] + [0.09 * x, y, 0.0])
    tails = np.vstack([rest.tails, np.array(heads[len(rest.tails) :]) + [0.0, 0.0, 0.02]])
    return RestSkeleton(tuple(names), tuple(parents), np.array(heads), tails), BoneMap(bones)


def posed(rest: RestSkeleton, bones: BoneMap, turns: dict[str, np.ndarray]) -> tuple[RestSkeleton, dict]:
    """A skeleton with its left arm's bones turned one after the other, mirrored on the right, as its rest pose; and the
    rotation of each bone from the T pose.
    """
    heads, tails, total = rest.heads.copy(), rest.tails.copy(), {}
    for side, sign in (("L", 1.0), ("R", -1.0)):
        R = np.eye(3)
        for role, turn in turns.items():
            R = R @ rotations.exp(np.array(turn) * [1.0, sign, sign])
            total[f"{role}.{side}"] = R
            [j] = rest.indices(bones.bones[f"{role}.{side}"])
            moved = [k for k in range(len(heads)) if k == j or is_below(rest, k, j)]
            at = heads[j].copy()
            step = R @ total.get(f"{above(role)}.{side}", np.eye(3)).T
            heads[moved], tails[moved] = at + (heads[moved] - at) @ step.T, at + (tails[moved] - at) @ step.T
    return replace(rest, heads=heads, tails=tails), total


def above(role: str) -> str:
    return {"hand": "forearm", "forearm": "upper_arm"}.get(role, "")


def is_below(rest: RestSkeleton, low: int, high: int) -> bool:
    while low >= 0 and low != high:
        low = rest.parents[low]
    return low == high


BENT = {
    "inward": {"upper_arm": (1.0, 1.2, 0.0), "forearm": (0.0, 0.0, -1.4)},
    "upward": {"upper_arm": (-1.5, 0.0, 0.0), "forearm": (0.0, 0.0, -1.4)},
    "forward": {"upper_arm": (0.0, 0.9, 0.0), "forearm": (0.0, 0.0, -1.0)},
}


@pytest.mark.parametrize("pose", BENT)
def test_elbows_bent_at_rest_show_the_twist_of_upper_arms(pose):
    """By the shortest way an upper arm that is turned inward would keep that twist, and its elbow bend sideways."""
    bent, turns = posed(PLAIN.rest, PLAIN.bones, BENT[pose])
    there = alignments(PLAIN.rest, PLAIN.bones, bent, PLAIN.bones)
    back = alignments(bent, PLAIN.bones, PLAIN.rest, PLAIN.bones)
    for role, turn in turns.items():
        np.testing.assert_allclose(there[role][0] @ turn, np.eye(3), atol=1e-6, err_msg=role)
        np.testing.assert_allclose(back[role][0] @ there[role][0], np.eye(3), atol=1e-9, err_msg=role)


@pytest.mark.parametrize("known", ["palms", "bones"])
def test_palms_that_face_forward_at_rest_are_turned_as_a_hand_without_fingers_has_them(known):
    """Half of the twist between them is the forearm's, whether the fingers that show it are controls or not."""
    rest, bones = with_fingers()
    supine, turns = posed(rest, bones, {"upper_arm": (0.0, 0.8, 0.0), "forearm": (-1.2, 0.0, 0.0), "hand": (0, 0, 0)})
    given = bones if known == "bones" else PLAIN.bones
    palms = {} if known == "bones" else {side: palm_axes(supine, bones, side) for side in SIDES}
    there = alignments(PLAIN.rest, PLAIN.bones, supine, given, palms)
    for side, sign in (("L", 1.0), ("R", -1.0)):
        np.testing.assert_allclose(there[f"hand.{side}"][0] @ turns[f"hand.{side}"], np.eye(3), atol=1e-3)
        twist = rotations.log(there[f"forearm.{side}"][0] @ turns[f"forearm.{side}"])
        assert abs(twist[0]) == pytest.approx(0.6, abs=0.01), sign
    if known == "bones":
        back = alignments(supine, bones, PLAIN.rest, PLAIN.bones)
        for role in turns:
            np.testing.assert_allclose(back[role][0] @ there[role][0], np.eye(3), atol=1e-9, err_msg=role)


def test_fingers_that_begin_in_one_place_show_no_palm():
    at = np.array([0.7, 0.0, 1.4])
    assert axes_of_palm(np.array([0.6, 0.0, 1.4]), at, at, at) is None
    assert axes_of_palm(at, at, at + [0, 0.03, 0], at - [0, 0.03, 0]) is None


@pytest.mark.parametrize("ends", ["hand", "forearm and hand"])
def test_a_hands_tail_counts_only_where_the_forearms_bone_points_to_the_hand(ends):
    """Importers let all bones of a rig point up: hands of raised arms seem to be bent then, but only by chance."""
    rest, turns = posed(
        PLAIN.rest, PLAIN.bones, {"upper_arm": (0.0, -1.2, 0.0), "forearm": (0, 0, 0), "hand": (0, 0, 0)}
    )
    tails = rest.tails.copy()
    for side in SIDES:
        for role in ("forearm", "hand")[0 if "forearm" in ends else 1 :]:
            j = PLAIN.index(f"{role}.{side}")
            tails[j] = rest.heads[j] + [0.0, 0.0, 0.1]
    there = alignments(PLAIN.rest, PLAIN.bones, replace(rest, tails=tails), PLAIN.bones)
    off = rotations.log(there["hand.L"][0] @ turns["hand.L"])
    assert np.linalg.norm(off) == pytest.approx(0.0 if "forearm" in ends else np.pi / 2 - 1.2, abs=1e-6)
