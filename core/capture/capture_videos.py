"""The videos of a capture, and the measures and colours of the L-frame's and the wand's balls."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..numerics.arrays import Array
from .capture import StandingPerformer
from .colours import Colour


@dataclass(frozen=True, eq=False)
class CaptureVideoView:
    """One camera's videos; for the other attributes see `CaptureView`.

    The video of the L-frame may be missing: the camera is then found from the wand alone.
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
    """The videos from which cameras are calibrated.

    Attributes
    ----------
    lframe_points : ndarray, shape (4, 3)
        Centres of the L-frame's balls, metres.
    lframe_colour : Colour
    lframe_diameter : float or None
        Diameter of the L-frame's balls, metres.
    wand_length : float
        Metres.
    wand_colours : tuple of Colour
        Colours of the wand's first and second ball, or one colour for both.
    wand_diameter : float or None
        Diameter of the wand's balls, metres.
    views : tuple of CaptureVideoView
    floor : tuple of tuple of int
        See `Capture.floor`. If it is given, points and colour of the L-frame are meaningless.
    performer : StandingPerformer, optional
        See `Capture.performer`. If it is given, points and colour of the L-frame are meaningless.
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
