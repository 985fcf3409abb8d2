"""A segment on some of its frames: what is far from the solution is found with fewer pictures, and in less memory.

A motion whose accelerations are known to be limited is known between two frames, too, once it is known on these. Where
the frames follow each other so closely that this is surer than a pixel of coarse images, all that leads from the curve
through the key poses to the solution is done on every k-th frame, as if the footage had been taken at a k-th of the
frame rate. Frames with key poses are always kept.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ...body import Body, part_poses
from ...body.motion import Motion
from ...body.smoothness_estimate import ROOT_GROUPS, AccelerationVariances, axis_mobility
from ...evidence.occlusion import LONG_GAP
from ...evidence.view_frames import ViewFrames
from ...numerics import rotations
from ...numerics.arrays import Array, Ints
from ...numerics.resampling import places_between
from ...runtime.processes.shared_arrays import picked_rows
from ...shot.acceleration_prior import usual_variances
from ...shot.keypose_spline import natural_spline
from .equations.measurement import Workspace
from .equations.problem import WIDEST_STEP, SegmentProblem, SegmentSolution

MAX_ERROR_PIXELS = 1.0
"""Largest expected error of a joint between the kept frames, in pixels: a quarter of those of the coarse stages."""
MIN_RATE = 20.0
"""Fewest frames per second that are kept: the shots that judge the tracker have 24 and more. One camera far from a
performer has pixels so large that fewer would do by them, but between them an arm moves by more than a descent reaches.
"""
MAX_KEPT_SHARE = 0.75
"""Share of the frames from which on it is not worth leaving out the others."""
MIN_KEPT = LONG_GAP + 2
"""Fewest frames that are kept: between two key poses a limb can then be out of sight for long enough to be doubted."""


@dataclass(frozen=True, eq=False)
class ThinnedProblem:
    """A problem on K of the F frames of another one.

    Attributes
    ----------
    whole : SegmentProblem
        The problem on all frames.
    frames : ndarray of int, shape (K,)
        The frames that are kept, among them the first, the last, and all on which a key pose fixes anything of
        performers that are solved for.
    every : int
        The usual step between them, which is the frame of the reduced problem.
    problem : SegmentProblem
        Its frame rate is that of the kept frames.
    """

    whole: SegmentProblem
    frames: Ints
    every: int
    problem: SegmentProblem

    @classmethod
    def of(cls, whole: SegmentProblem, motions: Sequence[Motion]) -> ThinnedProblem | None:
        """Keep some of a problem's frames, as `widest_step` allows; None if too few would be kept or left out.

        `motions`, F poses per performer, say how large the performers are in the pictures.
        """
        for every in range(widest_step(whole, motions), 1, -1):
            frames = kept_frames(whole, every)
            if MIN_KEPT <= len(frames) <= MAX_KEPT_SHARE * whole.length:
                return cls.at(whole, frames, every)
        return None

    @classmethod
    def at_rate(cls, whole: SegmentProblem, rate: float) -> ThinnedProblem | None:
        """Keep at least so many of a problem's frames per second; None if too few would be kept or left out."""
        every = min(WIDEST_STEP, int(whole.fps / rate))
        if every < 2 or whole.steps is not None:
            return None
        frames = kept_frames(whole, every)
        return cls.at(whole, frames, every) if MIN_KEPT <= len(frames) <= MAX_KEPT_SHARE * whole.length else None

    @classmethod
    def with_all(cls, whole: SegmentProblem) -> ThinnedProblem:
        """Keep all frames."""
        return cls(whole, np.arange(whole.length), 1, whole)

    @classmethod
    def at(cls, whole: SegmentProblem, frames: Ints, every: int) -> ThinnedProblem:
        """Keep certain frames, which usually are `every` frames apart."""
        (before, ahead), (after, behind) = (_known_beside(whole, end, every) for end in (0, 1))
        beside = ahead / every, behind / every
        typical, precision = whole.typical_variances, whole.acceleration_precision
        problem = replace(
            whole,
            views=tuple(_thinned(view, whole.first, frames, every) for view in whole.views),
            first=0,
            fps=whole.fps / every,
            fixed=tuple(fixed[frames] for fixed in whole.fixed),
            keypoints=tuple(own.on_frames(frames, every) for own in whole.keypoints),
            footage_offset=whole.footage_offset / every,
            acceleration_precision=None
            if precision is None
            else tuple((p[frames] if p.ndim > 1 else p) / every**4 for p in precision),
            typical_variances=None if typical is None else tuple(own * every**4 for own in typical),
            holds=tuple(hold.among(frames) for hold in whole.holds),
            steps=np.diff(frames) / every,
            before=before,
            after=after,
            beside=beside,
            beyond=(None, None),
        )
        return cls(whole, frames, every, problem)

    def of_motions(self, motions: Sequence[Motion]) -> list[Motion]:
        """Return motions of F poses on the kept frames."""
        return [motion[self.frames] for motion in motions]

    def interpolated(self, motions: Sequence[Motion]) -> list[Motion]:
        """Return motions of K poses on all F frames; those on the kept frames stay the same to the last bit."""
        return [interpolated(motion, self.frames, self.whole.length) for motion in motions]

    def between(self, values: Array, axis: int = 0) -> Array:
        """Interpolate what was measured on the K kept frames, along an axis, to all F frames."""
        last, share = places_between(self.frames, np.arange(self.whole.length))
        rows = np.moveaxis(values, axis, 0)
        part = share.reshape(-1, *(1,) * (rows.ndim - 1))
        return np.asarray(np.moveaxis((1 - part) * rows[last] + part * rows[last + 1], 0, axis))

    def workspace(self, workspace: Workspace) -> Workspace:
        """Return a workspace that reports motions on all frames, and whose caches end with the reduced problem."""
        outer = workspace.on_step
        if outer is None:
            return Workspace(workspace.by)
        report = outer

        def on_step(done: float, motions: Sequence[Motion]) -> None:
            whole = bool(motions) and len(motions[0]) == len(self.frames)  # otherwise they are those of a part of it
            report(done, self.interpolated(motions) if whole else motions)

        return Workspace(workspace.by, on_step=on_step)

    def on_all_frames(self, few: SegmentSolution) -> SegmentSolution:
        """Return a solution of the reduced problem as one on all frames, without evidence; what was measured is
        interpolated.
        """
        return replace(
            few,
            motions=tuple(self.interpolated(few.motions)),
            share=self.between(few.share, 1),
            explained=self.between(few.explained, 1),
            unhidden=self.between(few.unhidden, 1),
            residual=self.between(few.residual),
            evidence=None,
            moved=np.zeros(0),
            polished=False,
            variances=self.variances(few),
        )

    def variances(self, found: SegmentSolution) -> tuple[AccelerationVariances, ...]:
        """Return the variances of accelerations of a solution as those on all frames; the usual ones stay so."""
        return tuple(
            AccelerationVariances.constant(self.whole.variances(i) * (own.typical / self.problem.variances(i)), 0)
            for i, own in enumerate(found.variances)
        )


def _known_beside(whole: SegmentProblem, end: int, every: int) -> tuple[tuple[Motion, ...] | None, int]:
    """Return the known poses up to k frames before a problem (end 0) or after it (end 1), and how far away they are."""
    near, far = (whole.before, whole.after)[end], whole.beyond[end]
    if near is None or far is None:
        return near, 1
    count = min(every, len(far[0]))
    return tuple(m[[-count if end == 0 else count - 1]] for m in far), count


def kept_frames(problem: SegmentProblem, every: int) -> Ints:
    """Return which frames are kept: those with keys of performers that are solved for, the ends, and between them as
    many as keep all steps at most `every`.
    """
    keyed = np.any([problem.fixed[i].any(axis=1) for i in problem.sought], axis=0)
    keyed[[0, -1]] = True
    keys = np.flatnonzero(keyed)
    between = [
        first + np.rint(np.linspace(0, last - first, -(-(last - first) // every) + 1)).astype(int)[:-1]
        for first, last in pairwise(keys)
    ]
    return np.concatenate([*between, keys[-1:]])


def interpolated(motion: Motion, frames: Ints, length: int) -> Motion:
    """Return a motion on `length` frames from its poses on K >= 2 of them, the first and the last among these.

    Every joint turns from a pose to the next at a constant rate, and departs from that by what a cubic spline through
    all of its turns departs from straight lines.
    """
    if len(frames) == length:
        return motion
    K, every = len(frames), np.arange(length)
    last, share = places_between(frames, every)
    Q, T = motion.rotations, motion.translations
    turns = rotations.log(np.swapaxes(Q[:-1], -1, -2) @ Q[1:])
    steps = np.concatenate([np.diff(T, axis=0)[:, None], turns], axis=1).reshape(K - 1, -1)
    along = np.concatenate([np.zeros((1, steps.shape[1])), np.cumsum(steps, axis=0)])
    bent = natural_spline(frames, along, every) - along[last] if K > 2 else share[:, None] * steps[last]
    inside = np.setdiff1d(every, frames)
    found = motion[last]
    moved = found[inside].moved(bent[inside])
    T, Q = found.translations.copy(), found.rotations.copy()
    T[inside], Q[inside] = moved.translations, moved.rotations
    T[length - 1], Q[length - 1] = motion.translations[-1], motion.rotations[-1]
    return Motion(T, Q)


def _thinned(view: ViewFrames, first: int, frames: Ints, every: int) -> ViewFrames:
    """Return a view on some frames, counted from shot frame `first`, which become its frames 0, 1, 2, ..."""
    rows = first - view.first + frames
    sound, _ = view.sound(view.first, len(view.grey))
    torn = None
    if view.torn is not None:
        upto = np.cumsum([0, *view.torn])
        torn = upto[rows[1:]] > upto[rows[:-1]]
    return replace(
        view,
        camera=view.camera.at((first + frames).tolist()),
        grey=picked_rows(view.grey, rows),
        first=0,
        foreground=None if view.foreground is None else picked_rows(view.foreground, rows, axis=1),
        delay=view.delay / every,
        torn=torn,
        damaged=~sound[rows],
        palette=None if view.palette is None else picked_rows(view.palette, rows),
    )


def widest_step(problem: SegmentProblem, motions: Sequence[Motion]) -> int:
    """Return the largest step from frame to frame, up to `WIDEST_STEP`, with which no joint is expected to be off by
    more than `MAX_ERROR_PIXELS` between the frames that are kept, and these are `MIN_RATE` per second or more.

    Parameters
    ----------
    problem : SegmentProblem
        Its variances say how the performers may move between two frames; they count as at least the usual ones, as
        much of a motion may be calm.
    motions : sequence of Motion
        F poses per performer, which say how large they are in the pictures.
    """
    if not problem.views or problem.steps is not None:
        return 1
    pixel = np.mean([_pixel(view, problem, motions) for view in problem.views])
    sway = max(
        _sway(problem.bodies[i], variances, motions[i])
        for i in problem.sought
        for variances in (problem.variances(i), usual_variances(problem.bodies[i], problem.fps, problem.settings))
    )
    most = min(WIDEST_STEP, int(problem.fps / MIN_RATE))
    fine = [k for k in range(2, most + 1) if sway * np.sqrt(gap_variance(k)) <= MAX_ERROR_PIXELS * pixel]
    return max(fine, default=1)


def gap_variance(every: int) -> float:
    """Largest variance of a value between known ones that are k steps apart, where its second differences are
    independent and of variance one.
    """
    frames = np.arange(10 * every + 1)
    rows = np.diff(np.eye(len(frames)), 2, axis=0)
    unknown = frames % every > 0
    if not unknown.any():
        return 0.0
    covariance = np.linalg.inv((rows.T @ rows)[np.ix_(unknown, unknown)])
    inside = (frames[unknown] > 4 * every) & (frames[unknown] < 6 * every)
    return float(np.diag(covariance)[inside].max())


def _pixel(view: ViewFrames, problem: SegmentProblem, motions: Sequence[Motion]) -> float:
    """Return the size of a pixel at the performers that are solved for, metres."""
    there = np.mean([motions[i].translations.mean(axis=0) for i in problem.sought], axis=0)
    return 1 / view.camera.pixels_per_metre(there, problem.first)


def _sway(body: Body, variances: Array, motion: Motion) -> float:
    """Return the standard deviation of the second differences of the place of the fastest joint along an axis, metres
    per frame squared: of the root's place, and of the turns of all joints before it.
    """
    mobile = (axis_mobility(body)[3:].reshape(-1, 3) ** 2).mean(axis=1)
    joints = part_poses(body, motion[:1])[1][0]
    squares = np.full(len(body), variances[:ROOT_GROUPS].max())
    for part in range(len(body)):
        above = body.parents[part]
        while above >= 0:
            squares[part] += (
                variances[ROOT_GROUPS + above] * mobile[above] * np.sum((joints[part] - joints[above]) ** 2)
            )
            above = body.parents[above]
    return float(np.sqrt(squares.max()))
