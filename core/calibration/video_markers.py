"""Finding the balls of an L-frame and a wand in videos."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ..cameras.camera import Camera
from ..capture.capture import Capture, CaptureView, Markers
from ..capture.capture_videos import CaptureVideos, CaptureVideoView
from ..errors import CalibrationError
from ..numerics.arrays import Array
from ..runtime.processes.worker_pool import WorkerPool
from ..runtime.progress import Progress, report_progress, share
from ..runtime.threads import one_library_thread
from ..shot.footage import Footage, pictures, probe
from .balls.ball_centres import centres_of
from .balls.found_balls import Balls
from .calibration_result import CalibrationResult
from .lframe.lframe_markers import SeenBalls, SeenLFrame, expected_lframe, find_lframe, spread_out, usual_matrix
from .solving.wand_triangulation import projected
from .wand_detection import Pairs, WandAppearance, find_pairs, likeliest_pairs, swapped_ends

MIN_LFRAME_VIEWS = 2
"""Least number of views in which the L-frame must be found."""
_SAMPLED_FRAMES = 24
"""Number of frames from which a video's background and balls are learned."""
_LFRAME_WORK = 0.05
"""Fraction of the work that the L-frame's videos take."""
_MIN_WAND_SHARE = 0.02  # least fraction of a video's frames that must show the wand
_MIN_CANDIDATES = 3
"""Least number of candidates for the L-frame's balls in a view that takes part in the identification by all views."""


@dataclass(frozen=True, eq=False)
class SeenView:
    """The balls found in one camera's videos.

    Attributes
    ----------
    videos : CaptureVideoView
    footage : Footage
    lframe : SeenBalls
        The L-frame's balls as identified by this view alone; empty if it cannot identify them.
    wand : SeenBalls
    candidates : Balls
        Everything static in the L-frame's video that may be one of its balls.
    background : ndarray, shape (h, w, 3), optional
        Grey levels of the wand's video without the wand; None until small balls were measured.
    """

    videos: CaptureVideoView
    footage: Footage
    lframe: SeenBalls
    wand: SeenBalls
    candidates: Balls = field(default_factory=lambda: Balls.joined([]))
    background: NDArray[np.float32] | None = None


@dataclass(frozen=True, eq=False)
class VideoMarkers:
    """The balls found in all videos.

    Attributes
    ----------
    videos : CaptureVideos
    views : tuple of SeenView
    unidentified : CalibrationError, optional
        The error of the first view that cannot identify the L-frame alone.
    """

    videos: CaptureVideos
    views: tuple[SeenView, ...]
    unidentified: CalibrationError | None = None

    def capture(self, cameras: Mapping[str, Camera] | None = None) -> Capture:
        """Return the points from which cameras are solved.

        Parameters
        ----------
        cameras : mapping of str to Camera, optional
            A previous solution, which determines the centre of each ball within its outline. Without it, a given or
            usual focal length is used, and large balls near the picture's edges are off by a few hundredths of a pixel.
        """
        return Capture(
            self.videos.lframe_points,
            self.videos.wand_length,
            tuple(_capture_view(view, (cameras or {}).get(view.videos.camera)) for view in self.views),
            self.videos.floor,
            (self.videos.wand_diameter or 0.0) / 2,
            self.videos.performer,
        )

    def with_lframes_identified(self, solution: CalibrationResult) -> VideoMarkers:
        """Return the same with the L-frame's balls where a solution from all views predicts them, and no candidates."""
        views = []
        for c, view in enumerate(self.views):
            if view.videos.lframe is None or c in solution.moved:
                views.append(view)
                continue
            expected = projected(solution.rig, c, solution.lframe_world)
            balls = expected_lframe(view.videos, view.lframe, view.candidates, expected, view.footage.size)
            views.append(replace(view, lframe=balls))
        decided = (replace(view, candidates=Balls.joined([])) for view in views)
        return replace(self, views=tuple(decided))

    def without_lframe(self) -> tuple[str, ...]:
        """Return the cameras whose video of the L-frame does not show it."""
        return tuple(
            view.videos.camera for view in self.views if view.videos.lframe is not None and not len(view.lframe.markers)
        )


def _capture_view(view: SeenView, camera: Camera | None) -> CaptureView:
    videos, size = view.videos, view.footage.size
    if camera is not None:
        matrix, distortions = camera.matrix, camera.distortions
    else:
        matrix = videos.matrix if videos.matrix is not None else usual_matrix(size, videos.focal)
        distortions = np.zeros(4) if videos.distortions is None else videos.distortions
    return CaptureView(
        camera=videos.camera,
        size=size,
        fps=view.footage.fps or None,
        lframe=view.lframe.corrected(matrix, distortions),
        wand=view.wand.corrected(matrix, distortions),
        offset=videos.offset,
        focal=videos.focal,
        matrix=videos.matrix,
        distortions=videos.distortions,
        lframe_candidates=_candidates(view, matrix, distortions),
    )


def _candidates(view: SeenView, matrix: Array, distortions: Array) -> Markers | None:
    """Return the candidates for the L-frame's balls, as images of their centres."""
    balls = view.candidates
    if not len(balls):
        return None
    points = centres_of(balls.centres, balls.semi_axes[:, 1], matrix, distortions)
    return Markers(np.zeros(1, np.int64), points[None], balls.sigma[None])


def find_all(videos: CaptureVideos, progress: Progress | None = None, pool: WorkerPool | None = None) -> VideoMarkers:
    """Find the balls in all videos, frame by frame.

    If enough other views show the L-frame, a view in which it is not found is treated as having no video of it.

    Parameters
    ----------
    videos : CaptureVideos
    progress : callable, optional
    pool : WorkerPool, optional
        Workers that do a view each; by default this process does one after the other.

    Raises
    ------
    FootageError
        A video is missing or unreadable, or the two videos of a camera differ in size.
    CalibrationError
        The L-frame or the wand cannot be found; names the video.
    CancelledError
        `progress` returned False.
    """
    pool = pool or WorkerPool(1)
    footages = [_footage(view) for view in videos.views]
    views = list(zip(videos.views, footages, strict=True))
    looking = [
        (f"L-frame in {view.camera}", partial(find_lframe, view, videos, footage.size)) for view, footage in views
    ]
    lframes: list[SeenLFrame] = pool.do_all(looking, share(progress, 0.0, _LFRAME_WORK))
    missed = [lframe.unidentified for lframe in lframes if lframe.unidentified is not None]
    showing = [len(own.balls.markers) > 0 or len(own.candidates) >= _MIN_CANDIDATES for own in lframes]
    if missed and sum(showing) < MIN_LFRAME_VIEWS:
        raise missed[0]
    wands = find_wands(videos, footages, share(progress, _LFRAME_WORK, 1.0), pool)
    seen = tuple(
        SeenView(view, footage, lframe.balls, wand, lframe.candidates)
        for (view, footage), lframe, wand in zip(views, lframes, wands, strict=True)
    )
    return VideoMarkers(videos, seen, missed[0] if missed else None)


def find_wands(
    videos: CaptureVideos, footages: Sequence[Footage], progress: Progress | None, pool: WorkerPool
) -> list[SeenBalls]:
    """Find the wand's balls in all videos, each of which is one of the pool's tasks; see `find_wand`."""
    tasks = [
        (f"wand in {view.camera}", partial(find_wand, view, videos, footage.count))
        for view, footage in zip(videos.views, footages, strict=True)
    ]
    return pool.do_all(tasks, progress)


def _footage(view: CaptureVideoView) -> Footage:
    """Return a camera's video of the wand, which must have the same size as that of the L-frame."""
    footage = probe(view.wand)
    before = footage if view.lframe is None else probe(view.lframe)
    if footage.size != before.size:
        sizes = " and ".join(f"{f.size[0]}x{f.size[1]}" for f in (before, footage))
        raise CalibrationError(f"the videos of L-frame and wand are {sizes}", where=f"camera {view.camera}")
    return footage


@one_library_thread()
def find_wand(view: CaptureVideoView, videos: CaptureVideos, count: int, progress: Progress | None = None) -> SeenBalls:
    """Find the wand's balls on every frame of a camera's video on which they are seen.

    Raises
    ------
    CalibrationError
        They are seen on too few frames; names the video.
    """
    longest = videos.wand_length / videos.wand_diameter if videos.wand_diameter else None
    appearance = WandAppearance.learned(list(spread_out(view.wand, _SAMPLED_FRAMES)), videos.wand_colours)
    seen: list[Pairs] = []
    for k, image in enumerate(pictures(view.wand)):
        report_progress(progress, f"wand in {view.camera}", min(k / max(count, 1), 1.0))
        seen.append(find_pairs(image, videos.wand_colours, longest, appearance))
    path = likeliest_pairs(seen, longest)
    frames = np.flatnonzero(path >= 0)
    if len(frames) < max(3, _MIN_WAND_SHARE * len(seen)):
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
    return SeenBalls(Markers(frames, points, sigma), radii, appearance.interlaced)


def _swaps(frames: NDArray[np.int64], points: Array, radii: Array) -> NDArray[np.bool_]:
    """Return `swapped_ends` for frames with gaps between them."""
    places = np.full((frames[-1] + 1, 2, 2), np.nan)
    sizes = np.ones(len(places))
    places[frames], sizes[frames] = points, radii.mean(axis=1)
    return swapped_ends(places, sizes)[frames]
