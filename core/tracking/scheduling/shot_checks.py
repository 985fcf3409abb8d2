"""Checks of a shot and its footage before it is tracked."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager

from ...errors import ShotError
from ...runtime.threads import worker_count
from ...shot.footage_faults.footage_checks import check_view
from ...shot.footage_faults.footage_times import FootageRate
from ...shot.shot import Shot
from ..footage_reading.reader import is_kept, kept_rate
from ..solvers.registry import solver_named
from .run_context import RunContext
from .shot_values import check_values


def check_shot(shot: Shot, *, motion_known: bool = False) -> None:
    """Check that a shot can be tracked.

    Parameters
    ----------
    shot : Shot
    motion_known : bool
        Whether performers are known to be somewhere without a key pose, in an excerpt: by poses on the frames beside
        it, or by their earlier motion.

    Raises
    ------
    ShotError
    """
    if shot.length < 2:
        raise ShotError("a shot of one frame has nothing to track", where="[shot] frames")
    check_values(shot)
    solver = solver_named(shot.settings.solver)
    if shot.holds and not solver.uses_holds:
        what = f"the solver {shot.settings.solver} does not support holds"
        raise ShotError(what, where=shot.holds[0].place, todo="use the solver gauss-newton, or remove the hold")
    for performer in shot.performers:
        if not (motion_known or len(performer.key_poses.frames)):
            raise ShotError(
                "there is no key pose on the shot's frames",
                where=f"performer {performer.name}",
                todo="set one to begin with",
            )


@contextmanager
def footage_checked(shot: Shot, run: RunContext) -> Iterator[list[Future[FootageRate | None]]]:
    """Check, while the block runs, that all footage fits the shot, except what is known to.

    Yields
    ------
    list of Future
        The frame rate of each view, available once the block has ended.

    Raises
    ------
    FootageError
    """
    unchecked = [
        view
        for view in shot.views
        if not (run.footage_checked or (run.memory is not None and is_kept(shot, view, run.memory)))
    ]
    with ThreadPoolExecutor(worker_count(shot.settings.threads)) as pool:
        checked = [pool.submit(check_view, view, shot.frames[0], shot.length, shot.fps) for view in unchecked]
        yield [pool.submit(kept_rate, shot, view, run.memory) for view in shot.views]
        for check in checked:
            check.result()
