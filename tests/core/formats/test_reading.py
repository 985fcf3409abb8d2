"""What stops a reader is said with the file's name, in one line of limited length."""

from __future__ import annotations

from pathlib import Path

import pytest
from kfmocap.core.errors import LandmarkError
from kfmocap.core.formats.reading import reading


@pytest.mark.parametrize(
    ("problem", "message"),
    [
        (ValueError("no number\nof markers"), "is not a TRC file, or not whole: no number of markers"),
        (KeyError("points"), "is not a TRC file, or not whole: KeyError 'points'"),
        (RecursionError(), "is not a TRC file: it is nested too deeply"),
        (OSError(5, "Input/output error"), "cannot be read: Input/output error"),
    ],
)
def test_a_problem_is_said_in_words_that_make_sense_alone(problem: Exception, message: str) -> None:
    """The key that is missing would not: its kind of error is said as well."""
    with pytest.raises(LandmarkError) as raised, reading(Path("walk.trc"), "a TRC file", LandmarkError):
        raise problem
    assert str(raised.value) == f"walk.trc: {message}"


def test_errors_that_name_the_file_stay_and_others_get_its_name() -> None:
    for text, said in (("walk.trc: no frames", "walk.trc: no frames"), ("no frames", "walk.trc: no frames")):
        with pytest.raises(LandmarkError) as raised, reading(Path("walk.trc"), "a TRC file", LandmarkError):
            raise LandmarkError(text)
        assert str(raised.value) == said
