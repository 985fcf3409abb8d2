"""How a shot is tracked: the settings, and their defaults."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from ..choices import BEST_SOLVER, SOLVERS, either
from ..errors import ShotError, shortened

ESTIMATING_SOLVERS = (BEST_SOLVER,)
"""Solvers that can estimate how smooth a motion is."""
BROKEN_KEYPOINTS = ("refuse", "skip")
MAX_THREADS = 256
"""Largest number of threads: OpenCV starts as many for each video as it is told to."""
MAX_OFFSET = 0.5
"""Largest offset between key poses and footage that is allowed for, frames: one that is larger is measured as this."""
ONE_VIEW_LENGTHS, SEVERAL_VIEWS_LENGTHS = (0.2, 0.25), (0.1, 0.1)
"""Correlation lengths of pixels and of outlines, metres; with several views, the width of a limb."""


def _positive(default: Any) -> Any:
    """Declare a setting that must be a positive number; if its default is None, it may also be None."""
    return field(default=default, metadata={"positive": True})


@dataclass(frozen=True)
class Settings:
    """Settings of the tracker. The defaults are meant for every shot.

    Attributes
    ----------
    solver : str
        "gauss-newton" (solves for the whole segment at once) or "relaxation" (the method of paper 1).
    sweeps : int
        Number of sweeps of the relaxation.
    working_size : int
        Approximate limit of the longer side of the reduced frames that are tracked, pixels.
    correlation_length : float, optional
        Distance on the body within which residuals of pixels are correlated, metres: pixels within a square of that
        side count as one measurement. None: see `for_shot`.
    outline_correlation : float, optional
        The same along the body's outline, metres: a piece of that length counts as one measurement. None: see
        `for_shot`.
    joint_acceleration : float, optional
        Typical angular acceleration of a freely moving joint, rad/s^2. None estimates it from the shot, for each joint
        and frame (`core.body.smoothness_estimate`); the relaxation does not need it.
    root_acceleration : float, optional
        Typical acceleration of the root, m/s^2; None estimates it likewise.
    estimate_smoothness : bool, optional
        Whether to estimate those accelerations that are not given for each joint; if not, they are those of
        `core.shot.acceleration_prior`, except where keypoints determine them. None: see `for_shot`; in settings that
        are filled in, None means that only one scale of all accelerations is estimated.
    prediction : bool
        Whether to predict the motion of parts that no camera sees from the frames on which they are seen.
    plants : bool
        Whether points of the soles stand still while they are found to be planted.
    contact : bool
        Whether bodies of different performers are kept from passing through each other.
    limb_search : bool
        Whether to try other starts and to search for lost limbs if the images leave a solution in doubt; the relaxation
        never does.
    correct_gaps : bool
        Whether views that turn out to be early or late from some frame on are tracked again with that corrected, see
        `core.tracking.footage_corrections.footage_gaps`.
    stabilise : bool, optional
        Whether cameras that stand still by their calibration turn and zoom as the background of their pictures shows,
        see `core.tracking.footage_reading.turned_cameras`. None: those in whose pictures it clearly shifts.
    search_seed : int
        Random seed of the poses sampled in the search for limbs.
    keypoint_correlation : float
        Time within which a detector's errors are correlated, seconds: keypoints within it count as one measurement.
    broken_keypoints : str
        What to do about files in a folder of keypoints that cannot be read: "refuse" or "skip".
    footage_offset : float, optional
        Offset of all footage, in addition to each view's own: the footage shows the key pose of a frame this many
        frames later, -0.5 to 0.5. None estimates it (`core.evidence.time_offset`).
    threads : int, optional
        Number of threads. None uses every core (`core.runtime.threads.worker_count`).
    """

    solver: str = BEST_SOLVER
    sweeps: int = _positive(500)
    working_size: int = _positive(480)
    correlation_length: float | None = _positive(None)
    outline_correlation: float | None = _positive(None)
    joint_acceleration: float | None = _positive(None)
    root_acceleration: float | None = _positive(None)
    estimate_smoothness: bool | None = None
    prediction: bool = True
    plants: bool = True
    contact: bool = True
    limb_search: bool = True
    correct_gaps: bool = True
    stabilise: bool | None = None
    search_seed: int = 0
    keypoint_correlation: float = _positive(0.3)
    broken_keypoints: str = "refuse"
    footage_offset: float | None = None
    threads: int | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        check_solver(self.solver, where="[track] solver")
        if self.broken_keypoints not in BROKEN_KEYPOINTS:
            what, todo = f"unknown value '{self.broken_keypoints}'", f"use {either(BROKEN_KEYPOINTS)}"
            raise ShotError(what, where="[track] broken_keypoints", todo=todo)
        if not abs(self.footage_offset or 0.0) <= MAX_OFFSET:
            what, todo = f"it is {self.footage_offset!r}", "give -0.5 to 0.5 frames"
            raise ShotError(what, where="[track] footage_offset", todo=todo)
        if self.search_seed < 0:
            raise ShotError(f"it is {self.search_seed!r}", where="[track] search_seed", todo="give 0 or more")
        if self.threads is not None:
            check_threads(self.threads, where="[track] threads")
        for item in fields(self):
            value = getattr(self, item.name)
            if not item.metadata.get("positive") or (value is None and item.default is None):
                continue
            if not (isinstance(value, (int, float)) and np.isfinite(value) and value > 0):
                raise ShotError(f"it is {value!r}", where=f"[track] {item.name}", todo="give a positive number")

    @property
    def lengths(self) -> tuple[float, float]:
        """Correlation lengths of pixels and of outlines, metres: as given, or else those for one view."""
        pixels, outlines = ONE_VIEW_LENGTHS
        return self.correlation_length or pixels, self.outline_correlation or outlines

    @property
    def solver_estimates(self) -> bool:
        """Whether the solver can estimate how smooth the motion is."""
        return self.solver in ESTIMATING_SOLVERS

    def for_shot(self, views: int, key_frames: int, keypoint_views: int) -> Settings:
        """Return the settings with missing values filled in for a shot with some views and key frames.

        With one view, constant errors of the model's shape and of the calibration look like motion, so pixels have less
        weight. With one view or two key poses, and no keypoints in two views, the accelerations of single joints cannot
        be estimated: only a common scale is, which corrects most for a wrong frame rate. The relaxation needs none.
        """
        shown = key_frames > 2 or keypoint_views > 1
        can_estimate = views > 1 and shown and self.solver_estimates
        settings = self.with_lengths(*SEVERAL_VIEWS_LENGTHS) if can_estimate else self
        if can_estimate and settings.estimate_smoothness is None:
            settings = replace(settings, estimate_smoothness=True)
        return settings

    def with_lengths(self, pixels: float, outlines: float) -> Settings:
        """Return the settings with correlation lengths, metres, where none are given."""
        return replace(
            self,
            correlation_length=self.correlation_length or pixels,
            outline_correlation=self.outline_correlation or outlines,
        )


def check_solver(name: str, *, where: str) -> None:
    """Check that there is a solver of a name.

    Raises
    ------
    ShotError
        There is none.
    """
    if name not in SOLVERS:
        raise ShotError(f"unknown solver '{name}'", where=where, todo=f"use {either(SOLVERS)}")


def check_threads(threads: int, *, where: str) -> None:
    """Check that a number of threads is from 1 to `MAX_THREADS`.

    Raises
    ------
    ShotError
        It is not.
    """
    if not 1 <= threads <= MAX_THREADS:
        raise ShotError(shortened(f"it is {threads!r}", 60), where=where, todo=f"give 1 to {MAX_THREADS}")
