"""`kfmocap batch`: track many shots, each in its own process, and summarise them in one table."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..core.errors import InputError, KFMocapError, ShotError, WorkerEndedError
from ..core.runtime.output_files.files import check_writable
from ..core.runtime.processes.job import Job
from ..core.runtime.threads import worker_count
from ..core.shot.settings import check_solver
from .batch_display import BatchDisplay
from .batch_outcome import ShotOutcome, ShotState, outcomes
from .batch_selection import BatchShot, chosen_shots
from .batch_shot import BatchOptions, shot_digest, track_shot
from .batch_summary import write_summary
from .printed import print_outcome
from .services import Services

BAD_INPUT, FAULT = 2, 1
"""Exit codes: trying again does not help, or may help."""
ATTEMPTS = 3
"""Number of times that a shot is tried if its process is ended from outside."""
_POLL = 0.1


def run(args: argparse.Namespace, services: Services) -> int:
    """Run the command; returns the exit code: 0, `FAULT` if trying again may help, or `BAD_INPUT`."""
    try:
        shots = [] if args.summary else chosen_shots(args.shots, args.task)
        options = _options(args, services)
        check_writable(args.out)
    except InputError as error:
        print(f"kfmocap: error: {' '.join(str(error).split())}", file=sys.stderr)
        return BAD_INPUT
    found = run_batch(shots, args.out, options, jobs=args.jobs) if shots else []
    files = write_summary(args.out, outcomes(args.out))
    print_outcome(files, [_balance(found)] if found else [])
    return _exit_code({outcome.state for outcome in found})


def _exit_code(states: Collection[str]) -> int:
    if ShotState.FAILED in states:
        return FAULT
    return BAD_INPUT if ShotState.REFUSED in states else 0


def _balance(found: Sequence[ShotOutcome]) -> str:
    """Return how many shots are done, and the names of the others by what became of them."""
    by_state = {state: sorted(o.name for o in found if o.state == state) for state in ShotState}
    done = f"{len(by_state.pop(ShotState.DONE))} of {len(found)} shots done"
    return "; ".join([done, *(f"{state}: {', '.join(names)}" for state, names in by_state.items() if names)])


def _options(args: argparse.Namespace, services: Services) -> BatchOptions:
    if args.jobs is not None and args.jobs < 1:
        raise ShotError(f"it is {args.jobs}", where="--jobs", todo="give 1 or more")
    if args.solver is not None:
        check_solver(args.solver, where="--solver")
    if services.in_blender and not args.no_blender:
        todo = "leave them out with --no-blender, or run the program outside Blender"
        raise ShotError("the processes of a batch cannot write Blender's files from inside it", todo=todo)
    if not args.no_blender:
        services.blender()
    jobs = args.jobs or default_jobs()
    return BatchOptions(args.solver, None if args.no_blender else services.load_blender, max(1, worker_count() // jobs))


def default_jobs() -> int:
    """Return the number of shots tracked in parallel; each keeps about two cores busy."""
    return max(1, worker_count() // 2)


def run_batch(
    shots: Sequence[BatchShot], out: Path, options: BatchOptions, *, jobs: int | None = None
) -> list[ShotOutcome]:
    """Track shots, each into a folder with its name, except those that were done before and have not changed.

    A shot that fails, or whose process is killed, does not affect the others.

    Parameters
    ----------
    shots : sequence of BatchShot
    out : Path
    options : BatchOptions
    jobs : int, optional
        Number of shots tracked in parallel.

    Returns
    -------
    list of ShotOutcome
        One per shot, in no particular order.
    """
    with BatchDisplay(len(shots)) as display:
        batch = _Batch(out, options, display)
        for shot in shots:
            batch.take(shot)
        try:
            while batch.waiting or batch.running:
                while batch.waiting and len(batch.running) < (jobs or default_jobs()):
                    batch.start()
                time.sleep(_POLL)
                batch.collect()
        except KeyboardInterrupt as interrupt:
            done = f"{len(batch.found)} of {len(shots)} shots are done"
            interrupt.add_note(f"{done}; the same command does the rest")
            raise
        finally:
            for each in batch.running:
                each.job.end()
    return batch.found


@dataclass
class _Running:
    """A shot that is being tracked, `attempt` of `ATTEMPTS`."""

    shot: BatchShot
    digest: str
    attempt: int
    job: Job


class _Batch:
    """Shots that wait, as (shot, digest, attempt), those that are being tracked, and the outcomes of the others."""

    def __init__(self, out: Path, options: BatchOptions, display: BatchDisplay) -> None:
        self.out, self.options, self.display = out, options, display
        self.before = {outcome.name: outcome for outcome in outcomes(out)}
        self.waiting: list[tuple[BatchShot, str, int]] = []
        self.running: list[_Running] = []
        self.found: list[ShotOutcome] = []

    def take(self, shot: BatchShot) -> None:
        """Queue a shot, or close it if it needs no tracking."""
        try:
            if shot.error is not None:
                raise shot.error
            digest = shot_digest(shot.file, self.options)
        except KFMocapError as error:
            self._close(ShotOutcome(shot.name, str(shot.file), ShotState.REFUSED, message=_one_line(error)))
            return
        known = self.before.get(shot.name)
        if known is not None and (known.state, known.digest) == (ShotState.DONE, digest) and self._has_results(shot):
            self.found.append(known)
            self.display.skipped(known)
        else:
            self.waiting.append((shot, digest, 1))

    def start(self) -> None:
        """Start tracking the next shot."""
        shot, digest, attempt = self.waiting.pop(0)
        job = Job(partial(track_shot, shot.file.absolute(), (self.out / shot.name).absolute(), self.options))
        self.running.append(_Running(shot, digest, attempt, job))
        self.display.started(shot.name, job.process_id)

    def collect(self) -> None:
        """Show the progress of the running shots, and close those that are done."""
        self.display.update({each.shot.name: each.job.state for each in self.running})
        for each in [each for each in self.running if each.job.done]:
            self.running.remove(each)
            outcome = _outcome(each)
            if outcome is None:
                self.waiting.append((each.shot, each.digest, each.attempt + 1))
                self.display.print_line(f"{each.shot.name}: its process was ended from outside; it is tried again")
            else:
                self._close(outcome)

    def _close(self, outcome: ShotOutcome) -> None:
        outcome.write(self.out)
        self.found.append(outcome)
        self.display.finished(outcome)

    def _has_results(self, shot: BatchShot) -> bool:
        return (self.out / shot.name / "report.json").is_file()


def _outcome(each: _Running) -> ShotOutcome | None:
    """Return a shot's outcome; None if its process was ended from outside and it is to be tried again."""
    kept = each.shot.name, str(each.shot.file)
    try:
        return ShotOutcome(*kept, ShotState.DONE, each.digest, **each.job.result())
    except WorkerEndedError as error:
        if each.attempt < ATTEMPTS:
            return None
        return ShotOutcome(*kept, ShotState.FAILED, message=_one_line(error))
    except InputError as error:
        return ShotOutcome(*kept, ShotState.REFUSED, message=_one_line(error))
    except Exception as error:
        text = _one_line(error) if isinstance(error, KFMocapError) else f"{type(error).__name__}: {_one_line(error)}"
        return ShotOutcome(*kept, ShotState.FAILED, message=text)


def _one_line(error: Exception) -> str:
    return " ".join(str(error).split())
