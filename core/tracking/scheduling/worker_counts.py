"""How many processes solve the segments of a shot."""

from __future__ import annotations

from collections.abc import Sequence

from ...runtime.threads import worker_count
from ...shot.segments import segments
from ...shot.shot import Shot
from ...shot.shot_spec import ShotSpec
from .segment_tasks import solve_task

MIN_PARALLEL_WORK = 80
"""Frames x views x performers from which segments are solved in several processes: about a second of work, which is
twice what it takes to start one."""
WORKER_MODULES = (solve_task.__module__,)
"""Modules that these processes import while the first footage is decoded."""


def workers_of(shot: Shot, threads: int) -> int:
    """Return how many segments are solved at a time; starting a process takes as long as solving a small shot."""
    return min(threads, len(segments(shot))) if _enough_work(shot.length, shot.views, shot.performers) else 1


def workers_for(spec: ShotSpec) -> int:
    """Return how many workers the shot of a shot file will have; 1 if the shot file alone does not determine it."""
    first, last = spec.frames
    keyed = spec.named_keyframes
    if not keyed or not _enough_work(last + 1 - first, spec.views, spec.performers):
        return 1
    cuts = {first, last}.union(set.intersection(*map(set, keyed)))
    return min(worker_count(spec.settings.threads), len(cuts) - 1)


def _enough_work(frames: int, views: Sequence[object], performers: Sequence[object]) -> bool:
    """Whether there is enough work for several processes."""
    return frames * len(views) * len(performers) >= MIN_PARALLEL_WORK
