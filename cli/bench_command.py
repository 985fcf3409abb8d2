"""`kfmocap bench`: measure errors and times on the examples, errors on the set of shots, or times alone."""

from __future__ import annotations

import argparse

from ..core.errors import KFMocapError
from .services import BenchmarkRequest, Services


def run(args: argparse.Namespace, services: Services) -> int:
    """Run the command; returns the exit code."""
    if services.run_benchmark is None:
        raise KFMocapError("the benchmark is not installed", todo="run it from a checkout of the project")
    if not args.shots and (args.data is not None or args.set):
        option = "--set" if args.set else "--data"
        raise KFMocapError("it belongs to the set of shots", where=option, todo="give --shots, too")
    if args.against is not None and not args.speed:
        raise KFMocapError("it belongs to the times", where="--against", todo="give --speed, too")
    return services.run_benchmark(
        BenchmarkRequest(
            out=args.out,
            shot=args.shot,
            quick=args.quick,
            repeat=args.repeat,
            shots=args.shots,
            data=args.data,
            changed=tuple(args.set),
            speed=args.speed,
            against=args.against,
        )
    )
