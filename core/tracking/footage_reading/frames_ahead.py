"""Frames that are decoded before the tracker asks for them: other cores are idle while one fits the key poses."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from threading import Event

from ...errors import FootageError
from ...runtime.processes.worker_memory import WorkerMemory
from ...runtime.threads import worker_count
from ...shot.fingerprint import made_of
from ...shot.footage import MAX_PICTURE_SIDE, Album, Image, frames_at, working_factor
from ...shot.settings import Settings
from ...shot.shot import View

MAX_AHEAD = 32
"""Largest number of frames of a view that are decoded ahead, 12 MB at the usual working size."""
_KEY = "frames ahead"


class FramesAhead:
    """Decodes the first frames of a shot's views while nothing else keeps all cores busy.

    These are the frames of `core.shot.footage.frames_at`, and reading goes on after them.

    Parameters
    ----------
    frames : tuple of int
        The shot's first and last frame.
    pictures : collection of int
        Frames, counted from the shot's first, whose pictures the tracker may be asked to collect.
    settings : Settings
    """

    def __init__(self, frames: tuple[int, int], pictures: Collection[int], settings: Settings) -> None:
        self._frames = range(frames[0], frames[1] + 1)
        self._pictures = {frames[0] + frame for frame in pictures}
        self._settings = settings
        self._begun: dict[bytes, _BegunView] = {}

    @contextmanager
    def decoding(self, views: Sequence[View] = ()) -> Iterator[None]:
        """Decode frames while the block runs, from now on those of some views, too.

        Views whose footage cannot be read are left out: who reads them next reports it.
        """
        workers, stopped = worker_count(self._settings.threads), Event()
        for view in views:
            if view.camera.standing() is None and view.camera.zooms is None:
                with suppress(OSError, FootageError):
                    self._begin(view, max(1, workers // len(views)))
        with ThreadPoolExecutor(max(1, workers - 1)) as pool:  # one core is busy with what the block does
            try:
                for begun in self._begun.values():
                    pool.submit(begun.decode, stopped)
                yield
            finally:
                stopped.set()

    def _begin(self, view: View, threads: int) -> None:
        factor = working_factor(view, self._settings.working_size)
        album = Album(frozenset(self._pictures), working_factor(view, MAX_PICTURE_SIDE))
        coming = frames_at(view, self._frames, factor, grey=False, album=album, threads=threads)
        self._begun[made_of(view, factor)] = _BegunView(self._frames, album, coming)

    @property
    def done(self) -> bool:
        """Whether there is nothing more to decode ahead."""
        return all(begun.done for begun in self._begun.values())

    def taken(self, of: bytes, frames: range, album: Album) -> Iterator[Image] | None:
        """Take all frames of a view, given what they are made of (`made_of`), with those that are decoded already; None
        if they were not begun so, or without a picture that an album is to collect. Only while none are decoded.
        """
        begun = self._begun.pop(of, None)
        return begun.continued(album) if begun is not None and begun.fits(frames, album) else None


def taken_ahead(memory: WorkerMemory, of: bytes, frames: range, album: Album) -> Iterator[Image] | None:
    """Take the frames of a view if a worker's memory has some that were decoded ahead; see `FramesAhead.taken`."""
    ahead: FramesAhead | None = memory.value(_KEY, lambda: None)
    return None if ahead is None else ahead.taken(of, frames, album)


@contextmanager
def decoding_ahead(memory: WorkerMemory | None) -> Iterator[None]:
    """Decode ahead while the block runs, if a worker's memory has frames that were begun."""
    ahead: FramesAhead | None = None if memory is None else memory.value(_KEY, lambda: None)
    if ahead is None:
        yield
        return
    with ahead.decoding():
        yield


def remember_ahead(memory: WorkerMemory, ahead: FramesAhead) -> None:
    """Let the tracker find frames that are decoded ahead."""
    memory.replace_value(_KEY, ahead)


@dataclass(eq=False)
class _BegunView:
    """The stream of a view's frames, the first of which are decoded, and its pictures."""

    frames: range
    album: Album
    coming: Iterator[Image]
    decoded: deque[Image] = field(default_factory=deque)
    broken: bool = False

    @property
    def done(self) -> bool:
        """Whether nothing more is to be decoded."""
        return self.broken or len(self.decoded) == min(MAX_AHEAD, len(self.frames))

    def decode(self, stopped: Event) -> None:
        """Decode frames until it is stopped."""
        while not (stopped.is_set() or self.done):
            try:
                self.decoded.append(next(self.coming))
            except Exception:  # whoever reads the footage from its beginning gets the same error
                self.broken = True

    def fits(self, frames: range, album: Album) -> bool:
        """Whether these are the frames that are asked for, with their pictures."""
        pictures = album.frames <= self.album.frames and album.factor == self.album.factor
        return pictures and frames == self.frames and not self.broken

    def continued(self, album: Album) -> Iterator[Image]:
        """Generate all frames, and collect the pictures that an album asks for, with what they show of fields."""
        album.fields = self.album.fields
        for frame in self.frames:
            image = self.decoded.popleft() if self.decoded else next(self.coming)
            picture = self.album.pictures.pop(frame, None)
            if picture is not None and frame in album.frames:
                album.pictures[frame] = picture
            yield image
