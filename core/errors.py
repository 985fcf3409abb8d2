"""Errors that a user can cause or cure: each says what is wrong, where, and what to do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

_MAX_LENGTH = 400


def shortened(text: str, longest: int = _MAX_LENGTH) -> str:
    """Return a text, its middle left out where it is longer than that."""
    return text if len(text) <= longest else f"{text[: longest // 2]} ... {text[-longest // 2 :]}"


def listed(items: Sequence[object], most: int) -> str:
    """Return the first of some items as a text, and whether there are more."""
    return ", ".join(map(str, items[:most])) + (", ..." if len(items) > most else "")


class KFMocapError(Exception):
    """Base of every error that a user can cause.

    Parameters
    ----------
    what : str
        What is wrong, in one sentence.
    where : str, optional
        File, field, camera or frame.
    todo : str, optional
        What the user can do about it.
    """

    def __init__(self, what: str, *, where: str | None = None, todo: str | None = None) -> None:
        # What a damaged file holds in the place of a name can be long.
        what, where = shortened(what), where and shortened(where)
        self.what, self.where, self.todo = what, where, todo
        message = f"{where}: {what}" if where else what
        super().__init__(f"{message} ({todo})" if todo else message)

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickled, (type(self), self.args, self.__dict__)


def _unpickled(kind: type[KFMocapError], args: tuple[str, ...], state: dict[str, Any]) -> KFMocapError:
    """Return an error as it was, whatever its kind needs to be made."""
    error = kind.__new__(kind, *args)
    error.__dict__.update(state)
    return error


@contextmanager
def located(where: str) -> Iterator[None]:
    """Put the file and field that led to an error before the place that the error names."""
    try:
        yield
    except KFMocapError as error:
        place = f"{where}: {error.where}" if error.where else where
        raise type(error)(error.what, where=place, todo=error.todo) from error


class InputError(KFMocapError):
    """What was given cannot be used: trying again without changing it is of no use."""


class ShotError(InputError):
    """The shot file, or what it asks for, does not hold together."""


class CalibrationError(InputError):
    """A calibration cannot be read or does not fit the footage."""


class CaptureError(CalibrationError):
    """Cameras cannot be solved from a capture of an L-frame and a wand.

    Attributes
    ----------
    name : str
        Which problem the capture has, such as "wand-in-a-plane"; see `core.calibration.findings`.
    """

    def __init__(self, what: str, *, name: str = "capture", where: str | None = None, todo: str | None = None) -> None:
        self.name = name
        super().__init__(what, where=where, todo=todo)


class FootageError(InputError):
    """Footage is missing, unreadable, too short, or of the wrong size."""


class LandmarkError(InputError):
    """Landmarks are missing or not finite where a key pose needs them."""


class KeypointError(InputError):
    """2D keypoints cannot be read, or do not show what is asked of them."""


class BodyError(InputError):
    """A body cannot be built or a pose does not fit it."""


class OutputError(KFMocapError):
    """A result cannot be written."""


class CancelledError(KFMocapError):
    """The user cancelled a running job; nothing was changed."""

    def __init__(self) -> None:
        super().__init__("cancelled")


class WorkerEndedError(KFMocapError):
    """A process that worked for the program ended before its work was done: it was killed, or crashed.

    Parameters
    ----------
    exit_code : int
        Of the process; below 0 the signal that ended it.
    """

    def __init__(self, exit_code: int) -> None:
        how = f"it was ended by signal {-exit_code}" if exit_code < 0 else f"exit code {exit_code}"
        super().__init__(f"the worker process ended unexpectedly: {how}", todo="memory may have run out; try again")
