"""What a worker keeps between jobs: within bounds, and only for work that asks for it."""

from __future__ import annotations

from contextlib import closing

import job_functions
import numpy as np
from kfmocap.core.runtime.processes.job import Job
from kfmocap.core.runtime.processes.worker_memory import CachingTask, WorkerMemory
from kfmocap.core.runtime.processes.worker_process import WorkerProcess


def test_the_pictures_that_were_not_used_for_longest_go_first() -> None:
    memory = WorkerMemory(limit=30)
    for key in "abc":
        memory.keep(key, np.zeros(10, np.uint8))
    assert memory.picture("a") is not None
    memory.keep("d", np.zeros(10, np.uint8))
    assert memory.picture("b") is None and all(memory.picture(key) is not None for key in "acd")


def test_a_picture_larger_than_all_that_is_kept_is_not_kept() -> None:
    memory = WorkerMemory(limit=30)
    memory.keep("a", np.zeros(10, np.uint8))
    memory.keep("b", np.zeros(31, np.uint8))
    assert memory.picture("b") is None and memory.picture("a") is not None


def test_a_value_is_made_once() -> None:
    memory, made = WorkerMemory(), []
    for key in "aab":
        assert memory.value(key, lambda key=key: made.append(key) or key.upper()) == key.upper()
    assert made == ["a", "b"]


def test_a_worker_remembers_from_one_job_to_the_next() -> None:
    worker = WorkerProcess()
    try:
        found = []
        for _ in range(2):
            job = Job(CachingTask(job_functions.counted), worker)
            job._thread.join(30)
            found.append(job.result())
    finally:
        worker.close()
    assert found == [1, 2]
    assert CachingTask(job_functions.counted)(lambda *_: True) == 1  # where there is no worker


def test_processes_that_are_expected_are_those_of_the_pool() -> None:
    with closing(WorkerMemory()) as memory:
        memory.start_workers(2)
        with memory.pool(2) as pool:
            started = pool
        assert memory.workers == 2
        memory.start_workers(2)
        with memory.pool(2) as pool:
            assert pool is started
        with memory.pool(3) as pool:
            assert pool is started and pool.workers == 3
            found = [pool.submit(job_functions.process_id, lambda _: None) for _ in range(12)]
            assert 1 < len({future.result() for future in found}) <= 3
    assert memory.workers == 1 and not any(process.alive for process in started._processes)
