"""A study of how fast both solvers reach an energy: `python -m kfmocap.benchmarks.studies.solver_study SHOT.toml`.

The energy is that of paper 1, equation (21), of a segment: gradient terms linearised around the initial solution, the
terminal terms and the smoothness of the steps. Sweeps of equation (30) and Gauss-Newton steps, which solve for all
frames at once, start from that solution. Sweeps are made as published, with u = 1/n of equation (27) and lengths in
metres, and with u = 1, as in the second half of the solver's sweeps. What measuring the gradients takes does not count.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from ...core.body.motion import Motion
from ...core.numerics import rotations
from ...core.numerics.arrays import Array
from ...core.numerics.banded import BandedFactor
from ...core.numerics.banded_blocks import BandedBlocks
from ...core.shot.shot import Shot
from ...core.tracking.prepare import load_shot
from ...core.tracking.selection import selected
from ...core.tracking.solvers.paper_relaxation import relaxation
from ...core.tracking.solvers.paper_relaxation.motion_steps import StepEquations, Steps
from ...core.tracking.tracker import track
from ..tables import markdown

REACHED = 0.01
"""Share of the decrease of the energy that may be left."""
_MOST_SWEEPS = 4096
_MOST_STEPS = 20
_REPEATS = 5


@dataclass(frozen=True, eq=False)
class LinearisedSegment:
    """The problem of one performer in a segment of n + 1 frames, whose last one has a key pose of the whole body.

    Attributes
    ----------
    motion : Motion
        The initial solution.
    keyed : Motion
        The last of its poses is the key pose.
    fixed : ndarray of bool, shape (n + 1, D)
        As in `relaxation.relax`.
    rows : StepEquations
        Gradient terms around the initial solution.
    published : bool
        Whether sweeps are made as published.
    """

    motion: Motion
    keyed: Motion
    fixed: NDArray[np.bool_]
    rows: StepEquations
    published: bool

    @property
    def weights(self) -> tuple[Array, Array]:
        """Weights of the smoothness and of the terminal terms of each parameter, shape (D,), see `relaxation`."""
        u, smooth, terminal = relaxation.weights_of_steps(*self.rows.steps.shape, whole=not self.published)
        return smooth, u * terminal

    def steps_of(self, increments: Array) -> Array:
        """Steps x (n, D) after increments (n, D) of the poses, the inverse of `StepEquations.increments`."""
        before = np.concatenate([np.zeros_like(increments[:1]), increments[:-1]])
        return self.rows.steps + increments - (self.rows.carried @ before[..., None])[..., 0]

    def end_error(self, steps: Array) -> Array:
        """What is left to the last key pose after steps, in its own axes, shape (D,)."""
        end = Steps(steps[:, :3], steps[:, 3:].reshape(len(steps), -1, 3)).accumulated(self.motion)
        turn = rotations.log(np.swapaxes(end.rotations[-1], -1, -2) @ self.keyed.rotations[-1])
        return np.concatenate([self.keyed.translations[-1] - end.translations[-1], turn.ravel()])

    def energy(self, steps: Array) -> float:
        """Half the energy (21) at steps (n, D), against that of the gradient terms at the initial solution."""
        smooth, terminal = self.weights
        moved = self.rows.increments(steps)
        gradients = (moved * (self.rows.poses.gradient + self.rows.poses.gradient_at(moved))).sum() / 2
        apart = (smooth * np.diff(steps, axis=0) ** 2).sum() / 4
        return float(gradients + apart + (terminal * self.end_error(steps) ** 2).sum() / 2)

    def equations(self, steps: Array) -> BandedBlocks:
        """Normal equations of all terms in the increments of the poses, around the initial solution, with the terminal
        terms linearised around `steps`.
        """
        smooth, terminal = self.weights
        n, D = steps.shape
        system = BandedBlocks.zeros(n, D).add(self.rows.poses)
        carried = self.rows.carried
        here, back = carried[1:] + np.eye(D), carried[:-1].copy()
        back[0] = 0.0  # the first pose does not move
        weight = smooth[:, None] / 2
        apart = np.diff(self.rows.steps, axis=0)[..., None] * weight
        system.diagonal[1:] += np.diag(smooth / 2)
        system.diagonal[:-1] += np.swapaxes(here, 1, 2) @ (weight * here)
        system.diagonal[: n - 2] += np.swapaxes(back[1:], 1, 2) @ (weight * back[1:])
        system.first[:] -= weight * here
        system.first[: n - 2] -= np.swapaxes(here[1:], 1, 2) @ (weight * back[1:])
        system.second[:] += weight * back[1:]
        system.gradient[1:] += apart[..., 0]
        system.gradient[:-1] -= (np.swapaxes(here, 1, 2) @ apart)[..., 0]
        system.gradient[: n - 2] += (np.swapaxes(back[1:], 1, 2) @ apart[1:])[..., 0]
        system.diagonal[-1] += np.diag(terminal)
        system.gradient[-1] -= terminal * (self.end_error(steps) + self.rows.increments(steps)[-1])
        return system

    def gauss_newton(self, count: int) -> Array:
        """Steps (n, D) after a number of Gauss-Newton steps."""
        steps = self.rows.steps
        for _ in range(count):
            system = self.equations(steps)
            factor = BandedFactor(system, np.zeros(system.gradient.shape, bool))
            steps = self.steps_of(factor.solve(-system.gradient))
        return steps

    def relaxed(self, count: int) -> Array:
        """Steps (n, D) after a number of sweeps of equation (30)."""
        motion = relaxation.relax(self.motion, self.keyed, self.fixed, self.rows, count, whole=not self.published)
        return Steps.of(motion).vectors()


def linearised_segments(shot: Shot) -> list[LinearisedSegment]:
    """Return the problems of a shot's segments around the relaxation's initial solutions, as published and with u = 1.

    Parameters
    ----------
    shot : Shot
        Each of its performers has key poses of the whole body.
    """
    found = []

    def kept(
        motion: Motion, keyed: Motion, fixed: NDArray[np.bool_], rows: StepEquations, *_: Any, **__: Any
    ) -> Motion:
        found.extend(LinearisedSegment(motion, keyed, fixed, rows, published) for published in (True, False))
        return motion

    once = replace(shot.settings, sweeps=1, threads=1)  # in this process, whose module is changed
    with mock.patch.multiple(relaxation, relax=kept, PRINTED_SHARE=0.0):
        track(replace(selected(shot, solver="relaxation"), settings=replace(once, solver="relaxation")))
    return found


def fewest(energy: Callable[[int], float], bound: float, most: int) -> int | None:
    """Return how many steps a solver needs for an energy within a bound, or None if `most` are not enough; the energy
    falls with their number.
    """
    low, high = 0, 1
    while energy(high) > bound:
        if high >= most:
            return None
        low, high = high, min(2 * high, most)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if energy(middle) <= bound else (middle, high)
    return high


def seconds(solve: Callable[[int], Any], count: int) -> float:
    """Processor time of a solver with a number of steps, median of several runs."""
    runs = []
    for _ in range(_REPEATS):
        begin = time.process_time()
        solve(count)
        runs.append(time.process_time() - begin)
    return median(runs)


def compared(segment: LinearisedSegment) -> list[str]:
    """Return the numbers of sweeps and of Gauss-Newton steps, their seconds and the ratio of these, as text."""
    begin, least = segment.energy(segment.rows.steps), segment.energy(segment.gauss_newton(_MOST_STEPS))
    bound = least + REACHED * (begin - least)
    steps = fewest(lambda count: segment.energy(segment.gauss_newton(count)), bound, _MOST_STEPS)
    sweeps = fewest(lambda count: segment.energy(segment.relaxed(count)), bound, _MOST_SWEEPS)
    assert steps is not None  # the last of them is what the bound was made of
    direct = seconds(segment.gauss_newton, steps)
    if sweeps is None:
        slow = seconds(segment.relaxed, _MOST_SWEEPS)
        return [f"over {_MOST_SWEEPS}", f"over {slow:.2f}", str(steps), f"{direct:.3f}", f"over {slow / direct:.0f}"]
    slow = seconds(segment.relaxed, sweeps)
    return [str(sweeps), f"{slow:.2f}", str(steps), f"{direct:.3f}", f"{slow / direct:.0f}"]


def main(argv: Sequence[str] | None = None) -> int:
    """Solve every segment of a shot with both, print a table; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.solver_study", description=__doc__)
    parser.add_argument("shot", type=Path, help="a shot file whose key poses are of the whole body")
    parser.add_argument("--views", metavar="CAM,CAM", help="use the views of these cameras only")
    args = parser.parse_args(argv)
    shot = load_shot(args.shot, views=None if args.views is None else args.views.split(","))
    rows = [
        [str(len(own.motion) - 1), "1/n" if own.published else "1", *compared(own)] for own in linearised_segments(shot)
    ]
    print(markdown(["n", "u", "sweeps", "seconds", "Gauss-Newton steps", "seconds", "ratio"], rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
