"""The views' pictures of the key frames."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import repeat

import cv2
import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera, reduced_size
from ..errors import KFMocapError
from ..runtime.progress import Progress, report_progress
from ..shot.footage import frames_at, working_factor
from ..shot.footage_faults.footage_checks import check_view
from ..shot.frame_numbers import shown_delay
from ..shot.segments import whole_keys
from ..shot.shot import Shot, View


@dataclass(frozen=True, eq=False)
class KeyFrameView:
    """The pictures of the K key frames in one view.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames.
    pictures : ndarray of uint8, shape (K, h, w, 3)
        Reduced in size, with lens distortion; blue, green, red.
    factor : float
        Factor by which they are reduced.
    delay : float
        See `core.body.time_shift`.
    """

    frames: NDArray[np.int64]
    pictures: NDArray[np.uint8]
    factor: float
    delay: float

    def rectified(self, camera: Camera) -> NDArray[np.uint8]:
        """Return the pictures as the camera would have taken them without distortion, of the same shape."""
        own, undone = camera.reduced(self.factor), camera.unzooming(self.frames.tolist())
        turns = repeat(None) if undone is None else undone
        every = [own.rectify_maps(turn) for _, turn in zip(self.pictures, turns, strict=False)]
        remapped = [
            p if maps is None else cv2.remap(p, *maps, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for p, maps in zip(self.pictures, every, strict=True)
        ]
        return np.asarray(np.stack(remapped).astype(np.uint8, copy=False))

    def camera(self, camera: Camera) -> Camera:
        """Return the camera of the rectified pictures, whose frame k is the k-th key frame."""
        return camera.rectified().at(self.frames.tolist()).reduced(self.factor)


def posed_key_frames(shot: Shot, missing: KFMocapError) -> NDArray[np.int64]:
    """Return the shot frames with a key pose of the whole body of every performer.

    Raises
    ------
    KFMocapError
        `missing`, if there is no such frame.
    """
    frames = whole_keys(shot, 0, shot.length - 1)
    if not len(frames):
        raise missing
    return frames


def read_key_frames(shot: Shot, frames: NDArray[np.int64], progress: Progress | None) -> list[KeyFrameView]:
    """Decode the key frames of every view.

    Raises
    ------
    FootageError
        See `core.tracking.tracker.track`.
    CancelledError
    """
    found = []
    for v, view in enumerate(shot.views):
        check_view(view, shot.frames[0], shot.length, shot.fps)
        report_progress(progress, "footage", v / len(shot.views))
        found.append(_read(view, shot, frames))
    return found


def pictured_key_frames(
    shot: Shot, frames: NDArray[np.int64], pictures: Sequence[Mapping[int, NDArray[np.uint8]]]
) -> list[KeyFrameView]:
    """Make the views of key frames from pictures in memory, reduced like those that are read.

    Parameters
    ----------
    shot : Shot
        Whose cameras have no lens distortion.
    frames : ndarray of int, shape (K,)
    pictures : sequence of mappings
        Per view: rectified pictures by shot frame, no smaller than the working size; see `TrackResult.pictures`.
    """
    found = []
    for view, images in zip(shot.views, pictures, strict=True):
        factor = working_factor(view, shot.settings.working_size)
        size = reduced_size(view.camera.size, factor)
        reduced = [cv2.resize(images[int(frame)], size, interpolation=cv2.INTER_AREA) for frame in frames]
        delay = shown_delay(view, shot.settings)
        found.append(KeyFrameView(frames, np.stack(reduced).astype(np.uint8, copy=False), factor, delay))
    return found


def _read(view: View, shot: Shot, frames: NDArray[np.int64]) -> KeyFrameView:
    """Decode the key frames with distortion: rectification depends on the focal length, which is still to change."""
    factor = working_factor(view, shot.settings.working_size)
    as_stored = replace(view, camera=view.camera.rectified())
    pictures = frames_at(as_stored, [shot.frames[0] + int(f) for f in frames], factor, grey=False)
    return KeyFrameView(frames, np.stack(list(pictures)), factor, shown_delay(view, shot.settings))
