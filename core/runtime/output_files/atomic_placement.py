"""Putting finished results in their place, as nearly in one step as the system can.

A new folder is put in place by a single renaming. An existing folder that contains only files is exchanged atomically
for one with the new files and hard links to the others. If that is not possible (on Windows, in a folder that contains
folders, in the working folder of a process), files are moved one by one; if the run is killed meanwhile, the next run
finishes the moving.
"""

from __future__ import annotations

import os
import shutil
import stat
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from .exchange import exchange_paths
from .staging_folders import MOVING, RESULTS, move_files

_MAX_LINKED = 1000  # largest number of other files in a folder that is exchanged


def flush(path: Path) -> None:
    """Flush a file or folder to the disk; if the disk is full, this fails."""
    if path.is_dir() and os.name == "nt":
        return  # Windows cannot open folders
    descriptor = os.open(path, os.O_RDWR if os.name == "nt" else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def put_file(place: Path, path: Path) -> None:
    """Put a staging folder's only result in the place of a file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    os.replace(place / RESULTS / path.name, path)


def put_folder(place: Path, folder: Path) -> None:
    """Put a staging folder's results into a folder: by renaming, by exchange, or file by file."""
    if not folder.exists():
        folder.parent.mkdir(parents=True, exist_ok=True)
        os.rename(place / RESULTS, folder)
        return
    others = _other_files(place, folder)
    if others is None or not _exchange(place, folder, others):
        _move_files(place, folder)


def _other_files(place: Path, folder: Path) -> list[str] | None:
    """Return the names of a folder's files that are not replaced; None if it cannot be exchanged as a whole."""
    inside = place.parent == folder.absolute() or place.parent.stat().st_dev != folder.stat().st_dev
    if inside or folder.is_symlink() or _is_worked_in(folder.resolve()):
        return None
    others = []
    for entry in os.scandir(folder):
        if not (place / RESULTS / entry.name).exists():
            others.append(entry.name)
        if len(others) > _MAX_LINKED or not stat.S_ISREG(entry.stat(follow_symlinks=False).st_mode):
            return None
    return others


def _is_worked_in(folder: Path) -> bool:
    """Whether a folder is known to be the working folder of a process, which would lose it in an exchange."""
    working = [os.path.realpath(os.curdir)]
    for link in Path("/proc").glob("[0-9]*/cwd"):
        with suppress(OSError):  # it ended meanwhile, or is another user's
            working.append(os.readlink(link))
    return any(Path(path).is_relative_to(folder) for path in working)


def _exchange(place: Path, folder: Path, others: Sequence[str]) -> bool:
    """Exchange a folder for the results and links to its other files; returns whether the system could do that."""
    results = place / RESULTS
    linked = []
    try:
        for name in others:
            os.link(folder / name, results / name)
            linked.append(name)
        shutil.copystat(folder, results)
        if hasattr(os, "chown"):
            before = folder.stat()
            os.chown(results, before.st_uid, before.st_gid)
        flush(results)
        done = exchange_paths(results, folder)
    except OSError:
        done = False
    if not done:
        for name in linked:
            (results / name).unlink()
        return False
    for entry in os.scandir(results):  # files that another process wrote meanwhile
        if not (folder / entry.name).exists():
            os.rename(entry.path, folder / entry.name)
    return True


def _move_files(place: Path, folder: Path) -> None:
    """Move files into a folder one by one; if this run is killed after the first move, the next run moves the rest."""
    if folder.absolute() in (place.parent, place.parent / folder.name):
        plan = place / f"{MOVING}.new"
        plan.write_text(os.path.relpath(folder.absolute(), place.parent), encoding="utf-8")
        flush(plan)
        os.replace(plan, place / MOVING)
    move_files(place, folder)
