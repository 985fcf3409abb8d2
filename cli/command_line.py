"""The entry point: parse the arguments, run the command, and turn errors into one line and an exit code.

Importing this module loads neither Blender nor NumPy; a command's own module is loaded when the command is run.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from importlib import import_module

from ..core.errors import KFMocapError
from ..core.runtime.decoder_log import DecoderLog
from ..core.runtime.interrupts import Interruptions, interrupted_text, results_seen
from ..core.runtime.loading import without_garbage_collection
from ..core.runtime.processes.worker_memory import WorkerMemory
from ..core.runtime.processes.worker_process import can_be_copied
from .arguments import parser
from .services import Services

WORKER_MODULES = ("core.tracking.scheduling.segment_tasks", "core.fitting.shot_cameras")
"""Modules that workers import in advance: those that solve segments, and check cameras."""


def main(argv: Sequence[str] | None = None, services: Services | None = None) -> int:
    """Run a command.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments; by default the process's.
    services : Services, optional
        Blender and the benchmark; by default there is neither.

    Returns
    -------
    int
        Exit code: 0 when everything asked for was written, 1 after an error, 130 after Ctrl-C, 143 after SIGTERM.
    """
    _quiet_libraries()
    args = parser().parse_args(argv)
    with DecoderLog(), Interruptions() as interruptions:
        before = results_seen(getattr(args, "out", None))

        def reason(error: BaseException) -> str:
            # Checked only now: the signal may have come between putting the results in place and reporting it.
            return interrupted_text(error, written=results_seen(getattr(args, "out", None)) != before)

        try:
            with _blender_ahead(args, services or Services()) as beside, _workers_ahead(args, beside) as ready:
                with without_garbage_collection():
                    command = import_module(f".{args.command}_command", __package__)
                exit_code: int = command.run(args, ready)
        except Exception as error:
            if interruptions.received is not None:
                # Blender, and NumPy where it compares, turn an interrupt into errors of their own.
                print(f"kfmocap: {reason(error)}", file=sys.stderr)
                return interruptions.exit_code
            if not isinstance(error, KFMocapError):
                raise
            print(f"kfmocap: error: {' '.join(str(error).split())}", file=sys.stderr)
            for note in getattr(error, "__notes__", ()):
                print(f"kfmocap: {note}", file=sys.stderr)
            return 1
        except KeyboardInterrupt as interrupt:
            print(f"kfmocap: {reason(interrupt)}", file=sys.stderr)
            return interruptions.exit_code
    return exit_code


@contextmanager
def _blender_ahead(args: argparse.Namespace, services: Services) -> Iterator[Services]:
    """Start Blender in another process if the command will need it, while the command's own libraries are loaded."""
    if args.command not in ("track", "demo") or args.no_blender or services.start_blender is None:
        yield services
        return
    try:
        process = services.start_blender()
    except ImportError:  # reported when Blender is needed, after errors in the arguments
        yield services
        return
    with closing(process):
        yield replace(services, start_blender=lambda: process)


@contextmanager
def _workers_ahead(args: argparse.Namespace, services: Services) -> Iterator[Services]:
    """Start a worker while the command's own libraries are loaded, if it may need one.

    Only the shot file tells how many are needed, and reading it takes these libraries. If they are loaded already, or
    workers begin as copies of this process, there is nothing to gain.
    """
    gains = "numpy" not in sys.modules and not can_be_copied()
    if args.command != "track" or args.shot is None or args.threads == 1 or (os.cpu_count() or 1) == 1 or not gains:
        yield services
        return
    with closing(WorkerMemory(limit=0)) as workers:
        package = __package__.rpartition(".")[0]
        workers.start_workers(2, tuple(f"{package}.{module}" for module in WORKER_MODULES))
        yield replace(services, workers=workers)


def _quiet_libraries() -> None:
    """Silence OpenCV, whose messages would duplicate our errors, and keep BLAS on one thread.

    The libraries read these environment variables when they are first loaded. `DecoderLog` catches FFmpeg's messages.
    """
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    for library in ("OMP", "OPENBLAS", "MKL"):
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
