"""Heads, hands and feet that turn farther than their joints do are led evenly from key pose to key pose, unless images
object.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, keypoints_of, seen_places
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.keypoints.keypoint_factor import KeypointFactor
from kfmocap.core.keypoints.keypoint_offsets import KeypointOffsets
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers import gauss_newton_solver
from kfmocap.core.tracking.solvers.assessment.settled_solutions import SettledSolution
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.limb_corrections import regained_limbs, wound_ends
from kfmocap.core.tracking.solvers.limb_corrections.regained_limbs import with_limbs_regained
from kfmocap.core.tracking.solvers.limb_corrections.wound_ends import ends, with_ends_unwound
from synthetic import CAMERAS, at_rest, coloured, dark, ends_held

BODY, FRAMES, FPS = human(), 24, 30.0
HEAD, FOOT, HAND = (BODY.index(name) for name in ("head", "foot.R", "hand.L"))


def problem(performers: int = 1) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS for view in dark(camera, FRAMES))
    return SegmentProblem(views, (BODY,) * performers, 0, FPS, (ends_held(BODY, FRAMES),) * performers)


def looking(degrees: float, on_keys: float = 0.0, frames: slice = slice(1, -1), part: int = HEAD) -> Motion:
    """The head, or another part, is turned aside on some frames, and by another angle on the key frames."""
    motion, turn = at_rest(BODY, FRAMES), np.zeros((FRAMES, 3))
    turn[frames, 1], turn[[0, -1], 1] = degrees, on_keys
    motion.rotations[:, part] = rotations.exp(np.radians(turn))
    return motion


def solution(given: SegmentProblem, *motions: Motion) -> SegmentSolution:
    evidence = Workspace().measure(given, motions, Sampling(1.0, 1.0, 3, 0.07)).evidence
    return SegmentSolution.of(motions, evidence, iterations=1, energy=[0.0])


def turn(motion: Motion, part: int = HEAD) -> np.ndarray:
    return np.degrees(np.linalg.norm(rotations.log(motion.rotations[:, part]), axis=1))


def test_a_person_can_wind_up_what_no_search_for_limbs_turns() -> None:
    assert {BODY.names[part] for part in ends(BODY)} == {"head", "hand.L", "hand.R", "foot.L", "foot.R"}


@pytest.mark.parametrize("performer", [0, 1])
def test_a_head_that_looks_backward_is_led_evenly_where_images_say_nothing(performer: int) -> None:
    given, calm = problem(1 + performer), looking(20, 20)
    before = solution(given, *[calm] * performer, looking(150, 20))
    found = with_ends_unwound(given, before, Workspace())
    np.testing.assert_allclose(turn(found.motions[performer]), 20, atol=1)
    for other in range(performer):
        assert found.motions[other] is before.motions[other]
    assert found.only is None


@pytest.mark.parametrize("part", [FOOT, HAND], ids=["a foot", "a hand"])
def test_so_is_what_points_backward(part: int) -> None:
    given = problem()
    found = with_ends_unwound(given, solution(given, looking(130, 20, part=part)), Workspace())
    np.testing.assert_allclose(turn(found.motions[0], part), 20, atol=1)


def test_it_is_led_evenly_after_the_search_in_a_long_segment_which_leaves_no_evidence() -> None:
    given = problem()
    before = replace(solution(given, looking(150, 20)), evidence=None)
    found = with_ends_unwound(given, before, Workspace())
    np.testing.assert_allclose(turn(found.motions[0]), 20, atol=1)


@pytest.mark.parametrize("part", [FOOT, HAND, HEAD], ids=["a foot", "a hand", "a head"])
def test_beyond_the_last_key_pose_it_stays_as_on_that_one_and_without_any_as_at_rest(part: int) -> None:
    for keys, expected in (([0], 20.0), ([], 0.0)):
        held = np.zeros_like(ends_held(BODY, FRAMES))
        held[keys] = True
        given = replace(problem(), fixed=(held,))
        found = with_ends_unwound(given, solution(given, looking(130, 20, part=part)), Workspace())
        np.testing.assert_allclose(turn(found.motions[0], part), expected, atol=1)


def test_it_stays_where_the_images_say_clearly_more_for_it(monkeypatch: pytest.MonkeyPatch) -> None:
    given = problem()
    before = solution(given, looking(150))
    settled = SettledSolution.after(given, before, Workspace())
    monkeypatch.setattr(SettledSolution, "after", lambda *_: replace(settled, solution=before))
    monkeypatch.setattr(wound_ends, "solved_from", lambda _p, motions, *_: solution(given, *motions))
    for gain, kept in ((1e5, True), (10.0, False)):

        def likelihood(_problem: object, _noise: object, one: SegmentSolution, gain: float = gain) -> float:
            return gain * (turn(one.motions[0])[12] > 90)

        monkeypatch.setattr(wound_ends, "likelihood", likelihood)
        assert (with_ends_unwound(given, before, Workspace()) is before) == kept


@pytest.mark.parametrize(
    "motion",
    [looking(90), looking(150, on_keys=140), looking(150, frames=slice(9, 10))],
    ids=["as far as necks turn", "as keyed", "for a moment"],
)
def test_nothing_is_solved_for_a_head_that_is_not_wound_up(monkeypatch: pytest.MonkeyPatch, motion: Motion) -> None:
    given = problem()
    before = solution(given, motion)
    monkeypatch.setattr(wound_ends, "solved_from", lambda *_: pytest.fail("solved"))
    assert with_ends_unwound(given, before, Workspace()) is before


def test_heads_of_bodies_without_limits_turn_freely() -> None:
    free = replace(BODY, parts=tuple(replace(part, limits=np.array([[-np.pi, np.pi]] * 3)) for part in BODY.parts))
    given = replace(problem(), bodies=(free,))
    before = solution(given, looking(170))
    assert with_ends_unwound(given, before, Workspace()) is before


def test_heads_are_unwound_after_limbs_have_been_searched_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solving for limbs may wind a head up."""
    given = problem()
    monkeypatch.setattr(regained_limbs, "_searched", lambda _p, begin, *_: with_head(begin, looking(150)))
    found = with_limbs_regained(given, solution(given, looking(5)), Workspace())
    assert turn(found.motions[0]).max() < 20


def with_head(begin: SegmentSolution, motion: Motion) -> SegmentSolution:
    return replace(begin, motions=(motion, *begin.motions[1:]))


def with_keypoints() -> SegmentProblem:
    """Nothing is keyed, and keypoints show a standing person."""
    seen = keypoints_of(cameras(2), seen_places(BODY, at_rest(BODY, FRAMES)))
    factor = KeypointFactor(seen, KeypointOffsets.on(BODY, NAMES), 9.0)
    return replace(problem(), fixed=(np.zeros_like(ends_held(BODY, FRAMES)),), keypoints=(factor,))


def test_without_key_poses_hands_that_no_keypoint_shows_are_unwound_in_the_refinement(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given, motion = with_keypoints(), looking(130, part=HAND)
    given = replace(given, views=coloured(BODY, at_rest(BODY, FRAMES), CAMERAS))
    monkeypatch.setattr(gauss_newton_solver, "refine", lambda _p, motions, *_: solution(given, *motions))
    found = gauss_newton_solver.refined(given, [motion], Workspace())
    assert wound_ends.turned_too_far(given, 0, HAND, motion).any()
    assert not wound_ends.turned_too_far(given, 0, HAND, found.motions[0]).any()


def test_what_keypoints_show_stays(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(wound_ends, "solved_from", lambda *_: pytest.fail("solved"))
    given = with_keypoints()
    before = solution(given, looking(130, part=FOOT))
    assert with_ends_unwound(given, before, Workspace()) is before


def test_ends_of_which_one_is_right_are_led_one_after_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """The images say clearly that the hand is bent as it is."""
    given, motion = problem(), looking(130, part=FOOT)
    motion.rotations[:, HAND] = looking(130, part=HAND).rotations[:, HAND]
    before = solution(given, motion)
    settled = SettledSolution.after(given, before, Workspace())
    monkeypatch.setattr(SettledSolution, "after", lambda _, begin, __: replace(settled, solution=begin))
    monkeypatch.setattr(wound_ends, "solved_from", lambda _p, motions, *_: solution(given, *motions))
    monkeypatch.setattr(wound_ends, "likelihood", lambda _p, _n, one: 1e5 * (turn(one.motions[0], HAND)[12] > 90))
    found = with_ends_unwound(given, before, Workspace()).motions[0]
    assert turn(found, HAND)[12] > 90 and turn(found, FOOT)[12] < 1
