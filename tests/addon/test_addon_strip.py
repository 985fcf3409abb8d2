"""The strip under the footage shows where in the shot key poses, tracked and lost frames are."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from addon_shots import motion, shot  # noqa: E402
from kfmocap.kfmocap_addon.overlays import key_strip  # noqa: E402
from kfmocap.kfmocap_addon.overlays.alternative_boxes import boxes  # noqa: E402
from kfmocap.kfmocap_addon.overlays.key_strip import HEIGHT, Strip, pieces, position  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import scene as scenes  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import motion_curves  # noqa: E402
from kfmocap.kfmocap_addon.viewports import key_list  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

BOX = (60.0, 2.0, 860.0, 2.0 + HEIGHT)
COLOUR = (0.75, 1.0, 0.4)
STRIP = Strip((11, 50), COLOUR, (11, 50), (20,), (30, 40), ((12, 29), (31, 49)), ((14, 18), (16, 22), (48, 90)))


def spans(strip, colour):
    """Left and right ends of the triangles of a colour, those that touch as one."""
    found = {c: np.array(corners).reshape(-1, 3, 2)[:, :, 0] for c, corners in pieces(strip, BOX, 1.0)}
    joined = []
    for left, right in sorted((x.min(), x.max()) for x in found.get(colour, ())):
        if joined and left <= joined[-1][1] + 1e-6:
            joined[-1][1] = max(right, joined[-1][1])
        else:
            joined.append([left, right])
    return joined


def test_every_frame_has_its_share_of_the_strip():
    step = (BOX[2] - BOX[0]) / 40
    assert position((11, 50), BOX, 11) == pytest.approx(BOX[0] + step / 2)
    assert position((11, 50), BOX, 50) == pytest.approx(BOX[2] - step / 2)


def test_key_poses_are_diamonds_on_their_frames_and_proposals_are_paler():
    at = [position(STRIP.frames, BOX, frame) for frame in (11, 20, 50)]
    middles = [np.mean(span) for span in spans(STRIP, (*COLOUR, 1.0))]
    assert middles == pytest.approx(at)
    widths = [right - left for left, right in spans(STRIP, (*COLOUR, 1.0))]
    assert widths[1] < widths[0] == pytest.approx(widths[2]), "a pose of some bones is smaller"
    pale = [np.mean(span) for span in spans(STRIP, (*COLOUR, key_strip._PROPOSAL_OPACITY))]
    assert pale == pytest.approx([position(STRIP.frames, BOX, frame) for frame in (30, 40)])


def test_bands_span_tracked_and_lost_frames_within_the_shot():
    step = (BOX[2] - BOX[0]) / 40
    for colour, wanted in (
        (key_strip._TRACKED, [(12, 29), (31, 49)]),
        (key_strip._LOST_COLOUR, [(14, 22), (48, 50)]),  # what overlaps is one band, and none leaves the shot
    ):
        edges = [[BOX[0] + (a - 11) * step, BOX[0] + (b - 10) * step] for a, b in wanted]
        np.testing.assert_allclose(spans(STRIP, colour), edges)
    assert spans(replace(STRIP, lost=()), key_strip._LOST_COLOUR) == []


def test_nothing_leaves_the_strip_and_the_boxes_of_alternatives_begin_above_it():
    for _, corners in pieces(replace(STRIP, whole=(0, 15, 99), lost=((0, 12),)), BOX, 1.0):
        x, y = np.array(corners).T
        assert x.min() >= BOX[0] - 5 and x.max() <= BOX[2] + 5 and y.min() >= BOX[1] and y.max() <= BOX[3]
    assert boxes(1, 1.0)[0][1] > HEIGHT


def test_what_has_not_changed_is_not_computed_again():
    """A redraw compares values alone."""
    many = replace(STRIP, frames=(1, 5000), whole=tuple(range(1, 5000, 10)))
    first = pieces(many, BOX, 1.0)
    start = time.process_time()
    for _ in range(20):
        assert pieces(replace(many), BOX, 1.0) is first
    assert (time.process_time() - start) / 20 < 0.001


def test_the_strip_is_of_the_chosen_performers_keys(blender, tmp_path):
    assert key_strip.strip_of(bpy.context) is None, "nobody to show"
    made = scenes.build_scene(shot(tmp_path, frames=24), [motion(24)], bpy.context.scene)
    slot = made.kfmocap.performers[0]
    assert key_strip.strip_of(bpy.context) is None, "not looked up yet"
    key_list.known_keys().look_up()
    found = key_strip.strip_of(bpy.context)
    assert found == key_strip.strip_of(bpy.context), "equal values are not drawn anew"
    own = sorted(entry.frame for entry in key_list.known_keys().entries(slot.armature))
    start = made.kfmocap.frame_start
    assert found.frames == (start, start + 23) and found.colour == pytest.approx(tuple(slot.colour))
    assert list(found.whole) == own and not found.partial and not found.proposed
    tracked = {frame for first, last in found.tracked for frame in range(first, last + 1)}
    assert tracked == set(range(start, start + 24)) - set(own)
    part = slot.lost.add()
    part.name, part.frames = "hand.L", (start + 3, start + 5)
    assert key_strip.strip_of(bpy.context).lost == ((start + 3, start + 5),)
    hand = slot.armature.pose.bones["hand.L"]
    hand.rotation_quaternion = (0.8, 0.6, 0.0, 0.0)
    hand.keyframe_insert("rotation_quaternion", frame=start + 9)
    key_list.known_keys().outdate()
    assert key_strip.strip_of(bpy.context).partial == (), "until it has been looked up"
    key_list.known_keys().look_up()
    assert key_strip.strip_of(bpy.context).partial == (start + 9,)


def test_keys_that_are_written_just_before_the_frame_changes_are_seen(blender, tmp_path):
    """As after tracking: Blender's handlers of changes are not called then."""
    made = scenes.build_scene(shot(tmp_path, frames=24), scene=bpy.context.scene)
    armature, start = made.kfmocap.performers[0].armature, made.kfmocap.frame_start
    bpy.context.view_layer.update()
    key_list.known_keys().look_up()
    assert key_strip.strip_of(bpy.context).tracked == ()
    motion_curves.write_motion(armature, motion(24), start)
    made.frame_set(start + 3)
    key_list.known_keys().look_up()
    assert key_strip.strip_of(bpy.context).tracked
