"""A job's progress is divided among its parts without a gap, and cancelling a part cancels the job."""

from __future__ import annotations

from contextlib import nullcontext

import numpy as np
import pytest
from kfmocap.core.errors import CancelledError
from kfmocap.core.runtime.progress import report_progress, share, step_share


def test_parts_of_parts_add_up_to_the_job() -> None:
    seen: list[float] = []
    job = lambda what, fraction: not seen.append(fraction)  # noqa: E731
    half = share(job, 0.5, 1.0)
    for part in (share(half, 0.0, 0.5), share(half, 0.5, 1.0)):
        for fraction in (0.0, 1.0):
            report_progress(part, "work", fraction)
    assert seen == [0.5, 0.75, 0.75, 1.0]


def test_cancelling_a_part_cancels_the_job() -> None:
    with pytest.raises(CancelledError):
        report_progress(share(lambda what, fraction: False, 0.0, 0.5), "work", 0.3)


@pytest.mark.parametrize(
    ("answer", "cancelled"),
    [(np.False_, True), (np.True_, False), (None, False), (0, False), (np.float64(0), False), (True, False)],
)
def test_what_a_comparison_in_numpy_answers_cancels_as_well(answer: object, cancelled: bool) -> None:
    with pytest.raises(CancelledError) if cancelled else nullcontext():
        report_progress(lambda what, fraction: answer, "work", 0.3)


def test_no_callback_has_no_parts() -> None:
    assert share(None, 0.0, 0.5) is None
    assert step_share(None, 0.0, 0.5) is None


def test_a_solver_step_keeps_its_state() -> None:
    seen: list[tuple[float, str]] = []
    step = step_share(lambda fraction, state: seen.append((fraction, state)), 0.2, 0.4)
    assert step is not None
    step(0.5, "poses")
    assert seen == [(pytest.approx(0.3), "poses")]
