"""Evidence of the last evaluations is kept for the same motions under the same noise, and for nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.tracking.solvers.equations import measurement
from kfmocap.core.tracking.solvers.equations.measurement import CACHED_EVALUATIONS, RecentEvidence
from made_evidence import no_evidence

POSES, NOISE = np.arange(6.0), np.ones(3)


@pytest.mark.parametrize("noise", [None, NOISE])
def test_evidence_is_kept_for_equal_arrays_and_the_same_objects(noise: np.ndarray | None) -> None:
    recent, evidence = RecentEvidence(), no_evidence(1, 3, 2)
    recent.keep(("views", 4), [noise, POSES], evidence)
    again = None if noise is None else noise.copy()
    found = recent.evidence(("views", 4), [again, POSES.copy()])
    assert found is not None and found.gradients is evidence.gradients
    assert recent.evidence(("views", 5), [again, POSES]) is None
    assert recent.evidence(("views", 4), [again, POSES + 1e-12]) is None
    other = NOISE if noise is None else None
    assert recent.evidence(("views", 4), [other, POSES]) is None


def test_what_is_kept_takes_no_time_again() -> None:
    recent = RecentEvidence()
    evidence = no_evidence(1, 3, 2)
    evidence.seconds["gradients"] = 2.0
    recent.keep((), [POSES], evidence)
    found = recent.evidence((), [POSES])
    assert found is not None and found.seconds == {"gradients": 0.0}


def test_the_oldest_goes_first_and_of_what_is_large_fewer_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    recent = RecentEvidence()
    for k in range(CACHED_EVALUATIONS + 1):
        recent.keep((k,), [POSES], no_evidence(1, 3, 2))
    kept = [recent.evidence((k,), [POSES]) is not None for k in range(CACHED_EVALUATIONS + 1)]
    assert kept == [False] + [True] * CACHED_EVALUATIONS
    size = no_evidence(1, 3, 2).gradients.H.nbytes
    monkeypatch.setattr(measurement, "MAX_EVIDENCE_BYTES", 2 * size)
    for name in ("large", "next", "last"):
        recent.keep((name,), [POSES], no_evidence(1, 3, 2))
    kept = [recent.evidence((name,), [POSES]) is not None for name in ("large", "next", "last")]
    assert kept == [False, True, True], "a descent begins where the last evaluation or the one before it was"
    monkeypatch.setattr(measurement, "MAX_EVIDENCE_BYTES", size - 1)
    recent.keep(("larger",), [POSES], no_evidence(1, 3, 2))
    assert recent.evidence(("larger",), [POSES]) is None


def test_what_would_have_to_go_can_go_before_the_next_is_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    recent, size = RecentEvidence(), no_evidence(1, 3, 2).gradients.H.nbytes
    monkeypatch.setattr(measurement, "MAX_EVIDENCE_BYTES", 2 * size)
    recent.make_room()
    for name in ("first", "second"):
        recent.keep((name,), [POSES], no_evidence(1, 3, 2))
    recent.make_room()
    assert [recent.evidence((name,), [POSES]) is not None for name in ("first", "second")] == [False, True]
    recent.forget()
    assert recent.evidence(("second",), [POSES]) is None
