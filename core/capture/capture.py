"""A capture: the observations of an L-frame and a wand from which cameras are solved."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..numerics.arrays import Array


@dataclass(frozen=True, eq=False)
class Markers:
    """The balls of an L-frame or a wand in one camera's video.

    Attributes
    ----------
    frames : ndarray of int, shape (n,)
        Frames of the video, from 0, increasing.
    points : ndarray, shape (n, m, 2)
        Centres of the balls, distorted pixels; integers lie at pixel centres. NaN where a ball was not found.
    sigma : ndarray, shape (n, m)
        Standard deviation of each coordinate, pixels; NaN where a ball was not found.
    elongation : ndarray, shape (n, m, 2), optional
        The direction in which a point is least certain, with length e from 0 to 1: the variances are sigma^2 (1 + e)
        along it and sigma^2 (1 - e) across.
    """

    frames: NDArray[np.int64]
    points: Array
    sigma: Array
    elongation: Array | None = None

    def __post_init__(self) -> None:
        n = len(self.frames)
        if self.points.shape[:1] != (n,) or self.points.ndim != 3 or self.sigma.shape != self.points.shape[:2]:
            shapes = f"{self.frames.shape}, {self.points.shape}, {self.sigma.shape}"
            raise ValueError(f"frames, points and sigma have shapes {shapes}, not (n,), (n, m, 2) and (n, m)")
        if (np.diff(self.frames) <= 0).any():
            raise ValueError("frames must increase")

    def __len__(self) -> int:
        return len(self.frames)

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Whether each ball was found on each frame, shape (n, m)."""
        return np.asarray(np.isfinite(self.points).all(axis=-1))


@dataclass(frozen=True, eq=False)
class CaptureView:
    """One camera's part in a capture.

    Attributes
    ----------
    camera : str
    size : tuple of int
        Width and height, pixels.
    fps : float or None
        Frames per second; None: the same as the other views.
    lframe : Markers
        Four balls, in the order of `Capture.lframe_points`.
    wand : Markers
        Two balls. The order of the ends must be the same in all views; single frames with swapped ends are found.
    offset : float or None
        Frame f of the capture is this video's frame f + offset. None: to be estimated.
    focal : float or None
        A prior estimate of the focal length, pixels.
    matrix : ndarray, shape (3, 3), or None
        Intrinsic matrix, if it is known.
    distortions : ndarray, shape (k,), or None
        OpenCV's coefficients, if they are known.
    lframe_candidates : Markers, optional
        One row with all candidates for the L-frame's balls, among which all views together decide. `lframe` has those
        that this view alone identifies.
    """

    camera: str
    size: tuple[int, int]
    fps: float | None
    lframe: Markers
    wand: Markers
    offset: float | None = None
    focal: float | None = None
    matrix: Array | None = None
    distortions: Array | None = None
    lframe_candidates: Markers | None = None


@dataclass(frozen=True, eq=False)
class StandingPerformer:
    """Somebody who stands upright in several places, as a substitute for an L-frame.

    Attributes
    ----------
    height : float
        From the floor to the top of the head, including shoes and hair, metres.
    places : tuple of tuple of int
        First and last frame of the capture for each time that they stand in one place.
    points : mapping of str to Markers
        By camera: the points where the left and the right foot meet the floor, and the top of the head.
    gives_scale : bool
        Whether the scale comes from the height, because the length of the wand is unknown.
    """

    height: float
    places: tuple[tuple[int, int], ...]
    points: Mapping[str, Markers]
    gives_scale: bool = False


@dataclass(frozen=True, eq=False)
class Capture:
    """An L-frame on the floor and a waved wand, seen by several cameras.

    Attributes
    ----------
    lframe_points : ndarray, shape (4, 3)
        Centres of the L-frame's balls in the world frame, metres: the corner, two along the long arm, and one on the
        short arm.
    wand_length : float
        Distance between the centres of the wand's balls, metres.
    views : tuple of CaptureView
    floor : tuple of tuple of int
        Without an L-frame: first and last frame of the capture of the two times that the wand lies on the floor.
        `lframe_points` are NaN then.
    floor_height : float
        Height of the balls' centres above the floor while the wand lies there, metres.
    performer : StandingPerformer, optional
        The performer who replaces an L-frame. `lframe_points` are NaN then.
    """

    lframe_points: Array
    wand_length: float
    views: tuple[CaptureView, ...]
    floor: tuple[tuple[int, int], ...] = ()
    floor_height: float = 0.0
    performer: StandingPerformer | None = None

    @property
    def has_lframe(self) -> bool:
        """Whether an L-frame defines the world frame."""
        return not self.floor and self.performer is None
