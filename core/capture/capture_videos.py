"""A capture as it was filmed: the videos of an L-frame and a wand, and the colours of their balls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..numerics.arrays import Array
from .capture import StandingPerformer
from .colours import Colour


@dataclass(frozen=True, eq=False)
class CaptureVideoView:
    """One camera's videos; see `CaptureView` for what may be known of it.

    Some may lack a video of the L-frame: where they are follows from the wand.
    """

    camera: str
    lframe: Path | None
    wand: Path
    offset: float | None = None
    focal: float | None = None
    matrix: Array | None = None
    distortions: Array | None = None


@dataclass(frozen=True, eq=False)
class CaptureVideos:
    """What was filmed to calibrate cameras.

    Attributes
    ----------
    lframe_points : ndarray, shape (4, 3)
        Centres of its balls, metres.
    lframe_colour : Colour
    lframe_diameter : float or None
        Of its balls, metres.
    wand_length : float
        Metres.
    wand_colours : tuple of Colour
        Of its first and its second ball, or one for both.
    wand_diameter : float or None
        Of its balls, metres.
    views : tuple of CaptureVideoView
    floor : tuple of tuple of int
        See `Capture.floor`. Points and colour of the L-frame have no meaning then.
    performer : StandingPerformer, optional
        See `Capture.performer`. The same holds then.
    """

    lframe_points: Array
    lframe_colour: Colour
    lframe_diameter: float | None
    wand_length: float
    wand_colours: tuple[Colour, ...]
    wand_diameter: float | None
    views: tuple[CaptureVideoView, ...]
    floor: tuple[tuple[int, int], ...] = ()
    performer: StandingPerformer | None = None
