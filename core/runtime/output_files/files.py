"""Writing files so that nobody ever sees half-written results.

The results of a run are written under temporary names, flushed to the disk, and put in place together at its end (see
`placing`).
"""

from __future__ import annotations

import errno
import json
import os
import stat
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ...errors import OutputError
from ..interrupts import WRITTEN_NOTE, held_signals
from .atomic_placement import flush, put_file, put_folder
from .staging_folders import RESULTS, in_staging_folder, remove_leftovers, staging_folder

_NO_ROOM, _FORBIDDEN = "make room on its disk, or choose another one", "choose a folder that you may write to"
_REMEDIES = {
    errno.ENOSPC: _NO_ROOM,
    errno.EDQUOT: _NO_ROOM,
    errno.EROFS: _FORBIDDEN,
    errno.EPERM: _FORBIDDEN,
    errno.EACCES: f"{_FORBIDDEN}, or close the file where it is open",  # as Windows says of an open file
    errno.ENAMETOOLONG: "choose a shorter name",
}
"""What to do where a file cannot be written, by the number of the system's error."""


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Provide a temporary path beside `path`; the file written there replaces it if the block ends without an error.

    Raises
    ------
    OutputError
        The folder or the file cannot be written.
    """
    with _reported(path), together() as outputs:
        yield outputs.file(path)


@contextmanager
def staged(folder: Path, names: Sequence[str] = ()) -> Iterator[Path]:
    """Provide an empty temporary folder; its files are moved into `folder` if the block ends without an error.

    Parameters
    ----------
    folder : Path
        Created if it does not exist; other files in it are not changed.
    names : sequence of str, optional
        Names of the files that will be written.

    Raises
    ------
    OutputError
        `folder` cannot be written, or contains a folder with the name of a file; raised before the block begins.
    """
    with _reported(folder), together() as outputs:
        yield outputs.folder(folder, names)


@contextmanager
def together() -> Iterator[Outputs]:
    """Provide a run's `Outputs`; they are put in place together if the block ends without an error.

    Raises
    ------
    OutputError
        One of them cannot be written; then none is.
    """
    with ExitStack() as stack:
        outputs = Outputs(stack)
        yield outputs
        outputs.put_in_place()


class Outputs:
    """Files and folders that are put in place together; see `together`."""

    def __init__(self, stack: ExitStack) -> None:
        self._stack = stack
        self._places: list[_Output] = []

    def file(self, path: Path, *, parents: bool = False) -> Path:
        """Return the temporary path of a file.

        Parameters
        ----------
        path : Path
        parents : bool
            Whether to create its folder if there is none.

        Raises
        ------
        OutputError
            Its folder cannot be written, or the path is a folder.
        """
        check_free(path.parent, [path.name])
        if not path.parent.exists() and not parents:
            raise OutputError("cannot be written: there is no such folder", where=str(path))
        place = self._workplace(_existing(path.parent), path)
        self._places.append(_Output(place, path, put_file))
        return place / RESULTS / path.name

    def folder(self, path: Path, names: Sequence[str] = ()) -> Path:
        """Return the temporary folder for a folder's files.

        Parameters
        ----------
        path : Path
        names : sequence of str, optional
            Names of the files that will be written.

        Raises
        ------
        OutputError
            It cannot be written, or contains a folder with the name of a file.
        """
        check_free(path, names)
        remove_leftovers(path)
        place = self._workplace(_beside(path), path)
        self._places.append(_Output(place, path, put_folder))
        return place / RESULTS

    def _workplace(self, beside: Path, path: Path) -> Path:
        try:
            return self._stack.enter_context(staging_folder(beside))
        except OSError as error:
            raise unwritable(path, error) from error

    def put_in_place(self) -> None:
        """Put everything in place.

        Raises
        ------
        OutputError
        """
        for output in self._places:
            with _reported(output.path):
                files = list((output.place / RESULTS).iterdir())
                check_free(output.path if output.put is put_folder else output.path.parent, [f.name for f in files])
                for file in files:
                    flush(file)
                flush(output.place / RESULTS)
        done = False
        try:
            with held_signals():
                for output in self._places:
                    with _reported(output.path):
                        output.put(output.place, output.path)
                done = True
                for output in self._places:
                    with suppress(OSError):
                        flush(output.path.parent)
        except KeyboardInterrupt as interrupt:
            if done and not any(in_staging_folder(output.path) for output in self._places):
                interrupt.add_note(WRITTEN_NOTE)
            raise


@dataclass(frozen=True)
class _Output:
    """An output in a staging folder, which put(place, path) moves to its path."""

    place: Path
    path: Path
    put: Callable[[Path, Path], None]


def write_json(path: Path, values: Mapping[str, Any]) -> None:
    """Write plain values as JSON.

    Raises
    ------
    OutputError
        The file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(json.dumps(values, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def check_writable(folder: Path) -> None:
    """Check before any work is done that files can be written into a folder, which need not exist yet.

    Raises
    ------
    OutputError
        They cannot.
    """
    with ExitStack() as stack:
        Outputs(stack).folder(folder, ())


def check_inputs_kept(results: Iterable[Path], inputs: Iterable[Path]) -> None:
    """Check that no result would overwrite an input.

    Raises
    ------
    OutputError
        One would.
    """
    read = {(found.st_dev, found.st_ino) for path in inputs if (found := _found(path)) is not None}
    for path in results:
        if (found := _found(path)) is not None and (found.st_dev, found.st_ino) in read:
            todo = "write to another place, or give the results another name"
            raise OutputError("would be replaced by the results, which are made of it", where=str(path), todo=todo)


def _found(path: Path) -> os.stat_result | None:
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found if stat.S_ISREG(found.st_mode) else None


def check_free(folder: Path, names: Sequence[str]) -> None:
    """Check that a path is or can become a folder, in which no folder has one of the names.

    Raises
    ------
    OutputError
        It cannot, or one has.
    """
    try:
        if folder.exists() and not folder.is_dir():
            raise OutputError("is a file, not a folder", where=str(folder))
        for place in (folder, *folder.parents):
            if place.is_symlink() and not place.exists():
                raise OutputError("is a symbolic link that leads nowhere", where=str(place))
        folder.absolute()  # fails if the working folder has been removed
        for name in names:
            os.fsencode(name)  # fails if the system's encoding lacks one of its characters
            if (folder / name).is_dir():
                raise OutputError("a folder is in the way", where=str(folder / name))
    except (OSError, ValueError) as error:
        raise unwritable(folder, error) from error


def _beside(folder: Path) -> Path:
    """Return where to stage a folder's content: in its parent, so that it can be exchanged, or else in the folder."""
    if not folder.exists():
        return _existing(folder)
    parent = folder.absolute().parent
    one_system = parent.stat().st_dev == folder.stat().st_dev and not folder.is_symlink()
    return parent if one_system and os.access(parent, os.W_OK | os.X_OK) else folder


def _existing(folder: Path) -> Path:
    """Return the folder, or the nearest one above it that exists."""
    whole = folder.absolute()
    return next(one for one in (whole, *whole.parents) if one.exists())


@contextmanager
def _reported(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise unwritable(path, error) from error
    except OutputError as error:
        # Whoever wrote the file knows its temporary place alone.
        if error.where is None or not in_staging_folder(Path(error.where)):
            raise
        name = Path(error.where).name
        where = path if path.name == name else path / name
        raise OutputError(error.what, where=str(where), todo=error.todo) from error


def unwritable(path: Path, error: OSError | ValueError, failed: str = "cannot be written") -> OutputError:
    """Return the error for a path that cannot be written, or that `failed` otherwise, with what to do."""
    what = getattr(error, "strerror", None) or str(error)
    # Input files may vanish meanwhile.
    other = getattr(error, "filename", None)
    if isinstance(other, str) and not in_staging_folder(Path(other)) and not Path(other).is_relative_to(path):
        what = f"{what}: {other}"
    return OutputError(f"{failed}: {what}", where=str(path), todo=remedy(getattr(error, "errno", None)))


def remedy(number: int | None) -> str | None:
    """Return what to do where a file cannot be written, by the number of the system's error; None if that is not
    known.
    """
    return None if number is None else _REMEDIES.get(number)
