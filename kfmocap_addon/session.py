"""What the add-on keeps in memory while it is registered, and how it is taken back.

Blender calls handlers, panels and tools without a place to keep anything between two calls, and wants the handles that
it gave when something is removed. `SESSION` is the only state of the add-on's own beside Blender's data; nothing of it
is saved, and everything can be made again.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from functools import lru_cache
from typing import Any, ParamSpec, Protocol, TypeVar

Arguments = ParamSpec("Arguments")
Value = TypeVar("Value")


class Kept(Protocol):
    """What can be kept in a session: it is made without arguments, and cleared when the session ends."""

    def clear(self) -> None:
        """Let go of everything."""


Kind = TypeVar("Kind", bound=Kept)


class Session:
    """The add-on from being registered to being unregistered."""

    def __init__(self) -> None:
        self._removals = ExitStack()
        self._kept: dict[type[Kept], Kept] = {}
        self._remembered: dict[Callable[..., Any], Callable[..., Any]] = {}

    def on_end(self, remove: Callable[..., object], *arguments: Any) -> None:
        """Have something removed when the session ends, before what was added earlier."""
        self._removals.callback(remove, *arguments)

    def of(self, kind: type[Kind]) -> Kind:
        """Return the session's instance of a class, which is made when it is first asked for."""
        if kind not in self._kept:
            self._kept[kind] = kind()
        kept = self._kept[kind]
        assert isinstance(kept, kind)
        return kept

    def remembering(self, function: Callable[Arguments, Value], most: int) -> Callable[Arguments, Value]:
        """Return a function that remembers its last values, because Blender draws the same thing again and again.

        Parameters
        ----------
        function : callable
            Its value depends on its arguments alone, and is never changed.
        most : int
            Number of values that are remembered.
        """
        if function not in self._remembered:
            self._remembered[function] = lru_cache(maxsize=most)(function)
        return self._remembered[function]

    def end(self) -> None:
        """Remove what was added, and forget the rest."""
        self._removals.close()
        for kept in self._kept.values():
            kept.clear()
        self._kept.clear()
        self._remembered.clear()


SESSION = Session()
"""The add-on's session in this process."""
