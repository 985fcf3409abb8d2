"""A term of the papers, and how to break it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Term:
    """A term and a way to break it.

    Attributes
    ----------
    item : str
        What the papers call it, as in the first column of docs/papers.md.
    file : str
    right, wrong : str
        A piece of the file that is there once, and what it is replaced by.
    test : str
        The test that then fails: its file and its name.
    """

    item: str
    file: str
    right: str
    wrong: str
    test: str
