"""Synchronising the videos of a capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...capture.capture import Capture, Markers
from ...numerics.arrays import Array
from .. import findings
from .camera_rig import Rig
from .clocks import find_offsets
from .wand_tracks import Tracks, cleaned, is_waved, synchronised


@dataclass(frozen=True, eq=False)
class Synchrony:
    """The wand in all videos, and how their frames correspond.

    Attributes
    ----------
    wands : tuple of Markers
        Without outliers if the wand is waved, see `wand_tracks.cleaned`.
    rate, offset : ndarray, shape (V,)
        Frame s of the capture is frame rate s + offset of a video.
    estimated : ndarray of bool, shape (V,)
        Videos whose offset was estimated and is to be refined.
    """

    wands: tuple[Markers, ...]
    rate: Array
    offset: Array
    estimated: NDArray[np.bool_]

    @property
    def needs_interpolation(self) -> bool:
        """Whether videos see the wand between the capture's frames, so that its path must be interpolated."""
        return bool(self.estimated.any() or (self.offset % 1).any() or (self.rate != 1).any())

    def tracks(self, rig: Rig | None = None) -> Tracks:
        """Return the wand on the capture's frames, with a rig's clocks or else the first estimates."""
        if rig is None or not self.estimated.any():
            return synchronised(self.wands, self.rate, self.offset)
        return synchronised(self.wands, rig.rate * (1 + rig.drift), rig.offset)

    def with_ends_exchanged(self, views: Sequence[int]) -> Synchrony:
        """Return the same with the wand's ends exchanged in some views."""
        wands = list(self.wands)
        for v in views:
            wands[v] = replace(wands[v], points=wands[v].points[:, ::-1], sigma=wands[v].sigma[:, ::-1])
        return replace(self, wands=tuple(wands))


def find_synchrony(capture: Capture) -> Synchrony:
    """Find the time offsets between a capture's videos: as given, or from the wand's path.

    Raises
    ------
    CaptureError
        Offsets are missing, and the wand's path does not determine them.
    """
    views = capture.views
    pace = [view.fps for view in views]
    reference = next((fps for fps in pace if fps), 1.0)
    rate = np.array([(fps or reference) / reference for fps in pace])
    given = [view.offset for view in views]
    waved = sum(is_waved(view.wand) for view in views) > len(views) / 2
    wands = tuple(cleaned(view.wand) if waved else view.wand for view in views)
    offset, found = np.array([np.nan if o is None else o for o in given]), [v for v, o in enumerate(given) if o is None]
    if not waved and (found or (offset % 1).any() or (rate != 1).any()):
        raise findings.not_waved().error()
    if found:
        offset, found = find_offsets(wands, rate, given)
    for v in np.flatnonzero(np.isnan(offset)):
        raise findings.offset_unknown(views[v].camera).error()
    return Synchrony(wands, rate, offset, np.isin(np.arange(len(views)), found))


def with_capture_clock(rig: Rig) -> Rig:
    """Return the cameras with the capture's own clock."""
    n = len(rig)
    return replace(rig, offset=np.zeros(n), drift=np.zeros(n), rate=np.ones(n))
