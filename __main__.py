"""The program `kfmocap`, also run as `python -m kfmocap`: the command line with Blender's module and the benchmark."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from .cli import command_line
from .cli.services import BenchmarkRequest, BlenderSession, Services


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; see `kfmocap.cli.command_line.main`."""
    return command_line.main(argv, Services(load_blender=_load_blender, run_benchmark=_run_benchmark))


def _load_blender() -> BlenderSession:
    import bpy  # noqa: F401  a missing module is reported by its own name

    from .kfmocap_addon.batch import BatchSession

    return BatchSession()


def _run_benchmark(request: BenchmarkRequest) -> int:
    from .benchmarks import bench

    return bench.run(request)


if __name__ == "__main__":
    from .__main__ import main as run  # under its own name, by which other processes find its functions

    sys.exit(run())
