"""What key frames show of the performers: their colours against the background, and the shapes of their parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body import Body
from ..body.kinematics import scene_poses
from ..body.motion import Motion
from ..body.time_shift import poses_after
from ..evidence.foreground import HALO, foreground_images
from ..evidence.label_images import Geometry, render_labels
from ..evidence.part_shapes import fitted_shape
from ..evidence.view_frames import ViewFrames, views_with_foreground
from .reader import ColourFrames

Frames = NDArray[np.int64]


def grey_frames(frames: ColourFrames) -> ViewFrames:
    """The grey levels of frames, for solvers that look at gradients alone."""
    grey = np.stack([cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in frames.colour])
    return ViewFrames(frames.camera, grey, frames.first, delay=frames.delay)


def frames_with_foreground(
    frames: ColourFrames, bodies: Sequence[Body], motions: Sequence[Motion], keys: Frames, footage_offset: float
) -> ViewFrames:
    """Grey levels and foreground images of frames, some of which have key poses.

    Parameters
    ----------
    frames : ColourFrames
        Consecutive frames of a view.
    bodies : sequence of Body
    motions : sequence of Motion
        Poses on every frame of the shot, of which those on the key frames count.
    keys : ndarray of int, shape (K,)
        Shot frames, among these, that show the performers in known poses.
    footage_offset : float
        See `core.shot.shot.Settings`.

    Returns
    -------
    ViewFrames
        Without foreground images where the view sees nobody on the key frames, or there are none.
    """
    view = grey_frames(frames)
    if not len(keys):
        return view
    R, T = scene_poses(bodies, poses_after(motions, view.delay - footage_offset, keys))
    seen = render_labels(Geometry.of(bodies), view.camera.at(keys.tolist()), 0, R, T).part >= 0
    if not seen.any():
        return view
    scale = view.pixels_per_metre(T[0].mean(axis=0), int(keys[0]))
    masks = dict(zip((keys - view.first).tolist(), seen, strict=True))
    foreground = foreground_images(frames.colour, masks, scale, view.camera.stands_still)
    return replace(view, foreground=foreground, halo=HALO)


def key_frame_shape(
    views: Sequence[ViewFrames], bodies: Sequence[Body], motions: Sequence[Motion], keys: Frames, footage_offset: float
) -> Geometry | None:
    """The parts of all performers as the key frames show them; None where no view has foreground images.

    Parameters are those of `frames_with_foreground`.
    """
    seeing = views_with_foreground(views)
    if not seeing:
        return None
    shown = {d: poses_after(motions, d - footage_offset, keys) for d in {view.delay for view in seeing}}
    poses = {d: scene_poses(bodies, there) for d, there in shown.items()}
    return fitted_shape(seeing, Geometry.of(bodies), poses, keys.tolist())
