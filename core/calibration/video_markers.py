"""From videos of an L-frame and a wand to the points that cameras are solved from."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..capture.capture import LFRAME_BALLS, Capture, CaptureView, Markers
from ..capture.capture_videos import CaptureVideos, CaptureVideoView
from ..errors import CalibrationError
from ..numerics.arrays import Array
from ..runtime.progress import Progress, report_progress, share
from ..shot.footage import Footage, pictures, probe
from .ball_centres import centres_of
from .ball_detection import Balls, Picture, background_of, find_balls, without_rods
from .lframe_detection import FOCALS, LFrameModel, LFrameUnseenError, identified, standing
from .wand_detection import Pairs, find_pairs, told_apart, wand_path

FEWEST_LFRAMES = 2
"""Views in which the L-frame has to be found."""
_LFRAME_PICTURES = 15
_LFRAME_MOST = 200
_LFRAMES = 0.05
"""Share of the work that the L-frame's videos are."""
ARMS = ((0, 1), (1, 2), (0, 3))
_LEAST_SHARE = 0.02
_USUAL_FOCAL = 1.0  # of the longer side


@dataclass(frozen=True, eq=False)
class SeenBalls:
    """Balls of a video as their outlines lie: `markers` with the outlines' centres, and their minor semi-axes.

    Attributes
    ----------
    markers : Markers
    radii : ndarray, shape (n, m)
        Pixels.
    """

    markers: Markers
    radii: Array

    def corrected(self, matrix: Array, distortions: Array) -> Markers:
        """The images of the balls' middles, which are not their outlines' centres; see `ball_centres.centres_of`."""
        m = self.markers
        return Markers(m.frames, centres_of(m.points, self.radii, matrix, distortions), m.sigma, m.elongation)


@dataclass(frozen=True, eq=False)
class SeenView:
    """What was found in one camera's videos."""

    videos: CaptureVideoView
    footage: Footage
    lframe: SeenBalls
    wand: SeenBalls


@dataclass(frozen=True, eq=False)
class VideoMarkers:
    """What was found in all videos."""

    videos: CaptureVideos
    views: tuple[SeenView, ...]

    def capture(self, cameras: Mapping[str, Camera] | None = None) -> Capture:
        """The points to solve from.

        Parameters
        ----------
        cameras : mapping of str to Camera, optional
            Solved before; they determine where the centre of each ball lies within its outline. Without them, a
            given or usual focal length is used, and large balls near the picture's edges are off by some hundredths of
            a pixel.
        """
        return Capture(
            self.videos.lframe_points,
            self.videos.wand_length,
            tuple(_capture_view(view, (cameras or {}).get(view.videos.camera)) for view in self.views),
            self.videos.floor,
            (self.videos.wand_diameter or 0.0) / 2,
            self.videos.performer,
        )

    def without_lframe(self) -> tuple[str, ...]:
        """Cameras in whose video of the L-frame it was not found."""
        return tuple(
            view.videos.camera for view in self.views if view.videos.lframe is not None and not len(view.lframe.markers)
        )


def _capture_view(view: SeenView, camera: Camera | None) -> CaptureView:
    videos, size = view.videos, view.footage.size
    if camera is not None:
        matrix, distortions = camera.matrix, camera.distortions
    else:
        matrix = videos.matrix if videos.matrix is not None else _usual_matrix(size, videos.focal)
        distortions = np.zeros(4) if videos.distortions is None else videos.distortions
    return CaptureView(
        videos.camera,
        size,
        view.footage.fps or None,
        view.lframe.corrected(matrix, distortions),
        view.wand.corrected(matrix, distortions),
        videos.offset,
        videos.focal,
        videos.matrix,
        videos.distortions,
    )


def _usual_matrix(size: tuple[int, int], focal: float | None) -> Array:
    f = focal or _USUAL_FOCAL * max(size)
    return np.array([[f, 0, (size[0] - 1) / 2], [0, f, (size[1] - 1) / 2], [0, 0, 1]])


def find_all(videos: CaptureVideos, progress: Progress | None = None) -> VideoMarkers:
    """Find the balls in all videos, one frame after the other.

    A view in which the L-frame is not found counts as one that lacks it, if enough others show it.

    Raises
    ------
    FootageError
        A video is missing or unreadable, or the two of a camera differ in size.
    CalibrationError
        The L-frame or the wand cannot be found; names the video.
    CancelledError
        `progress` returned False.
    """
    count = len(videos.views)
    footages = [_footage(view) for view in videos.views]
    lframes: list[SeenBalls] = []
    missed: list[LFrameUnseenError] = []
    for k, (view, footage) in enumerate(zip(videos.views, footages, strict=True)):
        try:
            part = share(progress, _LFRAMES * k / count, _LFRAMES * (k + 1) / count)
            lframes.append(find_lframe(view, videos, footage.size, part))
        except LFrameUnseenError as error:
            lframes.append(_no_lframe())
            missed.append(error)
    if missed and sum(len(seen.markers) > 0 for seen in lframes) < FEWEST_LFRAMES:
        raise missed[0]
    seen = []
    for k, (view, footage, lframe) in enumerate(zip(videos.views, footages, lframes, strict=True)):
        begin, end = (_LFRAMES + (1 - _LFRAMES) * done / count for done in (k, k + 1))
        part = share(progress, begin, end)
        seen.append(SeenView(view, footage, lframe, find_wand(view, videos, footage.count, part)))
    return VideoMarkers(videos, tuple(seen))


def _footage(view: CaptureVideoView) -> Footage:
    """A camera's video of the wand, which must be as large as that of the L-frame."""
    footage = probe(view.wand)
    before = footage if view.lframe is None else probe(view.lframe)
    if footage.size != before.size:
        sizes = " and ".join(f"{f.size[0]}x{f.size[1]}" for f in (before, footage))
        raise CalibrationError(f"the videos of L-frame and wand are {sizes}", where=f"camera {view.camera}")
    return footage


def _no_lframe() -> SeenBalls:
    nothing = np.zeros((0, LFRAME_BALLS))
    return SeenBalls(Markers(np.zeros(0, np.int64), np.zeros((0, LFRAME_BALLS, 2)), nothing), nothing)


def find_lframe(
    view: CaptureVideoView, videos: CaptureVideos, size: tuple[int, int], progress: Progress | None = None
) -> SeenBalls:
    """The L-frame's balls as they stand through a camera's video, as one row.

    Raises
    ------
    LFrameUnseenError
        They cannot be found or distinguished.
    CalibrationError
        They are a mirrored L-frame's. Both name the video.
    """
    if view.lframe is None:
        return _no_lframe()
    report_progress(progress, f"{view.camera}: L-frame", 0.0)
    images = [Picture.of(image) for image in spread_out(view.lframe)]
    known = view.focal if view.matrix is None else float(view.matrix[0, 0])
    focals = [known] if known else [share * max(size) for share in FOCALS]
    frame = LFrameModel(videos.lframe_points, videos.lframe_diameter, (np.array(size) - 1) / 2, focals)
    where = f"{view.lframe} (camera {view.camera})"
    balls = standing([find_balls(picture, videos.lframe_colour) for picture in images])
    try:
        four = balls[identified(balls, frame, where)]
    except LFrameUnseenError:
        # Small balls drown in the noise of single frames, not in that of all of them together.
        images = [Picture.of(still_picture(view.lframe).round().astype(np.uint8))]
        balls = standing([find_balls(images[0], videos.lframe_colour)])
        four = balls[identified(balls, frame, where)]
    four = _without_arms(images, _as_spheres(four, size))
    markers = Markers(np.zeros(1, np.int64), four.centres[None], four.sigma[None])
    return SeenBalls(markers, four.semi_axes[None, :, 1])


def _without_arms(images: Sequence[Picture], four: Balls) -> Balls:
    """The L-frame's balls measured without the parts of their outlines that the arms may hide, where that can be."""
    ends = np.full((LFRAME_BALLS, 2, 2), np.nan)
    for ball in range(LFRAME_BALLS):
        held = [b if a == ball else a for a, b in ARMS if ball in (a, b)]
        ends[ball, : len(held)] = four.centres[held]
    seen = [without_rods(picture, four, ends, still=True) for picture in images]
    measured = [standing([balls[[k]][good[[k]]] for balls, good in seen]) for k in range(LFRAME_BALLS)]
    return Balls.joined([ball if len(ball) else four[[k]] for k, ball in enumerate(measured)])


def _as_spheres(balls: Balls, size: tuple[int, int]) -> Balls:
    """The balls with outlines as still spheres have them by a usual focal length, longer away from the middle.

    Arms that hide half an outline leave its own length and width unsure.
    """
    away = (balls.centres - (np.array(size) - 1) / 2) / (_USUAL_FOCAL * max(size))
    slant = np.sqrt(1 + np.sum(away**2, axis=1)) - 1
    ways = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    longer = np.eye(2) + slant[:, None, None] * ways[:, :, None] * ways[:, None, :]
    return replace(balls, shapes=balls.semi_axes[:, 1, None, None] * longer)


def spread_out(path: Path, most: int = _LFRAME_PICTURES) -> Iterator[NDArray[np.uint8]]:
    """Some frames from all over a video."""
    return islice(islice(pictures(path), 0, None, max(1, probe(path).count // most)), most)


def still_picture(path: Path) -> Array:
    """The mean of the frames of a video in which nothing moves, shape (h, w, 3), levels."""
    total, count = np.zeros(1), 0
    for image in spread_out(path, _LFRAME_MOST):
        total, count = total + image, count + 1
    return total / max(count, 1)


def find_wand(view: CaptureVideoView, videos: CaptureVideos, count: int, progress: Progress | None = None) -> SeenBalls:
    """The wand's balls on every frame of a camera's video on which they are seen.

    Raises
    ------
    CalibrationError
        They are hardly ever seen; names the video.
    """
    longest = videos.wand_length / videos.wand_diameter if videos.wand_diameter else None
    behind = background_of(list(spread_out(view.wand)))
    seen: list[Pairs] = []
    for k, image in enumerate(pictures(view.wand)):
        report_progress(progress, f"{view.camera}: wand", min(k / max(count, 1), 1.0))
        seen.append(find_pairs(image, videos.wand_colours, longest, behind))
    path = wand_path(seen)
    frames = np.flatnonzero(path >= 0)
    if len(frames) < max(3, _LEAST_SHARE * len(seen)):
        raise CalibrationError(
            f"the wand is seen on {len(frames)} of {len(seen)} frames",
            where=f"{view.wand} (camera {view.camera})",
            todo="pick the balls' colours on this video",
        )
    points, sigma, radii = (
        np.stack([getattr(seen[f], name)[path[f]] for f in frames]) for name in ("centres", "sigma", "radii")
    )
    if len(videos.wand_colours) == 1:
        swapped = _swaps(frames, points, radii)
        for values in (points, sigma, radii):
            values[swapped] = values[swapped][:, ::-1]
    return SeenBalls(Markers(frames, points, sigma), radii)


def _swaps(frames: NDArray[np.int64], points: Array, radii: Array) -> NDArray[np.bool_]:
    """`told_apart` over all frames, those without the wand between."""
    places = np.full((frames[-1] + 1, 2, 2), np.nan)
    sizes = np.ones(len(places))
    places[frames], sizes[frames] = points, radii.mean(axis=1)
    return told_apart(places, sizes)[frames]
