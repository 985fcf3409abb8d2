"""The program `kfmocap`, also run as `python -m kfmocap`: the command line with Blender's module and the benchmark."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from .cli import command_line
from .cli.services import BlenderSession, Services


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; see `kfmocap.cli.command_line.main`."""
    return command_line.main(argv, Services(load_blender=_load_blender, run_benchmark=_run_benchmark))


def _load_blender() -> BlenderSession:
    import bpy  # noqa: F401  a missing module is reported by its own name

    from .kfmocap_addon.batch import BatchSession

    return BatchSession()


def _run_benchmark(out: Path | None, *, shot: str | None, quick: bool, repeat: int) -> int:
    from .benchmarks import bench

    return bench.run(out, shot=shot, quick=quick, repeat=repeat)


if __name__ == "__main__":
    from .__main__ import main as run  # under its own name, by which other processes find its functions

    sys.exit(run())
