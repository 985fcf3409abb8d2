"""Pictures of the misfit: where the footage contradicts the model on one frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import scene_poses
from ..body.motion import Motion
from ..body.time_shift import poses_after
from ..errors import ShotError
from ..evidence.foreground_images.foreground import SURE_LOG_RATIO, foreground_images, log_ratio
from ..evidence.misfit import OWN_REACH
from ..evidence.rendering.label_images import render_labels
from ..evidence.rendering.part_geometry import Geometry
from ..shot.footage import MAX_PICTURE_SIDE, frames_at, working_factor
from ..shot.footage_faults.footage_checks import check_view
from ..shot.frame_numbers import shown_delay
from ..shot.segments import posed_frames, segments
from ..shot.shot import Shot, View

Image = NDArray[np.uint8]

UNCOVERED, BEYOND = (40, 90, 255), (255, 120, 40)
"""Colours (blue, green, red) where the performer is not covered by the model, and where the model covers background."""
_PICTURE_BRIGHTNESS = 0.6


@dataclass(frozen=True, eq=False)
class MisfitPicture:
    """The misfit in one view on one frame.

    Attributes
    ----------
    image : ndarray of uint8, shape (h, w, 3)
        The rectified footage in dark grey, tinted; blue, green, red.
    uncovered, beyond : float
        Area that looks like the performers but is not covered, and area that is covered but looks like background,
        relative to the model's area.
    """

    image: Image
    uncovered: float
    beyond: float


def misfit_picture(shot: Shot, view: View, motions: Sequence[Motion], frame: int) -> MisfitPicture:
    """Compare one frame of a view with a motion, using the colours of the key frames around it.

    Parameters
    ----------
    shot : Shot
    view : View
        One of the shot's.
    motions : sequence of Motion
        One per performer, a pose for every frame.
    frame : int
        Shot frame.

    Raises
    ------
    ShotError
        There is no key pose of the whole body before or after the frame, or the view shows no performer on it.
    FootageError
        The footage cannot be read.
    """
    segment = next((s for s in segments(shot) if s[0] <= frame <= s[1]), (0, shot.length - 1))
    keys = posed_frames(shot, *segment).frames.tolist()
    where = f"frame {shot.frames[0] + frame}"
    if not 0 <= frame < shot.length:
        first, last = shot.frames
        raise ShotError(f"the shot has frames {first} to {last}", where=where, todo="go to one of these")
    if not keys:
        raise ShotError("there is no key pose of the whole body around it", where=where, todo="set one, and track")
    frames = sorted({*keys, frame})
    camera = view.camera.reduced(factor := working_factor(view, MAX_PICTURE_SIDE)).rectified()
    check_view(view, shot.frames[0], shot.length, shot.fps)
    numbers, turns = [shot.frames[0] + f for f in frames], view.camera.unzooming(frames)
    colour = np.stack(list(frames_at(view, numbers, factor, grey=False, turns=turns)))
    bodies = [performer.body for performer in shot.performers]
    R, T = scene_poses(bodies, poses_after(motions, shown_delay(view, shot.settings), frames))
    geometry = Geometry.of(bodies)
    models = [render_labels(geometry, camera, f, R[[k]], T[[k]]).part[0] >= 0 for k, f in enumerate(frames)]
    if not any(models[frames.index(key)].any() for key in keys):
        raise ShotError(
            "it sees nobody on the key frames", where=f"view {view.camera.name}", todo="choose another view"
        )
    scale = camera.pixels_per_metre(T.mean(axis=(0, 1)), frame)
    masks = {frames.index(key): models[frames.index(key)] for key in keys}
    now = frames.index(frame)
    ratio = log_ratio(foreground_images(colour, masks, scale, camera.stands_still)[now])
    return _tinted(colour[now], ratio, models[now], OWN_REACH * scale)


def _tinted(picture: Image, ratio: NDArray[np.float32], model: NDArray[np.bool_], near: float) -> MisfitPicture:
    """Tint a picture where log likelihood ratios (h, w) contradict the model, up to `near` pixels from it."""
    beside = cv2.distanceTransform((~model).astype(np.uint8), cv2.DIST_L2, 3) < near
    uncovered = np.where(beside & ~model, np.clip(ratio / SURE_LOG_RATIO, 0, 1), 0)
    beyond = np.where(model, np.clip(-ratio / SURE_LOG_RATIO, 0, 1), 0)
    grey = cv2.cvtColor(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR) * _PICTURE_BRIGHTNESS
    for share, tint in ((uncovered, UNCOVERED), (beyond, BEYOND)):
        grey = grey + share[..., None] * (np.array(tint) - grey)
    area = max(int(model.sum()), 1)
    return MisfitPicture(grey.astype(np.uint8), float(uncovered.sum()) / area, float(beyond.sum()) / area)
