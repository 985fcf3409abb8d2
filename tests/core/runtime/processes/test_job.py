"""A job's process ends with the program that waits for it, however that ends and whatever the job does."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import job_functions
import pytest
from conftest import ROOT
from kfmocap.core.runtime.processes.worker import GRACE_SECONDS
from kfmocap.core.runtime.processes.worker_pool import WorkerPool
from kfmocap.core.runtime.processes.worker_process import WorkerProcess
from kfmocap.core.runtime.threads import worker_count

PARENT = """
import sys, time
from functools import partial
from pathlib import Path
import job_functions
from kfmocap.core.runtime.processes.job import Job
job = Job(partial(getattr(job_functions, sys.argv[1]), Path(sys.argv[2])))
time.sleep(60)
"""


def is_alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.fixture
def load() -> Iterator[None]:
    """Other programs that have more to do than the cores of this process can."""
    others = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * worker_count())]
    yield
    for other in others:
        other.kill()
        other.wait()


def ended_in_time(tmp_path: Path, work: str) -> None:
    """Kill a program while its job does some work; fails where a process is left two seconds later."""
    path = os.pathsep.join([str(ROOT / "tests" / "support"), *sys.path])
    command = [sys.executable, "-c", PARENT, work, str(tmp_path / "pid")]
    with subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}) as parent:
        limit = time.monotonic() + 60
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
            assert time.monotonic() < limit
            time.sleep(0.02)
        parent.kill()
    workers, killed = [int(file.read_text()) for file in tmp_path.iterdir()], time.monotonic()
    while any(map(is_alive, workers)):
        assert time.monotonic() < killed + 2
        time.sleep(0.02)


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("work", ["silent", "busy", "stubborn"])
def test_a_worker_ends_within_two_seconds_of_its_program(tmp_path: Path, work: str) -> None:
    ended_in_time(tmp_path, work)


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.usefixtures("load")
def test_so_do_those_who_work_for_it_though_the_machine_has_more_to_do_than_it_can(tmp_path: Path) -> None:
    """Each waits for the next one to end: what they are given to tidy must not add up."""
    ended_in_time(tmp_path, "helped")


def test_what_has_nothing_to_tidy_ends_at_once(tmp_path: Path) -> None:
    """A process that waits for work, and one that works for another one."""
    idle = WorkerProcess()
    idle.call(job_functions.process_id)
    with WorkerPool(2) as pool:
        pool.submit(partial(job_functions.stubborn, tmp_path / "pid"), lambda _: None)
        while not (tmp_path / "pid").exists():
            time.sleep(0.01)
        for process in (idle, pool._processes[0]):
            begun = time.monotonic()
            process.close()
            assert time.monotonic() < begun + GRACE_SECONDS
