"""Comparisons of bodies with frames are kept: evidence is the same with and without, and little memory is taken."""

from __future__ import annotations

from dataclasses import fields

import numpy as np
import pytest
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence import frame_comparison
from kfmocap.core.evidence.frame_comparison import EvidenceCaches, SegmentInViews
from kfmocap.core.evidence.gradient_evidence.gradients import GradientSums
from kfmocap.core.evidence.outline_evidence.outline_sums import OutlineSums
from kfmocap.core.evidence.rendering.part_geometry import Geometry, PerformerParts
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.segment_evidence import SegmentEvidence, accumulate_evidence
from kfmocap.core.evidence.view_frames import ViewFrames
from synthetic import at_rest, figure, look_at, picture, poses_of, silhouette

Array = np.ndarray
BODY = figure()
PARTS = PerformerParts(Geometry.of([BODY]))
CAMERA = look_at("cam", (0.8, -2.2, 1.6))
SHIFTS = np.random.default_rng(0).normal(0, 0.01, (3, BODY.dof))


def moved(times: float) -> Motion:
    return at_rest(BODY, 3).moved(times * SHIFTS)


@pytest.fixture(scope="module")
def view() -> ViewFrames:
    """A rendered body that moves a little, and its foreground images."""
    poses = poses_of([BODY], [moved(1.0)])
    grey = np.stack([picture([BODY], poses, f, CAMERA) for f in range(3)])
    shown = np.stack([silhouette([BODY], poses, f, CAMERA) for f in range(3)])
    return ViewFrames(CAMERA, grey, 0, shown[None])


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """A list that grows by an element with every drawing of a body."""
    done: list[int] = []
    render = frame_comparison.render_labels
    monkeypatch.setattr(frame_comparison, "render_labels", lambda *of: done.append(1) or render(*of))
    return done


def evidence_of(
    view: ViewFrames,
    motion: Motion,
    caches: EvidenceCaches | None = None,
    *,
    noise: float | None = None,
    by_part: bool = False,
) -> SegmentEvidence:
    given = None if noise is None else np.full((1, len(view.grey) - 1, 1 + len(BODY)), noise)
    sampling, poses = Sampling(1.0, 1.0, 2, 0.1, by_part), {0.0: poses_of([BODY], [motion])}
    return accumulate_evidence(SegmentInViews((view,), 0, poses, sampling), PARTS, noise=given, caches=caches)


def assert_same(found: SegmentEvidence, expected: SegmentEvidence) -> None:
    for name, sums in (("gradients", GradientSums), ("outlines", OutlineSums)):
        for item in fields(sums):
            own, other = (getattr(getattr(evidence, name), item.name) for evidence in (found, expected))
            np.testing.assert_array_equal(own, other)
    for name in ("explained", "unhidden", "share", "agreeing"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_the_same_poses_are_weighed_by_another_noise_without_being_drawn_again(
    view: ViewFrames, drawn: list[int]
) -> None:
    caches, motion = EvidenceCaches(), moved(1.3)
    evidence_of(view, motion, caches)
    for noise, by_part in ((0.01, False), (None, True), (0.02, True), (None, False)):
        count = len(drawn)
        found = evidence_of(view, motion, caches, noise=noise, by_part=by_part)
        assert len(drawn) == count
        assert_same(found, evidence_of(view, motion, noise=noise, by_part=by_part))


def test_a_descent_finds_its_end_again_after_a_step_that_was_refused(view: ViewFrames, drawn: list[int]) -> None:
    caches = EvidenceCaches()
    for times in (0.5, 1.0, 1.5):
        evidence_of(view, moved(times), caches)
    assert len(drawn) == 3
    evidence_of(view, moved(1.0), caches, noise=0.01)
    assert len(drawn) == 3
    evidence_of(view, moved(0.5), caches)
    assert len(drawn) == 4, "two are kept"
    evidence_of(view, moved(1.0), caches)
    assert len(drawn) == 4, "those used last"


def test_comparisons_that_would_take_much_memory_are_not_kept(
    view: ViewFrames, drawn: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(frame_comparison, "MAX_CACHED_BYTES", 1000)
    caches = EvidenceCaches()
    for _ in range(2):
        evidence_of(view, moved(1.0), caches)
    assert len(drawn) == 2
