"""Work is done side by side, in this process and others; where one of these dies, that is said."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from functools import partial
from pathlib import Path

import job_functions
import pytest
from kfmocap.core.errors import CancelledError, CaptureError, WorkerEndedError
from kfmocap.core.runtime.processes.worker_pool import WorkerPool
from kfmocap.core.runtime.processes.worker_process import WorkerProcess


def unheard(_: float) -> None:
    """Progress that nobody looks at."""


def test_a_pool_works_in_as_many_processes_as_it_has_workers() -> None:
    with WorkerPool(2) as pool:
        found = [pool.submit(job_functions.process_id, unheard) for _ in range(4)]
        processes = {future.result() for future in found}
    assert len(processes) == 2 and os.getpid() in processes


def test_a_single_worker_is_this_process() -> None:
    with WorkerPool(1) as pool:
        assert pool.submit(job_functions.process_id, unheard).result() == os.getpid()


def test_a_worker_that_is_killed_ends_all_work_with_a_message() -> None:
    begun = time.monotonic()
    with pytest.raises(WorkerEndedError, match="exit code 3"), WorkerPool(2) as pool:
        for future in [pool.submit(partial(job_functions.killed_elsewhere, os.getpid()), unheard) for _ in range(2)]:
            future.result()
    assert time.monotonic() < begun + 20


def test_an_error_of_the_work_comes_as_it_was_and_the_worker_lives() -> None:
    with WorkerPool(2) as pool:
        failing = [pool.submit(job_functions.failing, unheard) for _ in range(2)]
        for future in failing:
            with pytest.raises(CaptureError, match="it lies in a plane"):
                future.result()
        assert pool.submit(job_functions.process_id, unheard).result() > 0


@pytest.mark.parametrize("workers", [1, 2])
def test_results_have_the_order_of_their_tasks_and_progress_grows_to_one_whoever_does_them(workers: int) -> None:
    told: list[tuple[str, float]] = []
    tasks = [(f"part {n}", partial(job_functions.halfway, n)) for n in range(5)]
    with WorkerPool(workers) as pool:
        assert pool.do_all(tasks, lambda what, fraction: not told.append((what, fraction))) == [0, 1, 2, 3, 4]
    assert {what for what, _ in told} == {what for what, _ in tasks}
    assert [fraction for _, fraction in told] == pytest.approx([0.1 * k for k in range(1, 11)])  # also of its ends


@pytest.mark.parametrize("workers", [1, 2])
def test_the_error_of_the_first_task_that_failed_is_raised(workers: int) -> None:
    tasks = [("sound", job_functions.process_id), ("in a plane", job_functions.failing), ("bug", job_functions.broken)]
    with pytest.raises(CaptureError, match="it lies in a plane"), WorkerPool(workers) as pool:
        pool.do_all(tasks)


@pytest.mark.parametrize("workers", [1, 2])
def test_tasks_that_are_cancelled_end_all_of_them(workers: int) -> None:
    begun = time.monotonic()
    with pytest.raises(CancelledError), WorkerPool(workers) as pool:
        pool.do_all([("waiting", job_functions.waiting)] * 3, lambda *_: time.monotonic() < begun + 0.5)
    assert time.monotonic() < begun + 20


def test_a_process_has_what_it_was_to_import_before_its_first_work() -> None:
    for imports in ((), ("kfmocap.core.runtime.output_files.exchange",)):
        process = WorkerProcess(imports=imports)
        try:
            found = process.call(partial(job_functions.has_imported, "kfmocap.core.runtime.output_files.exchange"))
        finally:
            process.close()
        assert found == bool(imports)


@pytest.mark.skipif(sys.platform != "linux", reason="processes cannot be copied")
def test_copies_of_a_process_have_what_it_has_imported_and_end_as_other_workers_do() -> None:
    code = """
import os
from functools import partial

import job_functions
from kfmocap.core.errors import WorkerEndedError
from kfmocap.core.runtime.output_files import exchange
from kfmocap.core.runtime.processes.worker_process import WorkerProcess, can_be_copied

assert can_be_copied()
first, second = (WorkerProcess(tidies=False, copied=True) for _ in range(2))
for process in (first, second):
    assert process.call(job_functions.process_id) == process.id != os.getpid()
    assert process.call(partial(job_functions.has_imported, exchange.__name__))
first.close()  # it ends although the second one, which began later, is still there
assert not first.alive and second.alive
second.kill()
try:
    second.call(job_functions.process_id)
except WorkerEndedError as error:
    assert "signal 9" in str(error)
else:
    raise AssertionError
"""
    folders = [str(Path(job_functions.__file__).parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(folders)}
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60, env=environment)


@pytest.mark.skipif(not hasattr(os, "nice"), reason="there is no niceness")
def test_the_processes_of_a_pool_are_as_important_as_this_one() -> None:
    """All are waited for: one that lets others go first would hold up the rest."""
    with WorkerPool(2) as pool:
        assert {pool.submit(job_functions.niceness, unheard).result() for _ in range(4)} == {os.nice(0)}


def test_processes_that_are_lent_do_no_other_tasks_until_they_are_back() -> None:
    with WorkerPool(3) as pool:
        with pool.lent(5) as processes:
            lent = {process.call(job_functions.process_id) for process in processes}
            assert len(lent) == 2 and os.getpid() not in lent, "all but this process, which does what comes meanwhile"
            assert pool.submit(job_functions.process_id, unheard).result() == os.getpid()
        with pool.lent(1) as processes:
            assert len(processes) == 1
            assert pool.submit(job_functions.process_id, unheard).result() in lent
        assert {pool.submit(job_functions.process_id, unheard).result() for _ in range(3)} <= lent


def test_what_is_lent_of_a_single_worker_is_nothing() -> None:
    with WorkerPool(1) as pool, pool.lent(2) as processes:
        assert not processes
