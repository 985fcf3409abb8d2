"""Questions about sequences of names and numbers: what is repeated in them, and which numbers are whole."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from numbers import Real
from typing import TypeVar

Name = TypeVar("Name", bound=Hashable)


def first_repeated(names: Iterable[Name]) -> Name | None:
    """Return the first name that occurs a second time, or None."""
    seen: set[Name] = set()
    for name in names:
        if name in seen:
            return name
        seen.add(name)
    return None


def is_whole(number: object) -> bool:
    """Whether something is a whole number, such as 3 or 3.0; True and False, as a mask has them, are none."""
    return not isinstance(number, bool) and isinstance(number, Real) and number % 1 == 0
