"""The program `kfmocap`, also run as `python -m kfmocap`: the command line with Blender's module and the benchmark."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any, NoReturn

from .cli import command_line
from .cli.services import BenchmarkRequest, Services, blender_needed
from .core.errors import ShotError, WorkerEndedError
from .core.runtime.loading import without_garbage_collection
from .core.runtime.standard_streams import make_streams_safe

if TYPE_CHECKING:
    from pathlib import Path

    from .cli.services import OutputRequest, RetargetRequest
    from .core.runtime.progress import Progress
    from .core.shot.shot import Shot
    from .core.tracking.results.track_result import TrackResult
    from .kfmocap_addon.batch import BatchSession


def main(argv: Sequence[str] | None = None) -> int:
    """Run a command; see `kfmocap.cli.command_line.main`."""
    make_streams_safe()
    loaded = sys.modules.get("bpy") is not None  # its paths, which another process would get, lead to other modules
    services = Services(
        load_blender=_load_blender,
        start_blender=None if loaded else _BlenderProcess,
        run_benchmark=_run_benchmark,
    )
    return command_line.main(argv, services)


def program() -> NoReturn:
    """Run the command of this process, and end it at once: to take its libraries apart would take a tenth of a second
    more, when all is written.
    """
    exit_code = main()
    try:
        for stream in (sys.stdout, sys.stderr):
            if stream is not None:
                stream.flush()
    except OSError:
        sys.exit(exit_code)  # as Python reports it
    os._exit(exit_code)


def _load_blender() -> BatchSession:
    import bpy  # noqa: F401  a missing module is reported by its own name

    from .kfmocap_addon.batch import BatchSession

    return BatchSession()


class _BlenderProcess:
    """Blender's module in a process of its own; see `kfmocap.cli.services.BlenderProcess`."""

    def __init__(self) -> None:
        if find_spec("bpy") is None:
            import bpy  # noqa: F401  says that it is missing
        from .core.runtime.processes.worker_process import WorkerProcess

        self._process = WorkerProcess(yields=False)
        self._thread = ThreadPoolExecutor(1)
        self._loaded = self._thread.submit(self._process.call, _loaded_blender)
        self._shown: Future[Any] | None = None

    def check(self) -> None:
        """Raise what went wrong with loading it, if that is known."""
        if self._loaded.done():
            with blender_needed():
                self._loaded.result()

    def prepare(self, shot: Shot, home: Path, beside: Path | None = None) -> None:
        """Have a scene built for a shot that is going to be written to a folder; returns at once."""
        self._shown = self._thread.submit(self._process.call, partial(_showing, shot, home, beside))

    def write_outputs(self, shot: Shot, result: TrackResult, request: OutputRequest) -> list[Path]:
        """Write the BVH and FBX files and shot.blend; returns the files written."""
        small = replace(result, pictures=(), segments=())
        try:
            with blender_needed():
                self._loaded.result()
            if self._shown is not None:
                self._shown.result()
                request = replace(request, shown=True)
            files: list[Path] = self._process.call(partial(_written_outputs, shot, small, request))
        except BaseException:
            self.close()  # it must not go on writing to a folder that is removed
            raise
        self._process.kill()  # it takes a while to end, and nothing more is asked of it
        return files

    def retarget(self, request: RetargetRequest) -> dict[str, Any]:
        """Put a motion on a character and save the file; returns the report."""
        with blender_needed():
            self._loaded.result()
        try:
            report: dict[str, Any] = self._process.call(partial(_retargeted, request))
        except WorkerEndedError as error:  # damaged files make Blender crash
            raise ShotError(
                f"Blender ended while it worked on them: {error.what}",
                where=f"{request.motion}, {request.character}",
                todo="open both in Blender, and save them again",
            ) from error
        return report

    def close(self) -> None:
        """End it."""
        self._process.kill()
        self._thread.shutdown()
        self._process.close()


def _loaded_blender(_: Progress) -> None:
    """Load Blender's module, and what writes results with it."""
    with without_garbage_collection():
        _load_blender()
        from .kfmocap_addon.export import blender_outputs  # noqa: F401  it is loaded for later


def _showing(shot: Shot, home: Path, beside: Path | None, _: Progress) -> None:
    """Have Blender show a shot before it is tracked."""
    _load_blender().show_shot(shot, home, beside)


def _written_outputs(shot: Shot, result: TrackResult, request: OutputRequest, _: Progress) -> list[Path]:
    """Have Blender write what was tracked."""
    return _load_blender().write_outputs(shot, result, request)


def _retargeted(request: RetargetRequest, _: Progress) -> dict[str, Any]:
    """Have Blender put a motion on a character."""
    return _load_blender().retarget(request)


def _run_benchmark(request: BenchmarkRequest) -> int:
    from .benchmarks import bench

    return bench.run(request)


if __name__ == "__main__":
    from .__main__ import program as run  # under its own name, by which other processes find its functions

    run()
