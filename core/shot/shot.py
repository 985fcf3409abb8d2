"""The shot: what is tracked (views, performers, key poses) and how (settings), as plain values."""

from __future__ import annotations

from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body import Body
from ..body.motion import Motion, stacked
from ..cameras.camera import Camera
from ..choices import BEST_SOLVER, SOLVERS, either
from ..errors import ShotError, shortened
from .holds import Hold, holds_between

FIELD_ORDERS = ("progressive", "top-first", "bottom-first")
ESTIMATING_SOLVERS = (BEST_SOLVER,)
"""Solvers that can estimate how smooth a motion is."""
BROKEN_KEYPOINTS = ("refuse", "skip")
MAX_THREADS = 256
"""Largest number of threads: OpenCV starts as many for each video as it is told to."""
MAX_OFFSET = 0.5
"""Largest offset between key poses and footage that is allowed for, frames: one that is larger is measured as this."""


@dataclass(frozen=True)
class Gap:
    """A place in footage where frames are missing, or are there once too often.

    Attributes
    ----------
    frame : int
        Frame, or field, of the footage: the first behind the gap where frames are missing, otherwise the first of those
        that are there once too often.
    missing : int
        How many frames, or fields, are missing before it; negative if that many are repeated.
    timed : bool
        Whether the times in the file say so: programs that show footage by its times then show it right.
    """

    frame: int
    missing: int
    timed: bool = False


@dataclass(frozen=True, eq=False)
class View:
    """A camera and its footage: shot frame f is the footage's frame (or field, if interlaced) every * f + offset.

    Attributes
    ----------
    camera : Camera
        A moving camera's pose of frame f is the pose at the footage's frame itself.
    footage : Path
        The video, or the pattern of an image sequence.
    offset : float
        Frames, or fields, of the footage. Between two of them, the nearest is used as frame f, and shows the performers
        a little later or earlier (`core.body.time_shift`).
    fields : str
        One of `FIELD_ORDERS`.
    keypoints : Path, optional
        File or folder of a detector's 2D keypoints.
    gaps : tuple of Gap
        In order of their frames. Behind a gap, frames are counted as if it were none, see `core.shot.frame_numbers`.
    damaged : tuple of (int, int)
        First and last frame of the file of each damaged stretch, which is not used as evidence.
    every : int
        Number of the footage's frames, or fields, for each frame of the shot.
    """

    camera: Camera
    footage: Path
    offset: float = 0.0
    fields: str = "progressive"
    keypoints: Path | None = None
    gaps: tuple[Gap, ...] = ()
    damaged: tuple[tuple[int, int], ...] = ()
    every: int = 1


@dataclass(frozen=True, eq=False)
class KeyPoses:
    """Poses that the animator set.

    Attributes
    ----------
    frames : ndarray of int, shape (K,)
        Shot frames, increasing.
    poses : Motion
        K poses.
    fixed : ndarray of bool, shape (K, D)
        Which degrees of freedom each key pose fixes, in the order of `Motion.moved`. A key pose that fixes none is a
        proposal: the tracker learns the performer's appearance on its frame, but may change the pose.
    """

    frames: NDArray[np.int64]
    poses: Motion
    fixed: NDArray[np.bool_]

    @classmethod
    def whole(cls, frames: NDArray[np.int64] | list[int], poses: Motion) -> KeyPoses:
        """Return key poses on frames (K,) that fix every degree of freedom."""
        return cls(np.asarray(frames, np.int64), poses, np.ones((len(poses), 3 + 3 * poses.rotations.shape[1]), bool))

    @classmethod
    def proposed(cls, frames: NDArray[np.int64] | list[int], poses: Motion) -> KeyPoses:
        """Return key poses on frames (K,) that fix nothing."""
        whole = cls.whole(frames, poses)
        return cls(whole.frames, poses, np.zeros_like(whole.fixed))

    def joined(self, other: KeyPoses) -> KeyPoses:
        """Return these key poses together with others on different frames."""
        frames = np.concatenate([self.frames, other.frames])
        order = np.argsort(frames)
        poses = stacked([self.poses, other.poses])[order]
        return KeyPoses(frames[order], poses, np.concatenate([self.fixed, other.fixed])[order])

    def between(self, first: int, last: int) -> KeyPoses:
        """Return the key poses on shot frames first to last, counted from the first of these."""
        inside = (self.frames >= first) & (self.frames <= last)
        return KeyPoses(self.frames[inside] - first, self.poses[inside], self.fixed[inside])

    def without_parts(self, free: NDArray[np.bool_]) -> KeyPoses:
        """Return these key poses without the rotations of some parts (K, P), which they no longer fix."""
        fixed = self.fixed.copy()
        fixed[:, 3:] &= ~np.repeat(free, 3, axis=1)
        return replace(self, fixed=fixed)

    def proposals(self) -> NDArray[np.int64]:
        """Return the frames whose key pose is a proposal, shape (n,)."""
        return np.asarray(self.frames[~self.fixed.any(axis=1)])

    def full(self) -> NDArray[np.int64]:
        """Return the frames whose key pose fixes the whole body, where segments end, shape (n,)."""
        return np.asarray(self.frames[self.fixed.all(axis=1)])


@dataclass(frozen=True, eq=False)
class Performer:
    """A person to track.

    Attributes
    ----------
    name : str
    body : Body
    key_poses : KeyPoses
    person : int, optional
        Which of the people in the keypoints it is, counted from 1 in order of appearance; by default this follows from
        its key poses, or from the order of the performers.
    unknown : tuple of str
        Parts of the body that neither landmarks nor keypoints show on any frame; they keep their rest rotation.
    joint_deviation : ndarray, shape (P,), optional
        Distances of the parts' tips from the landmarks that the key poses were fitted to, metres; None if there were
        none.
    fingers : bool
        Whether files with its motion include fingers, as found from keypoints.
    """

    name: str
    body: Body
    key_poses: KeyPoses
    person: int | None = None
    unknown: tuple[str, ...] = ()
    joint_deviation: NDArray[np.float64] | None = field(default=None, compare=False)
    fingers: bool = field(default=False, compare=False)


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
        `core.tracking.footage_gaps`.
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
    search_seed: int = 0
    keypoint_correlation: float = _positive(0.3)
    broken_keypoints: str = "refuse"
    footage_offset: float | None = None
    threads: int | None = field(default=None, compare=False)

    def __post_init__(self) -> None:
        if self.solver not in SOLVERS:
            raise ShotError(f"unknown solver '{self.solver}'", where="[track] solver", todo=f"use {either(SOLVERS)}")
        if self.broken_keypoints not in BROKEN_KEYPOINTS:
            what, todo = f"unknown value '{self.broken_keypoints}'", f"use {either(BROKEN_KEYPOINTS)}"
            raise ShotError(what, where="[track] broken_keypoints", todo=todo)
        if not abs(self.footage_offset or 0.0) <= MAX_OFFSET:
            what, todo = f"it is {self.footage_offset!r}", "give -0.5 to 0.5 frames"
            raise ShotError(what, where="[track] footage_offset", todo=todo)
        if self.search_seed < 0:
            raise ShotError(f"it is {self.search_seed!r}", where="[track] search_seed", todo="give 0 or more")
        if self.threads is not None and not 1 <= self.threads <= MAX_THREADS:
            todo = f"give 1 to {MAX_THREADS}"
            raise ShotError(shortened(f"it is {self.threads!r}", 60), where="[track] threads", todo=todo)
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

    def for_shot(self, views: int, key_frames: int, keypoint_views: int = 0) -> Settings:
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


@dataclass(frozen=True, eq=False)
class Shot:
    """Everything that one tracking job needs.

    Attributes
    ----------
    name : str
        Name of the files with its results.
    fps : float
        Frames per second; for interlaced footage, fields per second.
    frames : tuple of int
        First and last frame number of the footage, inclusive; shot frame 0 is the first.
    views : tuple of View
    performers : tuple of Performer
    settings : Settings
    holds : tuple of Hold
        Which performers (props) are held by which others, and when.
    """

    name: str
    fps: float
    frames: tuple[int, int]
    views: tuple[View, ...]
    performers: tuple[Performer, ...]
    settings: Settings = field(default_factory=Settings)
    holds: tuple[Hold, ...] = ()

    @property
    def length(self) -> int:
        """Number of frames."""
        return self.frames[1] - self.frames[0] + 1

    def with_settings_filled(self) -> Shot:
        """Return the shot with missing settings filled in, see `Settings.for_shot`."""
        keypoint_views = sum(view.keypoints is not None for view in self.views)
        return replace(self, settings=self.settings.for_shot(len(self.views), self._fewest_keys, keypoint_views))

    def for_refinement(self) -> Shot:
        """Return the shot, with its settings filled in, as it is refined: between two key poses, pixels of several
        views count as much as between many.

        With so few key poses the smoothness alone would hold long movements too near to the curve through them. While
        limbs are still where that curve has them, they would be led astray by such weights.
        """
        if len(self.views) < 2 or self._fewest_keys < 2 or not self.settings.solver_estimates:
            return self
        return replace(self, settings=self.settings.with_lengths(*SEVERAL_VIEWS_LENGTHS))

    @property
    def _fewest_keys(self) -> int:
        return min((len(p.key_poses.frames) for p in self.performers), default=0)

    def with_footage_offset(self, found: float | None) -> Shot:
        """Return the shot with an estimated offset of all footage, if there is one and its settings give none."""
        if found is None or self.settings.footage_offset is not None:
            return self
        return replace(self, settings=replace(self.settings, footage_offset=found))

    def between(self, first: int, last: int) -> Shot:
        """Return shot frames first to last as a shot of their own, with the key poses on these frames."""
        return replace(
            self,
            frames=(self.frames[0] + first, self.frames[0] + last),
            views=tuple(replace(view, camera=view.camera.between(first, last)) for view in self.views),
            performers=tuple(replace(p, key_poses=p.key_poses.between(first, last)) for p in self.performers),
            holds=holds_between(self.holds, first, last),
        )
