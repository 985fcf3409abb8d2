"""Functions for the tests of jobs to run: a process without Blender imports them from here."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from kfmocap.core.errors import CaptureError
from kfmocap.core.runtime.processes.worker_memory import WorkerMemory
from kfmocap.core.runtime.processes.worker_pool import WorkerPool

Progress = Callable[[str, float], bool]


def halfway(answer: int, progress: Progress) -> int:
    print("chatter of a library")
    progress("half", 0.5)
    return answer


def silent(file: Path, progress: Progress) -> None:
    """Reports nothing for long."""
    file.write_text(str(os.getpid()))
    time.sleep(60)


def failing(progress: Progress) -> None:
    raise CaptureError("it lies in a plane", name="wand-in-a-plane", where="wand.mp4", todo="wave it about")


def broken(progress: Progress) -> None:
    raise ZeroDivisionError("a bug")


def silently(_progress: Progress) -> None:
    """Does nothing."""


@dataclass(frozen=True)
class Tracked:
    """What stands for a result of tracking."""

    pictures: tuple[object, ...] = ()
    segments: tuple[object, ...] = ()


def writing_nothing(_shot: object, _result: Tracked, _request: object, _progress: Progress) -> list[Path]:
    """Writes no files."""
    return []


def crashing(_work: object, _progress: Progress) -> None:
    """Ends the process as a crash does."""
    os.kill(os.getpid(), signal.SIGKILL)


def killed(progress: Progress) -> None:
    os._exit(1)


def busy(file: Path, progress: Progress) -> None:
    """Computes for long, and reports nothing."""
    file.write_text(str(os.getpid()))
    while True:
        pass


def stubborn(file: Path, progress: Progress) -> None:
    """Does not end when it is asked to."""
    file.write_text(str(os.getpid()))
    while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            continue


def helped(file: Path, progress: Progress) -> None:
    """Does not end when it is asked to, and neither does a process that works for it."""
    with WorkerPool(2) as pool:
        helper = file.with_name("helper")
        pool.submit(partial(stubborn, helper), lambda _: None)
        while not helper.exists() or not helper.read_text():
            time.sleep(0.01)
        stubborn(file, progress)


def killed_elsewhere(home: int, progress: Progress) -> None:
    """Ends its process, unless that is the program's: there it goes on until it is told to stop."""
    if os.getpid() != home:
        os._exit(3)
    while progress("waiting", 0.5):
        time.sleep(0.01)


def waiting(progress: Progress) -> None:
    """Goes on until it is told to stop."""
    while progress("waiting", 0.5):
        time.sleep(0.01)


def process_id(progress: Progress) -> int:
    """Tells where it is done, after a while."""
    time.sleep(0.2)
    return os.getpid()


def counted(progress: Progress, memory: WorkerMemory | None = None) -> int:
    """How often it was called where one memory was kept."""
    count = 1
    while memory is not None and memory.picture(count) is not None:
        count += 1
    if memory is not None:
        memory.keep(count, np.zeros(1, np.uint8))
    return count


def showing(file: Path, _progress: Progress, *, memory: WorkerMemory, show: Callable[[object, object], None]) -> str:
    """Shows interim results of two keys, and ends when a file is there."""
    for key, value in (("a", 1), ("b", 2), ("a", 3)):
        show(key, value)
    while not file.exists():
        time.sleep(0.01)
    return "end"


def niceness(progress: Progress) -> int:
    """How much the process lets others go first."""
    time.sleep(0.1)
    return os.nice(0)


def has_imported(module: str, progress: Progress) -> bool:
    """Whether this process has a module."""
    return module in sys.modules
