"""A Blender scene as a shot, and a shot as a Blender scene.

Blender shows shot frame f at scene frame f + frame_start. Files count video frames: there shot frame 0 is the
first frame of the shot.
"""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.body.motion import Motion
from ...core.errors import ShotError
from ...core.shot.keypose_spline import spline
from ...core.shot.settings import Settings
from ...core.shot.shot import Performer, Shot
from . import active_performer, lossless, playback, prop_holds
from .body import body_armature, shown_model
from .body.sides import PERFORMERS
from .cameras import footage_background, view_cameras
from .keys import key_pose_curves, motion_curves
from .review import unknown_bones

FRAME_START = 1
"""Scene frame of shot frame 0 in the scenes that we build, as Blender's own scenes start."""
_FPS = "kfmocap_fps"


def build_scene(
    shot: Shot,
    motions: Sequence[Motion] | None = None,
    scene: bpy.types.Scene | None = None,
    stored: Callable[[str], str] = footage_background.as_blender_stores,
) -> bpy.types.Scene:
    """Show a shot in a scene: cameras with footage, armatures, key poses and, if given, tracked motions.

    Parameters
    ----------
    shot : Shot
    motions : sequence of Motion, optional
        One per performer, `shot.length` poses each; written as keys of type GENERATED.
    scene : bpy.types.Scene, optional
        Where to build; by default a new scene.
    stored : callable, optional
        See `footage_background.load_clip`.

    Returns
    -------
    bpy.types.Scene

    Raises
    ------
    FootageError
        If Blender cannot read some footage. Nothing was built then.
    """
    clips = load_clips([view.footage for view in shot.views], stored)
    scene = scene or bpy.data.scenes.new(shot.name)
    set_rate(scene, shot.fps)
    scene.frame_set(FRAME_START)
    _describe(scene, shot)
    _build_views(scene, shot, clips)
    bodies = ensure_collection(scene, "Performers")
    for performer in shot.performers:
        armature = body_armature.build_armature(performer.body, performer.name, bodies)
        slot = add_slot(scene, performer.name, armature)
        slot.person, slot.fingers = performer.person or 0, performer.fingers
        unknown_bones.mark_resting(slot.armature, performer.unknown)
        key_pose_curves.write_key_poses(slot.armature, performer.key_poses, FRAME_START)
        if len(proposed := performer.key_poses.proposals()):
            first_pass = spline(performer.key_poses, shot.length)
            motion_curves.write_motion(slot.armature, first_pass, FRAME_START, FRAME_START + proposed)
    prop_holds.write_holds(scene, shot)
    shown_model.show_model(scene)
    if motions is not None:
        write_motions(scene, motions)
    return scene


def add_slot(scene: bpy.types.Scene, name: str, armature: bpy.types.Object) -> bpy.types.PropertyGroup:
    """Make an armature a performer of that name, in a colour that no other performer has if there is one left."""
    slots = scene.kfmocap.performers
    taken = {tuple(round(value, 3) for value in slot.colour) for slot in slots}
    free = [colour for colour in PERFORMERS if colour not in taken]
    slot = slots.add()
    slot.name, slot.armature = name, armature
    slot.colour = free[0] if free else PERFORMERS[(len(slots) - 1) % len(PERFORMERS)]
    return slot


def write_motions(
    scene: bpy.types.Scene,
    motions: Sequence[Motion],
    shot: Shot | None = None,
    first: int = 0,
    *,
    slots: Sequence[bpy.types.PropertyGroup] | None = None,
) -> None:
    """Write tracked motions, one per performer or one for each of some slots, into the scene's armatures beside the
    animator's keys.

    What the shot proposes as key poses, by default what the scene does already, is marked as such. The motions begin on
    that shot frame.
    """
    start = scene.kfmocap.frame_start + first
    for i, (slot, motion) in enumerate(zip(slots or scene.kfmocap.performers, motions, strict=True)):
        proposed = None if shot is None else start + shot.performers[i].key_poses.proposals()
        motion_curves.write_motion(slot.armature, motion, start, proposed)


def shot_from_scene(scene: bpy.types.Scene, footage: bool = True) -> Shot:
    """Read the shot that a scene shows, as it stands now: cameras, bodies and the animator's keys.

    Parameters
    ----------
    scene : bpy.types.Scene
    footage : bool
        Read the views. Without any, the shot still has the key poses.

    Raises
    ------
    KFMocapError
        If the scene holds no shot, or some of it is gone or cannot be tracked; says what and where.
    """
    properties = scene.kfmocap
    if not properties.views or not properties.performers:
        raise ShotError("the scene holds no shot", where=f"scene {scene.name}", todo="load a shot first")
    if properties.length < 1:
        raise ShotError(
            f"the last frame ({properties.last}) is before the first ({properties.first})",
            where=f"scene {scene.name}",
        )
    playback.check_playback(scene)
    return Shot(
        name=properties.shot,
        fps=frame_rate(scene),
        frames=(properties.first, properties.last),
        views=view_cameras.read_views(scene, properties.frame_start, properties.length) if footage else (),
        performers=tuple(_read_performer(scene, slot) for slot in properties.performers),
        settings=read_settings(properties),
        holds=prop_holds.read_holds(scene),
    )


def _read_performer(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> Performer:
    if not active_performer.is_present(scene, slot):
        raise ShotError("the armature is gone from the scene", where=f"performer {slot.name}")
    keys = key_pose_curves.read_key_poses(slot.armature, scene.kfmocap.frame_start, scene.kfmocap.length)
    resting = unknown_bones.resting_bones(slot.armature, keys)
    return Performer(
        slot.name,
        body_armature.body_from_armature(slot.armature),
        keys,
        slot.person or None,
        unknown=resting,
        fingers=slot.fingers,
    )


def load_clips(
    footage: Sequence[Path], stored: Callable[[str], str] = footage_background.as_blender_stores
) -> list[bpy.types.MovieClip]:
    """Load footage as movie clips, all or none; `stored` as in `footage_background.load_clip`.

    Raises
    ------
    FootageError
        If Blender cannot read some.
    """
    clips: list[bpy.types.MovieClip] = []
    try:
        for path in footage:
            clips.append(footage_background.load_clip(path, stored))
    except Exception:
        bpy.data.batch_remove(clips)
        raise
    return clips


def frame_rate(scene: bpy.types.Scene) -> float:
    """Return the scene's frames per second, to the last digit as `set_rate` had them."""
    return float(lossless.recall(scene, _FPS, scene.render.fps / scene.render.fps_base))


def replaced_rate(scene: bpy.types.Scene) -> float | None:
    """Return the frame rate that `set_rate` set, if something else has changed it since, as importers of FBX do."""
    before = lossless.stored(scene[_FPS]) if _FPS in scene else None
    changed = before is not None and not lossless.same(before, np.array(frame_rate(scene)))
    return float(before) if changed else None


def set_rate(scene: bpy.types.Scene, fps: float | None) -> None:
    """Set a scene's frame rate, frames per second; None leaves it unchanged."""
    if fps is not None:
        render = scene.render
        render.fps = max(1, round(fps))
        render.fps_base = render.fps / fps
        lossless.keep(scene, _FPS, fps)


def _describe(scene: bpy.types.Scene, shot: Shot) -> None:
    properties = scene.kfmocap
    properties.shot, properties.zero = shot.name, FRAME_START - shot.frames[0]
    properties.first, properties.last = shot.frames
    settings = dataclasses.asdict(shot.settings)
    properties.solver, properties.contact = settings.pop("solver"), settings.pop("contact")
    properties.settings = json.dumps(settings)


def _build_views(scene: bpy.types.Scene, shot: Shot, clips: list[bpy.types.MovieClip]) -> None:
    cameras = ensure_collection(scene, "Views")
    for view, clip in zip(shot.views, clips, strict=True):
        slot = scene.kfmocap.views.add()
        view_cameras.build_view(view, clip, slot, cameras, first=shot.frames[0], frame_start=FRAME_START)
    footage_background.look_through(scene, scene.kfmocap.views[0])


def read_settings(properties: bpy.types.PropertyGroup) -> Settings:
    """Return the tracker's settings as a scene says: defaults for what it does not, and without what this version
    lacks.
    """
    shown = {"solver": properties.solver, "contact": properties.contact}
    stored = json.loads(properties.settings or "{}") | shown
    known: dict[str, Any] = {f.name: stored[f.name] for f in dataclasses.fields(Settings) if f.name in stored}
    return Settings(**known)


def find_collection(scene: bpy.types.Scene, name: str) -> bpy.types.Collection | None:
    """Return the scene's collection of that name, numbered or not."""
    return next((c for c in scene.collection.children if c.name.split(".")[0] == name), None)


def ensure_collection(scene: bpy.types.Scene, name: str) -> bpy.types.Collection:
    """Return the scene's collection of that name, made where it is missing."""
    collection = find_collection(scene, name)
    if collection is None:
        collection = bpy.data.collections.new(name)
        scene.collection.children.link(collection)
    return collection


def free_name(name: str, slots: bpy.types.bpy_prop_collection) -> str:
    """Return a name that none of the slots has: the one given, with a number if need be."""
    taken, number, free = {slot.name for slot in slots}, 2, name
    while free in taken:
        free, number = f"{name} {number}", number + 1
    return free
