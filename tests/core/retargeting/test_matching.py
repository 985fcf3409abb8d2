"""Bones are found by presets, names and places; a map that does not fit is refused by name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from foreign_skeletons import SKELETONS, foreign_skeleton
from kfmocap.core.body import human
from kfmocap.core.body.skeleton_motion import RestSkeleton
from kfmocap.core.errors import BodyError
from kfmocap.core.formats.bone_map_files import read_bone_map, write_bone_map
from kfmocap.core.numerics import rotations
from kfmocap.core.retargeting.bone_matching import match_bones, sides_exchanged
from kfmocap.core.retargeting.bone_roles.bone_names import roles_by_name
from kfmocap.core.retargeting.bone_roles.bone_positions import roles_by_position
from kfmocap.core.retargeting.bone_roles.bone_presets import PRESETS
from kfmocap.core.retargeting.bone_roles.bone_words import read_name, shared_words
from kfmocap.core.retargeting.bone_roles.roles import CHAINS, FINGERS, BoneMap, named_together
from kfmocap.core.retargeting.bone_roles.skeleton_tree import SkeletonTree
from kfmocap.core.retargeting.rest_poses.rest_alignment import feet_point_back
from made_rigs import made_rig

BODY = human(1.75)
KINDS = [name for name in PRESETS if name != "rigify-ik"]


@pytest.mark.parametrize("preset", KINDS)
def test_every_preset_is_recognised_by_its_bones(preset):
    rig = made_rig(preset, BODY, 0.5)
    found = match_bones(rig.rest)
    assert found.bones == rig.bones.bones
    assert found.preset == preset


def test_a_rig_whose_hips_have_another_name_is_not_taken_for_a_metarig():
    """Its spine has the name that the metarig's hips have."""
    rig = made_rig("kfmocap", BODY, 0.3)
    plain = {rig.bones.bones["hips"][0]: "hips", rig.bones.bones["spine"][0]: "spine"}
    renamed = replace(rig.rest, names=tuple(plain.get(name, name) for name in rig.rest.names))
    found = match_bones(renamed)
    assert found.bones["hips"] == ("hips",) and found.bones["spine"][0] == "spine"
    assert found.preset == ""


def test_feet_that_point_back_by_the_names_of_their_sides_are_noticed():
    rig = made_rig("mixamo", BODY)
    assert not feet_point_back(rig.rest, rig.bones)
    swapped = {
        role: rig.bones.bones[role[:-1] + {"L": "R", "R": "L"}[role[-1]] if role[-2:] in (".L", ".R") else role]
        for role in rig.bones.bones
    }
    assert feet_point_back(rig.rest, BoneMap(swapped))


@pytest.mark.parametrize("turn", [0.0, 2.0])
def test_sides_named_as_seen_from_the_front_are_exchanged_where_toes_show_it(turn):
    rest, roles = foreign_skeleton("rokoko")
    R = rotations.exp(np.array([0.0, 0.0, turn]))
    seen = tuple(n.replace("Left", "?").replace("Right", "Left").replace("?", "Right") for n in rest.names)
    found = match_bones(replace(rest, names=seen, heads=rest.heads @ R.T, tails=rest.tails @ R.T))
    assert found.bones["shin.L"] == ("RightShin",)
    assert found.bones["hand.R"] == ("LeftHand",)
    assert sides_exchanged(found)
    lying = rotations.exp(np.array([np.pi / 2, 0.0, 0.0]))
    down = match_bones(replace(rest, heads=rest.heads @ lying.T, tails=rest.tails @ lying.T))
    assert down.bones["shin.L"] == roles["shin.L"]
    assert not sides_exchanged(down)


@pytest.mark.parametrize("wrap", ["Character1:{}", "rig|{}", "{}"])
def test_namespaces_and_case_do_not_matter(wrap):
    rest = made_rig("mixamo", BODY).rest
    renamed = replace(rest, names=tuple(wrap.format(name.replace("mixamorig:", "")).upper() for name in rest.names))
    assert match_bones(renamed).preset == "mixamo"


def test_a_preset_whose_bones_are_missing_is_refused():
    with pytest.raises(BodyError, match=r"hero: no bone was found for hips"):
        match_bones(made_rig("mixamo", BODY).rest, "unreal", "hero")
    with pytest.raises(BodyError, match=r"no preset 'maya'.*kfmocap, rigify"):
        match_bones(made_rig("mixamo", BODY).rest, "maya")


NAMED = {
    "biped": ("Bip01 Pelvis", "Bip01 {S} Thigh", "Bip01 {S} Calf", "Bip01 {S} UpperArm", "Bip01 {S} Forearm"),
    "words": ("COG", "{side}_upper_leg", "{side}_lower_leg", "{side}_upper_arm", "{side}_lower_arm"),
    "suffixes": ("hip", "thigh.{s}", "calf.{s}", "arm.{s}", "elbow.{s}"),
    "brackets": ("Hips", "Thigh ({S})", "Calf [{side}]", "UpperArm({s})", "Forearm[{S}]"),
    "camel": ("Pelvis", "{s}Thigh", "{s}Shin", "{s}UpperArm", "{s}LowerArm"),
}


@pytest.mark.parametrize("style", NAMED)
def test_words_and_marks_of_sides_are_understood(style):
    roles = ("hips", "thigh", "shin", "upper_arm", "forearm")
    names, wanted = [], {}
    for role, pattern in zip(roles, NAMED[style], strict=True):
        for side, words in (("L", ("L", "l", "left")), ("R", ("R", "r", "right"))):
            name = pattern.format(S=words[0], s=words[1], side=words[2])
            key = role if role == "hips" else f"{role}.{side}"
            if name not in names:
                names.append(name)
            wanted[key] = (name,)
    rest = RestSkeleton(tuple(names), (-1,) * len(names), np.zeros((len(names), 3)), np.zeros((len(names), 3)))
    assert dict(roles_by_name(rest).bones) == wanted


ARM, LEG = ["Collar", "Shoulder", "Elbow", "Wrist"], ["Hip", "Knee", "Ankle"]


def named_after_joints(*trunk: str) -> RestSkeleton:
    """A skeleton whose bones are named after the joints in which they begin, with given bones from hips to head."""
    names, parents = [*trunk], list(range(-1, len(trunk) - 1))
    for side in ("Left", "Right"):
        for limb, root in ((ARM, 1), (LEG, 0)):
            parents += [root, *range(len(names), len(names) + len(limb) - 1)]
            names += [side + joint for joint in limb]
    return RestSkeleton(tuple(names), tuple(parents), np.zeros((len(names), 3)), np.zeros((len(names), 3)))


def test_bones_may_be_named_after_the_joints_in_which_they_begin():
    found = match_bones(named_after_joints("Hips", "Chest", "Neck"))
    roles = dict(zip(("shoulder", "upper_arm", "forearm", "hand", "thigh", "shin", "foot"), ARM + LEG, strict=True))
    for role, joint in roles.items():
        assert (found.bones[f"{role}.L"], found.bones[f"{role}.R"]) == ((f"Left{joint}",), (f"Right{joint}",))


@pytest.mark.parametrize(
    ("above", "neck", "head"),
    [(["Neck"], (), "Neck"), (["Neck", "Neck1"], ("Neck",), "Neck1"), (["Neck", "Head"], ("Neck",), "Head")],
    ids=["one bone", "two bones", "with a head"],
)
def test_the_last_bone_of_a_neck_without_a_head_is_the_head(above, neck, head):
    """As of characters whose face hangs on the neck: it would not turn with the performer's head otherwise."""
    found = match_bones(named_after_joints("Hips", "Chest", *above)).bones
    assert (found.get("neck", ()), found["head"]) == (neck, (head,))


@pytest.mark.parametrize("kind", SKELETONS)
def test_bones_of_other_programs_are_found(kind):
    """Twist and IK bones, hips and spines that hang side by side, words of other meanings, layers of controls."""
    rest, roles = foreign_skeleton(kind)
    of_rig = match_bones(rest).checked(rest.names, kind)
    found = of_rig.bones
    assert {role: names for role, names in found.items() if role in roles} == roles
    assert of_rig.found_by == ("places" if "finnish" in kind else "names") or of_rig.preset
    strays = set(found) - set(roles)
    assert all(role.split(".")[0] in ("root", *FINGERS) for role in strays)


@pytest.mark.parametrize(
    ("above", "root"),
    [(["c_pos", "c_traj"], "c_traj"), (["master", "c_traj"], "master"), ([], None)],
    ids=["standing on the ground", "called so", "none"],
)
def test_the_root_carries_the_hips(above, root):
    """Bones below the hips are called root in some rigs, and would take the legs away from the trunk."""
    made = made_rig("mixamo", BODY).rest
    named = dict(zip(made.names, made.names, strict=True)) | {"mixamorig:Hips": "c_root_master.x"}
    shift, hips = len(above), made.names.index("mixamorig:Hips")
    names = (*above, *(named[name] for name in made.names), "c_root.x")
    parents = (*range(-1, shift - 1), *(p + shift if p >= 0 else shift - 1 for p in made.parents), hips + shift)
    on_ground = np.zeros((shift, 3))
    heads, tails = (np.concatenate([on_ground, a, a[[hips]]]) for a in (made.heads, made.tails))
    found = roles_by_name(RestSkeleton(names, parents, heads, tails)).bones
    assert found["hips"] == ("c_root_master.x",)
    assert found.get("root") == (None if root is None else (root,))


def test_limbs_below_the_legs_are_not_taken_for_arms():
    """A skeleton whose arms cannot be told from its legs is refused, not bent."""
    rest, roles = foreign_skeleton("finnish, hips and spine side by side")
    arms = {
        name
        for role, names in roles.items()
        if role[:-2] in ("shoulder", "upper_arm", "forearm", "hand")
        for name in names
    }
    kept = [j for j, name in enumerate(rest.names) if name not in arms]
    parents = tuple(kept.index(rest.parents[j]) if rest.parents[j] >= 0 else -1 for j in kept)
    names = tuple(rest.names[j] for j in kept)
    with pytest.raises(BodyError, match="no bone was found"):
        match_bones(RestSkeleton(names, parents, rest.heads[kept], rest.tails[kept]))


@pytest.mark.parametrize("turn", [0, 1, 2])
@pytest.mark.parametrize("droop", [0.0, 0.8])
def test_bones_without_telling_names_are_found_by_their_places(turn, droop):
    rig = made_rig("mixamo", BODY, droop)
    c, s = np.cos(turn * np.pi / 2), np.sin(turn * np.pi / 2)
    R = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    names = tuple(f"b{k}" for k in range(len(rig.rest.names)))
    rest = RestSkeleton(names, rig.rest.parents, rig.rest.heads @ R.T, rig.rest.tails @ R.T)
    found = roles_by_position(rest)
    meant = dict(zip(names, rig.rest.names, strict=True))
    for role, bones in found.items():
        if role not in CHAINS:
            assert tuple(meant[name] for name in bones) == rig.bones.bones[role], role
    limbs = {f"{limb}.{side}" for limb in ("thigh", "shin", "foot", "upper_arm", "forearm", "hand") for side in "LR"}
    assert limbs | {"hips", "head"} <= set(found)


LIMBS = {f"{limb}.{side}" for limb in ("thigh", "shin", "foot", "upper_arm", "forearm", "hand") for side in "LR"}


def nameless(extra=(), turn=0.0, droop=0.8):
    """A human whose bones have numbers for names, with pairs of chains of further bones (role that they hang on, joints
    on the left), turned about the vertical; and the number of the bone of each role.
    """
    rig = made_rig("mixamo", BODY, droop)
    heads, parents, tails = [*rig.rest.heads], [*rig.rest.parents], [*rig.rest.tails]
    for role, joints in extra:
        for side in (1.0, -1.0):
            parent = rig.index(role.format("L" if side > 0 else "R"))
            for at in joints:
                parents.append(parent)
                parent = len(heads)
                heads.append(np.array(at) * [side, 1.0, 1.0])
                tails.append(heads[-1] + [0.0, 0.0, -0.05])
    R = rotations.exp(np.array([0.0, 0.0, turn]))
    names = tuple(str(k) for k in range(len(heads)))
    rest = RestSkeleton(names, tuple(parents), np.array(heads) @ R.T, np.array(tails) @ R.T)
    return rest, {role: (names[rig.index(role)],) for role in ("hips", "head", *LIMBS)}


BESIDE = {
    "skirt": [("hips", [(0.15, 0.0, 1.0), (0.2, 0.0, 0.7), (0.25, 0.0, 0.45), (0.3, 0.0, 0.2)])],
    "wings": [("spine", [(0.1, 0.1, 1.2), (0.5, 0.3, 1.6), (1.0, 0.4, 1.7), (1.4, 0.4, 1.3)])],
    "hair": [("head", [(0.08, 0.05, 1.65), (0.12, 0.08, 1.3), (0.13, 0.1, 0.95), (0.13, 0.1, 0.6)])],
    "helpers": [("forearm.{}", [(0.45 + 0.01 * k, 0.05, 1.2)]) for k in range(3)],
    "hind legs": [("hips", [(0.1, 0.9, 0.95), (0.1, 0.85, 0.5), (0.1, 0.9, 0.05)])],
}


@pytest.mark.parametrize("turn", [0.0, 0.6])
@pytest.mark.parametrize("what", BESIDE)
def test_limbs_that_are_least_human_are_no_arms_and_no_legs_where_places_decide(what, turn):
    rest, roles = nameless(BESIDE[what], turn)
    found = roles_by_position(rest)
    assert {role: found[role] for role in roles} == roles


def divided(rest: RestSkeleton, bones: Sequence[int], middle: Sequence[int]) -> RestSkeleton:
    """A skeleton in which some bones are two each, the lower one of which carries what hung on them, and others hang on
    bones of their own that begin at the one above, as MakeHuman's and Daz's limbs do.
    """
    made: list[tuple[str, str, np.ndarray, np.ndarray]] = []
    carrier: dict[int, str] = {-1: ""}
    for j, name in enumerate(rest.names):
        above, carrier[j] = carrier[rest.parents[j]], name
        if j in middle:
            made.append((f"{name} above", above, rest.heads[rest.parents[j]], rest.heads[j]))
            above = f"{name} above"
        made.append((name, above, rest.heads[j], rest.tails[j]))
        if j in bones:
            carrier[j] = f"{name} below"
            made.append((carrier[j], name, 0.7 * rest.heads[j] + 0.3 * rest.tails[j], rest.tails[j]))
    names = tuple(name for name, *_ in made)
    parents = tuple(names.index(above) if above else -1 for _, above, *_ in made)
    return RestSkeleton(names, parents, *(np.array(points) for points in list(zip(*made, strict=True))[2:]))


@pytest.mark.parametrize("turn", [0.0, 0.6])
@pytest.mark.parametrize("what", ["", "hair", "skirt", "helpers"])
def test_segments_of_two_bones_are_one_where_places_decide(what, turn):
    plain = made_rig("mixamo", BODY, 0.8)
    wrist = plain.rest.heads[plain.index("hand.L")]
    fingers = [("hand.{}", [wrist + [0.06, y, -0.06], wrist + [0.08, y, -0.08]]) for y in (-0.03, 0.0, 0.03, 0.06)]
    rest, roles = nameless([*fingers, *BESIDE.get(what, [])], turn)
    limbs = [int(roles[role][0]) for role in LIMBS if role[:-2] not in ("hand", "foot")]
    thighs = [int(roles[f"thigh.{side}"][0]) for side in "LR"]
    found = roles_by_position(divided(rest, limbs, thighs))
    assert {role: found[role] for role in roles} == roles


def test_short_legs_below_a_huge_head_are_legs_where_places_decide():
    """Legs of a cartoon's character, whose head makes up half of its height."""
    rest, roles = nameless()
    hips = rest.heads[int(roles["hips"][0]), 2]
    above = [0.0, 0.0, 0.65 * hips]
    heads, tails = (np.where(at[:, 2:] > 0.9 * hips, at - above, at * [1, 1, 0.35]) for at in (rest.heads, rest.tails))
    tails[int(roles["head"][0]), 2] += 1.3
    found = roles_by_position(replace(rest, heads=heads, tails=tails))
    assert {role: found[role] for role in roles} == roles


@pytest.mark.parametrize("in_palm", [False, True])
@pytest.mark.parametrize("count", [4, 5])
def test_fingers_are_found_by_their_places(count, in_palm):
    """Also where bones in the palm are above them; the thumb has none."""
    plain = made_rig("mixamo", BODY, 0.0)
    wrist = plain.rest.heads[plain.index("hand.L")]
    fingers = [("thumb", -0.05), ("index", -0.03), ("middle", 0.0), ("ring", 0.025), ("pinky", 0.05)]
    chosen = [one for one in fingers if count > 4 or one[0] != "ring"]
    chains = []
    for finger, y in reversed(chosen):
        if finger == "thumb":
            joints = [wrist + [0.02 + 0.02 * k, -0.03 - 0.03 * k, 0.0] for k in range(3)]
        else:
            joints = [wrist + [0.09 + 0.03 * k, y, 0.0] for k in range(3)]
            joints = [wrist + [0.02, y / 3, 0.0], *joints] if in_palm else joints
        chains.append(("hand.{}", joints))
    rest, _ = nameless(chains, droop=0.0)
    found = roles_by_position(rest)
    place = len(plain.rest.names)
    for (finger, _), (_, joints) in zip(reversed(chosen), chains, strict=True):
        for side in "LR":
            own = tuple(str(place + k) for k in range(len(joints)))[-3:]
            assert found[f"{finger}.{side}"] == own, finger
            place += len(joints)


def test_an_animal_on_four_legs_is_no_human_where_places_decide():
    heads, parents = [[0.0, 0.35, 0.6], [0.0, 0.1, 0.62], [0.0, -0.25, 0.62], [0.0, -0.45, 0.8]], [-1, 0, 1, 2]
    for x in (0.12, -0.12):
        for y, top, above in ((-0.25, 0.61, 2), (0.35, 0.55, 0)):
            parents += [above, len(heads), len(heads) + 1]
            heads += [[x, y, top], [x, y + 0.04, 0.3], [x, y, 0.06]]
    names = tuple(str(k) for k in range(len(heads)))
    tails = np.array(heads) + [0.0, -0.05, 0.0]
    assert roles_by_position(RestSkeleton(names, tuple(parents), np.array(heads), tails)) == {}


def stepping(rest, roles, turns):
    """Heads and tails of a skeleton whose left and right legs are turned forward by angles, radians."""
    heads, tails = rest.heads.copy(), rest.tails.copy()
    for side, turn in zip("LR", turns, strict=True):
        bones = [rest.names.index(roles[f"{role}.{side}"][0]) for role in ("thigh", "shin", "foot")]
        R, hip = rotations.exp(np.array([turn, 0.0, 0.0])), heads[bones[0]].copy()
        heads[bones], tails[bones] = hip + (heads[bones] - hip) @ R.T, hip + (tails[bones] - hip) @ R.T
    return heads, tails


def test_a_weapon_in_one_hand_and_a_step_forward_leave_a_skeleton_symmetrical():
    rest, roles = nameless()
    heads, tails = stepping(rest, roles, (-0.2, 0.15))
    hand = rest.names.index(roles["hand.R"][0])
    blade = heads[hand] + np.array([[-0.1, -0.2, 0.0], [-0.3, -1.0, 0.0]])
    armed = RestSkeleton(
        (*rest.names, "grip", "point"),
        (*rest.parents, hand, len(heads)),
        np.vstack([heads, blade]),
        np.vstack([tails, blade + [0.0, -0.1, 0.0]]),
    )
    found = roles_by_position(armed)
    assert {role: found[role] for role in roles} == roles


def test_a_wide_step_does_not_turn_a_skeleton_around_where_places_decide():
    """The foot behind stands on its toes: it does not show that the skeleton faces backward."""
    rest, roles = nameless()
    heads, tails = stepping(rest, roles, (-0.5, 0.45))
    found = roles_by_position(replace(rest, heads=heads, tails=tails))
    assert {role: found[role] for role in roles} == roles


def test_an_arm_is_no_head_where_places_decide_and_there_is_none():
    rest, roles = nameless()
    tree, heads = SkeletonTree(rest), rest.heads.copy()
    arms = [rest.names.index(roles[f"upper_arm.{side}"][0]) for side in "LR"]
    chest = tree.common(arms)
    tops = [next(j for j in (arm, *tree.above(arm)) if rest.parents[j] == chest) for arm in arms]
    heads[tops, 2] = heads[chest, 2] + 0.3
    neck = [j for j, p in enumerate(rest.parents) if p == chest and j not in tops]
    kept = [j for j in range(len(heads)) if j not in neck and not any(tree.is_above(k, j) for k in neck)]
    parents = tuple(kept.index(rest.parents[j]) if rest.parents[j] >= 0 else -1 for j in kept)
    found = roles_by_position(RestSkeleton(tuple(rest.names[j] for j in kept), parents, heads[kept], rest.tails[kept]))
    assert found["forearm.L"] == roles["forearm.L"]
    assert "head" not in found


def test_places_of_limbs_go_by_the_sides_that_names_say_and_not_by_feet_that_point_nowhere():
    made = made_rig("kfmocap", BODY, 0.5).rest
    words = {"upper_arm": "felkar", "forearm": "alkar", "thigh": "comb", "shin": "lábszár", "foot": "lábfej"}
    kept = [j for j, name in enumerate(made.names) if name.split(".")[0] not in ("toe", *FINGERS)]
    names = [made.names[j].split(".") for j in kept]
    foreign = tuple(".".join([words.get(word, f"csont_{word}"), *side]) for word, *side in names)
    tails = made.tails[kept].copy()
    for k, (word, *_) in enumerate(names):
        if word == "foot":
            tails[k] = made.heads[kept[k]] + [0.0, 0.01, -0.05]
    parents = tuple(kept.index(made.parents[j]) if made.parents[j] >= 0 else -1 for j in kept)
    found = match_bones(RestSkeleton(foreign, parents, made.heads[kept], tails))
    assert found.found_by == "places"
    for side in "LR":
        assert found.bones[f"upper_arm.{side}"] == (f"felkar.{side}",)
        assert found.bones[f"shin.{side}"] == (f"lábszár.{side}",)


def test_a_bone_that_marks_the_end_of_the_head_is_not_the_head_where_places_decide():
    rig = made_rig("mixamo", BODY)
    names = (*(f"b{k}" for k in range(len(rig.rest.names))), "b_end")
    head = rig.index("head")
    top = rig.rest.tails[head]
    rest = RestSkeleton(
        names,
        (*rig.rest.parents, head),
        np.vstack([rig.rest.heads, top]),
        np.vstack([rig.rest.tails, top + [0, 0, 0.05]]),
    )
    assert roles_by_position(rest)["head"] == (names[head],)


BIRD = {
    "Body": ("", (0.0, 0.1, 0.5)),
    "Neck1": ("Body", (0.0, -0.12, 0.57)),
    "Neck2": ("Neck1", (0.0, -0.2, 0.7)),
    "Head": ("Neck2", (0.0, -0.24, 0.82)),
    "Beak": ("Head", (0.0, -0.36, 0.81)),
    "Tail": ("Body", (0.0, 0.3, 0.48)),
    **{
        f"{name}.{side}": (f"{above}.{side}" if above != "Body" else above, (x * at[0], *at[1:]))
        for side, x in (("L", 1.0), ("R", -1.0))
        for name, above, at in (
            ("WingUpper", "Body", (0.08, -0.05, 0.58)),
            ("WingLower", "WingUpper", (0.3, 0.0, 0.6)),
            ("WingTip", "WingLower", (0.55, -0.05, 0.6)),
            ("Thigh", "Body", (0.07, 0.05, 0.45)),
            ("Shank", "Thigh", (0.08, -0.02, 0.32)),
            ("Tarsus", "Shank", (0.08, 0.08, 0.16)),
            ("Claw", "Tarsus", (0.08, 0.03, 0.03)),
        )
    },
}


def test_a_birds_head_and_neck_are_found_by_their_names_where_its_limbs_are_by_places():
    """They do not stand above a body that lies."""
    names = list(BIRD)
    heads = np.array([head for _, head in BIRD.values()])
    parents = [names.index(above) if above else -1 for above, _ in BIRD.values()]
    tails = np.array([heads[parents.index(j)] if j in parents else heads[j] + [0, -0.1, 0] for j in range(len(names))])
    found = match_bones(RestSkeleton(tuple(names), tuple(parents), heads, tails))
    assert found.found_by == "places"
    assert (found.bones["head"], found.bones["neck"]) == (("Head",), ("Neck1", "Neck2"))
    assert found.bones["thigh.L"] == ("Thigh.L",)
    assert found.bones["foot.R"] == ("Tarsus.R",)


@pytest.mark.parametrize(
    ("roles", "said"),
    [
        (["head", "hand.L", "hand.R"], "head, hand"),
        (["toe.L", "upper_arm.R"], "toe.L, upper_arm.R"),
        ([f"{finger}.{side}" for finger in FINGERS for side in "LR"], "fingers"),
    ],
)
def test_roles_are_said_in_few_words(roles, said):
    assert named_together(roles) == said


def test_a_word_for_a_part_says_nothing_only_where_nearly_all_bones_have_it():
    fingers = [f"LeftHand{finger}{k}" for finger in ("Thumb", "Index", "Middle", "Ring", "Pinky") for k in (1, 2, 3)]
    rest = ["Hips", "Spine", "Head", "LeftArm", "LeftForeArm"]
    assert shared_words([*fingers, *rest]) == set()
    assert shared_words([*fingers, *(f"Hand{name}" for name in rest)]) == {"hand"}


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("mixamorigLeftUpLeg_049", ("L", "thigh")),
        ("mixamorigRightHand_052", ("R", "hand")),
        ("mixamorigSpine1_043", ("", "spine")),
        ("mixamorigHead_035", ("", "head")),
    ],
)
def test_numbers_that_a_site_for_models_adds_to_mixamos_names_say_nothing(name, read):
    """Even where hair and a skirt have more bones than the body, so that few names have the word in front."""
    found = read_name(name)
    assert (found.side, found.part) == read
    assert found.kind == ""


@pytest.mark.parametrize(
    ("name", "read"),
    [
        ("C_head_SHJnt", ("", "head", "")),
        ("C_hand_L", ("L", "hand", "control")),
        ("c_head.x", ("", "head", "control")),
        ("L_arm_upper_SHJnt", ("L", "upper_arm", "")),
    ],
)
def test_a_capital_c_is_the_middle_and_a_small_one_a_control(name, read):
    found = read_name(name)
    assert (found.side, found.part, found.kind) == read


def test_a_bone_map_comes_back_from_its_file(tmp_path):
    bones = made_rig("unreal", BODY).bones.bones
    write_bone_map(tmp_path / "map.json", bones, "unreal")
    assert read_bone_map(tmp_path / "map.json") == ("unreal", bones)


@pytest.mark.parametrize(
    ("text", "message"),
    [("no", "not a bone map"), ("{}", "no table 'bones'"), ('{"bones": {"hips": 3}}', "bones.hips: must be the name")],
)
def test_a_broken_bone_map_names_the_file_and_the_field(tmp_path, text, message):
    (tmp_path / "map.json").write_text(text)
    with pytest.raises(BodyError, match=rf"map.json.*{message}"):
        read_bone_map(tmp_path / "map.json")


def test_unknown_roles_and_bones_that_play_two_are_refused():
    with pytest.raises(BodyError, match="'tail' is no role"):
        BoneMap({"tail": ("t",)})
    rig = made_rig("unreal", BODY)
    twice = BoneMap({**rig.bones.bones, "hand.L": ("hand_r",)})
    with pytest.raises(BodyError, match=r"hero: bone 'hand_r' plays two roles"):
        twice.checked(rig.rest.names, "hero")


def test_limbs_of_one_bone_are_no_human_though_hands_and_feet_lie_as_forearms_and_shins():
    rig = made_rig("mixamo", BODY, 0.4)
    left_out = {rig.rest.names.index(name) for name in rig.rest.names if "ForeArm" in name or name.endswith("tLeg")}
    kept = [k for k in range(len(rig.rest.names)) if k not in left_out]
    above = [rig.rest.parents[p] if (p := rig.rest.parents[k]) in left_out else p for k in kept]
    names = tuple(rig.rest.names[k].replace("mixamorig:", "") for k in kept)
    parents = tuple(kept.index(p) if p >= 0 else -1 for p in above)
    with pytest.raises(BodyError, match=r"no bone was found for shin\.L"):
        match_bones(RestSkeleton(names, parents, rig.rest.heads[kept], rig.rest.tails[kept]))
