"""The L-frame in one camera's video: all that may be its balls, and which are by this view alone."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...capture.calibration_objects import LFRAME_ARMS, LFRAME_BALLS
from ...capture.capture import Markers
from ...capture.capture_videos import CaptureVideos, CaptureVideoView
from ...errors import CalibrationError
from ...numerics.arrays import Array
from ...runtime.progress import Progress, report_progress
from ...shot.footage import pictures, probe
from ..balls.ball_centres import centres_of
from ..balls.ball_detection import Picture, find_balls, find_spots, without_rods
from ..balls.found_balls import Balls
from .lframe_detection import TRIED_FOCALS, LFrameModel, LFrameUnseenError, identified, static_balls

_SEARCHED_PICTURES, _AVERAGED_PICTURES = 15, 200
"""Frames on which balls are looked for, and of which the mean is taken."""
_MAX_CANDIDATES, _MAX_ALONE = 40, 12
"""How many things of the balls' colour are considered at most: by all views together, and by one view alone."""
_EXPECTED_RADIUS = 0.006
"""How far a ball may be from where it is expected, as a share of the picture's longer side."""
_USUAL_FOCAL = 1.0
"""Focal length assumed at first, as a share of the longer side."""


@dataclass(frozen=True, eq=False)
class SeenBalls:
    """Balls of a video as their outlines lie: `markers` with the outlines' centres, and their minor semi-axes.

    Attributes
    ----------
    markers : Markers
    radii : ndarray, shape (n, m)
        Pixels.
    interlaced : bool
        Whether the video is interlaced.
    """

    markers: Markers
    radii: Array
    interlaced: bool = False

    def corrected(self, matrix: Array, distortions: Array) -> Markers:
        """Return the images of the balls' middles, which are not their outlines' centres; see
        `ball_centres.centres_of`.
        """
        m = self.markers
        return Markers(m.frames, centres_of(m.points, self.radii, matrix, distortions), m.sigma, m.elongation)


@dataclass(frozen=True, eq=False)
class SeenLFrame:
    """What one camera's video shows of the L-frame.

    Attributes
    ----------
    balls : SeenBalls
        Those identified as the L-frame's by this view alone, one row; none where it cannot.
    candidates : Balls
        All that stands still and may be one of them.
    unidentified : CalibrationError, optional
        Why the view alone cannot identify them; names the video.
    """

    balls: SeenBalls
    candidates: Balls
    unidentified: CalibrationError | None = None


def find_lframe(
    view: CaptureVideoView, videos: CaptureVideos, size: tuple[int, int], progress: Progress | None = None
) -> SeenLFrame:
    """Find the L-frame's balls in a camera's video.

    Parameters
    ----------
    view : CaptureVideoView
    videos : CaptureVideos
        With the measures and the colour of the L-frame.
    size : tuple of int
        Width and height of the video, pixels.
    progress : callable, optional
    """
    if view.lframe is None:
        return SeenLFrame(_nothing(), Balls.joined([]))
    report_progress(progress, f"L-frame in {view.camera}", 0.0)
    known = view.focal if view.matrix is None else float(view.matrix[0, 0])
    focals = [known] if known else [share * max(size) for share in TRIED_FOCALS]
    frame = LFrameModel(videos.lframe_points, videos.lframe_diameter, (np.array(size) - 1) / 2, focals)
    where = f"{view.lframe} (camera {view.camera})"
    images = [Picture.of(image) for image in spread_out(view.lframe)]
    balls = static_balls([find_balls(picture, videos.lframe_colour) for picture in images], _MAX_CANDIDATES)
    # Small balls drown in the noise of single frames, not in that of all of them together.
    still = Picture.of(still_picture(view.lframe).round().astype(np.uint8))
    calm = static_balls([find_balls(still, videos.lframe_colour)], _MAX_CANDIDATES)
    spots = find_spots(still, videos.lframe_colour, _MAX_CANDIDATES)
    candidates = Balls.joined([balls, calm[_apart(calm, balls)]])
    candidates = Balls.joined([candidates, spots[_apart(spots, candidates)]])
    unidentified: CalibrationError | None = None
    for own, seen_in in ((balls, images), (calm, [still]), (spots, [still])):
        try:
            four = own[identified(own[:_MAX_ALONE], frame, where)]
        except LFrameUnseenError as error:
            unidentified = error
        except CalibrationError as error:
            return SeenLFrame(_nothing(), candidates, error)
        else:
            return SeenLFrame(_measured(seen_in, four, range(LFRAME_BALLS), size), candidates)
    return SeenLFrame(_nothing(), candidates, unidentified)


def _apart(balls: Balls, others: Balls) -> NDArray[np.bool_]:
    """Return which balls are none of others."""
    near = np.linalg.norm(balls.centres[:, None] - others.centres, axis=-1) < balls.semi_axes[:, :1] + 1
    return np.asarray(~near.any(axis=1))


def expected_lframe(
    view: CaptureVideoView, before: SeenBalls, candidates: Balls, expected: Array, size: tuple[int, int]
) -> SeenBalls:
    """Return the L-frame's balls in a camera's video where a solution expects them.

    Parameters
    ----------
    before : SeenBalls
        As the view alone shows them: kept if they are where they are expected.
    candidates : Balls
    expected : ndarray, shape (4, 2)
        Pixels.
    """
    assert view.lframe is not None
    reach = _EXPECTED_RADIUS * max(size)
    if len(before.markers) and np.linalg.norm(before.markers.points[0] - expected, axis=1).max() < reach:
        return before
    apart = np.linalg.norm(candidates.centres - expected[:, None], axis=-1)
    seen = [k for k in range(LFRAME_BALLS) if len(candidates) and apart[k].min() < reach]
    if not seen:
        return _nothing()
    images = [Picture.of(image) for image in spread_out(view.lframe)]
    return _measured(images, candidates[[int(apart[k].argmin()) for k in seen]], seen, size)


def _measured(images: Sequence[Picture], balls: Balls, which: Sequence[int], size: tuple[int, int]) -> SeenBalls:
    """Some of the L-frame's balls measured without what its arms hide; the others are NaN."""
    balls = _without_arms(images, _as_spheres(balls, size), list(which))
    points, sigma, radii = np.full((1, LFRAME_BALLS, 2), np.nan), *np.full((2, 1, LFRAME_BALLS), np.nan)
    points[0, list(which)], sigma[0, list(which)] = balls.centres, balls.sigma
    radii[0, list(which)] = balls.semi_axes[:, 1]
    return SeenBalls(Markers(np.zeros(1, np.int64), points, sigma), radii)


def _without_arms(images: Sequence[Picture], balls: Balls, which: list[int]) -> Balls:
    """Balls measured without the parts of their outlines that the arms may hide, where that can be."""
    ends = np.full((len(balls), 2, 2), np.nan)
    for row, ball in enumerate(which):
        held = [b if a == ball else a for a, b in LFRAME_ARMS if ball in (a, b)]
        there = [which.index(other) for other in held if other in which]
        ends[row, : len(there)] = balls.centres[there]
    seen = [without_rods(picture, balls, ends, still=True) for picture in images]
    measured = [static_balls([own[[k]][good[[k]]] for own, good in seen]) for k in range(len(balls))]
    return Balls.joined([ball if len(ball) else balls[[k]] for k, ball in enumerate(measured)])


def _as_spheres(balls: Balls, size: tuple[int, int]) -> Balls:
    """Return the balls with outlines as still spheres have them by a usual focal length, longer away from the middle.

    Arms that hide half an outline leave its own length and width unsure.
    """
    away = (balls.centres - (np.array(size) - 1) / 2) / (_USUAL_FOCAL * max(size))
    slant = np.sqrt(1 + np.sum(away**2, axis=1)) - 1
    ways = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    longer = np.eye(2) + slant[:, None, None] * ways[:, :, None] * ways[:, None, :]
    return replace(balls, shapes=balls.semi_axes[:, 1, None, None] * longer)


def spread_out(path: Path, most: int = _SEARCHED_PICTURES) -> Iterator[NDArray[np.uint8]]:
    """A few frames spread over a video."""
    return islice(islice(pictures(path), 0, None, max(1, probe(path).count // most)), most)


def still_picture(path: Path) -> Array:
    """Return the mean of the frames of a video in which nothing moves, shape (h, w, 3), levels."""
    total, count = np.zeros(1), 0
    for image in spread_out(path, _AVERAGED_PICTURES):
        total, count = total + image, count + 1
    return total / max(count, 1)


def _nothing() -> SeenBalls:
    nothing = np.zeros((0, LFRAME_BALLS))
    return SeenBalls(Markers(np.zeros(0, np.int64), np.zeros((0, LFRAME_BALLS, 2)), nothing), nothing)


def usual_matrix(size: tuple[int, int], focal: float | None) -> Array:
    """Intrinsic matrix of a camera of which no more is known than a focal length, or nothing, shape (3, 3)."""
    f = focal or _USUAL_FOCAL * max(size)
    return np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]])
