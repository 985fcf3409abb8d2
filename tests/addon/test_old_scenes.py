"""A scene that was saved by an earlier version opens with everything in it, and tracks."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from conftest import ROOT  # noqa: E402
from kfmocap.core.body import human, landmark_positions  # noqa: E402
from kfmocap.core.body.body import REST_SIGMA  # noqa: E402
from kfmocap.core.body.measures import measures_from_landmarks  # noqa: E402
from kfmocap.core.formats import read_trc  # noqa: E402
from kfmocap.core.tracking.prepare import load_shot  # noqa: E402
from kfmocap.kfmocap_addon.scene_io import fcurves, scene  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.body import body_channels  # noqa: E402
from kfmocap.kfmocap_addon.scene_io.keys import key_ownership, motion_curves  # noqa: E402

pytest_plugins = ("addon_fixtures",)

pytestmark = pytest.mark.blender

SAVED = ROOT / "tests" / "data" / "blend" / "walk_0.1.0.blend"
"""The example "walk" as version 0.1.0 tracked and saved it."""
WALK = ROOT / "examples" / "walk"
KEYS = [0, 20, 39, 59]


@pytest.fixture
def opened(blender):
    """The saved scene, open."""
    bpy.ops.wm.open_mainfile(filepath=str(SAVED))
    return bpy.context.scene


def tracked_frames(armature) -> set[int]:
    """Scene frames on which the root's first location channel has a key of the type GENERATED."""
    keys = fcurves.get_keys(fcurves.find_channelbag(armature).fcurves[0])
    return set(fcurves.frames_of(keys)[keys["type"] == fcurves.enum_value("type", "GENERATED")].tolist())


def human_of_then(*arguments, **options):
    """The default body of version 0.1.0: no collar bones, and a trunk that turns as it likes."""
    body = human(*arguments, **options, collar_bones=False)
    return replace(body, parts=tuple(replace(part, departure=REST_SIGMA) for part in body.parts))


def test_the_saved_shot_is_that_of_the_shot_file(opened, monkeypatch) -> None:
    monkeypatch.setattr(measures_from_landmarks, "human", human_of_then)
    read, original = scene.shot_from_scene(opened), load_shot(WALK / "shot.toml")
    assert (read.name, read.fps, read.frames) == (original.name, original.fps, original.frames)
    usual = {"joint_acceleration": 30.0, "root_acceleration": 2.0}
    lengths = {"correlation_length": 0.2, "outline_correlation": 0.25}
    # What was the default then was saved with the scene, and holds.
    assert read.settings == replace(original.settings, **usual, **lengths)
    for view, expected in zip(read.views, original.views, strict=True):
        assert view.footage.samefile(expected.footage)
        assert (view.offset, view.fields, view.camera.name) == (expected.offset, expected.fields, expected.camera.name)
        for name in ("matrix", "R_cam_world", "t_cam_world"):
            np.testing.assert_array_equal(getattr(view.camera, name), getattr(expected.camera, name))
        read_terms, terms = view.camera.distortions, expected.camera.distortions
        np.testing.assert_allclose(read_terms, np.pad(terms, (0, len(read_terms) - len(terms))), atol=1e-7)
    [performer], [expected] = read.performers, original.performers
    assert performer.name == expected.name
    assert list(performer.body.landmarks) == list(expected.body.landmarks)
    for part, other in zip(performer.body.parts, expected.body.parts, strict=True):
        assert (part.name, part.parent, part.departure) == (other.name, other.parent, other.departure)
        # The shot file's body is fitted anew, since then with poses that follow its measures: 0.1 mm apart.
        np.testing.assert_allclose(part.vertices, other.vertices, atol=5e-4)
    keys = performer.key_poses
    assert keys.frames.tolist() == expected.key_poses.frames.tolist() == KEYS
    assert keys.fixed.all()
    # The shot file's are fitted anew, which turns a part by some degrees whose landmarks are on its axis.
    names = ("RAnkle", "LAnkle", "RKnee", "LKnee", "RElbow", "LElbow", "RWrist", "LWrist", "Neck", "Nose")
    saved, anew = (landmark_positions(p.body, p.key_poses.poses, names) for p in (performer, expected))
    np.testing.assert_allclose(saved, anew, atol=3e-3)


def test_saved_tracked_keys_are_known_as_the_trackers(opened) -> None:
    [slot] = opened.kfmocap.performers
    start = opened.kfmocap.frame_start
    assert tracked_frames(slot.armature) == set(range(start, start + 60)) - {start + key for key in KEYS}
    own = {
        frame
        for _, _, keys, animators in key_ownership.channel_keys(
            slot.armature, body_channels.list_channels(slot.armature)
        )
        for frame in fcurves.frames_of(keys[animators]).tolist()
    }
    assert own == {start + key for key in KEYS}


def test_part_of_a_saved_scene_is_tracked_again(opened) -> None:
    [slot] = opened.kfmocap.performers
    start = opened.kfmocap.frame_start
    opened.kfmocap.settings = json.dumps(json.loads(opened.kfmocap.settings) | {"limb_search": False})  # takes longest
    before = motion_curves.read_motion(slot.armature, start, 60)
    opened.frame_set(start + 45)
    assert bpy.ops.kfmocap.clear_between(where="HERE") == {"FINISHED"}
    assert not tracked_frames(slot.armature) & set(range(start + 39, start + 60))
    assert bpy.ops.kfmocap.track_here() == {"FINISHED"}
    assert tracked_frames(slot.armature) == set(range(start, start + 60)) - {start + key for key in KEYS}
    after = motion_curves.read_motion(slot.armature, start, 60)
    np.testing.assert_array_equal(after.translations[:40], before.translations[:40])

    [performer], truth = scene.shot_from_scene(opened).performers, read_trc(WALK / "landmarks.trc")
    names = [name for name in performer.body.landmarks if name in truth.names]
    expected = truth.points_world[:60, [truth.names.index(name) for name in names]]
    error = np.linalg.norm(landmark_positions(performer.body, after, names) - expected, axis=2)
    assert len(names) > 10
    assert 1000 * error[40:59].mean() < 20
