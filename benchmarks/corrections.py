"""`kfmocap bench --speed`: the time of tracking again after a key pose was corrected, with the footage in the cache."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import median

import numpy as np

from ..core.runtime.processes.worker_memory import WorkerMemory
from ..core.shot.shot import Shot
from ..core.tracking.prepare import load_shot
from ..core.tracking.retracking import Excerpt, excerpt_at, track_excerpts
from ..core.tracking.scheduling.run_context import RunContext
from .tables import markdown

MOVED, TURNED = 0.01, 0.03
"""Errors of the key pose before its correction: of its position, metres, and of each joint, radians."""


@dataclass(frozen=True)
class Correction:
    """A measured correction.

    Attributes
    ----------
    what : str
        Description, for the table.
    key : int or None
        The key frame whose pose was wrong; None if the whole shot was tracked.
    seconds : float
        Median time.
    """

    what: str
    key: int | None
    seconds: float


def measure_corrections(folder: Path, *, repeat: int, threads: int | None = None) -> str:
    """Track an example, correct wrong key poses, and track the segments next to them again; returns a table.

    As while Blender is open, footage and processes are kept, and tracking starts from the earlier motion. The time that
    Blender takes to make curves of the result is not included.

    Parameters
    ----------
    folder : Path
        The example's.
    repeat : int
        Number of runs, of which medians are taken.
    threads : int, optional
        Number of cores; by default all.
    """
    shot = load_shot(folder / "shot.toml")
    shot = replace(shot, settings=replace(shot.settings, threads=threads))
    keys = shot.performers[0].key_poses.frames.tolist()
    found = []
    with closing(WorkerMemory()) as memory:
        run = RunContext(memory=memory)

        def taken(what: str, key: int | None, work: Callable[[], object], count: int = repeat) -> None:
            times = []
            for _ in range(count):
                begin = time.perf_counter()
                work()
                times.append(time.perf_counter() - begin)
            found.append(Correction(what, key, median(times)))
            print(f"kfmocap bench: {what}: {found[-1].seconds:.2f} s", file=sys.stderr, flush=True)

        everything = [Excerpt(0, shot.length - 1)]
        taken("all, footage not read yet", None, lambda: track_excerpts(shot, everything, run=run), 1)
        taken("all", None, lambda: track_excerpts(shot, everything, run=run))
        for what, key in (("two segments", keys[len(keys) // 2]), ("one at an end", keys[0])):
            [wrong] = track_excerpts(with_key_moved(shot, key), everything, run=run)
            excerpt = excerpt_at(shot, key, wrong.motions, wrong.footage_offset)
            taken(what, key, lambda excerpt=excerpt: track_excerpts(shot, [excerpt], run=run))
    return table(found)


def with_key_moved(shot: Shot, key: int) -> Shot:
    """Return the shot with one key pose of its first performer moved by `MOVED` and turned by `TURNED`."""
    performer, *others = shot.performers
    poses, rng = performer.key_poses.poses, np.random.default_rng(key)
    step = np.zeros((len(poses), performer.body.dof))
    ways = rng.normal(size=(performer.body.dof // 3, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    step[performer.key_poses.frames == key] = np.concatenate([MOVED * ways[0], TURNED * ways[1:].ravel()])
    keyed = replace(performer.key_poses, poses=poses.moved(step))
    return replace(shot, performers=(replace(performer, key_poses=keyed), *others))


def table(found: list[Correction]) -> str:
    """Return a table of the times, absolute and relative to tracking the whole shot."""
    whole = next(one.seconds for one in found if one.key is None and one.what == "all")
    cells = [
        [one.what, "-" if one.key is None else str(one.key), f"{one.seconds:.2f}", f"{one.seconds / whole:.0%}"]
        for one in found
    ]
    return markdown(["tracked", "key pose corrected", "seconds", "of all"], cells)
