"""Telling degenerate captures: before anything is solved, from the links between views, and from a solution."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .capture import Capture
from .initial import Link
from .findings import Finding
from .pairwise import Lens

if TYPE_CHECKING:
    from .solve import Solution

FEWEST_FRAMES = 20

def check_capture(capture: Capture) -> None:
    pass

def check_links(names: Sequence[str], links: Sequence[Link], lenses: Sequence[Lens]) -> None:
    pass

def doubts(solution) -> list[Finding]:
    return []
