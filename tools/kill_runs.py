"""End runs of a command at random moments, and see that results are all old or all new and that nothing stays behind.

    .venv/bin/python tools/kill_runs.py --kills 200 track examples/walk/shot.toml --out OUT --no-blender
    .venv/bin/python tools/kill_runs.py --kills 200 calibrate wand.toml --out OUT/cameras.toml --report OUT/report
    .venv/bin/python tools/kill_runs.py --kills 200 --apart batch shots/*.toml --out OUT --no-blender

OUT in the arguments stands for a folder that is made for each run. Each run is forked from a process that has loaded
everything, begins with old results in its folder, and gets SIGKILL, SIGTERM or SIGINT. Its processes must be gone in
two seconds, its exit code and its message must say what it left, and what a SIGKILL leaves must be gone as soon as the
next run begins and ends; every tenth time that is a run of the command itself. Runs that ended before the signal came
do not count; where most do, it fails. With --fork the processes that a run starts are forked as well: what they load
takes longer than a short shot.
"""

from __future__ import annotations

import argparse
import os
import random
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from contextlib import AbstractContextManager, ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

from kfmocap.__main__ import main as run_command
from kfmocap.cli import batch_command, calibrate_command, track_command  # noqa: F401  loaded once, for all runs
from kfmocap.cli.batch_outcome import STATUS
from kfmocap.core.runtime.interrupts import WRITTEN_NOTE
from kfmocap.core.runtime.output_files.files import check_writable
from kfmocap.core.runtime.processes import worker, worker_process
from kfmocap.core.tracking.results.journal import JOURNAL_SUFFIX, journal_beside

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
OLD = "old"
PATIENCE = 2.0
"""Seconds after which no process of a run may be left."""
MOST_RUNS = 20
"""Runs for each that is to be hit, at most."""
HANGING = 120.0
"""Seconds from a signal to the end of a run, at most."""
_MOST_FILES = 256
"""Numbers of open files, at most."""


@dataclass(frozen=True)
class Ended:
    """A run that has ended: its exit code, its session, what it printed on standard error, and how long it took."""

    code: int
    session: int
    text: str
    seconds: float

    @property
    def said(self) -> str:
        """The last line of it."""
        return (self.text.splitlines() or [""])[-1]


def run(
    arguments: Sequence[str],
    out: Path,
    number: int | None = None,
    after: float = 0.0,
    *,
    temporary: Path | None = None,
) -> Ended:
    """Run a command in a session of its own, which gets a signal after some seconds.

    Parameters
    ----------
    arguments : sequence of str
    out : Path
        What OUT in the arguments stands for.
    number : int, optional
        The signal.
    after : float
        Seconds from the start; a run that ends sooner is not waited for any longer.
    temporary : Path, optional
        Where the run keeps temporary files.
    """
    messages, name = tempfile.mkstemp()
    ready, begun = os.pipe()
    process = os.fork()
    if process == 0:
        os.setsid()
        # A program in a shell's background ignores SIGINT, and so would all runs.
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(messages, 2)
        if temporary is not None:
            os.environ["TMPDIR"] = tempfile.tempdir = str(temporary)
        os.write(begun, b"!")
        code = 1
        try:
            code = run_command([argument.replace("OUT", str(out)) for argument in arguments])
        except KeyboardInterrupt:  # before the command handles it: Python ends by the signal then
            signal.signal(signal.SIGINT, signal.SIG_DFL)
            os.kill(os.getpid(), signal.SIGINT)
        finally:
            os._exit(code)
    os.close(begun)
    os.read(ready, 1)
    started = time.monotonic()
    # From now on the pipe is silent, and closed when the process ends.
    if number is not None and not select.select([ready], [], [], after)[0]:
        os.kill(process, number)  # until it is waited for its id is its own
        if not select.select([ready], [], [], HANGING)[0]:
            os.kill(process, signal.SIGKILL)
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    seconds = time.monotonic() - started
    os.close(ready)
    os.close(messages)
    text = Path(name).read_text(errors="replace")
    Path(name).unlink()
    return Ended(code, process, text, seconds)


def _work() -> None:
    """Do a worker's work in a process that was forked for it, and does not go on to start a program."""
    code = 1
    try:
        # The other workers' pipes; with the last of these the program is told that it runs.
        os.closerange(3, _MOST_FILES)
        worker.main()
        code = 0
    finally:
        os._exit(code)


def forked_workers() -> AbstractContextManager[object]:
    """While it is entered, workers are forked instead of started."""

    def popen(*arguments: Any, **options: Any) -> subprocess.Popen[bytes]:
        return subprocess.Popen(*arguments, **options, preexec_fn=_work)  # noqa: PLW1509  the threads wait

    return mock.patch.object(worker_process, "subprocess", SimpleNamespace(**vars(subprocess) | {"Popen": popen}))


def left(session: int) -> int:
    """Return how many processes of a session are still there after `PATIENCE`, or sooner when there are none.

    A process whose first thread has ended is a zombie already, but holds its files until the last one has.
    """
    until, count = time.monotonic() + PATIENCE, 1
    while count and time.monotonic() < until:
        count = 0
        for stat in Path("/proc").glob("[0-9]*/stat"):
            with suppress(OSError):  # it ended meanwhile
                fields = stat.read_text().rpartition(")")[2].split()
                state, its_session, threads = fields[0], int(fields[3]), int(fields[17])
                count += its_session == session and (state != "Z" or threads > 1)
        time.sleep(0.02 if count else 0)
    return count


def contents(out: Path) -> dict[Path, bytes]:
    """Return the results of a run."""
    return {file.relative_to(out): file.read_bytes() for file in out.rglob("*") if file.is_file()}


def untrue(ended: Ended, number: int, found: str, *, apart: bool) -> list[str]:
    """Return what a run that ended by a signal says and does not hold: its exit code, and what it wrote."""
    codes = {signal.SIGKILL: -signal.SIGKILL, signal.SIGTERM: 143, signal.SIGINT: 130}
    if ended.code == 0:
        return [] if found == "new" else [f"exit code 0 with {found} results"]
    if ended.code == -signal.SIGKILL != -number:
        return [f"it went on for {HANGING:g} s"]
    if ended.code == -number:  # the command had not begun to handle it, or was done
        return []
    if ended.code != codes[signal.Signals(number)]:
        return [f"exit code {ended.code}: {ended.said}"]
    if number == signal.SIGKILL or apart:
        return []
    said = {"old": "nothing was written", "new": WRITTEN_NOTE}.get(found, "")
    return [] if said in ended.said else [f"'{ended.said}' with {found} results"]


def faults_of(out: Path, names: Sequence[Path], number: int, *, apart: bool) -> tuple[str, list[str]]:
    """Say which results a run left, and what is wrong with that.

    With `apart` each folder of results is by itself, and may have a journal from which the next run goes on.
    """
    faults = []
    if number != signal.SIGKILL and list(out.parent.rglob(".kfmocap-*")):
        faults.append("it left temporary files")
    # In a batch each shot has its folder and its state.
    groups = {name: name if name.parent.name == STATUS else name.parent for name in names}
    folders = sorted({out / name.parent for name in names})
    if number != signal.SIGKILL and not apart and list(out.parent.rglob(f"*{JOURNAL_SUFFIX}")):
        faults.append("it left a journal")
    for folder in folders:  # as the next run begins and ends
        check_writable(folder)
        with journal_beside(folder, resume=apart):
            pass
    if stay := [*out.parent.rglob(".kfmocap-*"), *out.parent.rglob(f"*{JOURNAL_SUFFIX}")]:
        faults.append(f"{', '.join(entry.name for entry in stay)} stayed after the next run")
    found = contents(out)
    kinds: dict[Path, set[str]] = {}
    for name in names:
        kinds.setdefault(groups[name] if apart else Path(), set()).add(OLD if found[name] == OLD.encode() else "new")
    faults += [f"results in '{group}' are mixed" for group, kind in kinds.items() if len(kind) > 1]
    return "/".join(sorted(set().union(*kinds.values()))), faults


def faults_of_the_next(command: Sequence[str], out: Path, names: Sequence[Path]) -> list[str]:
    """Return what is wrong once a run has ended of itself where another one was killed."""
    ended = run(command, out)
    if ended.code:
        return [f"the next run ends with code {ended.code}: {ended.said}"]
    stay = [entry.name for entry in out.parent.rglob("*") if entry.name.startswith(".kfmocap-")]
    found = contents(out)
    old = [str(name) for name in names if found.get(name) in (None, OLD.encode())]
    return [f"{', '.join(fault)} after the next run" for fault in (stay, old) if fault]


class Trials:
    """Runs of a command that are ended at random moments.

    Parameters
    ----------
    command : sequence of str
    folder : Path
        Where the runs write, each into a folder of its own.
    apart : bool
        Each folder of results is by itself, as in a batch.
    seed : int
        Of the moments.

    Attributes
    ----------
    outcomes : Counter
        How many runs ended so, by signal, exit code and results.
    faults : int
        What runs left that they should not, so far.

    Raises
    ------
    RuntimeError
        The command fails by itself.
    """

    def __init__(self, command: Sequence[str], folder: Path, *, apart: bool, seed: int) -> None:
        self.outcomes: Counter[tuple[str, int, str]] = Counter()
        self.faults = 0
        self._command, self._folder, self._apart, self._chance = command, folder, apart, random.Random(seed)
        for kind in ("first", "second"):  # the second, as all others, with files that the system knows
            out = folder / kind / "out"
            out.mkdir(parents=True)  # a batch would find its results there already
            ended = run(command, out)
            if ended.code:
                raise RuntimeError(f"the command fails by itself: {ended.said}")
        self._seconds, self._names = ended.seconds, sorted(contents(out))

    def hit(self, number: signal.Signals, wanted: int) -> None:
        """End so many runs by a signal.

        Raises
        ------
        RuntimeError
            Most runs end before it comes.
        """
        hits = k = 0
        while hits < wanted:
            if k == MOST_RUNS * wanted:
                raise RuntimeError(f"only {hits} of {k} runs were ended by {number.name}")
            k += 1
            hits += self._run(number, k, with_next=number == signal.SIGKILL and hits % 10 == 0)

    def _run(self, number: signal.Signals, k: int, *, with_next: bool) -> bool:
        """One run, and with the next one after another that was ended; returns whether the signal ended it."""
        out = self._folder / f"{number.name}{k}" / "out"
        if k % 2:
            (out / "folder").mkdir(parents=True)  # files are moved one by one then
        for file in self._names:
            (out / file).parent.mkdir(parents=True, exist_ok=True)
            (out / file).write_text(OLD)
        ended = run(self._command, out, number, self._chance.uniform(0, self._seconds))
        if ended.code == 0:  # how long a run takes changes with what else the machine does
            self._seconds = ended.seconds
        processes = left(ended.session)
        found, faults = faults_of(out, self._names, number, apart=self._apart)
        faults += untrue(ended, number, found, apart=self._apart)
        if with_next:
            run(self._command, out, number, self._chance.uniform(0, self._seconds))
            faults += faults_of_the_next(self._command, out, self._names)
        faults += [f"{processes} processes live on after {PATIENCE:g} s"] if processes else []
        self.outcomes[number.name, ended.code, found] += 1
        self.faults += len(faults)
        for fault in faults:
            print(f"{number.name} {k}: {fault}", flush=True)
        shutil.rmtree(out.parent)
        return ended.code != 0


def parser() -> argparse.ArgumentParser:
    """Return the tool's arguments."""
    out = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    out.add_argument("--kills", type=int, default=10, help="runs that get each of the signals (default: 10)")
    out.add_argument("--apart", action="store_true", help="each folder of results is by itself, as in a batch")
    every = ",".join(number.name for number in SIGNALS)
    out.add_argument(
        "--signals",
        default=every,
        metavar="NAMES",
        help="which of them; SIGINT=5 for another number of runs (default: %(default)s)",
    )
    out.add_argument("--fork", action="store_true", help="fork the processes that a run starts")
    out.add_argument("--seed", type=int, default=0, help="of the moments (default: 0)")
    out.add_argument("command", nargs=argparse.REMAINDER, metavar="...", help="a command that writes into OUT")
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Kill runs, print what came of them; returns 1 if any left what it should not."""
    args = parser().parse_args(argv)
    with ExitStack() as stack:
        folder = stack.enter_context(tempfile.TemporaryDirectory())
        if args.fork:
            stack.enter_context(forked_workers())
        try:
            trials = Trials(args.command, Path(folder), apart=args.apart, seed=args.seed)
            for name, _, kills in (text.partition("=") for text in args.signals.split(",")):
                trials.hit(signal.Signals[name], int(kills or args.kills))
        except RuntimeError as error:
            print(error, file=sys.stderr)
            return 1
    for (name, code, found), count in sorted(trials.outcomes.items()):
        print(f"{name}: {count} runs with exit code {code} and {found} results")
    return 1 if trials.faults else 0


if __name__ == "__main__":
    sys.exit(main())
