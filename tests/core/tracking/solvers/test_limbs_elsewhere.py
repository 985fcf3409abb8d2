"""A limb that is found elsewhere on a few frames of a long segment is tried on these, and kept where it is likelier."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.equations.segment_equations import SegmentNoise
from kfmocap.core.tracking.solvers.judgement.settled_solutions import SettledSolution
from kfmocap.core.tracking.solvers.limb_corrections import limbs_elsewhere
from kfmocap.core.tracking.solvers.limb_corrections.local_trials import ADAPTATION_TIME, HELD_FRAMES
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, dark, ends_held

BODY, FPS, FRAMES = human(1.75), 30.0, 80
ARM = [BODY.index(f"{name}.R") for name in ("upper_arm", "forearm", "hand")]
REST = at_rest(BODY, FRAMES)
AWAY = slice(40, 46)
BESIDE = HELD_FRAMES + round(ADAPTATION_TIME * FPS)


def found(frames: slice, elsewhere: float = 1.0) -> Motion:
    """The arm elsewhere on some frames, and a little beside its place on all others, as sampled poses are."""
    turns = np.full((FRAMES, 3), 0.01)
    turns[frames, 0] = elsewhere
    turns[[0, -1]] = 0.0
    Q = REST.rotations.copy()
    Q[:, ARM[0]] = Q[:, ARM[0]] @ rotations.exp(turns)
    return Motion(REST.translations, Q)


def turned(motion: Motion) -> float:
    return 1000 * float(np.abs(motion.rotations - np.eye(3)).max())


def seen_by(cameras: int, frames: int = FRAMES) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS[:cameras] for view in dark(camera, frames))
    return SegmentProblem(views, (BODY,), 0, FPS, (ends_held(BODY, frames),))


SOLUTION = Landscape(truth=REST).solution(seen_by(0), REST)


@pytest.fixture
def tried(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, int]]:
    """The first frame and the length of every problem that is solved; nothing moves."""
    each: list[tuple[int, int]] = []

    def solved(problem: SegmentProblem, motions: Sequence[Motion], *_: object) -> SegmentSolution:
        each.append((problem.first, problem.length))
        return replace(SOLUTION, motions=tuple(motions))

    monkeypatch.setattr(limbs_elsewhere, "solved_from", solved)
    monkeypatch.setattr(limbs_elsewhere, "settled_further", lambda *given, **_: given[2])
    monkeypatch.setattr(limbs_elsewhere.gauss_newton, "refine", lambda _, motions, *__: solved(*(_, motions)))
    return each


def after(problem: SegmentProblem, motion: Motion) -> SegmentSolution:
    noise = SegmentNoise(*(np.ones((len(problem.views), FRAMES - 1, *more)) for more in ((1,), ())), np.ones(2))
    return limbs_elsewhere.likelier_with_limb(
        problem, SOLUTION, SettledSolution(SOLUTION, noise, SOLUTION), (0, ARM), motion, workspace=Workspace()
    )


@pytest.mark.parametrize("gain", [-1.0, 1.0])
def test_a_limb_that_is_elsewhere_on_few_frames_is_tried_on_these_and_kept_where_it_is_likelier(
    tried: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch, gain: float
) -> None:
    """All other frames stay as they were, though the search has drawn other poses there, too."""
    monkeypatch.setattr(limbs_elsewhere, "likelihood", lambda _p, _n, one: gain * turned(one.motions[0]))
    [motion] = after(seen_by(2), found(AWAY)).motions
    first, length = AWAY.start - BESIDE, AWAY.stop - AWAY.start + 2 * BESIDE
    assert tried == [(first, length)] * 2 + [(0, FRAMES)] * (gain > 0)
    expected = REST.rotations.copy()
    if gain > 0:
        expected[AWAY] = found(AWAY).rotations[AWAY]
    np.testing.assert_array_equal(motion.rotations, expected)


@pytest.mark.parametrize(("cameras", "frames"), [(2, slice(5, 75)), (1, AWAY)])
def test_on_most_frames_or_in_one_view_it_is_tried_in_the_whole_segment(
    tried: list[tuple[int, int]], monkeypatch: pytest.MonkeyPatch, cameras: int, frames: slice
) -> None:
    monkeypatch.setattr(limbs_elsewhere, "likelihood", lambda *_: 0.0)
    after(seen_by(cameras), found(frames))
    assert tried == [(0, FRAMES)]
