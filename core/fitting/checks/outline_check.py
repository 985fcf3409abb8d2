"""How far cameras are off the key poses, by the performers' outlines."""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import CalibrationError
from ...runtime.progress import Progress
from ...shot.shot import Shot
from ..camera_fits.camera_refinement import refine_cameras
from ..key_frame_views import KeyFrameView
from ..outline_fit import RefinementStage
from .view_findings import CameraFit

CHECK_STAGES = (RefinementStage(0.25, 4.0, 4, learns_once=True), RefinementStage(0.10, 1.0, 4, learns_once=True))
"""Few stages: a camera that fits passes soon, and one that does not need not be corrected to be detected."""
CHECK_CONVERGED_PIXELS = 0.25
"""As `CONVERGED_PIXELS`, for these stages, pixels of the reduced frames: inexact key poses are off by pixels anyway."""


def outline_fits(shot: Shot, views: Sequence[KeyFrameView], progress: Progress | None = None) -> list[CameraFit]:
    """Return how far each camera is off the key poses, of those that show the performers clearly enough.

    Parameters
    ----------
    shot : Shot
    views : sequence of KeyFrameView
        The pictures of its views on frames with key poses of the whole body.
    progress : callable, optional

    Raises
    ------
    CancelledError
    """
    try:
        found = refine_cameras(shot, progress, views=views, stages=CHECK_STAGES, settled=CHECK_CONVERGED_PIXELS).views
    except CalibrationError:  # no view shows the performers clearly
        return []
    return [CameraFit(v.shift, v.deviation, v.limit, v.camera.name, "key poses") for v in found if not v.lost]
