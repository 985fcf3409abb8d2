"""The time and memory of a whole command, which runs in its own process."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from ..core.errors import KFMocapError
from .long_shots import threads_text

_SAMPLED = 0.1  # seconds between samples of the memory


@dataclass(frozen=True)
class Cost:
    """The time and memory that a command took.

    Attributes
    ----------
    seconds : float
        From its start to its end.
    processor : float
        Processor time of all of its processes, seconds.
    memory : int
        Largest memory of all of its processes together, bytes, with shared memory counted once. 0 on systems that do
        not report it.
    """

    seconds: float
    processor: float
    memory: int

    @classmethod
    def median(cls, costs: Sequence[Cost]) -> Cost:
        """Return the median of each number."""
        return cls(
            median(cost.seconds for cost in costs),
            median(cost.processor for cost in costs),
            int(median(cost.memory for cost in costs)),
        )


def command_cost(program: Path, shot: Path, cameras: Sequence[str], threads: int, *, ends: bool = False) -> Cost:
    """Run `kfmocap track` of a program in its own process and measure its cost; `ends` as in `SpeedRow`.

    Raises
    ------
    KFMocapError
        The command fails.
    """
    limit = threads_text(shot, threads, ends=ends)
    with tempfile.TemporaryDirectory() as out, _memory_watched() as watch:
        command = [sys.executable, "-m", "kfmocap", "track", str(limit), "--out", out, "--no-blender"]
        begin, before = time.perf_counter(), _children_seconds()
        process = subprocess.Popen(
            [*command, "--views", ",".join(cameras)],
            env=os.environ | {"PYTHONPATH": str(program)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
        )
        watch.process = process.pid
        _, errors = process.communicate()
        seconds = time.perf_counter() - begin
    if process.returncode:
        raise KFMocapError((errors.strip().splitlines() or ["it ended without a message"])[-1], where=" ".join(command))
    return Cost(seconds, _children_seconds() - before, watch.most)


def _children_seconds() -> float:
    times = os.times()
    return times.children_user + times.children_system


class _MemoryWatch:
    """The largest memory of a process and those that it started."""

    def __init__(self) -> None:
        self.process: int | None = None
        self.most = 0
        self.ended = threading.Event()

    def run(self) -> None:
        while not self.ended.wait(_SAMPLED):
            if self.process is not None:
                self.most = max(self.most, sum(_own_memory(p) for p in _family(self.process)))


@contextmanager
def _memory_watched() -> Iterator[_MemoryWatch]:
    watch = _MemoryWatch()
    thread = threading.Thread(target=watch.run, daemon=True)
    thread.start()
    try:
        yield watch
    finally:
        watch.ended.set()
        thread.join()


def _family(process: int) -> list[int]:
    """Return a process and all its descendants, on Linux."""
    found = [process]
    for one in found:
        try:
            for file in Path(f"/proc/{one}/task").glob("*/children"):
                found += [int(number) for number in file.read_text().split()]
        except OSError:
            continue  # it ended meanwhile, or this is another system
    return found


def _own_memory(process: int) -> int:
    """Return a process's proportional set size, bytes: shared memory is divided among the processes that share it."""
    try:
        for line in Path(f"/proc/{process}/smaps_rollup").read_text().splitlines():
            if line.startswith("Pss:"):
                return 1024 * int(line.split()[1])
    except OSError:
        pass
    return 0
