"""The journal of a run: files of its finished segments, from which an interrupted run can be resumed.

A file holds NumPy arrays and a checksum over them and over everything that they depend on: the shot, its files and the
program. A file that is damaged or belongs to another shot is ignored.
"""

from __future__ import annotations

import hashlib
import io
import os
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...body.motion import Motion
from ...errors import CancelledError
from ...evidence.part_shapes import ShapeEvidence
from ...evidence.time_offset import Offset
from ...numerics.arrays import Array, Bools
from ...runtime.interrupts import WRITTEN_NOTE
from ...shot.fingerprint import checksum, file_bytes, value_bytes
from ...shot.segments import Segment, segments
from ...shot.shot import Shot
from ..expected_errors.uncertainty import SegmentUncertainty
from ..solvers.equations.view_delays import DelayEvidence
from .track_result import SegmentResult

JOURNAL_SUFFIX = ".unfinished"
"""Suffix that is added to the name of the results' folder for that of the journal."""
DISK_RESERVE = 20
"""A file is written only if the disk has room for this many times its size, as the results need room, too."""
_FILE = re.compile(r"[0-9a-f]{16}_\d+_\d+\.segment(\.new)?")
_CHECKSUM = hashlib.sha256().digest_size


@dataclass(frozen=True, eq=False)
class FinishedSegment:
    """What is kept of a finished segment: all but its footage and evidence.

    Attributes
    ----------
    result : SegmentResult
    first_motions : tuple of Motion
        Per performer: the motion before refinement, with which the neighbouring segments were refined.
    motions : tuple of Motion
        Per performer: the final motion.
    offset : Offset or None
        Offset of the footage as measured on this segment.
    share : ndarray, shape (V, F, P)
        Visible share of the parts of all performers.
    residual : ndarray, shape (F,)
    uncertainties : tuple of SegmentUncertainty
        Per performer.
    planted : tuple of (ndarray of bool, shape (F, C), or None)
        Per performer: when points of the soles are planted, see `core.tracking.solvers.protocol.SettledMotions`.
    delays : DelayEvidence
        What its footage says about delays of the views.
    shape : ShapeEvidence, optional
        What its key frames say about the shapes of all performers' parts.
    """

    result: SegmentResult
    first_motions: tuple[Motion, ...]
    motions: tuple[Motion, ...]
    offset: Offset | None
    share: Array
    residual: Array
    uncertainties: tuple[SegmentUncertainty, ...]
    planted: tuple[Bools | None, ...]
    delays: DelayEvidence
    shape: ShapeEvidence | None = None

    @property
    def segment(self) -> Segment:
        """First and last shot frame."""
        return self.result.first, self.result.last


class Journal:
    """The folder in which a run keeps its finished segments.

    Errors while writing are ignored: a journal never prevents results.

    Parameters
    ----------
    folder : Path
        It is made with the first segment that is kept, accessible to the user alone.
    resume : bool
        Reuse the segments that an earlier run finished.

    Attributes
    ----------
    taken, kept : list of Segment
        Segments that were reused in this run, and those that were written.
    """

    def __init__(self, folder: Path, *, resume: bool = False) -> None:
        self.folder, self.resume = folder, resume
        self.taken: list[Segment] = []
        self.kept: list[Segment] = []

    def read(self, key: str, segment: Segment) -> FinishedSegment | None:
        """Read a segment that an earlier run finished, if it is there; `key` is that of `run_key`."""
        if not self.resume or not _is_own(self.folder):
            return None
        with suppress(Exception):  # of another version of the program, or damaged: it is tracked again
            found = _of_bytes((self.folder / _name(key, segment)).read_bytes(), key, segment)
            self.taken.append(segment)
            return found
        return None

    def write(self, key: str, finished: FinishedSegment) -> None:
        """Write a finished segment."""
        with suppress(OSError):
            data = _bytes_of(finished, key)
            self.folder.mkdir(mode=0o700, exist_ok=True)
            if not _is_own(self.folder) or shutil.disk_usage(self.folder).free < DISK_RESERVE * len(data):
                return
            file = self.folder / _name(key, finished.segment)
            new = file.with_suffix(".segment.new")
            try:
                new.write_bytes(data)
                os.replace(new, file)
            except OSError:
                new.unlink(missing_ok=True)
                raise
            self.kept.append(finished.segment)

    @property
    def what_stays(self) -> str:
        """A sentence on the finished segments that the folder holds; empty if it holds none of this run's."""
        count = len(self.taken) + len(self.kept)
        kept = f"{count} finished segment{' is' if count == 1 else 's are'} kept"
        return f"{kept}; --resume goes on from there" if count else ""

    def stay(self, error: BaseException) -> None:
        """Keep the folder unless it is empty, and note on what ended the run what stays."""
        if self.what_stays:
            error.add_note(self.what_stays)
        else:
            with suppress(OSError):  # it holds what an earlier run kept of another shot
                self.folder.rmdir()

    def discard(self) -> None:
        """Remove the folder."""
        with suppress(OSError):
            if _is_own(self.folder):
                for entry in list(os.scandir(self.folder)):
                    if _FILE.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                        os.unlink(entry.path)
                self.folder.rmdir()


@dataclass(frozen=True)
class KeptSegments:
    """The segments of one shot in a journal, if there is one.

    Attributes
    ----------
    journal : Journal or None
    key : str
        See `run_key`.
    known : dict of Segment to FinishedSegment
        Segments that need not be tracked, as an earlier run finished them.
    """

    journal: Journal | None
    key: str
    known: dict[Segment, FinishedSegment]

    @classmethod
    def of(cls, journal: Journal | None, shot: Shot, around: Sequence[tuple[Motion, ...] | None]) -> KeptSegments:
        """Read the finished segments of a shot; `around` are the poses known before and after it."""
        if journal is None:
            return cls(None, "", {})
        key = run_key(shot, around)
        found = {segment: journal.read(key, segment) for segment in segments(shot)}
        return cls(journal, key, {segment: one for segment, one in found.items() if one is not None})

    def joined(self, others: Sequence[FinishedSegment]) -> KeptSegments:
        """Return the same with more segments that are known."""
        return replace(self, known=self.known | {one.segment: one for one in others})

    def write(self, finished: FinishedSegment) -> None:
        """Write one more finished segment."""
        if self.journal is not None:
            self.journal.write(self.key, finished)


@contextmanager
def journal_beside(folder: Path, *, resume: bool) -> Iterator[Journal]:
    """Context with the journal of a run whose results go into a folder; it is removed when the block succeeds.

    If the block fails, the journal stays. If the run is interrupted, it stays only if `resume` is set. A note on the
    exception says what is kept. No empty folder stays.
    """
    whole = folder.absolute()
    journal = Journal(whole.with_name(whole.name + JOURNAL_SUFFIX) if whole.name else whole, resume=resume)
    if not resume:
        journal.discard()
    try:
        yield journal
    except (KeyboardInterrupt, CancelledError) as interrupt:
        if not resume or WRITTEN_NOTE in getattr(interrupt, "__notes__", ()):
            journal.discard()
        else:
            journal.stay(interrupt)
        raise
    except Exception as error:
        journal.stay(error)
        raise
    journal.discard()


def run_key(shot: Shot, around: Sequence[tuple[Motion, ...] | None]) -> str:
    """Hash of everything that the result of tracking depends on: the shot, the poses known around it, the content of
    its files, and the program.
    """
    core = Path(__file__).parents[1]
    named = [file for view in shot.views for file in (view.footage, view.keypoints) if file is not None]
    files = (*sorted(core.rglob("*.py")), *named)
    return checksum(value_bytes((shot, tuple(around))), *map(file_bytes, files))


def _name(key: str, segment: Segment) -> str:
    return f"{key[:16]}_{segment[0]}_{segment[1]}.segment"


def _is_own(folder: Path) -> bool:
    """Whether a path is a folder owned by this user and no symbolic link."""
    if folder.is_symlink() or not folder.is_dir():
        return False
    return not hasattr(os, "getuid") or folder.stat().st_uid == os.getuid()


def _checksum(key: str, data: bytes) -> bytes:
    return hashlib.sha256(key.encode() + data).digest()


def _bytes_of(finished: FinishedSegment, key: str) -> bytes:
    result, offset = finished.result, finished.offset
    arrays: dict[str, NDArray[np.generic]] = {
        "counts": np.array([result.first, result.last, result.iterations, len(finished.motions)]),
        "energy": np.array(result.energy, float),
        "offset": np.array([] if offset is None else [offset.value, offset.precision], float),
        "share": finished.share,
        "residual": finished.residual,
        **{f"delays {f.name}": getattr(finished.delays, f.name) for f in fields(DelayEvidence)},
    }
    for i, (before, motion) in enumerate(zip(finished.first_motions, finished.motions, strict=True)):
        arrays |= {f"first translations {i}": before.translations, f"first rotations {i}": before.rotations}
        arrays |= {f"translations {i}": motion.translations, f"rotations {i}": motion.rotations}
        arrays |= {
            f"doubt {f.name} {i}": np.asarray(getattr(finished.uncertainties[i], f.name))
            for f in fields(SegmentUncertainty)
        }
        if result.accelerations:
            arrays[f"accelerations {i}"] = result.accelerations[i]
        if (planted := finished.planted[i]) is not None:
            arrays[f"planted {i}"] = planted
    if (shape := finished.shape) is not None:
        arrays |= {f"shape {f.name}": getattr(shape, f.name) for f in fields(ShapeEvidence)}
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return _checksum(key, stream.getvalue()) + stream.getvalue()


def _of_bytes(data: bytes, key: str, segment: Segment) -> FinishedSegment:
    """Read a segment back.

    Raises
    ------
    ValueError
        It is not what was written with this key.
    """
    if data[:_CHECKSUM] != _checksum(key, data[_CHECKSUM:]):
        raise ValueError(f"segment {segment} is not what was written")
    with np.load(io.BytesIO(data[_CHECKSUM:]), allow_pickle=False) as file:
        arrays: Mapping[str, Array] = dict(file)
    first, last, iterations, count = arrays["counts"].tolist()
    if (first, last) != segment:
        raise ValueError(f"it is segment {first, last}")

    def each(name: str) -> tuple[Array, ...]:
        return tuple(arrays[f"{name} {i}"] for i in range(count) if f"{name} {i}" in arrays)

    def motions(prefix: str = "") -> tuple[Motion, ...]:
        return tuple(map(Motion, each(f"{prefix}translations"), each(f"{prefix}rotations")))

    energy = tuple(arrays["energy"].tolist())
    return FinishedSegment(
        result=SegmentResult(first, last, iterations, energy, each("accelerations")),
        first_motions=motions("first "),
        motions=motions(),
        offset=Offset(*arrays["offset"].tolist()) if arrays["offset"].size else None,
        share=arrays["share"],
        residual=arrays["residual"],
        uncertainties=tuple(map(SegmentUncertainty, *(each(f"doubt {f.name}") for f in fields(SegmentUncertainty)))),
        planted=tuple(arrays[name].astype(bool) if (name := f"planted {i}") in arrays else None for i in range(count)),
        delays=DelayEvidence(
            arrays["delays places"].astype(int),
            *(arrays[f"delays {name}"] for name in ("gradient", "precision", "coupling")),
        ),
        shape=ShapeEvidence(
            arrays["shape frames"].astype(int),
            *(arrays[f"shape {name}"] for name in ("change", "matrix", "gradient")),
        )
        if "shape frames" in arrays
        else None,
    )
