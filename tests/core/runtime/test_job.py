"""A job's process ends with the program that waits for it, however that ends and whatever the job does."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT

PARENT = """
import sys, time
from functools import partial
from pathlib import Path
import job_functions
from kfmocap.core.runtime.job import Job
job = Job(partial(getattr(job_functions, sys.argv[1]), Path(sys.argv[2])))
time.sleep(60)
"""


def is_alive(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.skipif(sys.platform != "linux", reason="looks into /proc")
@pytest.mark.parametrize("work", ["silent", "busy", "stubborn"])
def test_a_worker_ends_within_two_seconds_of_its_program(tmp_path: Path, work: str) -> None:
    path = os.pathsep.join([str(ROOT / "tests" / "support"), *sys.path])
    command = [sys.executable, "-c", PARENT, work, str(tmp_path / "pid")]
    with subprocess.Popen(command, env={**os.environ, "PYTHONPATH": path}) as parent:
        limit = time.monotonic() + 30
        while not (tmp_path / "pid").exists() or not (tmp_path / "pid").read_text():
            assert time.monotonic() < limit
            time.sleep(0.02)
        parent.kill()
    worker, killed = int((tmp_path / "pid").read_text()), time.monotonic()
    while is_alive(worker):
        assert time.monotonic() < killed + 2
        time.sleep(0.02)
