"""Which shots a batch has."""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.errors import KFMocapError, ShotError
from ..core.formats.file_kind import file_kind
from ..core.formats.shot_toml import read_shot_spec
from .batch_outcome import STATUS
from .batch_summary import SUMMARY


@dataclass(frozen=True)
class BatchShot:
    """A shot of the batch.

    Attributes
    ----------
    name : str
    file : Path
    error : KFMocapError, optional
        The error raised when its file was read.
    """

    name: str
    file: Path
    error: KFMocapError | None = None

    @classmethod
    def of(cls, file: Path) -> BatchShot:
        """Return the shot of a file; its name is the one in it or, if it cannot be read, of the file."""
        try:
            return cls(read_shot_spec(file).name, file)
        except KFMocapError as error:
            return cls(file.stem, file, error)


def chosen_shots(patterns: Sequence[str], task: int | None = None) -> list[BatchShot]:
    """Return the shots among files, and among the files that match patterns such as shots/*.toml.

    Parameters
    ----------
    patterns : sequence of str
    task : int, optional
        Index of the only shot to return, from 0.

    Raises
    ------
    ShotError
        There is none, two have the same name, or one has the name of a file of the batch.
    """
    files: dict[Path, None] = {}
    for pattern in patterns:
        path = Path(pattern)
        if path.exists() or not any(sign in pattern for sign in "*?["):
            files[path] = None
        else:
            base = Path(path.anchor)
            files |= dict.fromkeys(sorted(base.glob(str(path.relative_to(base)))))
    shots = _with_names_apart([BatchShot.of(file) for file in files if not _is_something_else(file)])
    if not shots:
        raise ShotError("there is no shot among the files", where="kfmocap batch", todo="name shot files")
    named: dict[str, Path] = {}
    for shot in shots:
        if shot.name.casefold() in (STATUS, *SUMMARY):
            what, todo = f"a batch writes something else to '{shot.name}'", "give the shot another name"
            raise ShotError(what, where=str(shot.file), todo=todo)
        other = named.setdefault(shot.name, shot.file)
        if other != shot.file:
            what, todo = f"'{shot.name}' is the name of two shots", "give each its own [shot] name"
            raise ShotError(what, where=f"{other} and {shot.file}", todo=todo)
    if task is None:
        return shots
    if not 0 <= task < len(shots):
        raise ShotError(f"there is no shot {task}", where="--task", todo=f"give 0 to {len(shots) - 1}")
    return [shots[task]]


def _with_names_apart(shots: Sequence[BatchShot]) -> list[BatchShot]:
    """Return the shots, with the folder's name added to those of unreadable shots that share a file name: they should
    be reported for what is wrong with them, not for their names.
    """
    counts = Counter(shot.name for shot in shots)
    return [
        shot
        if shot.error is None or counts[shot.name] == 1
        else replace(shot, name="_".join([*shot.file.resolve().parts[1:-1], shot.name]))
        for shot in shots
    ]


def _is_something_else(file: Path) -> bool:
    """Whether a file is not a shot file: *.toml may also match a calibration in the same folder."""
    try:
        kind = file_kind(file)
    except KFMocapError:
        return False
    if kind != "shot":
        what = "folder: name its files, as with *.toml" if file.is_dir() else f"{kind}: left out"
        print(f"kfmocap: {file} is no shot file, but a {what}", file=sys.stderr)
    return kind != "shot"
