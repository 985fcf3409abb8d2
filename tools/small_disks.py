"""Run a command on disks that are too small for it, and see that it never passes for done with a damaged file.

    .venv/bin/python tools/small_disks.py --sizes 1:50:1 track examples/walk/shot.toml --out OUT
    .venv/bin/python tools/small_disks.py --sizes 0.1:2:0.1 calibrate wand.toml --out OUT/cameras.toml
    .venv/bin/python tools/small_disks.py --sizes 1:50:1 --apart batch shots/*.toml --out OUT

OUT in the arguments stands for a folder on the disk, a tmpfs of so many MB, which only root can mount. Every other disk
is the one for temporary files as well, and on half of them there are old results. A run must end with code 0 and the
files that it writes where there is room, or with an error that names a path on the disk and says that it is full, old
files as they were and no temporary ones. Then the disk grows, and the next run must find nothing in its way. With
--fork the processes that a run starts are forked, as in kill_runs.py.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
from kfmocap.core.tracking.results.journal import JOURNAL_SUFFIX
from kill_runs import OLD, Ended, contents, forked_workers, run

LARGE = 4096.0
"""MB of a disk that is large enough for anything."""
_SIGNS = ("No space left", "is the disk full?")
_TABLE_END, _MARK, _LENGTHS = 1, 16, 0.02
"""Last bytes that all whole tables have in common, and all whole scenes; difference in length of two, relative."""


@contextmanager
def disk(megabytes: float) -> Iterator[Path]:
    """Mount a disk of that size in a temporary folder.

    Raises
    ------
    OSError
        It cannot be mounted.
    """
    with tempfile.TemporaryDirectory(prefix="small-disk-") as name:
        _mount("-t", "tmpfs", "-o", _size(megabytes), "tmpfs", name)
        try:
            yield Path(name)
        finally:
            subprocess.run(["umount", "--lazy", name], check=True)


def grow(place: Path, megabytes: float) -> None:
    """Give a disk another size."""
    _mount("-o", f"remount,{_size(megabytes)}", str(place))


def _size(megabytes: float) -> str:
    return f"size={round(megabytes * 1024)}k"


def _mount(*arguments: str) -> None:
    try:
        subprocess.run(["mount", *arguments], check=True, capture_output=True)
    except (OSError, subprocess.CalledProcessError) as error:
        raise OSError(f"no disk can be mounted: {error}") from error


def is_whole(name: Path, found: bytes, whole: bytes) -> bool:
    """Whether a file is one that a run wrote which had room; reports, tables and scenes differ from run to run."""
    if name.suffix == ".json":
        try:
            json.loads(found)
        except ValueError:
            return False
        return True
    if name.suffix in (".html", ".csv"):
        return found[-_TABLE_END:] == whole[-_TABLE_END:]
    if name.suffix in (".blend", ".fbx"):  # with a mark at the end, and the time
        return found[-_MARK:] == whole[-_MARK:] and abs(len(found) - len(whole)) <= max(64, _LENGTHS * len(whole))
    return found == whole


def faults_of(ended: Ended, place: Path, old: bool, whole: Mapping[Path, bytes], *, apart: bool) -> list[str]:
    """Return what is wrong with what a run left on a disk; with `apart` some of its folders may have new results."""
    found = contents(place / "out") if (place / "out").exists() else {}
    left = [entry for entry in place.rglob("*") if entry.name.startswith(".kfmocap-") or entry.name.endswith(".new")]
    faults = [f"{entry.name} was left" for entry in left]
    if ended.code not in (0, 1):
        faults.append(f"exit code {ended.code}: {ended.text[-300:]}")
    if "Traceback" in ended.text:
        faults.append(f"a traceback: {ended.text[-300:]}")
    if ended.code and not (str(place) in ended.text and any(sign in ended.text for sign in _SIGNS)):
        faults.append(f"its message does not say where there is no room: {ended.text[-300:]}")
    new = {name for name, content in found.items() if content != OLD.encode() and JOURNAL_SUFFIX not in str(name)}
    faults += [
        f"{name} is not whole"
        for name in sorted(new)
        if name not in whole or not is_whole(name, found[name], whole[name])
    ]
    if ended.code == 0:
        faults += [f"exit code 0 without {name}" for name in whole if name not in new]
    elif not apart:
        faults += [f"exit code {ended.code} with a new {name}" for name in sorted(new)]
        faults += [f"{name} is gone" for name in whole if old and name not in found]
    return faults


def sizes(text: str) -> list[float]:
    """Return the sizes from "first:last:step" or "one,other", in MB."""
    if ":" not in text:
        return [float(size) for size in text.split(",")]
    first, last, step = map(float, text.split(":"))
    return [first + step * k for k in range(int(np.floor((last - first) / step + 1e-6)) + 1)]


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command on every disk, print what came of it; returns 1 if anything was wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sizes", type=sizes, required=True, metavar="FIRST:LAST:STEP", help="of the disks, MB")
    parser.add_argument("--apart", action="store_true", help="each folder of results is by itself, as in a batch")
    parser.add_argument(
        "--next", type=int, default=5, metavar="N", help="run again after each N-th failure (default: 5)"
    )
    parser.add_argument("--fork", action="store_true", help="fork the processes that a run starts")
    parser.add_argument("command", nargs=argparse.REMAINDER, metavar="...", help="a command that writes into OUT")
    args = parser.parse_args(argv)
    with forked_workers() if args.fork else nullcontext():
        return _tried(args)


def _tried(args: argparse.Namespace) -> int:
    outcomes, wrong = Counter[str](), 0
    with disk(LARGE) as place:
        ended = run(args.command, place / "out", temporary=place)
        if ended.code:
            print(f"the command fails by itself: {ended.said}", file=sys.stderr)
            return 2
        whole = contents(place / "out")
    print(f"{len(whole)} files of {sum(map(len, whole.values())) / 2**20:.2f} MB")
    for k, size in enumerate(args.sizes):
        with disk(size) as place, tempfile.TemporaryDirectory() as elsewhere:
            old = k % 4 > 1
            for name in whole if old else ():
                (place / "out" / name).parent.mkdir(parents=True, exist_ok=True)
                (place / "out" / name).write_text(OLD)
            ended = run(args.command, place / "out", temporary=place if k % 2 else Path(elsewhere))
            faults = faults_of(ended, place, old, whole, apart=args.apart)
            outcomes["whole" if ended.code == 0 else "refused"] += 1
            if ended.code and outcomes["refused"] % args.next == 1 % args.next:
                grow(place, LARGE)
                ended = run(args.command, place / "out", temporary=Path(elsewhere))
                faults += [
                    f"{fault} (after the disk grew)" for fault in faults_of(ended, place, old, whole, apart=False)
                ]
                faults += [f"{journal.name} stayed" for journal in place.rglob(f"*{JOURNAL_SUFFIX}")]
                faults += [f"it fails on the disk that grew: {ended.said}"] if ended.code else []
            for fault in faults:
                print(f"{size:g} MB: {fault}", flush=True)
            wrong += len(faults)
    print(f"{len(args.sizes)} disks: {outcomes['whole']} runs done, {outcomes['refused']} ended with an error")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
