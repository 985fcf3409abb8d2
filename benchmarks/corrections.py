"""`kfmocap bench --speed`: what tracking again costs once a key pose was corrected, where footage is kept."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from statistics import median

import numpy as np

from ..core.body.motion import Motion
from ..core.runtime.worker_memory import WorkerMemory
from ..core.shot.shot import Shot
from ..core.tracking.prepare import load_shot
from ..core.tracking.retracking import Excerpt, track_excerpts
from ..core.tracking.run_context import RunContext
from .tables import markdown

MOVED, TURNED = 0.01, 0.03
"""How far the key pose was off, metres, and each of its joints, radians."""


@dataclass(frozen=True)
class Correction:
    """What is tracked.

    Attributes
    ----------
    what : str
    key : int or None
        The key frame whose pose was off; None tracks the whole shot.
    seconds : float
        Median.
    """

    what: str
    key: int | None
    seconds: float


def measure_corrections(folder: Path, *, repeat: int, threads: int | None = None) -> str:
    """Track an example, put key poses right that were off, and track the segments beside them; returns a table.

    Footage and processes are kept, as they are while Blender is open, and the motion that was there is begun with.
    What Blender takes to make curves of it is not measured.

    Parameters
    ----------
    folder : Path
    repeat : int
        Runs of each; the medians count.
    threads : int, optional
        Cores; by default all.
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
            excerpt = beside(shot, key, wrong.motions, wrong.footage_offset)
            taken(what, key, lambda excerpt=excerpt: track_excerpts(shot, [excerpt], run=run))
    return table(found)


def with_key_moved(shot: Shot, key: int) -> Shot:
    """The shot with one key pose of its first performer moved by `MOVED` and turned by `TURNED`."""
    performer, *others = shot.performers
    poses, rng = performer.key_poses.poses, np.random.default_rng(key)
    step = np.zeros((len(poses), performer.body.dof))
    ways = rng.normal(size=(performer.body.dof // 3, 3))
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    step[performer.key_poses.frames == key] = np.concatenate([MOVED * ways[0], TURNED * ways[1:].ravel()])
    keyed = replace(performer.key_poses, poses=poses.moved(step))
    return replace(shot, performers=(replace(performer, key_poses=keyed), *others))


def beside(shot: Shot, key: int, motions: Sequence[Motion], offset: float | None) -> Excerpt:
    """The segments on both sides of a key pose, with what was tracked there and beside them, and the offset."""
    keys = shot.performers[0].key_poses.frames.tolist()
    ends = [end for pair in pairwise(keys) if key in pair for end in pair]
    first, last = min(ends), max(ends)

    def pose(frame: int) -> tuple[Motion, ...] | None:
        return tuple(m[[frame]] for m in motions) if 0 <= frame < shot.length else None

    earlier = tuple(m[first : last + 1] for m in motions)
    return Excerpt(first, last, (pose(first - 1), pose(last + 1)), offset, earlier)


def table(found: list[Correction]) -> str:
    """What each took, and its share of tracking all."""
    whole = next(one.seconds for one in found if one.key is None and one.what == "all")
    cells = [
        [one.what, "-" if one.key is None else str(one.key), f"{one.seconds:.2f}", f"{one.seconds / whole:.0%}"]
        for one in found
    ]
    return markdown(["tracked", "key pose corrected", "seconds", "of all"], cells)
