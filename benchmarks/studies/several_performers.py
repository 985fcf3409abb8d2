"""A study of the cost of several performers, in accuracy and time: `python -m
kfmocap.benchmarks.studies.several_performers`.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean

import numpy as np

from ...core.errors import ShotError
from ...core.formats.shot_toml import read_shot_spec
from ...core.shot.shot_spec import ShotSpec
from ...core.tracking.prepare import prepare_shot
from ...core.tracking.tracker import track
from ..tables import markdown
from .review_study import real_errors


@dataclass(frozen=True)
class TrackedPerformers:
    """The measurements of a tracked shot.

    Attributes
    ----------
    errors : dict
        Mean error of each performer's joints on its frames without a key pose, millimetres.
    seconds : float
        Processor time from the prepared shot to the motions.
    """

    errors: dict[str, float]
    seconds: float


def main(argv: Sequence[str] | None = None) -> int:
    """Track performers together, and each in a shot of its own; print how much errors and time increase."""
    parser = argparse.ArgumentParser(
        prog="python -m kfmocap.benchmarks.studies.several_performers", description=__doc__
    )
    parser.add_argument("shot", type=Path, help="shot file whose performers have landmarks, the truth, on all frames")
    alone = "shot files with one of these performers each, who is alone in the picture"
    parser.add_argument("alone", type=Path, nargs="*", help=alone)
    args = parser.parse_args(argv)
    together, *others = [tracked(read_shot_spec(file)) for file in (args.shot, *args.alone)]
    single = {name: error for other in others for name, error in other.errors.items()}
    rows = []
    for name, error in together.errors.items():
        compared = [f"{single[name]:.1f}", f"{error / single[name]:.2f}"] if name in single else ["-", "-"]
        rows.append([name, f"{error:.1f}", *compared])
    print(markdown(["performer", "error, mm", "alone", "ratio"], rows))
    print(f"\nProcessor time: {together.seconds:.1f} s", end="")
    if others:
        usual = fmean(other.seconds for other in others)
        print(f", {together.seconds / usual:.1f} times the {usual:.1f} s of one performer", end="")
    print()
    return 0


def tracked(spec: ShotSpec) -> TrackedPerformers:
    """Track a shot on a single processor and compare its performers with their landmarks.

    Raises
    ------
    ShotError
        A performer has no landmarks.
    """
    shot = prepare_shot(replace(spec, settings=replace(spec.settings, threads=1)))
    begin = time.process_time()
    result = track(shot)
    seconds = time.process_time() - begin
    errors = {}
    for i, (performer, own) in enumerate(zip(shot.performers, spec.performers, strict=True)):
        if own.landmarks is None:
            raise ShotError("it has no truth to compare with", where=own.where, todo="give its 'landmarks'")
        untouched = np.setdiff1d(np.arange(shot.length), performer.key_poses.full())
        errors[performer.name] = float(np.nanmean(real_errors(shot, result, own.landmarks, i)[untouched]))
    return TrackedPerformers(errors, seconds)


if __name__ == "__main__":
    raise SystemExit(main())
