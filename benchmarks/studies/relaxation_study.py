"""A study of choices that the paper leaves open: `python -m kfmocap.benchmarks.studies.relaxation_study`."""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from unittest import mock

from ...core.body.motion import Motion
from ...core.shot.shot import Shot
from ...core.tracking.prepare import load_shot
from ...core.tracking.selection import selected
from ...core.tracking.solvers.paper_relaxation import relaxation
from ...core.tracking.tracker import track
from ..measured_case import Reference
from ..tables import markdown


def _with_drift(initial: Motion, *_: object) -> Motion:
    """Leave an initial solution as it is."""
    return initial


VARIANTS: Mapping[str, Mapping[str, Any]] = MappingProxyType(
    {
        "as it is": {"PRINTED_SHARE": relaxation.PRINTED_SHARE},
        "no sweep as printed": {"PRINTED_SHARE": 0.0},
        "a quarter of the sweeps as printed": {"PRINTED_SHARE": 0.25},
        "three quarters of the sweeps as printed": {"PRINTED_SHARE": 0.75},
        "all sweeps as printed": {"PRINTED_SHARE": 1.0},
        "unit of length 1 m": {"LENGTH_UNIT": 1.0},
        "unit of length 1/10 m": {"LENGTH_UNIT": 1 / 10},
        "unit of length 1/100 m": {"LENGTH_UNIT": 1 / 100},
        "initial solution with its drift": {"without_drift": _with_drift},
    }
)
"""By variant, the changed values of names in the module `relaxation`; for the choices see docs/papers.md."""


def error(shot: Shot, reference: Reference, variant: str) -> float:
    """Return the mean error of the joints on frames without a key pose with one of `VARIANTS`, mm."""
    with mock.patch.multiple(relaxation, **VARIANTS[variant]):
        return reference.score(track(shot).motions[0]).mean


def main(argv: Sequence[str] | None = None) -> int:
    """Track a shot with each variant, print a table; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m kfmocap.benchmarks.studies.relaxation_study", description=__doc__)
    parser.add_argument("shot", type=Path, help="a shot file")
    parser.add_argument("reference", type=Path, help="TRC with the true landmarks")
    parser.add_argument("--views", metavar="CAM,CAM", help="use the views of these cameras only")
    parser.add_argument("--sweeps", type=int, nargs="+", default=[500], metavar="N", help="columns (default: 500)")
    args = parser.parse_args(argv)
    views = None if args.views is None else args.views.split(",")
    shot = selected(load_shot(args.shot, views=views), solver="relaxation")
    # In this process, whose module has been changed.
    swept = [replace(shot, settings=replace(shot.settings, sweeps=count, threads=1)) for count in args.sweeps]
    reference = Reference(shot, args.reference)
    rows = [[name, *(f"{error(one, reference, name):.1f}" for one in swept)] for name in VARIANTS]
    print(markdown(("variant", *(f"{count} sweeps, mm" for count in args.sweeps)), rows))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
