"""Staging folders: temporary folders beside results, with unpredictable names. The next run removes what one left.

A staging folder is a folder `.kfmocap-RANDOM` that contains

    lock      locked by the process that uses it, as long as that lives
    results/  the files being written
    moving    exists while results are moved into place one by one, and contains the target's name; see `_finish_moving`
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO

from ..interrupts import held_signals

PREFIX = ".kfmocap-"
RESULTS, MOVING = "results", "moving"
_LOCK = "lock"
_ATTEMPTS = 10


@contextmanager
def staging_folder(beside: Path) -> Iterator[Path]:
    """Make a staging folder in a folder, with a folder `results` in it; it is removed when the block ends.

    Leftovers of killed processes are removed first.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    remove_leftovers(beside)
    made: list[tuple[Path, IO[bytes]]] = []
    try:
        with held_signals():
            made.append(_made(beside))
        yield made[0][0]
    finally:
        with held_signals():
            for place, lock in made:
                lock.close()
                _remove(place)


def in_staging_folder(path: Path) -> bool:
    """Whether a path is in a staging folder, where files are not final results."""
    return any(part.startswith(PREFIX) for part in path.absolute().parts)


def _made(beside: Path) -> tuple[Path, IO[bytes]]:
    """Create a staging folder; returns it and its lock."""
    for _ in range(_ATTEMPTS):
        place = Path(tempfile.mkdtemp(prefix=PREFIX, dir=beside))
        try:
            lock = (place / _LOCK).open("wb")
            _try_lock(lock)
            (place / RESULTS).mkdir()
            return place, lock
        except FileNotFoundError:
            continue  # another run removed it as a leftover before it was locked
        except OSError:
            _remove(place)
            raise
    raise OSError(f"temporary folders in {beside} vanish")


def _remove(place: Path) -> None:
    """Remove a staging folder, its lock last: without a lock it counts as empty."""
    with suppress(OSError):
        for entry in place.iterdir():
            if entry.is_dir():
                shutil.rmtree(entry, ignore_errors=True)
            elif entry.name != _LOCK:
                entry.unlink()
        (place / _LOCK).unlink(missing_ok=True)
        place.rmdir()


def remove_leftovers(folder: Path) -> None:
    """Remove what killed processes left in a folder, after finishing the moving of their results into place."""
    with suppress(OSError):
        for entry in os.scandir(folder):
            if entry.name.startswith(PREFIX) and entry.is_dir(follow_symlinks=False):
                with suppress(OSError), held_signals():
                    _remove_leftover(Path(entry.path))
        for entry in os.scandir(folder):
            # Files beside the staging folder that they are named after: some must be written where they will be used.
            ours = entry.name.startswith(PREFIX) and entry.is_file(follow_symlinks=False)
            if ours and not Path(entry.path).with_suffix("").exists():
                Path(entry.path).unlink()


def _remove_leftover(place: Path) -> None:
    if hasattr(os, "getuid") and place.stat().st_uid != os.getuid():
        return
    if not (place / _LOCK).exists():
        place.rmdir()  # fails if its lock was created meanwhile
        return
    with (place / _LOCK).open("r+b") as lock:
        if not _try_lock(lock):
            return  # another process is using it
        if (place / MOVING).is_file():
            _finish_moving(place)
        if sys.platform == "win32":
            lock.close()  # Windows cannot remove open files
        _remove(place)


def _finish_moving(place: Path) -> None:
    """Move results from a staging folder into the folder named in its file `moving`: one beside it, or its parent."""
    name = (place / MOVING).read_text(encoding="utf-8")
    if name == os.curdir or Path(name).name == name:
        move_files(place, place.parent / name)


def move_files(place: Path, folder: Path) -> None:
    """Move a staging folder's results into a folder, one by one.

    Raises
    ------
    OSError
    """
    for file in sorted((place / RESULTS).iterdir()):
        os.replace(file, folder / file.name)


def _try_lock(lock: IO[bytes]) -> bool:
    """Lock a file, unless another process holds it; returns whether it is locked now."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(lock.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True
