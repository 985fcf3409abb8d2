"""A head that is wound up farther than necks turn is led evenly from key pose to key pose, unless images object."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.assessment.settled_solutions import SettledSolution
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.limb_corrections import regained_limbs, wound_heads
from kfmocap.core.tracking.solvers.limb_corrections.regained_limbs import with_limbs_regained
from kfmocap.core.tracking.solvers.limb_corrections.wound_heads import heads, with_heads_unwound
from synthetic import CAMERAS, at_rest, dark, ends_held

BODY, FRAMES, FPS = human(), 24, 30.0
[HEAD] = heads(BODY)


def problem(performers: int = 1) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS for view in dark(camera, FRAMES))
    return SegmentProblem(views, (BODY,) * performers, 0, FPS, (ends_held(BODY, FRAMES),) * performers)


def looking(degrees: float, on_keys: float = 0.0, frames: slice = slice(1, -1)) -> Motion:
    """The head is turned aside on some frames, and by another angle on the key frames."""
    motion, turn = at_rest(BODY, FRAMES), np.zeros((FRAMES, 3))
    turn[frames, 1], turn[[0, -1], 1] = degrees, on_keys
    motion.rotations[:, HEAD] = rotations.exp(np.radians(turn))
    return motion


def solution(given: SegmentProblem, *motions: Motion) -> SegmentSolution:
    evidence = Workspace().measure(given, motions, Sampling(1.0, 1.0, 3, 0.07)).evidence
    return SegmentSolution.of(motions, evidence, iterations=1, energy=[0.0])


def turn(motion: Motion) -> np.ndarray:
    return np.degrees(np.linalg.norm(rotations.log(motion.rotations[:, HEAD]), axis=1))


def test_the_head_is_the_only_tip_of_a_person_that_belongs_to_no_limb() -> None:
    assert BODY.names[HEAD] == "head"


@pytest.mark.parametrize("performer", [0, 1])
def test_a_head_that_looks_backward_is_led_evenly_where_images_say_nothing(performer: int) -> None:
    given, calm = problem(1 + performer), looking(20, 20)
    before = solution(given, *[calm] * performer, looking(150, 20))
    found = with_heads_unwound(given, before, Workspace())
    np.testing.assert_allclose(turn(found.motions[performer]), 20, atol=1)
    for other in range(performer):
        assert found.motions[other] is before.motions[other]
    assert found.only is None


def test_it_is_led_evenly_after_the_search_in_a_long_segment_which_leaves_no_evidence() -> None:
    given = problem()
    before = replace(solution(given, looking(150, 20)), evidence=None)
    found = with_heads_unwound(given, before, Workspace())
    np.testing.assert_allclose(turn(found.motions[0]), 20, atol=1)


def test_nothing_is_solved_without_key_poses_on_both_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    held = ends_held(BODY, FRAMES)
    held[-1] = False
    given = replace(problem(), fixed=(held,))
    before = solution(given, looking(150, 5))
    monkeypatch.setattr(wound_heads, "solved_from", lambda *_: pytest.fail("solved"))
    assert with_heads_unwound(given, before, Workspace()) is before


def test_it_stays_where_the_images_say_clearly_more_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    given = problem()
    before = solution(given, looking(150))
    settled = SettledSolution.after(given, before, Workspace())
    monkeypatch.setattr(SettledSolution, "after", lambda *_: replace(settled, solution=before))
    monkeypatch.setattr(wound_heads, "solved_from", lambda _p, motions, *_: solution(given, *motions))
    for gain, kept in ((1e5, True), (10.0, False)):

        def likelihood(_problem: object, _noise: object, one: SegmentSolution, gain: float = gain) -> float:
            return gain * (turn(one.motions[0])[12] > 90)

        monkeypatch.setattr(wound_heads, "likelihood", likelihood)
        assert (with_heads_unwound(given, before, Workspace()) is before) == kept


@pytest.mark.parametrize(
    "motion",
    [looking(90), looking(150, on_keys=140), looking(150, frames=slice(9, 10))],
    ids=["as far as necks turn", "as keyed", "for a moment"],
)
def test_nothing_is_solved_for_a_head_that_is_not_wound_up(monkeypatch: pytest.MonkeyPatch, motion: Motion) -> None:
    given = problem()
    before = solution(given, motion)
    monkeypatch.setattr(wound_heads, "solved_from", lambda *_: pytest.fail("solved"))
    assert with_heads_unwound(given, before, Workspace()) is before


def test_heads_of_bodies_without_limits_turn_freely() -> None:
    free = replace(BODY, parts=tuple(replace(part, limits=np.array([[-np.pi, np.pi]] * 3)) for part in BODY.parts))
    given = replace(problem(), bodies=(free,))
    before = solution(given, looking(170))
    assert with_heads_unwound(given, before, Workspace()) is before


def test_heads_are_unwound_after_limbs_have_been_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solving for limbs may wind a head up."""
    given = problem()
    monkeypatch.setattr(regained_limbs, "_searched", lambda _p, begin, *_: with_head(begin, looking(150)))
    found = with_limbs_regained(given, solution(given, looking(5)), Workspace())
    assert turn(found.motions[0]).max() < 20


def with_head(begin: SegmentSolution, motion: Motion) -> SegmentSolution:
    return replace(begin, motions=(motion, *begin.motions[1:]))
