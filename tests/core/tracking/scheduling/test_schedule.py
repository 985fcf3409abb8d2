"""Segments are handed to workers as soon as these are free."""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kfmocap.core.shot.segments import segments
from kfmocap.core.tracking.results.journal import KeptSegments
from kfmocap.core.tracking.scheduling import schedule
from kfmocap.core.tracking.scheduling.schedule import ScheduleStart, SegmentSchedule, SegmentWorkers
from kfmocap.core.tracking.track_state import TrackState
from synthetic import CAMERAS, figure, film, shot_of, swing

BODY, LENGTH = figure(), 13
TRUTH = swing(BODY, LENGTH)


class Pool:
    """Two workers that are threads."""

    workers = 2

    def __init__(self) -> None:
        self._threads = ThreadPoolExecutor(self.workers)

    def submit(self, work: Any, _progress: object) -> Future[Any]:
        return self._threads.submit(work)


def test_while_one_worker_searches_for_a_limb_the_other_goes_on_with_the_segments_behind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shot = shot_of(film(tmp_path, [BODY], [TRUTH], CAMERAS), [BODY], [TRUTH], range(0, LENGTH, 2))
    chosen, others_solved, waited = segments(shot), Event(), list[bool]()
    solved: list[int] = []

    def solve(task: Any, *_: object, **__: object) -> Any:
        first, last = task.segment
        if first == 0:
            waited.append(others_solved.wait(5.0))
        solved.append(first)
        if len(solved) == len(chosen) - 1:
            others_solved.set()
        part = SimpleNamespace(motions=(TRUTH[first : last + 1],))
        return SimpleNamespace(solution=part, offset=None, seconds={}, finished=None, shape=None)

    def refine(task: Any, *_: object, **__: object) -> Any:
        first, last = task.segment
        finished = SimpleNamespace(segment=task.segment, motions=(TRUTH[first : last + 1],))
        return SimpleNamespace(finished=finished, seconds={})

    monkeypatch.setattr(schedule, "solve_task", solve)
    monkeypatch.setattr(schedule, "refine_task", refine)
    pool: Any = Pool()
    kept = KeptSegments.of(None, shot, (None, None))
    work = SegmentSchedule(shot, ScheduleStart(TrackState((TRUTH,))), SegmentWorkers(pool), kept)
    for _ in chosen:
        work.add(())
    state, done = work.finish()
    assert waited == [True]
    assert [one.segment for one in done] == chosen
    np.testing.assert_array_equal(state.motions[0].rotations, TRUTH.rotations)
