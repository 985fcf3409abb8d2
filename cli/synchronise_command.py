"""`kfmocap synchronise`: find the time offsets of another take's videos from its wand."""

from __future__ import annotations

import argparse

from ..core.calibration.api import synchronise_take
from ..core.formats import load_cameras
from ..core.formats.wand_toml import load_wand
from .progress_bar import progress_bar
from .services import Services


def run(args: argparse.Namespace, _services: Services) -> int:
    """Run the command; returns the exit code."""
    with progress_bar() as progress:
        clocks = synchronise_take(load_wand(args.wand), load_cameras(args.cameras), progress, drift=args.drift)
    print(*clocks.lines, sep="\n")
    return 0
