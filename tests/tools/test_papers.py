"""The page on the papers and the script that breaks their terms name the same things, and these are there."""

from __future__ import annotations

from pathlib import Path

import pytest
from papers import TERMS
from papers.term import Term

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "papers.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("term", TERMS, ids=lambda term: term.item)
def test_a_term_can_be_broken_and_its_test_and_its_row_are_there(term: Term) -> None:
    file, _, name = term.test.partition("::")
    assert (ROOT / term.file).read_text(encoding="utf-8").count(term.right) == 1
    assert f"def {name}(" in (ROOT / file).read_text(encoding="utf-8")
    [row] = [line for line in PAGE.splitlines() if line.startswith(f"| {term.item} |")]
    assert f"| {name} |" in row


def test_every_row_with_a_test_has_a_term_that_is_broken() -> None:
    rows = [line.split("|")[1].strip() for line in PAGE.splitlines() if line.startswith("|") and "| test_" in line]
    assert sorted(rows) == sorted(term.item for term in TERMS)
