"""Key poses made of a detector's keypoints or of landmarks, on the frames that the animator asks for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np

from ...core.body import Body
from ...core.body.inverse_kinematics import fit_poses
from ...core.body.motion import Motion
from ...core.errors import KeypointError, LandmarkError, ShotError
from ...core.formats.keypoint_files import read_keypoints, read_shot_keypoints
from ...core.formats.landmark_files import landmarks_of, read_landmarks
from ...core.formats.trc import Landmarks
from ...core.keypoints.observations import performer_keypoints
from ...core.keypoints.proposals import KeypointPoses, away_from_keys, best_frames
from ...core.posing.clicks import pixel
from ...core.shot.shot import KeyPoses, Shot
from ..scene_io import joint_marks
from ..scene_io import scene as scenes
from ..scene_io.body import body_armature
from ..scene_io.cameras import view_cameras
from ..scene_io.keys import key_pose_curves, motion_curves

_RATES_DIFFER = 0.01
"""Relative difference from which the rate of a file is meant to be another than the shot's: 29.97 and 30 are not."""


def frames_wanted(scene: bpy.types.Scene) -> list[int] | None:
    """Return the shot frames that the scene's settings ask for; None where they are to be proposed.

    Raises
    ------
    ShotError
        A frame lies outside the shot, or the text is not a list of frames.
    """
    properties, wanted = scene.kfmocap, scene.kfmocap.key_frames
    if wanted.choice == "AUTO":
        return None
    if wanted.choice == "EVERY":
        return list(range(0, properties.length, wanted.step))
    listed = [scene.frame_current] if wanted.choice == "CURRENT" else frames_listed(wanted.listed)
    frames = [frame - properties.frame_start for frame in listed]
    for frame, shown in zip(frames, listed, strict=True):
        if not 0 <= frame < properties.length:
            last = properties.frame_start + properties.length - 1
            todo = f"the shot is shown on frames {properties.frame_start} to {last}"
            raise ShotError(f"frame {shown} lies outside the shot", where="Frames", todo=todo)
    return sorted(set(frames))


def frames_listed(text: str) -> list[int]:
    """Return the scene frames of a list such as "1, 20, 40-42".

    Raises
    ------
    ShotError
        The text is not a list of frames.
    """
    found: list[int] = []
    for item in filter(None, (part.strip() for part in text.split(","))):
        ends = re.fullmatch(r"(-?\d+)(?:\s*-\s*(-?\d+))?", item)
        if ends is None:
            raise ShotError(f"'{item}' is no frame", where="Frames", todo="list them as in 1, 20, 40-42")
        first, last = int(ends[1]), int(ends[2] or ends[1])
        found += range(first, last + 1)
    if not found:
        raise ShotError("no frame is listed", where="Frames", todo="list some, as in 1, 20, 40-42")
    return found


def set_key_poses(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, frames: Sequence[int], poses: Motion) -> int:
    """Set key poses on shot frames as if the animator had done so, beside the keys that are there already unless the
    settings say that these are replaced; returns how many were set.
    """
    start = scene.kfmocap.frame_start
    own = {frame - start for frame in key_pose_curves.keyed_bones(slot.armature)[0]}
    free = [i for i, frame in enumerate(frames) if scene.kfmocap.key_frames.replace or frame not in own]
    if free:
        key_pose_curves.write_key_poses(slot.armature, KeyPoses.whole([frames[i] for i in free], poses[free]), start)
    return len(free)


def without_replaced(scene: bpy.types.Scene, shot: Shot, number: int, frames: Sequence[int] | None) -> Shot:
    """Return the shot without the key poses of a performer that are to be replaced, so that they do not constrain the
    new ones.
    """
    if frames is None or not scene.kfmocap.key_frames.replace:
        return shot
    performers, keys = list(shot.performers), shot.performers[number].key_poses
    kept = ~np.isin(keys.frames, list(frames))
    left = KeyPoses(keys.frames[kept], keys.poses[kept], keys.fixed[kept])
    performers[number] = replace(performers[number], key_poses=left)
    return replace(shot, performers=tuple(performers))


def propose(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, seen: KeypointPoses) -> int:
    """Show a motion as tracked, with key poses proposed on some of its frames; returns their number."""
    start = scene.kfmocap.frame_start
    earlier = key_pose_curves.keyed_bones(slot.armature)[1]
    motion_curves.write_motion(slot.armature, seen.motion, start, np.union1d(start + seen.frames, earlier))
    return len(seen.frames)


def attach_keypoints(scene: bpy.types.Scene, paths: Sequence[Path]) -> dict[str, int]:
    """Give views a detector's keypoints, by the view's name in the path; returns how many people each shows.

    A single file or folder without the name of a view belongs to the view that the scene looks through. A folder
    without files stands for those of its folders that have the name of a view.

    Raises
    ------
    KeypointError
        A file is not a keypoint file, or contains nobody.
    """
    each = [part for path in paths for part in _parts(scene, path)]
    sources = list(dict.fromkeys(_source(path) for path in each))
    chosen = {_view_of(scene, source, alone=len(sources) == 1).name: source for source in sources}
    if len(chosen) < len(sources):
        raise KeypointError("two of the files are for the same view", todo="choose one file or folder for each view")
    people = {}
    for name, source in chosen.items():
        people[name] = len(read_keypoints(source, tuple(scene.kfmocap.views[name].size)))
    for name, source in chosen.items():
        view_cameras.set_keypoints(scene.kfmocap.views[name], source)
    return people


def mark_keypoints(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> int:
    """Turn a detector's keypoints on the current frame into the chosen performer's marks; returns their number.

    Raises
    ------
    KeypointError
        No view has keypoints of the performer on this frame.
    """
    shot = scenes.shot_from_scene(scene)
    frame = scene.frame_current - scene.kfmocap.frame_start
    number = next(i for i, other in enumerate(scene.kfmocap.performers) if other == slot)
    if not 0 <= frame < shot.length:
        raise KeypointError("the frame lies outside the shot", where=f"frame {scene.frame_current}")
    keypoints = performer_keypoints(shot, read_shot_keypoints(shot))[number]
    found = dict(joint_marks.on_frame(slot, scene.frame_current))
    before = len(found)
    for v, k in zip(*np.nonzero(keypoints.confidence[:, frame] > 0), strict=True):
        name = keypoints.names[k]
        if name in shot.performers[number].body.landmarks:
            lens = shot.views[v].camera.at([frame]).unzoomed()  # marks are places in the picture of this frame
            x, y = pixel(lens.matrix, keypoints.rays[v, frame, k])
            found.setdefault((shot.views[v].camera.name, name), (float(x), float(y)))
    if len(found) == before:
        todo = "import keypoints first, or choose another frame"
        raise KeypointError("no new keypoint is known here", where=f"frame {scene.frame_current}", todo=todo)
    joint_marks.put(slot, scene.frame_current, found)
    return len(found) - before


def landmark_poses(
    scene: bpy.types.Scene, slot: bpy.types.PropertyGroup, path: Path, up: str, first_row: int
) -> tuple[list[int], Motion]:
    """Return shot frames, and the poses that a file of landmarks shows there, on the frames that the settings ask for.

    Raises
    ------
    KFMocapError
        The file cannot be read, or gives no pose on one of the frames.
    """
    body = body_armature.body_from_armature(slot.armature)
    landmarks = landmarks_of(body, read_landmarks(path, up), str(path))
    rows = _rows(scene, landmarks, first_row)
    frames = frames_wanted(scene)
    if frames is None:
        own = np.array(sorted(key_pose_curves.keyed_bones(slot.armature)[0]), np.int64) - scene.kfmocap.frame_start
        known = [np.isfinite(landmarks.points_world[row]).all(axis=-1).mean() if row >= 0 else 0.0 for row in rows]
        chosen = away_from_keys(best_frames(np.array(known), scenes.frame_rate(scene)), own, scenes.frame_rate(scene))
        frames = [int(frame) for frame in chosen if known[frame] > 0]
    return frames, _fitted(
        scene, body, landmarks, rows=[int(rows[frame]) for frame in frames], frames=frames, where=str(path)
    )


def _fitted(
    scene: bpy.types.Scene, body: Body, landmarks: Landmarks, *, rows: list[int], frames: list[int], where: str
) -> Motion:
    for row, frame in zip(rows, frames, strict=True):
        shown = scene.kfmocap.frame_start + frame
        if row < 0:
            raise LandmarkError(f"it has no row for frame {shown}", where=where, todo="choose another first row")
        if np.isfinite(landmarks.points_world[row]).all(axis=-1).sum() < 3:
            what = f"it knows fewer than three landmarks on frame {shown}"
            raise LandmarkError(what, where=where, todo="choose other frames")
    if not frames:
        raise LandmarkError("no frame beside your key poses is left", where=where, todo="choose the frames yourself")
    return fit_poses(body, landmarks.names, landmarks.points_world[rows])


def _rows(scene: bpy.types.Scene, landmarks: Landmarks, first_row: int) -> np.ndarray:
    """Return the file's row of every shot frame, -1 where there is none; the file may have another rate than the
    shot.
    """
    fps = scenes.frame_rate(scene)
    rate = landmarks.fps / fps if landmarks.fps > 0 and abs(landmarks.fps / fps - 1) > _RATES_DIFFER else 1.0
    rows = first_row + np.rint(rate * np.arange(scene.kfmocap.length)).astype(np.int64)
    return np.where((rows >= 0) & (rows < len(landmarks)), rows, -1)


def _parts(scene: bpy.types.Scene, path: Path) -> list[Path]:
    """Return the folders of the views in a folder that has no file itself; else the path alone."""
    if not path.is_dir() or any(path.glob("*.json")):
        return [path]
    names = [view.name.lower() for view in scene.kfmocap.views]
    folders = [part for part in sorted(path.iterdir()) if part.is_dir()]
    return [part for part in folders if any(name in part.name.lower() for name in names)] or [path]


def _source(path: Path) -> Path:
    """Return the file, or its folder where it is one of many files, one for every picture."""

    def pattern(name: str) -> str:
        return re.sub(r"\d+(?=\D*$)", "#", name)

    if path.is_dir():
        return path
    alike = [other for other in path.parent.glob("*.json") if pattern(other.name) == pattern(path.name)]
    one_picture = len(set(read_keypoints(path, (1, 1)).frames.tolist())) <= 1 if len(alike) > 1 else False
    return path.parent if one_picture else path


def _view_of(scene: bpy.types.Scene, source: Path, alone: bool) -> bpy.types.PropertyGroup:
    slots = scene.kfmocap.views
    for name in (source.name, source.parent.name):
        named = [slot for slot in slots if slot.name.lower() in name.lower()]
        if named:
            return max(named, key=lambda slot: len(slot.name))
    shown = scene.kfmocap.shown_view
    if alone and shown >= 0:
        return slots[shown]
    known = ", ".join(slot.name for slot in slots)
    raise KeypointError(
        "its name does not say which view it belongs to", where=str(source), todo=f"name it by its view: {known}"
    )
