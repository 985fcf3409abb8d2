"""Props in hands, in Blender: who holds what is in the scene, and is what the tracker is given."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import FIRST, FRAMES, shot  # noqa: E402
from kfmocap.core.body import part_poses  # noqa: E402
from kfmocap.core.body.motion import Motion  # noqa: E402
from kfmocap.core.body.prop import body_of_prop  # noqa: E402
from kfmocap.core.body.skeleton_motion import RestSkeleton  # noqa: E402
from kfmocap.core.errors import ShotError  # noqa: E402
from kfmocap.core.shot.holds import Hold  # noqa: E402
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import hold_checks, tracked_segments  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene as scenes  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

LAST = FRAMES - 1


def with_stick(folder) -> Shot:
    """The man, and a stick that is in his left hand on every key frame."""
    made = shot(folder)
    man = made.performers[0]
    R, T = part_poses(man.body, man.key_poses.poses)
    hand = man.body.index("hand.L")
    joint = RestSkeleton(("stick",), (-1,), np.zeros((1, 3)), np.ones((1, 3)))
    corners = np.array([[x, y, z] for x in (-0.01, 0.01) for y in (-0.3, 0.3) for z in (-0.01, 0.01)])
    places = T[:, hand] + R[:, hand] @ [0.0, 0.08, 0.0]
    keys = KeyPoses.whole(man.key_poses.frames, Motion(places, R[:, [hand]]))
    return replace(made, performers=(man, Performer("stick", body_of_prop(joint, corners), keys)))


@pytest.fixture
def scene(blender, tmp_path):
    """The scene of both on the first frame, a key frame."""
    current = scenes.build_scene(with_stick(tmp_path), scene=bpy.context.scene)
    bpy.context.view_layer.update()
    current.frame_set(1)
    return current


def test_the_button_finds_prop_hand_and_frames(scene):
    assert bpy.ops.kfmocap.hold_prop() == {"FINISHED"}
    scene.kfmocap.performer = "stick"
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 3, 7
    assert bpy.ops.kfmocap.hold_prop() == {"FINISHED"}
    found = scenes.shot_from_scene(scene).holds
    assert [(h.prop, h.holder, h.part, h.frames) for h in found] == [
        ("stick", "man", "hand.L", (0, LAST)),
        ("stick", "man", "hand.L", (2, 6)),
    ]
    assert bpy.ops.kfmocap.remove_hold(number=0) == {"FINISHED"}
    assert [hold.frames for hold in scenes.shot_from_scene(scene).holds] == [(2, 6)]


def test_what_is_not_whole_is_not_used_and_says_so(scene):
    bpy.ops.kfmocap.hold_prop()
    [hold] = scene.kfmocap.holds
    assert hold_checks.why_unused(scene, hold) == ""
    for name, value, said in (
        ("bone", "paw", "bone"),
        ("prop", None, "prop"),
        ("holder", hold.prop, "another performer"),
        ("first", hold.last + 1, "before the first"),
        ("last", scene.kfmocap.frame_start - 1, "before the first"),
    ):
        before = getattr(hold, name)
        setattr(hold, name, value)
        assert said in hold_checks.why_unused(scene, hold)
        assert scenes.shot_from_scene(scene).holds == ()
        setattr(hold, name, before)
    hold.first, hold.last = LAST + 10, LAST + 20
    assert "outside" in hold_checks.why_unused(scene, hold)
    scene.kfmocap.performers["stick"].name = "staff"
    hold.first, hold.last = -5, 500
    [read] = scenes.shot_from_scene(scene).holds
    assert (read.prop, read.frames) == ("staff", (0, LAST))


def test_a_shot_with_a_hold_is_the_same_in_a_scene(blender, tmp_path):
    hold = Hold("stick", "man", "hand.L", (2, 8))
    current = scenes.build_scene(replace(with_stick(tmp_path), holds=(hold,)), scene=bpy.context.scene)
    [read] = scenes.shot_from_scene(current).holds
    assert (read.prop, read.holder, read.part, read.frames) == ("stick", "man", "hand.L", (2, 8))


def test_tracking_is_given_how_the_prop_lies_in_the_hand(scene):
    bpy.ops.kfmocap.hold_prop()
    asked = tracked_segments.asked_tracking(scene, scenes.shot_from_scene(scene))
    [hold] = asked.shot.holds
    assert hold.grip.places == pytest.approx(np.tile([0.0, 0.08, 0.0], (3, 1)), abs=1e-5)
    scene.kfmocap.holds[0].first, scene.kfmocap.holds[0].last = 3, 4
    with pytest.raises(ShotError, match="no frame from 3 to 4 has a key pose of both stick and man"):
        tracked_segments.asked_tracking(scene, scenes.shot_from_scene(scene))


def test_a_hold_makes_its_frames_out_of_date_and_renaming_does_not(scene):
    whole = scenes.shot_from_scene(scene)
    before = tracked_segments.digests(whole, tracked_segments.segments(whole))
    bpy.ops.kfmocap.hold_prop()
    scene.kfmocap.holds[0].last = 4
    held = scenes.shot_from_scene(scene)
    after = tracked_segments.digests(held, tracked_segments.segments(held))
    assert [after[segment] == before[segment] for segment in before] == [False, True]
    scene.kfmocap.performers["stick"].name = "staff"
    renamed = scenes.shot_from_scene(scene)
    assert after == tracked_segments.digests(renamed, tracked_segments.segments(renamed))


def test_tracking_one_performer_leaves_out_holds_of_those_who_are_left_out(scene):
    bpy.ops.kfmocap.hold_prop()
    stick = scene.kfmocap.performers["stick"]
    asked = tracked_segments.asked_tracking(scene, scenes.shot_from_scene(scene), stick)
    assert len(asked.shot.holds) == 1
    with_no_keys = replace(
        scenes.shot_from_scene(scene),
        performers=tuple(
            replace(p, key_poses=p.key_poses.between(900, 901)) if p.name == "stick" else p
            for p in scenes.shot_from_scene(scene).performers
        ),
        holds=(),
    )
    assert tracked_segments.asked_tracking(scene, with_no_keys, scene.kfmocap.performers["man"]).shot.holds == ()


def test_one_alone_holds_nothing(blender, tmp_path):
    scenes.build_scene(shot(tmp_path), scene=bpy.context.scene)
    with pytest.raises(RuntimeError, match="A performer and a prop are needed"):
        bpy.ops.kfmocap.hold_prop()
    assert bpy.context.scene.kfmocap.first == FIRST
