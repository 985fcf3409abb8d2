"""Calibrating from a capture, either videos or points; used by the command line, by Blender and by scripts."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..cameras.camera import Camera
from ..capture.calibration_objects import LFRAME_BALLS
from ..capture.capture import Capture, CaptureView, Markers
from ..capture.capture_videos import CaptureVideos
from ..errors import CaptureError
from ..runtime.processes.worker_pool import WorkerPool
from ..runtime.progress import Progress, share
from ..runtime.threads import worker_count
from ..shot.footage import Footage, probe
from ..shot.footage_faults.footage_times import video_rate
from .calibration_result import CalibrationResult
from .findings import LFRAME_NOT_SEEN, Finding, interlaced, lframe_missed, rate_varies
from .remeasure import remeasured, with_lframes_remeasured
from .resync import known_camera, synchronise
from .solving.clocks import Clocks
from .video_markers import VideoMarkers, find_all, find_wands
from .wand_calibration import solve_capture

_MARKERS_FOUND, _BALLS_REMEASURED, _CAMERAS_SOLVED = 0.6, 0.9, 0.95
"""Fractions of the work after which markers are found, small ones measured again, and cameras solved from these."""
MIN_PARALLEL_PICTURES = 400
"""Pictures of the wand from which views are worked on in several processes: ten times what it takes to start one."""


def calibrate(
    source: CaptureVideos | Capture, progress: Progress | None = None, *, drift: bool = False
) -> CalibrationResult:
    """Find the markers, if they are given as videos, and solve for the cameras.

    The first solution is used to correct the markers: the position of a ball's centre within its outline depends on the
    camera, and small balls are measured again where they are expected. Then the cameras are solved a second time, and,
    if balls are small, a third time after the L-frame's balls were measured with the second solution.

    Parameters
    ----------
    source : CaptureVideos or Capture
    progress : callable, optional
    drift : bool
        Whether clocks may also run at different speeds; see `solve_capture`.

    Raises
    ------
    KFMocapError
        A video cannot be read, the markers are not found, or they do not determine the cameras.
    CancelledError
        `progress` returned False.
    """
    if isinstance(source, Capture):
        return solve_capture(source, progress, drift=drift)
    middle = (_MARKERS_FOUND + _BALLS_REMEASURED) / 2
    with _workers([probe(view.wand) for view in source.views]) as pool:
        found = find_all(source, share(progress, 0.0, _MARKERS_FOUND), pool)
        doubtful = list(_doubtful(found))
        first = _first(found, doubtful, share(progress, _MARKERS_FOUND, middle), drift=drift)
        found = found.with_lframes_identified(first)
        found = remeasured(found, first, share(progress, middle, _BALLS_REMEASURED), pool)
    solution = solve_capture(
        found.capture(first.cameras), share(progress, _BALLS_REMEASURED, _CAMERAS_SOLVED), drift=drift
    )
    solution = _with_lframe_remeasured(found, solution, share(progress, _CAMERAS_SOLVED, 1.0), drift=drift)
    missed = tuple(lframe_missed(camera) for camera in found.without_lframe())
    return replace(solution, findings=(*solution.findings, *doubtful, *missed))


def _workers(footages: Sequence[Footage]) -> WorkerPool:
    """Return workers for the videos of the wand: one per core, or this process alone if there is little to do."""
    pictures = sum(footage.count for footage in footages)
    return WorkerPool(min(worker_count(), len(footages)) if pictures >= MIN_PARALLEL_PICTURES else 1, (__name__,))


def _with_lframe_remeasured(
    found: VideoMarkers, solution: CalibrationResult, progress: Progress | None, *, drift: bool
) -> CalibrationResult:
    """Solve again with the L-frame's small balls measured by a solution; return that solution if there are none."""
    if not any(view.background is not None and len(view.lframe.markers) for view in found.views):
        return solution
    found = with_lframes_remeasured(found, solution)
    return solve_capture(found.capture(solution.cameras), progress, drift=drift)


def _doubtful(found: VideoMarkers) -> Iterator[Finding]:
    """Generate findings on wand videos that are interlaced or have a variable frame rate."""
    for view in found.views:
        rate = video_rate(view.videos.wand, view.footage.count)
        if rate is not None and rate.varies:
            yield rate_varies(view.videos.camera, rate)
        if view.wand.interlaced:
            yield interlaced(view.videos.camera)


def _first(
    found: VideoMarkers, doubtful: Sequence[Finding], progress: Progress | None, *, drift: bool
) -> CalibrationResult:
    """Solve from the markers found; if that fails, the error names doubtful videos as a possible reason."""
    try:
        return solve_capture(found.capture(), progress, drift=drift)
    except CaptureError as error:
        if error.name == LFRAME_NOT_SEEN and found.unidentified is not None:
            raise found.unidentified from error
        if doubtful:
            raise doubtful[0].error() from error
        raise


def synchronise_take(
    source: CaptureVideos | Capture,
    cameras: Mapping[str, Camera],
    progress: Progress | None = None,
    *,
    drift: bool = False,
) -> Clocks:
    """Find the clocks of another take by cameras that have not moved since they were solved.

    Parameters
    ----------
    source : CaptureVideos or Capture
        The take's videos of the wand, or the markers found in them.
    cameras, progress, drift
        As of `synchronise`.

    Raises
    ------
    KFMocapError, CancelledError
        As `calibrate`.
    """
    if isinstance(source, Capture):
        return synchronise(source, cameras, progress, drift=drift)
    capture = _wands(source, cameras, share(progress, 0.0, _MARKERS_FOUND))
    return synchronise(capture, cameras, share(progress, _MARKERS_FOUND, 1.0), drift=drift)


def _wands(videos: CaptureVideos, cameras: Mapping[str, Camera], progress: Progress | None) -> Capture:
    """Find the wand in the videos."""
    footages = [probe(view.wand) for view in videos.views]
    known = [
        known_camera(cameras, view.camera, footage.size) for view, footage in zip(videos.views, footages, strict=True)
    ]
    with _workers(footages) as pool:
        wands = find_wands(videos, footages, progress, pool)
    views = [
        CaptureView(
            view.camera,
            footage.size,
            footage.fps or None,
            _unseen(),
            seen.corrected(camera.matrix, camera.distortions),
            view.offset,
        )
        for view, footage, camera, seen in zip(videos.views, footages, known, wands, strict=True)
    ]
    return Capture(videos.lframe_points, videos.wand_length, tuple(views))


def _unseen() -> Markers:
    return Markers(np.zeros(0, np.int64), np.zeros((0, LFRAME_BALLS, 2)), np.zeros((0, LFRAME_BALLS)))
