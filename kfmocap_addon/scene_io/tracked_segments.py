"""Segments between key poses in a scene: which to track, what is beside them, and from what they were tracked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.body.motion import Motion
from ...core.errors import ShotError
from ...core.numerics.frame_ranges import segments_joined
from ...core.shot.segments import Segment, segments
from ...core.shot.shot import KeyPoses, Performer, Shot
from ...core.tracking.footage_corrections.footage_gaps import with_found_gaps
from ...core.tracking.footage_reading.turned_cameras import with_turns
from ...core.tracking.results.track_result import TrackResult
from ...core.tracking.retracking import Excerpt, digests
from . import lossless, prop_holds
from . import scene as scenes
from .cameras import view_cameras
from .cameras.view_gaps import remember_gaps
from .keys import motion_curves
from .review import bone_confidence, plant_lists, review_data

_OFFSET = "kfmocap_footage_offset"


def out_of_date(scene: bpy.types.Scene, shot: Shot) -> list[Segment]:
    """Return the segments of a scene's shot that have changed since they were tracked, or were never tracked."""
    keyed = _keyed(scene, scene.kfmocap.performers, 0, shot.length)
    tracked = {(slot.first, slot.last): slot.digest for slot in scene.kfmocap.stretches}
    zero = shot.frames[0]
    return [
        (first, last)
        for (first, last), now in digests(shot, segments(shot)).items()
        if not keyed[first : last + 1].all() or tracked.get((zero + first, zero + last)) != now
    ]


@dataclass(frozen=True, eq=False)
class AskedTracking:
    """What of a scene's shot is to be tracked.

    Attributes
    ----------
    whole : Shot
        The scene's shot as it was read.
    shot : Shot
        What the tracker is given: all of it, or one performer with what is known of the others.
    slots : mapping of int to KFMocapPerformer
        Whose motion is written, by their numbers among the performers of `shot`.
    among : tuple of KFMocapPerformer
        The performers of `shot`.
    """

    whole: Shot
    shot: Shot
    slots: Mapping[int, bpy.types.PropertyGroup]
    among: tuple[bpy.types.PropertyGroup, ...]


def asked_tracking(scene: bpy.types.Scene, shot: Shot, one: bpy.types.PropertyGroup | None = None) -> AskedTracking:
    """Ask for the tracking of all performers of a scene's shot, or of one.

    If one is tracked, others that are already tracked on every frame are held, so that they are known to hide it;
    others with key poses only are tracked together with it, and their results are discarded. Those without a key pose
    are left out.
    """
    slots = tuple(scene.kfmocap.performers)
    shot = prop_holds.with_grips_of_scene(scene, shot)
    if one is None:
        return AskedTracking(shot, shot, dict(enumerate(slots)), slots)
    performers: list[Performer] = []
    among: list[bpy.types.PropertyGroup] = []
    number = 0
    for slot, performer in zip(slots, shot.performers, strict=True):
        if slot == one:
            number = len(performers)
        elif not len(performer.key_poses.frames):
            continue
        elif motion_curves.keyed_frames(slot.armature, scene.kfmocap.frame_start, shot.length).all():
            motion = motion_curves.read_motion(slot.armature, scene.kfmocap.frame_start, shot.length)
            performer = replace(performer, key_poses=_held(performer.key_poses, motion))
        performers.append(performer)
        among.append(slot)
    names = {performer.name for performer in performers}
    holds = tuple(hold for hold in shot.holds if {hold.prop, hold.holder} <= names)
    asked = replace(shot, performers=tuple(performers), holds=holds)
    return AskedTracking(shot, asked, {number: one}, tuple(among))


def _held(keys: KeyPoses, motion: Motion) -> KeyPoses:
    """Return a motion as key poses on every frame. On frames without a key pose of the animator's, the last part is
    left free, so that they are not key poses of the whole body, from which appearance is learned and where segments
    meet.
    """
    frames = np.arange(len(motion))
    fixed = np.ones((len(motion), 3 + 3 * motion.rotations.shape[1]), bool)
    fixed[~np.isin(frames, keys.full()), -3:] = False
    return KeyPoses(frames, motion, fixed)


def excerpts(
    scene: bpy.types.Scene, asked: AskedTracking, chosen: Sequence[Segment], *, anew: bool = True
) -> list[Excerpt]:
    """Return the runs of some segments, each with what is known of the rest of the shot: the poses beside it that are
    tracked or keyed, and the offset of the footage; unless they are tracked anew, with the motion that they have.
    """
    shot = asked.shot
    return [
        Excerpt(
            first,
            last,
            (_pose(scene, asked, first - 1), _pose(scene, asked, last + 1)),
            None if (first, last) == (0, shot.length - 1) else _footage_offset(scene),
            () if anew else _motions(scene, asked, first, last),
        )
        for first, last in segments_joined(chosen)
    ]


def write(
    scene: bpy.types.Scene,
    asked: AskedTracking,
    parts: Sequence[Excerpt],
    results: Sequence[TrackResult],
    *,
    unwatched: bool = True,
) -> Shot:
    """Write what was tracked into the scene that the shot was read from; returns the scene's shot as it stands.

    Parameters
    ----------
    unwatched : bool
        Whether the scene may have changed since it was read; it is then read again and compared.

    Raises
    ------
    KFMocapError
        The scene has changed; nothing is written then.
    """
    whole = _unchanged(scene, asked.whole, parts) if unwatched else asked.whole
    shot, slots = asked.shot, list(asked.slots.values())
    for part, result in zip(parts, results, strict=True):
        scenes.write_motions(scene, [result.motions[i] for i in asked.slots], first=part.first, slots=slots)
        remember_footage(scene, result, offset=part.footage_offset is None)
        if view_cameras.show_turns(scene, with_turns(shot, result.turns), result.turns):
            # Segments are out of date once the scene differs from what it is now.
            shot = replace(shot, views=scenes.shot_from_scene(scene).views)
    tracked = [(shot.between(p.first, p.last), result, p.first) for p, result in zip(parts, results, strict=True)]
    review_data.write_review(scene, tracked, slots=asked.slots, whole=whole)
    if len(slots) == len(asked.whole.performers):
        _remember(scene, shot, _digests(shot, parts, results))
    scene.frame_set(scene.frame_current, subframe=scene.frame_subframe)  # the tracked pose is shown
    return whole


def remember_footage(scene: bpy.types.Scene, result: TrackResult, *, offset: bool = True) -> None:
    """Store the footage's gaps and offset that a track has found, for tracking parts again and for showing it."""
    remember_gaps(scene, result.gaps)
    if not offset:
        return
    scene.kfmocap.footage_offset = result.footage_offset
    lossless.keep(scene, _OFFSET, result.footage_offset)


def with_footage_offset(scene: bpy.types.Scene, shot: Shot) -> Shot:
    """Return a scene's shot with the footage offset that an earlier track found, if any."""
    return shot.with_footage_offset(_footage_offset(scene))


def clear(scene: bpy.types.Scene, chosen: Sequence[Segment]) -> int:
    """Remove the tracked keys of some segments of a scene's shot; returns on how many frames there were any."""
    frames = [scene.kfmocap.frame_start + f for f in sorted({f for a, b in chosen for f in range(a, b + 1)})]
    cleared: set[int] = set()
    for slot in scene.kfmocap.performers:
        if gone := motion_curves.clear_motion(slot.armature, frames):
            bone_confidence.forget(scene, slot, sorted(gone))
            plant_lists.forget(slot, gone)
            cleared |= gone
    return len(cleared)


def _unchanged(scene: bpy.types.Scene, shot: Shot, parts: Sequence[Excerpt]) -> Shot:
    """Read a scene's shot again: another window may have changed it since."""
    now = scenes.shot_from_scene(scene)
    changed = [(part.first, part.last) for part in parts]
    if now.frames != shot.frames or digests(now, changed) != digests(shot, changed):
        raise ShotError("it was changed while it was tracked", where=f"scene {scene.name}", todo="track again")
    return now


def _digests(shot: Shot, parts: Sequence[Excerpt], results: Sequence[TrackResult]) -> dict[Segment, str]:
    """Return from what the segments of some excerpts were tracked: gaps were found in one after the other."""
    found = {}
    for part, result in zip(parts, results, strict=True):
        done = [s for s in segments(shot) if part.first <= s[0] and s[1] <= part.last]
        found.update(digests(with_found_gaps(shot, result.gaps), done))
    return found


def _remember(scene: bpy.types.Scene, shot: Shot, tracked: Mapping[Segment, str]) -> None:
    """Keep from what segments were tracked; frames that are no longer a segment of the shot are forgotten."""
    zero = shot.frames[0]
    kept = {(slot.first - zero, slot.last - zero): slot.digest for slot in scene.kfmocap.stretches}
    kept.update(tracked)
    scene.kfmocap.stretches.clear()
    for first, last in segments(shot):
        if (first, last) in kept:
            slot = scene.kfmocap.stretches.add()
            slot.first, slot.last, slot.digest = zero + first, zero + last, kept[first, last]


def _footage_offset(scene: bpy.types.Scene) -> float | None:
    """Return the offset of the footage as it was found; None where nothing was tracked."""
    return float(lossless.recall(scene, _OFFSET, scene.kfmocap.footage_offset)) if _OFFSET in scene else None


def _pose(scene: bpy.types.Scene, asked: AskedTracking, frame: int) -> tuple[Motion, ...] | None:
    """Every performer's pose on a shot frame; None beyond the shot, and where one has neither a tracked pose nor a
    key pose.
    """
    if not 0 <= frame < asked.shot.length or not _keyed(scene, asked.among, frame, 1).all():
        return None
    start = scene.kfmocap.frame_start
    return tuple(motion_curves.read_motion(slot.armature, start + frame, 1) for slot in asked.among)


def _motions(scene: bpy.types.Scene, asked: AskedTracking, first: int, last: int) -> tuple[Motion, ...]:
    """Every performer's motion on shot frames; none where some frame is neither tracked nor keyed."""
    count, start = last + 1 - first, scene.kfmocap.frame_start + first
    if not _keyed(scene, asked.among, first, count).all():
        return ()
    return tuple(motion_curves.read_motion(slot.armature, start, count) for slot in asked.among)


def _keyed(
    scene: bpy.types.Scene, slots: Sequence[bpy.types.PropertyGroup], first: int, length: int
) -> NDArray[np.bool_]:
    """Shot frames, from the first on, on which every channel of every performer has a key, shape (length,)."""
    start = scene.kfmocap.frame_start + first
    return np.all([motion_curves.keyed_frames(slot.armature, start, length) for slot in slots], axis=0)
