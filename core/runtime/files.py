"""Writing files so that nothing half-written is ever seen."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ..errors import OutputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a temporary path beside `path`; what is written there takes its place when the block ends well.

    Raises
    ------
    OutputError
        The folder or the file cannot be written.
    """
    temporary = path.with_name(f".{path.stem}.part{os.getpid()}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, path)
    except OSError as error:
        raise OutputError(f"cannot be written: {error.strerror or error}", where=str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


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
    """See that files can be written into a folder, which may not exist yet, before any work is done.

    Raises
    ------
    OutputError
        They cannot.
    """
    _new_stage(folder).rmdir()


@contextmanager
def staged(folder: Path) -> Iterator[Path]:
    """Give an empty temporary folder; its files are moved into `folder` when the block ends well, else dropped.

    Raises
    ------
    OutputError
        `folder` cannot be written: raised before the block begins.
    """
    stage = _new_stage(folder)
    try:
        yield stage
        _move_files(stage, folder)
    except OSError as error:
        raise _unwritable(folder, error) from error
    finally:
        shutil.rmtree(stage, ignore_errors=True)


def _new_stage(folder: Path) -> Path:
    if folder.exists() and not folder.is_dir():
        raise OutputError("is a file, not a folder", where=str(folder))
    # On the file system of the results, so that moving a file into place cannot fail half-way.
    beside = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    try:
        return Path(tempfile.mkdtemp(prefix=".kfmocap-", dir=beside))
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(folder: Path, error: OSError) -> OutputError:
    return OutputError(f"the folder cannot be written: {error.strerror or error}", where=str(folder))


def _move_files(stage: Path, folder: Path) -> None:
    files = sorted(stage.iterdir())
    for file in files:
        if (folder / file.name).is_dir():
            raise OutputError("a folder is in the way", where=str(folder / file.name))
    folder.mkdir(parents=True, exist_ok=True)
    for file in files:
        os.replace(file, folder / file.name)
