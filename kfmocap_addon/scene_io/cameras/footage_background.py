"""Footage behind cameras: movie clips as their backgrounds, at the right frame and without lens distortion."""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ....core.errors import FootageError
from ....core.shot.footage_files.image_sequences import image_files
from ....core.shot.frame_numbers import frames_per_file_frame, gap_frame, is_interlaced, whole_offset

_LONGEST = 220
"""Number of characters that Blender stores of a driver's expression, 255, without those around."""
_DRIVEN_OFFSET = re.compile(r"\) ([+-]\d+)$")
"""A clip's own offset at the end of such an expression: see `_start`."""


def as_blender_stores(path: str) -> str:
    """Return an absolute path as Blender's file browser stores it: relative to the open file, if there is one and the
    preferences do not say otherwise.
    """
    if not bpy.data.filepath or not bpy.context.preferences.filepaths.use_relative_paths:
        return path
    try:
        return bpy.path.relpath(path)
    except ValueError:  # on another drive
        return path


def load_clip(path: Path, stored: Callable[[str], str] = as_blender_stores) -> bpy.types.MovieClip:
    """Load footage as a movie clip.

    Parameters
    ----------
    path : Path
    stored : callable, optional
        Returns the path that Blender is to store for an absolute one; it must lead there from the open file or, without
        one, from the working directory. By default as other tools of Blender's do.

    Raises
    ------
    FootageError
        If Blender cannot read it.
    """
    images = image_files(path)
    first = path if images is None else images[min(images)]
    if not first.is_file():
        raise FootageError("there is no such footage", where=str(path))
    clip = bpy.data.movieclips.load(stored(str(first.resolve())))
    if clip.source == "MOVIE" and clip.frame_duration < 1:
        bpy.data.movieclips.remove(clip)
        raise FootageError("Blender cannot read the footage", where=str(path))
    return clip


def footage_folder(scene: bpy.types.Scene) -> Path | None:
    """Return the folder of the first footage of a scene's shot; None without any."""
    for view in scene.kfmocap.views:
        clip = clip_behind(view.camera) if view.camera is not None else None
        if clip is not None:
            return Path(bpy.path.abspath(clip.filepath)).parent
    return None


def clip_behind(owner: bpy.types.Object) -> bpy.types.MovieClip | None:
    """Return the footage behind a camera object."""
    for background in owner.data.background_images:
        if background.source == "MOVIE_CLIP" and background.clip is not None:
            return background.clip
    return None


def footage_path(slot: bpy.types.PropertyGroup) -> Path | None:
    """Return the footage of a view as a shot names it, or None where there is none."""
    clip = clip_behind(slot.camera) if slot.camera is not None else None
    if clip is None:
        return None
    path = Path(os.path.normpath(bpy.path.abspath(clip.filepath, library=clip.library)))
    return path.with_name(slot.sequence) if slot.sequence else path


def background_clip(slot: bpy.types.PropertyGroup) -> bpy.types.MovieClip:
    """Return the footage behind a view's camera; raises a FootageError if there is none."""
    clip = clip_behind(slot.camera)
    if clip is None:
        raise FootageError(
            "the camera has no footage",
            where=f"camera {slot.camera.name}",
            todo="give it a movie clip as background image",
        )
    return clip


def show_behind(data: bpy.types.Camera, clip: bpy.types.MovieClip) -> None:
    """Show footage behind a camera."""
    background = data.background_images.new()
    background.source, background.clip = "MOVIE_CLIP", clip
    background.alpha, background.frame_method = 1.0, "STRETCH"
    undistort(background)
    data.show_background_images = True


def undistort(background: bpy.types.CameraBackgroundImage) -> None:
    """Show the footage without lens distortion, which Blender's cameras do not have."""
    background.clip_user.use_render_undistorted = True


def show_in_time(slot: Any, first: int, frame_start: int) -> None:
    """Set up the footage behind a view's camera to show the right frames for its offset and fields.

    The Frame Offset of its clip stays: tracks and solved cameras of Blender's own do not move with it, and would leave
    the pictures on which they were made.

    Parameters
    ----------
    first : int
        First frame of the shot in the footage's count.
    frame_start : int
        Scene frame of shot frame 0.
    """
    clip = clip_behind(slot.camera) if slot.camera is not None else None
    if clip is None:
        return
    start = _plain_start(slot, first, frame_start) + clip.frame_offset
    expression = _start(slot, first - frame_start, clip.frame_offset) if _is_driven(slot) else ""
    if expression == _driver_of(clip) and (expression or start == clip.frame_start):
        return
    clip = _own_clip(slot, clip)
    clip.driver_remove("frame_start")
    clip.frame_start = start
    if expression:
        # Of functions that Blender evaluates itself: a file may drive it where Python is not trusted.
        clip.driver_add("frame_start").driver.expression = expression
    forget_pictures(clip)


def forget_pictures(clip: bpy.types.MovieClip) -> None:
    """Have Blender read the pictures of a clip anew: it keeps some by the frames of the scene on which they were shown,
    wherever the clip begins by now.
    """
    clip.filepath = str(clip.filepath)


def moved_by(slot: Any, first: int, frame_start: int) -> int:
    """Return by how many frames the pictures behind a view's camera are ahead of those that its offset says: somebody
    may have moved the clip in Blender's editor of clips.

    Parameters
    ----------
    first, frame_start : int
        See `show_in_time`.
    """
    clip = clip_behind(slot.camera) if slot.camera is not None else None
    if clip is None:
        return 0
    if _is_driven(slot):
        allowed = _DRIVEN_OFFSET.search(_driver_of(clip))
        return int(clip.frame_offset - (int(allowed[1]) if allowed else 0))
    return int(_plain_start(slot, first, frame_start) + clip.frame_offset - clip.frame_start)


def moved_offset(slot: Any, moved: int) -> float:
    """Return the offset with which a clip that is ahead by so many frames of its file shows what it shows."""
    return float(slot.offset + moved * frames_per_file_frame(slot))


def _plain_start(slot: Any, first: int, frame_start: int) -> int:
    """Return the scene frame on which a view's clip begins, where no driver says it."""
    return int(frame_start - (first + whole_offset(slot)) // frames_per_file_frame(slot))


def _is_driven(slot: Any) -> bool:
    """Whether a view's clip begins on another frame for each of the scene, to be shown in time."""
    return slot.every > 1 or is_interlaced(slot) or not all(gap.timed for gap in slot.gaps)


def _driver_of(clip: bpy.types.MovieClip) -> str:
    """Return the expression that drives where a clip begins, empty where none does."""
    drivers = clip.animation_data.drivers if clip.animation_data is not None else ()
    return next((curve.driver.expression for curve in drivers if curve.data_path == "frame_start"), "")


def _own_clip(slot: Any, clip: bpy.types.MovieClip) -> bpy.types.MovieClip:
    """Return a view's clip, which becomes a copy where another camera shows it as well, as in a copy of the scene."""
    own = slot.camera.data
    if not any(behind.clip == clip for data in bpy.data.cameras if data != own for behind in data.background_images):
        return clip
    copy = clip.copy()
    for behind in own.background_images:
        if behind.clip == clip:
            behind.clip = copy
    return copy


def _start(slot: Any, ahead: int, clip_offset: int) -> str:
    """Return a clip's start as an expression of the scene's frame: a movie clip has neither a playback rate nor gaps.

    Of footage with several frames for each of the shot, one is shown.

    Each frame of interlaced footage, with both fields interleaved, is shown on the two scene frames that are its
    fields, and the picture before missing frames in their place; Blender shows videos by the times in their files, so
    that it does so by itself where these tell. `ahead` is by how much the shot's frames are ahead of the scene's,
    `clip_offset` the clip's own Frame Offset.
    """
    every = slot.every
    shown = f"{every} * frame {every * ahead + whole_offset(slot):+d}".removeprefix("1 * ")
    for gap in (gap for gap in slot.gaps if not gap.timed):
        frame, count = gap_frame(slot, gap) - ahead, gap.missing
        steps = [f" - (frame >= {frame + i // every})" for i in range(count)] or [f" + {-count} * (frame >= {frame})"]
        if len(shown) + len("".join(steps)) > _LONGEST:
            break
        shown += "".join(steps)
    own = f" {clip_offset:+d}" if clip_offset else ""
    return f"frame - floor(({shown}) / {frames_per_file_frame(slot)}){own}"


def look_through(scene: bpy.types.Scene, slot: bpy.types.PropertyGroup) -> None:
    """Make a view the scene's camera, with the resolution and pixel aspect of its footage."""
    scene.camera = slot.camera
    render = scene.render
    render.resolution_x, render.resolution_y = slot.size
    render.resolution_percentage = 100
    render.pixel_aspect_x, render.pixel_aspect_y = slot.aspect
    refresh(scene)


def refresh(scene: bpy.types.Scene) -> None:
    """Show the footage of all views in their cameras, with the scene's opacity for it.

    The scene's resolution is that of one view; in cameras of another shape, footage keeps its own proportions. A
    camera's lens refers to its picture's width, so that is what the footage must span.
    """
    render = scene.render
    aspect = render.resolution_x * render.pixel_aspect_x / (render.resolution_y * render.pixel_aspect_y)
    for slot in scene.kfmocap.views:
        for background in slot.camera.data.background_images if slot.camera is not None else ():
            own = slot.size[0] * slot.aspect[0] / (slot.size[1] * slot.aspect[1])
            same = abs(own - aspect) < 1e-4 * aspect
            background.frame_method = "STRETCH" if same else "FIT" if own > aspect else "CROP"
            background.alpha = scene.kfmocap.opacity
