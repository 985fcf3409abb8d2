"""End runs of a command at random moments, and see that results are all old or all new and that nothing stays behind.

    PYTHONPATH=.pkg python tools/kill_runs.py --kills 200 track examples/walk/shot.toml --no-blender

Each run is forked from a process that has loaded everything, begins with old results in its folder, and gets SIGKILL,
SIGTERM or SIGINT. What a SIGKILL leaves must be gone after the next run into the folder.
"""

from __future__ import annotations

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from kfmocap.__main__ import main as run_command
from kfmocap.cli import calibrate_command, track_command  # noqa: F401  loaded once, for all runs
from kfmocap.core.runtime.files import check_writable

SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
OLD = "old"


def run(arguments: Sequence[str], number: int | None = None, after: float = 0.0) -> int:
    """Run a command in a process of its own, which gets a signal after some seconds; returns its exit code."""
    process = os.fork()
    if process == 0:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        os.dup2(1, 2)
        code = 1
        try:
            code = run_command(arguments)
        finally:
            os._exit(code)
    if number is not None:
        time.sleep(after)
        os.kill(process, number)  # until it is waited for its id is its own
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def faults_of(base: Path, names: Sequence[str], number: int) -> tuple[str, list[str]]:
    """Say which results a run left, and what is wrong with that."""
    out, faults = base / "out", []
    if number != signal.SIGKILL and list(base.rglob(".kfmocap-*")):
        faults.append("it left temporary files")
    check_writable(out)
    if list(base.rglob(".kfmocap-*")):
        faults.append("temporary files stayed after the next run")
    kinds = {OLD if (out / name).read_bytes() == OLD.encode() else "new" for name in names}
    if len(kinds) > 1:
        faults.append("results are mixed")
    return "/".join(sorted(kinds)), faults


def main(argv: Sequence[str] | None = None) -> int:
    """Kill runs, print what came of them; returns 1 if any left what it should not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=10, help="runs that get each of the signals (default: 10)")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="a command that takes --out DIR, without that")
    args = parser.parse_args(argv)
    chance, outcomes, wrong = random.Random(0), Counter(), 0
    with tempfile.TemporaryDirectory() as folder:
        begun = time.monotonic()
        if run([*args.command, "--out", f"{folder}/first/out"]):
            print("the command fails by itself", file=sys.stderr)
            return 1
        seconds, names = time.monotonic() - begun, sorted(p.name for p in Path(folder, "first", "out").iterdir())
        for number in SIGNALS:
            for k in range(args.kills):
                base = Path(folder, f"{number.name}{k}")
                (base / "out").mkdir(parents=True)
                if k % 2:
                    (base / "out" / "folder").mkdir()  # files are moved one by one then
                for name in names:
                    (base / "out" / name).write_text(OLD)
                code = run([*args.command, "--out", str(base / "out")], number, chance.uniform(0, 1.1 * seconds))
                found, faults = faults_of(base, names, number)
                outcomes[number.name, code, found] += 1
                wrong += len(faults)
                for fault in faults:
                    print(f"{number.name} {k}: {fault}")
                shutil.rmtree(base)
    for (name, code, found), count in sorted(outcomes.items()):
        print(f"{name}: {count} runs with exit code {code} and {found} results")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
