"""A study of how well hidden limbs are bridged without any picture.

A limb is taken out of a known motion for some frames, and put back in the ways of both solvers. The initial solution of
the relaxation goes step by step: with prediction by the filters of paper 1, section 5, without it by repeating the last
step. Gauss-Newton knows both sides of a gap: with prediction its accelerations are expected to be those of the motion
that is predicted from both sides, without it they are expected to be zero.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from ...core.body import Body, landmark_positions
from ...core.body.motion import Motion
from ...core.body.smoothness import acceleration, smoothness
from ...core.shot.keypose_spline import spline
from ...core.tracking.prepare import load_shot
from ...core.tracking.solvers.unseen_parts.prediction import FILTER_STEPS, predict_unseen
from ..tables import markdown

GAPS = (3, 6, 9, 12, 18)
"""Numbers of hidden frames."""
LEAST_PAST, LEAST_AFTER = FILTER_STEPS + 4, 4
"""Frames that are seen before and after a gap, at least."""
LIMBS = MappingProxyType(
    {
        f"{side}{end}": tuple(f"{part}.{side}" for part in parts)
        for end, parts in (("Wrist", ("upper_arm", "forearm", "hand")), ("Ankle", ("thigh", "shin", "foot")))
        for side in "RL"
    }
)
"""By landmark at the end of a limb: its parts."""
ROUNDS = 4
"""Of the solution for minimal accelerations; more change nothing."""


def repeated(motion: Motion, gap: range, hidden: NDArray[np.bool_]) -> Motion:
    """Repeat the limb's last step before a gap."""
    step = motion[[gap.start - 2]].difference(motion[[gap.start - 1]])
    for frame in gap:
        there = motion[[frame]].difference(motion[[frame - 1]].moved(step))
        degrees = np.concatenate([np.zeros(3, bool), np.repeat(hidden[frame], 3)])
        motion = motion.replaced(frame, motion[[frame]].moved(np.where(degrees, there, 0.0)))
    return motion


def predicted(motion: Motion, gap: range, hidden: NDArray[np.bool_]) -> Motion:
    """Predict the limb from the frames before a gap alone."""
    return motion.replaced(0, predict_unseen(motion[: gap.stop], hidden[: gap.stop]))


def smooth(motion: Motion, gap: range, hidden: NDArray[np.bool_], *, expect: bool = False) -> Motion:
    """Find the poses of the least accelerations, or of the least difference from those predicted from both sides."""
    filled, first, dof = predict_unseen(motion, hidden), gap.start - 2, 3 + 3 * hidden.shape[1]
    near = filled[first : gap.stop + 2]
    expected = acceleration(near) if expect else None
    degrees = np.concatenate(
        [np.zeros((len(near), 3), bool), np.repeat(hidden[first : gap.stop + 2], 3, axis=1)], axis=1
    )
    free = np.flatnonzero(degrees)
    for _ in range(ROUNDS):
        blocks = smoothness(near, np.ones(dof), expected)
        A, g = np.zeros((len(near), dof, len(near), dof)), blocks.gradient.ravel()
        for distance, band in enumerate((blocks.diagonal, blocks.first, blocks.second)):
            for frame, block in enumerate(band):
                A[frame + distance, :, frame] = block
                A[frame, :, frame + distance] = block.T
        step = np.zeros(g.size)
        step[free] = -np.linalg.solve(A.reshape(g.size, g.size)[np.ix_(free, free)], g[free])
        near = near.moved(step.reshape(len(near), dof))
    return filled.replaced(first, near)


WAYS: Mapping[str, Callable[[Motion, range, NDArray[np.bool_]], Motion]] = MappingProxyType(
    {
        "relaxation, last step repeated": repeated,
        "relaxation, predicted": predicted,
        "Gauss-Newton, smooth": smooth,
        "Gauss-Newton, predicted": lambda motion, gap, hidden: smooth(motion, gap, hidden, expect=True),
    }
)


def bridged(body: Body, motion: Motion, length: int, end: str) -> Iterator[list[float]]:
    """Yield for every second place of a gap the mean error at the end of a limb of each of `WAYS`, mm."""
    parts = [body.index(name) for name in LIMBS[end]]
    true = landmark_positions(body, motion, [end])
    for begin in range(LEAST_PAST, len(motion) - length - LEAST_AFTER + 1, 2):
        gap = range(begin, begin + length)
        hidden = np.zeros((len(motion), len(body)), bool)
        hidden[begin : gap.stop, parts] = True
        found = [landmark_positions(body, way(motion, gap, hidden), [end]) for way in WAYS.values()]
        yield [1000 * float(np.linalg.norm((there - true)[begin : gap.stop], axis=-1).mean()) for there in found]


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    made = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.prediction_study", description=__doc__)
    made.add_argument("shot", type=Path, help="a shot file with landmarks on all frames")
    return made


def main(argv: Sequence[str] | None = None) -> int:
    """Bridge gaps in the motion of a shot's landmarks and print a table; returns the exit code."""
    args = parser().parse_args(argv)
    first, last = load_shot(args.shot).frames
    performer = load_shot(args.shot, keyframes=range(first, last + 1)).performers[0]
    motion = spline(performer.key_poses, last + 1 - first)
    rows = []
    for ends in (("RWrist", "LWrist"), ("RAnkle", "LAnkle")):
        for length in GAPS:
            found = [errors for end in ends for errors in bridged(performer.body, motion, length, end)]
            if found:
                rows.append(
                    [ends[0][1:], str(length), *(f"{fmean(column):.0f}" for column in zip(*found, strict=True))]
                )
    print(markdown(("limb's end", "frames hidden", *(f"{name}, mm" for name in WAYS)), rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
