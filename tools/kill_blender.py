"""Kill workers, and Blender itself, while a shot is tracked in Blender's window, and see what they leave.

    python tools/kill_blender.py --shot SHOT.toml --work WORK --workers 50 --blenders 50

It needs the Blender application and Xvfb. If they are in another root file system, `--run` gives the command that runs
a program there; it must see the work folder, with the shot in it, under the same path. `--libraries` names folders with
the package and what it needs. Two seconds after Blender has ended no process of it may be left. The scene must be as it
was where the worker was killed, and open as it was saved where Blender was; if that was while it saved, the version
before is opened.
"""

from __future__ import annotations

import argparse
import os
import random
import shlex
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PATIENCE, STARTING = 2.0, 120.0
"""Seconds in which a worker must be gone, and in which Blender must begin to track, or be gone itself."""
SPAN = 3.0
"""Seconds of tracking in which Blender is killed."""


class Blender:
    """A Blender that tracks, in a session of its own."""

    def __init__(self, args: argparse.Namespace, kills: int, seed: int) -> None:
        self.said = args.work / "said"
        self.said.unlink(missing_ok=True)
        script = args.work / "killed_tracking.py"
        shutil.copy(ROOT / "tools" / "walkthrough" / script.name, script)
        command = [
            *shlex.split(args.run.format(work=args.work)),
            *("xvfb-run", "-a", "-s", "-screen 0 800x600x24", "blender", "--factory-startup"),
            *("--gpu-backend", "opengl", "--window-geometry", "0", "0", "800", "600", "--python", str(script), "--"),
            *(str(args.work), str(args.shot), str(kills), str(seed), os.pathsep.join(map(str, args.libraries))),
        ]
        with (args.work / "log").open("ab") as log:
            self.process = subprocess.Popen(command, start_new_session=True, stdout=log, stderr=log)

    def lines(self) -> list[str]:
        """Return what it said, in whole lines."""
        text = self.said.read_text() if self.said.exists() else ""
        return text.splitlines() if text.endswith("\n") else text.splitlines()[:-1]

    def wait(self, done: Callable[[list[str]], bool], seconds: float) -> list[str]:
        """Wait for what it says.

        Raises
        ------
        TimeoutError
            It does not say that, or has ended.
        """
        until = time.monotonic() + seconds
        while not done(lines := self.lines()):
            if time.monotonic() > until or self.process.poll() is not None:
                raise TimeoutError(f"Blender said {lines}")
            time.sleep(0.01)
        return lines

    def close(self) -> None:
        """End what is left of its session."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()


def gone(process: int, patience: float) -> bool:
    """Whether a process is gone within some seconds."""
    until = time.monotonic() + patience
    while _runs(process):
        if time.monotonic() > until:
            return False
        time.sleep(0.01)
    return True


def _runs(process: int) -> bool:
    """Whether any thread of a process runs: a killed Blender's first one is gone before its files are closed."""
    for stat in Path(f"/proc/{process}/task").glob("*/stat"):
        with suppress(OSError):
            if stat.read_text().rpartition(")")[2].split()[0] != "Z":
                return True
    return False


def kill_workers(args: argparse.Namespace) -> int:
    """Kill workers of one Blender; returns how many faults there were."""
    blender = Blender(args, args.workers, args.seed)
    try:
        lines = blender.wait(lambda said: "done" in said, STARTING + 60.0 * args.workers)
    finally:
        blender.close()
    killed = [line for line in lines if line.startswith("killed")]
    wrong = len([line for line in killed if line != "killed True"]) + ("tracked True" not in lines)
    print(f"{len(killed)} workers were killed: {wrong} faults", flush=True)
    return wrong


def kill_blenders(args: argparse.Namespace) -> int:
    """Kill Blenders; returns how many faults there were."""
    chance, wrong, kept, between = random.Random(args.seed), 0, "", 0
    for k in range(args.blenders + 1):
        between += brought_back(args.work / "scene.blend")
        blender = Blender(args, 0, args.seed)
        try:
            lines = blender.wait(lambda said: any(line.startswith("tracking") for line in said), STARTING)
            how, keys = lines[0].split()
            kept = kept or keys
            if how != ("opened" if k else "made") or keys != kept:
                print(f"Blender {k}: the scene was {how}, its keys are {'as before' if keys == kept else 'others'}")
                wrong += 1
            if k < args.blenders:
                time.sleep(chance.uniform(0, SPAN))
                last = [line for line in blender.lines() if line.startswith("tracking")][-1]
                process, worker = (int(number) for number in last.split()[1:])
                os.kill(process, signal.SIGKILL)
                if not gone(process, STARTING) or not gone(worker, PATIENCE):
                    print(f"Blender {k}: processes live on after {PATIENCE:g} s", flush=True)
                    wrong += 1
        finally:
            blender.close()
    print(f"{args.blenders} Blenders were killed, {between} between two renames: {wrong} faults", flush=True)
    return wrong


def brought_back(scene: Path) -> bool:
    """Take the version before, as a user would, where Blender ended while it saved: it renames the file to `.blend1`,
    and only then the new one, `.blend@`, to the file's name.
    """
    before = scene.with_suffix(".blend1")
    missing = not scene.exists() and before.exists()
    if missing:
        before.rename(scene)
    return missing


def main(argv: Sequence[str] | None = None) -> int:
    """Kill, print what came of it; returns 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shot", type=Path, required=True)
    parser.add_argument("--work", type=Path, required=True, help="folder for the scene")
    parser.add_argument("--workers", type=int, default=2, help="workers to kill (default: 2)")
    parser.add_argument("--blenders", type=int, default=2, help="Blenders to kill (default: 2)")
    parser.add_argument("--seed", type=int, default=0, help="of the moments (default: 0)")
    parser.add_argument("--libraries", type=Path, nargs="*", default=[], help="folders for Blender's sys.path")
    parser.add_argument("--run", default="", help="what runs a program where Blender is; {work} is the work folder")
    args = parser.parse_args(argv)
    wrong = 0
    for count, kill in ((args.workers, kill_workers), (args.blenders, kill_blenders)):
        if count:
            for file in args.work.glob("scene.blend*"):
                file.unlink()
            wrong += kill(args)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
