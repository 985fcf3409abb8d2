"""Strict reading of TOML files: every mistake gives one message with the file, the table and the key."""

from __future__ import annotations

import difflib
import os
import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

from ..errors import KFMocapError, ShotError
from .reading import NUMBER_LIMIT, read_text, reading

Kind = Literal["shot", "capture", "calibration"]
_KINDS: dict[Kind, tuple[str, str]] = {
    "shot": ("a shot file", "it is for kfmocap track, and for calibrate with --performer or --refine"),
    "capture": ("a capture file of a wand", "it is for kfmocap calibrate and synchronise"),
    "calibration": ("a calibration", "a shot file names it as file under [calibration]"),
}
"""What the kinds of TOML files are called, and what they are for."""
_CAPTURE_BESIDE_WAND = {"lframe", "floor", "view"}
"""Tables of a capture file; which of the first two there is depends on how the floor is found."""
_REQUIRED: Any = object()
_LONGEST_PATH, _LONGEST_NAME = 4000, 255  # characters of a path, and bytes of each of its parts
_SHOWN = 60  # characters of a value in a message
_BACKSLASHES = "write paths with /, as in 'D:/shoot/cam01.mp4', or between single quotes"
_QUOTES = 'write texts between straight quotes, as in name = "walk"'
_ADVICE = (
    (re.compile(r"[\u2018-\u201f\u00ab\u00bb]"), _QUOTES),
    (re.compile(r"=\s*(True|False)\b"), "write true or false in small letters"),
    (re.compile(r"=\s*\d+,\d"), "write numbers with a point, as in 29.97"),
    (re.compile(r"^\s*[\w-]+\s*:"), 'write names and values with =, as in name = "walk"'),
    (re.compile(r"=\s*[\d.]+\s*[/*+-]"), "write a number, such as 29.97, not a calculation"),
    (re.compile(r"=\s*(?!(true|false|inf|nan)\b)[\w~./-]*[A-Za-z~./]"), _QUOTES),
    (
        re.compile(r"^\s*\[[^=]*\]\s*$"),
        "[[view]], [[performer]] and [[hold]] have two brackets each time",
    ),
)
"""What to do about a line that is not TOML, by what it contains; the first that fits counts."""
_LINE = re.compile(r"at line (\d+)")
# tomllib takes quadratic time for a key with very many parts. The possessive repetitions never backtrack.
_LONG_KEY = re.compile(r"""(?<![\w"'-])(?:(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')[ \t]*+\.[ \t]*+){50}""")


def read_toml(path: Path, what: str, error: type[KFMocapError]) -> dict[str, Any]:
    """Read the document in a TOML file, which is called `what` in messages of the type `error`."""
    text = read_text(path, what, error)
    if _LONG_KEY.search(text):
        raise error("is not a TOML file: a key has too many parts", where=str(path))
    try:
        with reading(path, "a TOML file", error):
            return tomllib.loads(text)
    except KFMocapError as problem:
        raise error(problem.what, where=problem.where, todo=_advice(text, problem.what)) from problem


def _advice(text: str, what: str) -> str | None:
    """Return what to do about a text that is not TOML, by the line that a message about it names."""
    number = _LINE.search(what)
    line = text.split("\n")[int(number[1]) - 1] if number else ""
    if text.startswith("{\\rtf"):
        return "save it as plain text"
    # In double quotes a backslash begins an escape sequence: Windows' paths seldom are valid ones.
    if "\\" in (line or text):
        return _BACKSLASHES
    return next((todo for sign, todo in _ADVICE if sign.search(line)), None)


def document_kind(document: Mapping[str, Any]) -> Kind | None:
    """Return what kind of file of ours, or of other programs, a TOML document is, by its tables; None if that is
    unclear.
    """
    tables = [value for value in document.values() if isinstance(value, Mapping)]
    if any("matrix" in table for table in tables):
        return "calibration"
    if "shot" in document:
        return "shot"
    return "capture" if "wand" in document and document.keys() & _CAPTURE_BESIDE_WAND else None


def check_kind(document: Mapping[str, Any], path: Path, wanted: Kind, error: type[KFMocapError]) -> None:
    """Check that a TOML document is not one of another kind.

    Raises
    ------
    KFMocapError
        Of type `error`: it is; says what it is, and which command it is for.
    """
    kind = document_kind(document)
    if kind is not None and kind != wanted:
        raise error(f"is {_KINDS[kind][0]}, not {_KINDS[wanted][0]}", where=str(path), todo=_KINDS[kind][1])


class Table:
    """One table of a TOML file, read key by key.

    Parameters
    ----------
    values : mapping
    where : str
        File and table, for messages.
    keys : iterable of str
        The keys that the table may have.

    Raises
    ------
    ShotError
        A key is unknown; the methods below raise it if a key is missing or its value has the wrong type.
    """

    def __init__(self, values: Any, where: str, keys: Iterable[str]) -> None:
        if not isinstance(values, Mapping):
            raise ShotError("must be a table", where=where)
        self._values, self.where = values, where
        allowed = list(keys)
        for key in values:
            if key not in allowed:
                near = difflib.get_close_matches(key, allowed, n=1, cutoff=0.5)
                todo = f"did you mean '{near[0]}'?" if near else f"known are {', '.join(allowed)}"
                raise ShotError(f"unknown key '{key[:_SHOWN]}'", where=where, todo=todo)

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def error(self, key: str, what: str, todo: str | None = None) -> ShotError:
        """Return an error about one key."""
        return ShotError(what, where=f"{self.where} {key}", todo=todo)

    def value(self, key: str, default: Any = _REQUIRED) -> Any:
        """Return a value without checking its type."""
        if key in self._values:
            return self._values[key]
        if default is _REQUIRED:
            raise ShotError(f"'{key}' is missing", where=self.where)
        return default

    def text(self, key: str, default: Any = _REQUIRED) -> str:
        """Return a string that is not empty."""
        value: str = self.value(key, default)
        if key in self._values and not (isinstance(value, str) and value.strip()):
            raise self.error(key, f"must be a text in quotes, not {_shown(value)}")
        return value

    def number(self, key: str, default: Any = _REQUIRED) -> float:
        """Return a finite number within `NUMBER_LIMIT`."""
        value: float = self.value(key, default)
        if key in self._values and not _is_number(value):
            raise self.error(key, f"must be a number, not {_shown(value)}")
        return value

    def positive(self, key: str) -> float:
        """Return a number greater than 0."""
        value = self.number(key)
        if value <= 0:
            raise self.error(key, f"must be greater than 0, not {value}")
        return float(value)

    def integers(self, key: str, default: Any = _REQUIRED) -> list[int]:
        """Return a list of integers."""
        value: list[int] = self.value(key, default)
        if key in self._values and not (isinstance(value, list) and all(is_integer(v) for v in value)):
            raise self.error(key, f"must be a list of whole numbers, not {_shown(value)}")
        return value

    def flag(self, key: str) -> bool:
        """Return a boolean, False by default."""
        value = self.value(key, False)
        if not isinstance(value, bool):
            raise self.error(key, f"must be true or false, not {_shown(value)}")
        return value

    def path(self, key: str, folder: Path, default: Any = _REQUIRED) -> Path | Any:
        """Return a path, which is relative to the folder of the file; it may be written with backslashes anywhere."""
        if key not in self._values and default is not _REQUIRED:
            return default
        text = self.text(key)
        if any(character in text for character in "\b\t\n\f\r"):
            raise self.error(key, f"{_shown(text)} cannot be a path: a backslash began an escape", _BACKSLASHES)
        if os.sep == "/":
            text = text.replace("\\", "/")
        longest = max(len(part.encode(errors="replace")) for part in re.split(r"[/\\]", text))
        if "\0" in text or len(text) > _LONGEST_PATH or longest > _LONGEST_NAME:
            raise self.error(key, f"{_shown(text)} cannot be a path")
        return folder / text


def is_integer(value: Any) -> bool:
    """Return whether a value is a whole number, which true and false are not, of a size that can be meant."""
    return isinstance(value, int) and not isinstance(value, bool) and abs(value) <= NUMBER_LIMIT


def _is_number(value: Any) -> bool:
    return is_integer(value) or (isinstance(value, float) and abs(value) <= NUMBER_LIMIT)


def _shown(value: Any) -> str:
    """Return a value as text for a message, cut off if it is long."""
    text = repr(value)
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}..."
