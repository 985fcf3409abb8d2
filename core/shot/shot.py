"""The shot: what is tracked (views, performers, key poses), as plain values."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..body import Body
from ..body.motion import Motion, stacked
from ..cameras.camera import Camera
from ..errors import ShotError
from ..numerics.sequences import is_whole
from .holds import Hold, holds_between
from .settings import SEVERAL_VIEWS_LENGTHS, Settings

FIELD_ORDERS = ("progressive", "top-first", "bottom-first")


@dataclass(frozen=True)
class Gap:
    """A place in footage where frames are missing or repeated.

    Attributes
    ----------
    frame : int
        Frame, or field, of the footage: the first behind the gap where frames are missing, otherwise the first of the
        repeated ones.
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


def _whole_numbers(frames: ArrayLike) -> NDArray[np.int64]:
    """Return frame numbers as integers; a mask of frames, or a time between two, is refused."""
    numbers = np.asarray(frames)
    if not all(map(is_whole, numbers.ravel().tolist())):
        what = f"key frames are {', '.join(map(str, numbers.ravel()[:20]))}"
        raise ShotError(what, todo="give frame numbers, which are whole and count from the shot's first frame")
    return numbers.astype(np.int64)


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
        """Return key poses on frames (K,) that fix every degree of freedom.

        Raises
        ------
        ShotError
            A frame is not a whole number.
        """
        return cls(_whole_numbers(frames), poses, np.ones((len(poses), 3 + 3 * poses.rotations.shape[1]), bool))

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

    @property
    def fixed_axes(self) -> NDArray[np.bool_]:
        """About which axes each key pose fixes the rotation of each part, shape (K, P, 3)."""
        return self.fixed[:, 3:].reshape(self.poses.rotations.shape[:2] + (3,))

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
    file_fps : float
        Frames per second that the file of its key poses states; 0 if it states none, or there is no file.
    file_rows : int
        Rows of the file of its key poses, if it was not said which frame the first of them shows; 0 if it was.
    given_height : float, optional
        Height that was stated beside the landmarks or keypoints to which the body was fitted, metres.
    """

    name: str
    body: Body
    key_poses: KeyPoses
    person: int | None = None
    unknown: tuple[str, ...] = ()
    joint_deviation: NDArray[np.float64] | None = field(default=None, compare=False)
    fingers: bool = field(default=False, compare=False)
    file_fps: float = field(default=0.0, compare=False)
    file_rows: int = field(default=0, compare=False)
    given_height: float | None = field(default=None, compare=False)


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
