"""Where the pictures of a segment are kept: in memory, or in memory-mapped files."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...evidence.view_frames import ViewFrames
from ...runtime.output_files.files import unwritable
from ...runtime.output_files.staging_folders import RESULTS, staging_folder
from ...runtime.processes.shared_arrays import SharedArray
from ...shot.footage import working_factor
from ...shot.segments import segments
from ...shot.shot import Shot

Images = NDArray[np.uint8]

MAX_MEMORY_BYTES = 256 << 20
"""Largest size of a segment's pictures in memory; those of longer segments are in files."""

COLOUR, GREY, FOREGROUND, PALETTE = "colour", "grey", "foreground", "palette"


@dataclass(frozen=True)
class PictureStore:
    """Keeps the pictures of one view on one segment.

    Attributes
    ----------
    folder : Path, optional
        Folder of the files; without one, pictures are kept in memory.
    name : str
        Prefix of the files' names.
    """

    folder: Path | None = None
    name: str = ""

    def kept(self, kind: str, pictures: Iterable[Images], count: int) -> Images:
        """Store `count` pictures of one shape as an iterable yields them; returns an array of shape (count, ...).

        Raises
        ------
        OSError
            The disk is full.
        """
        if self.folder is not None:
            return SharedArray.write(self._path(kind), pictures).array()
        coming = iter(pictures)
        first = next(coming)
        out = np.empty((count, *first.shape), np.uint8)
        out[0] = first
        for row, picture in enumerate(coming, 1):
            out[row] = picture
        return out

    def shared(self, kind: str, shape: tuple[int, ...]) -> SharedArray | None:
        """Return pictures that were kept in a form that can be sent to other processes; None without a folder."""
        return None if self.folder is None else SharedArray(self._path(kind), shape)

    def remove(self, kind: str) -> None:
        """Remove pictures that are no longer used; on Windows, mapped ones stay until their folder is removed."""
        if self.folder is not None:
            with suppress(OSError):
                self._path(kind).unlink()

    def stored(self, view: ViewFrames) -> ViewFrames | StoredView:
        """Return a view with kept pictures in a form that can be sent to other processes."""
        if self.folder is None:
            return view
        foreground = None
        if view.foreground is not None:
            foreground = SharedArray(self._path(FOREGROUND), np.moveaxis(view.foreground, 1, 0).shape)
        palette = None if view.palette is None else SharedArray(self._path(PALETTE), view.palette.shape)
        bare = replace(view, grey=np.zeros((0, 0, 0), np.uint8), foreground=None, palette=None)
        return StoredView(bare, SharedArray(self._path(GREY), view.grey.shape), foreground, palette)

    def _path(self, kind: str) -> Path:
        assert self.folder is not None
        return self.folder / f"{self.name}_{kind}.raw"


@dataclass(frozen=True)
class StoredView:
    """Frames of a view whose pictures are in files.

    Attributes
    ----------
    frames : ViewFrames
        The view without its pictures.
    grey : SharedArray, shape (N, h, w)
    foreground : SharedArray, shape (N, M, h, w), optional
    palette : SharedArray, shape (N, h, w), optional
    """

    frames: ViewFrames
    grey: SharedArray
    foreground: SharedArray | None
    palette: SharedArray | None

    def opened(self) -> ViewFrames:
        """Return the view with its pictures mapped into memory."""
        foreground = None if self.foreground is None else np.moveaxis(self.foreground.array(), 1, 0)
        palette = None if self.palette is None else self.palette.array()
        return replace(self.frames, grey=self.grey.array(), foreground=foreground, palette=palette)

    def remove(self) -> None:
        """Remove the files."""
        for pictures in (self.grey, self.foreground, self.palette):
            if pictures is not None:
                pictures.remove()


def fits_in_memory(shot: Shot) -> bool:
    """Whether the pictures of the longest segment of a shot take no more than `MAX_MEMORY_BYTES`."""
    longest = max(last + 1 - first for first, last in segments(shot))
    images = 3 + 1 + len(shot.performers)  # colour, grey, and the foreground of each performer
    sizes = [view.camera.reduced(working_factor(view, shot.settings.working_size)).size for view in shot.views]
    return longest * images * sum(width * height for width, height in sizes) <= MAX_MEMORY_BYTES


@contextmanager
def picture_folder() -> Iterator[Path]:
    """Provide a temporary folder for pictures that several processes share, or that are too many for memory.

    Raises
    ------
    OutputError
        The disk is full, or the folder cannot be written.
    """
    folder = Path(tempfile.gettempdir())
    try:
        with staging_folder(folder) as place:
            yield place / RESULTS
    except OSError as error:
        raise unwritable(folder, error, "the frames cannot be kept") from error
