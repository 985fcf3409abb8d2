"""Reduced frames of a view, and a cache of the gradient images that are made of them when they are needed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..runtime.processes.shared_arrays import copied_from_map
from ..shot.footage_faults.continuity import single_frames
from .foreground_images.part_colours import ColouredFrames, PartColours
from .smoothed_images import SmoothedImages

BOX_MARGIN = 6
"""Margin around a requested box for which gradient images are computed as well, pixels."""
MAX_CACHED_BYTES = 32 << 20
"""Largest size of one view's gradient images in a cache."""
_MIN_CACHED_SHARE = 0.25
"""Share of a view that a cache must hold: less saves little time, and takes as much memory."""


@dataclass(frozen=True, eq=False)
class ViewFrames:
    """Consecutive frames of a view, reduced in size and without lens distortion.

    Attributes
    ----------
    camera : Camera
        The camera for the reduced frames, without lens distortion.
    grey : ndarray of uint8, shape (N, h, w)
    first : int
        Shot frame of the first of them.
    foreground : ndarray of uint8, shape (M, N, h, w), optional
        Foreground images of each of M performers, see `core.evidence.foreground_images.foreground`.
    halo : float
        Distance by which foreground images extend beyond the body's edge, pixels.
    delay : float
        How much later than the shot's frames these were taken, in frames; see `core.body.time_shift`.
    torn : ndarray of bool, shape (N - 1,), optional
        Pairs of frames that do not continue each other and are not used as evidence, see `footage_faults.continuity`.
    damaged : ndarray of bool, shape (N,), optional
        Frames that are not used as evidence, nor the pairs that they belong to.
    colours : PartColours, optional
        Colours of the performers' parts.
    palette : ndarray of uint8, shape (N, h, w), optional
        Index of the palette's colour of every pixel.
    """

    camera: Camera
    grey: NDArray[np.uint8]
    first: int
    foreground: NDArray[np.uint8] | None = None
    halo: float = 0.0
    delay: float = 0.0
    torn: NDArray[np.bool_] | None = None
    damaged: NDArray[np.bool_] | None = None
    colours: PartColours | None = None
    palette: NDArray[np.uint8] | None = None

    def sound(self, first: int, count: int) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Return which of consecutive shot frames are evidence, (count,), and which of their pairs, (count - 1,)."""
        N = len(self.grey)
        torn = np.zeros(N - 1, bool) if self.torn is None else self.torn
        bad = np.zeros(N, bool) if self.damaged is None else self.damaged
        start = first - self.first
        frames, pairs = ~(single_frames(torn) | bad), ~(torn | bad[:-1] | bad[1:])
        return frames[start : start + count], pairs[start : start + count - 1]

    def between(self, first: int, last: int) -> ViewFrames:
        """Return shot frames `first` to `last` alone; which of them are evidence stays the same."""
        rows, (sound, _) = slice(first - self.first, last + 1 - self.first), self.sound(self.first, len(self.grey))
        return replace(
            self,
            grey=self.grey[rows],
            first=first,
            foreground=None if self.foreground is None else self.foreground[:, rows],
            torn=None if self.torn is None else self.torn[rows.start : rows.stop - 1],
            damaged=~sound[rows],
            palette=None if self.palette is None else self.palette[rows],
        )

    def part_colours(self, first: int, count: int, stride: int = 1) -> ColouredFrames | None:
        """Return the palette colours of consecutive shot frames, at every stride-th pixel; None without any."""
        if self.colours is None or self.palette is None:
            return None
        start = first - self.first
        return ColouredFrames(self.colours, copied_from_map(self.palette[start : start + count, ::stride, ::stride]))

    def foreground_at(self, first: int, count: int, stride: int = 1) -> NDArray[np.uint8]:
        """Return the foreground images of consecutive shot frames at every stride-th pixel, shape (M, count, h, w)."""
        assert self.foreground is not None
        start = first - self.first
        return copied_from_map(self.foreground[:, start : start + count, ::stride, ::stride])


def is_cached(view: ViewFrames, frames: range, nbytes: int, most: int) -> bool:
    """Whether what was made of some of a view's frames is kept for the next evaluation.

    The same is kept whichever thread comes first, as what lies beyond the edge of gradient images depends on it.

    Parameters
    ----------
    view : ViewFrames
    frames : range
        Consecutive shot frames, one of several windows of this length.
    nbytes : int
        Size of what was made of them.
    most : int
        Largest size of what is kept of all windows. If it holds less than `_MIN_CACHED_SHARE` of them, none is kept.
    """
    step = max(len(frames) - 1, 1)
    before, all_frames = frames.start - view.first, len(view.grey)
    return (1 + before / step) * nbytes <= most and (all_frames - 1) / step * nbytes <= most / _MIN_CACHED_SHARE


class GradientImageCache:
    """Gradient images, kept from one evaluation of the evidence to the next, when performers have hardly moved.

    Threads may share a cache; what it returns does not depend on their order.
    """

    def __init__(self) -> None:
        self._kept: dict[ViewFrames, dict[tuple[int, int], tuple[float, SmoothedImages]]] = {}

    def images(self, view: ViewFrames, frames: range, sigma: float, box: tuple[int, int, int, int]) -> SmoothedImages:
        """Return the gradient images of consecutive shot frames in a box (left, top, right, bottom) and around it."""
        margin, (height, width) = BOX_MARGIN + int(np.ceil(2 * sigma)), view.grey.shape[1:]
        left, top = max(box[0] - margin, 0), max(box[1] - margin, 0)
        right, bottom = min(box[2] + margin, width), min(box[3] + margin, height)
        kept = self._kept.setdefault(view, {})
        kept_sigma, images = kept.get((frames.start, len(frames)), (0.0, None))
        if images is not None and kept_sigma == sigma and images.shows((left, top, right, bottom)):
            return images
        left, top = max(left - BOX_MARGIN, 0), max(top - BOX_MARGIN, 0)  # a little more, for the next time
        start = frames.start - view.first
        window = copied_from_map(
            view.grey[start : start + len(frames), top : bottom + BOX_MARGIN, left : right + BOX_MARGIN]
        )
        images = SmoothedImages.with_gradients(window, sigma, (left, top))
        for first, count in list(kept):  # those that show some of the same pairs of frames are replaced
            if min(first + count, frames.stop) - max(first, frames.start) > 1:
                kept.pop((first, count), None)  # another thread may have done it
        if is_cached(view, frames, images.values.nbytes, MAX_CACHED_BYTES):
            kept[frames.start, len(frames)] = sigma, images
        return images


def views_with_foreground(views: Sequence[ViewFrames]) -> list[ViewFrames]:
    """Return the views with foreground images."""
    return [view for view in views if view.foreground is not None]
