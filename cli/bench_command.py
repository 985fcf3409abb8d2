"""`kfmocap bench`: measure the tracker's errors and times on the examples."""

from __future__ import annotations

import argparse

from ..core.errors import KFMocapError
from .services import Services


def run(args: argparse.Namespace, services: Services) -> int:
    """Carry out the command; returns the exit code."""
    if services.run_benchmark is None:
        raise KFMocapError("the benchmark is not installed", todo="run it from a checkout of the project")
    return services.run_benchmark(args.out, shot=args.shot, quick=args.quick, repeat=args.repeat)
