"""Solutions are doubted, limbs are searched for, and the best of what is found counts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limb_pairs, limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.occlusion import LONG_GAP
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers import gauss_newton, gauss_newton_solver, multi_start
from kfmocap.core.tracking.solvers.approach import Approach
from kfmocap.core.tracking.solvers.assessment import solution_doubts, solution_ranking
from kfmocap.core.tracking.solvers.assessment.settled_solutions import SettledSolution
from kfmocap.core.tracking.solvers.descent_stages import (
    FINE_STAGES,
    FREE_STAGES,
    MAX_EXTRA_ITERATIONS,
    SETTLED,
    STAGES,
)
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.limb_corrections import limb_exchange, search_rounds
from kfmocap.core.tracking.solvers.limb_corrections.local_trials import ADAPTATION_TIME, HELD_FRAMES
from kfmocap.core.tracking.solvers.limb_corrections.swapped_limbs import exchanges, swaps
from kfmocap.core.tracking.solvers.limb_evidence.limb_likelihood import MIN_GAIN
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, coloured, dark, ends_held, figure, swing

BODY = figure()
HUMAN = human(1.75)
ARMS, LEGS = (left + right for left, right in limb_pairs(HUMAN))
FPS = 30.0
LENGTH = LONG_GAP + 2


def test_fixed_degrees_of_freedom_do_not_move() -> None:
    F = 7
    start = swing(BODY, F, 0.3)
    fixed = ends_held(BODY, F)
    fixed[3, 6:9] = fixed[2, 0] = True
    problem = SegmentProblem(dark(CAMERAS[0], F), (BODY,), 0, FPS, (fixed,))
    found = multi_start.best_of_starts(problem, [start], Workspace()).motions[0]
    moved = start.difference(found)
    np.testing.assert_allclose(moved[fixed], 0, atol=1e-12)
    assert np.abs(moved[1:-1]).max() > 1e-2


@pytest.mark.parametrize(
    ("views", "plants", "contradicted", "solved_by"),
    [
        (2, True, False, (FREE_STAGES,)),
        (2, True, True, (FREE_STAGES, FINE_STAGES)),
        (2, False, True, (FREE_STAGES,)),
        (1, True, True, (STAGES,)),
    ],
)
def test_soles_are_left_free_first_unless_the_images_contradict_that(
    monkeypatch: pytest.MonkeyPatch, views: int, plants: bool, contradicted: bool, solved_by: tuple[object, ...]
) -> None:
    """A single view hardly shows how feet creep."""
    shown = tuple(view for camera in CAMERAS[:views] for view in dark(camera, LENGTH))
    problem = SegmentProblem(shown, (HUMAN,), 0, FPS, (ends_held(HUMAN, LENGTH),), settings=Settings(plants=plants))
    landscape, asked = Landscape(truth=at_rest(HUMAN, LENGTH)), list[object]()
    begin, made = landscape.truth, list[SegmentSolution]()

    def descend(_: object, begun: Sequence[Motion] | Approach, __: object, stages: object) -> SegmentSolution:
        asked.append(stages)
        [motion] = begun.motions if isinstance(begun, Approach) else begun
        made.append(replace(landscape.solution(problem, motion), seconds={"solve": 1.0}))
        return made[-1]

    monkeypatch.setattr(multi_start, "descend", descend)
    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: [0] * contradicted)
    found = multi_start.first_solution(problem, [begin], Workspace())
    assert tuple(asked) == solved_by and found.motions is made[-1].motions
    assert found.seconds["solve"] == len(solved_by)
    assert found.iterations == sum(one.iterations for one in made)


def test_without_the_search_a_doubted_solution_stands() -> None:
    truth = swing(BODY, 5, 0.2)
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, 5),))
    beside = np.zeros((5, BODY.dof))
    beside[1:4, 0] = 1.0
    start = [truth.moved(beside)]
    first = gauss_newton.descend(problem, start, Workspace())
    assert solution_doubts.doubted_performers(problem, start, first) == [0]
    without, searched = (
        multi_start.best_of_starts(replace(problem, settings=Settings(limb_search=on)), start, Workspace())
        for on in (False, True)
    )
    np.testing.assert_array_equal(without.motions[0].rotations, first.motions[0].rotations)
    assert "initial solution" in searched.seconds
    assert "initial solution" not in without.seconds


@pytest.mark.parametrize("found", [False, True])
def test_limbs_are_exchanged_only_once_the_search_has_found_another_motion(
    monkeypatch: pytest.MonkeyPatch, found: bool
) -> None:
    """A doubt that the search dispels is no reason for it."""
    landscape, asked = Landscape(truth=TRUTH, reach=0.0), list[SegmentSolution]()
    first, other = (landscape.solution(PROBLEM, motion) for motion in (TRUTH, off(TRUTH, ARMS, 0.3)))
    other = replace(other, doubted=(0,))
    monkeypatch.setattr(multi_start, "descend", lambda *_: first)
    monkeypatch.setattr(multi_start, "doubted_performers", lambda *_: [0])
    monkeypatch.setattr(multi_start, "best_of_own_starts", lambda *_: other if found else first)
    monkeypatch.setattr(multi_start, "with_limbs_exchanged", lambda _problem, best, *_: asked.append(best) or best)
    multi_start.best_of_starts(PROBLEM, [TRUTH], Workspace())
    assert asked == [other] * found


@pytest.mark.parametrize(("contradicted", "elsewhere"), [(False, False), (False, True), (True, False)])
def test_one_round_of_the_search_is_enough_where_nothing_but_foreground_contradicts(
    monkeypatch: pytest.MonkeyPatch, contradicted: bool, elsewhere: bool
) -> None:
    landscape, rounds = Landscape(truth=TRUTH, reach=0.0), list[bool]()
    lost, found = (landscape.solution(PROBLEM, motion) for motion in (off(TRUTH, ARMS, 0.9), TRUTH))
    monkeypatch.setattr(multi_start, "images_contradict", lambda *_: contradicted)
    monkeypatch.setattr(search_rounds.TrialRound, "explains", lambda *_: elsewhere)
    monkeypatch.setattr(search_rounds, "search_round", lambda *_, **__: rounds.append(True) or found)
    best = multi_start.searched_once(PROBLEM, lost, landscape)
    assert len(rounds) == (not contradicted)
    assert (None if best is None else best.motions) == (
        None if contradicted else found.motions if elsewhere else lost.motions
    )


@pytest.mark.parametrize(("contradicted", "elsewhere"), [(False, False), (False, True), (True, False)])
def test_a_motion_that_was_followed_ends_the_doubt_unless_the_pictures_contradict_it_or_a_look_finds_limbs_elsewhere(
    monkeypatch: pytest.MonkeyPatch, contradicted: bool, elsewhere: bool
) -> None:
    landscape = Landscape(truth=TRUTH, reach=0.0)
    lost, found = (landscape.solution(PROBLEM, motion) for motion in (off(TRUTH, ARMS, 0.9), TRUTH))
    monkeypatch.setattr(multi_start, "follow_both_ways", lambda *_: [TRUTH])
    monkeypatch.setattr(multi_start, "with_whole_turn", lambda _problem, start, first, _: (start, first))
    monkeypatch.setattr(multi_start, "images_contradict", lambda _, one: contradicted or one is lost)
    monkeypatch.setattr(multi_start, "is_doubtful", lambda _, one: one is lost)
    monkeypatch.setattr(search_rounds.TrialRound, "gains", lambda *_: elsewhere)
    monkeypatch.setattr(search_rounds, "search_round", lambda *_, **__: found)
    best = multi_start.best_of_own_starts(PROBLEM, lost.motions, lost, landscape)
    assert best.doubted == ((0,) if contradicted or elsewhere else ())
    assert error(best) < 0.01


@pytest.mark.parametrize(
    ("apart", "contradicted", "elsewhere", "doubted"),
    [
        (0.0, False, False, False),
        (1.1, False, False, True),
        (0.0, True, False, True),
        (0.0, False, True, True),
    ],
)
def test_two_starts_that_lead_to_the_same_motion_end_the_doubt_that_it_explains_too_little(
    monkeypatch: pytest.MonkeyPatch, apart: float, contradicted: bool, elsewhere: bool, doubted: bool
) -> None:
    """Unless a limb of it is contradicted, or a look around it finds limbs elsewhere."""
    landscape = Landscape(truth=TRUTH, reach=0.0)
    first = landscape.solution(PROBLEM, off(TRUTH, ARMS, 0.05))
    monkeypatch.setattr(multi_start, "follow_both_ways", lambda *_: [off(TRUTH, ARMS, 0.05 + apart)])
    monkeypatch.setattr(multi_start, "with_whole_turn", lambda _problem, start, first, _: (start, first))
    monkeypatch.setattr(multi_start, "images_contradict", lambda *_: True)
    monkeypatch.setattr(multi_start, "is_doubtful", lambda *_: True)
    monkeypatch.setattr(multi_start, "limb_contradicted", lambda *_: contradicted)
    monkeypatch.setattr(search_rounds.TrialRound, "gains", lambda *_: elsewhere)
    monkeypatch.setattr(search_rounds, "search_round", lambda *_, **__: first)
    best = multi_start.best_of_own_starts(PROBLEM, first.motions, first, landscape)
    assert best.doubted == ((0,) if doubted else ())


@pytest.mark.parametrize(("little", "keys", "views"), [(False, 2, 2), (True, 2, 1), (True, 1, 2), (True, 1, 1)])
def test_a_motion_is_followed_only_where_too_little_of_the_body_is_explained(
    monkeypatch: pytest.MonkeyPatch, little: bool, keys: int, views: int
) -> None:
    """A limb that is lost alone is searched for around the solution: following the whole body would not find it.

    So it is before the first key pose and after the last one, too, but in a single view many poses look alike there.
    """
    landscape, followed, begun = Landscape(truth=TRUTH, reach=0.0), list[bool](), list[int]()
    fixed = PROBLEM.fixed[0].copy()
    fixed[0] &= keys == 2
    problem = replace(PROBLEM, fixed=(fixed,))
    monkeypatch.setattr(SegmentProblem, "shows_depth", views > 1)
    first = landscape.solution(problem, off(TRUTH, ARMS, 0.05))
    monkeypatch.setattr(multi_start, "follow_both_ways", lambda *_: followed.append(True) or [TRUTH])
    monkeypatch.setattr(multi_start, "with_whole_turn", lambda _problem, start, first, _: (start, first))
    monkeypatch.setattr(multi_start, "images_contradict", lambda *_: True)
    monkeypatch.setattr(multi_start, "is_doubtful", lambda *_: little)
    monkeypatch.setattr(multi_start, "limb_contradicted", lambda *_: True)
    monkeypatch.setattr(multi_start, "searched", lambda _p, _s, from_, *_, **__: begun.append(len(from_)) or first)
    assert multi_start.best_of_own_starts(problem, first.motions, first, landscape).doubted == (0,)
    assert followed == [True] * little and begun == [1 + little] * (keys + views > 2)


def test_it_takes_two_starts_to_agree() -> None:
    solution = Landscape(truth=TRUTH).solution(PROBLEM, TRUTH)
    assert multi_start.starts_agree(PROBLEM, solution, solution)
    assert not multi_start.starts_agree(PROBLEM, solution)


def explained(problem: SegmentProblem, motion: Motion) -> SegmentSolution:
    """A motion as if it had been found."""
    evidence = Workspace().measure(problem, [motion], Sampling(1.0, 1.0, 2, 0.07)).evidence
    return SegmentSolution.of([motion], evidence, iterations=1, energy=[0.0])


def test_a_body_that_covers_background_is_doubted() -> None:
    truth = swing(BODY, 5, 0.2)
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, 5),))
    assert not solution_doubts.is_doubtful(problem, explained(problem, truth))
    beside = np.zeros((5, BODY.dof))
    beside[2, 0] = 0.35
    assert solution_doubts.is_doubtful(problem, explained(problem, truth.moved(beside)))


def test_a_body_that_shows_less_of_itself_than_on_the_key_frames_is_not_doubted_but_one_that_covers_less_is() -> None:
    """A human turns sideways to the only camera: two thirds of the front are to be seen."""
    truth = at_rest(HUMAN, 5)
    truth.rotations[2, 0] = rotations.exp(np.array([0.0, np.pi / 2, 0.0]))
    problem = SegmentProblem(coloured(HUMAN, truth, CAMERAS[:1]), (HUMAN,), 0, FPS, (ends_held(HUMAN, 5),))
    found = explained(problem, truth)
    assert solution_doubts.explained_share(problem, found, 0)[2] < 0.75
    assert not solution_doubts.is_doubtful(problem, found)
    beside = np.zeros((5, HUMAN.dof))
    beside[2, 0] = 0.1
    assert solution_doubts.is_doubtful(problem, explained(problem, truth.moved(beside)))


@pytest.mark.parametrize(("wrong", "expected"), [(0, False), (LONG_GAP - 1, False), (LONG_GAP, True)])
def test_a_view_that_shows_a_limb_where_the_solution_has_none_for_long_calls_for_a_search(
    wrong: int, expected: bool
) -> None:
    rest = at_rest(HUMAN, LENGTH)
    raised = rest.rotations.copy()
    raised[:, HUMAN.index("upper_arm.L")] = rotations.exp(np.array([0.0, 0.0, 1.2]))
    truth = Motion(rest.translations, raised)
    lowered = truth.rotations.copy()
    lowered[1 : 1 + wrong] = rest.rotations[1 : 1 + wrong]
    problem = SegmentProblem(coloured(HUMAN, truth, CAMERAS), (HUMAN,), 0, FPS, (ends_held(HUMAN, LENGTH),))
    found = explained(problem, Motion(rest.translations, lowered))
    assert solution_doubts.performers_uncovered(problem, found.motions) == [0] * expected


def test_foreground_beside_an_earlier_motion_is_not_searched_for_limbs_again() -> None:
    """A small correction is not followed by another search."""
    rest = at_rest(HUMAN, LENGTH)
    raised = rest.rotations.copy()
    raised[1:-1, HUMAN.index("upper_arm.L")] = rotations.exp(np.array([0.0, 0.0, 1.2]))
    truth = Motion(rest.translations, raised)
    problem = SegmentProblem(coloured(HUMAN, truth, CAMERAS), (HUMAN,), 0, FPS, (ends_held(HUMAN, LENGTH),))
    nearly = rest.moved(np.full((LENGTH, HUMAN.dof), 0.01))
    assert solution_doubts.performers_uncovered(problem, [nearly]) == [0]
    assert solution_doubts.performers_uncovered(problem, [nearly], [rest]) == []
    assert solution_doubts.performers_uncovered(problem, [rest], [truth]) == [0]


@pytest.mark.parametrize(("moved", "known"), [(0.01, True), (0.5, False)])
def test_after_a_large_correction_limbs_are_searched_for_again(
    moved: float, known: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = swing(BODY, 5, 0.2)
    problem = SegmentProblem(dark(CAMERAS[0], 5), (BODY,), 0, FPS, (ends_held(BODY, 5),))
    step = np.zeros((5, BODY.dof))
    step[0, 0] = moved
    asked: list[object] = []
    monkeypatch.setattr(gauss_newton_solver, "doubted_performers", lambda *given: asked.append(given[3]))
    start = [truth]
    assert gauss_newton_solver.resumed(problem, start, Workspace(), [truth.moved(step)]) is not None
    assert asked == [start if known else None]


@pytest.mark.parametrize(
    ("wrong", "hidden", "expected"), [(0, False, False), (2, False, False), (3, False, True), (3, True, False)]
)
def test_a_limb_on_the_background_of_one_view_for_more_than_a_moment_calls_for_a_search(
    wrong: int, hidden: bool, expected: bool
) -> None:
    """Unless furniture is before it, which hides it on the key frames as well."""
    rest = at_rest(HUMAN, LENGTH)
    turns = rest.rotations.copy()
    turns[1 : 1 + wrong, HUMAN.index("upper_arm.L")] = rotations.exp(np.array([0.0, 0.0, 1.2]))
    views = coloured(HUMAN, rest, CAMERAS)
    if hidden:
        views = tuple(replace(view, foreground=np.full_like(view.foreground, 4)) for view in views)
    problem = SegmentProblem(views, (HUMAN,), 0, FPS, (ends_held(HUMAN, LENGTH),))
    assert solution_doubts.limb_on_background(problem, explained(problem, Motion(rest.translations, turns))) == expected


def test_whether_a_solution_is_doubtful_is_judged_by_the_key_poses() -> None:
    """What is expected between them lies between what they explain."""
    total = np.array([100.0, 90, 80, 70, 60])
    share, none, unhidden = np.ones((1, 5, len(BODY))), np.zeros(5), np.ones((1, 5))

    def doubted(explained: np.ndarray, fixed: np.ndarray) -> bool:
        problem = SegmentProblem((), (BODY,), 0, FPS, (fixed,))
        found = SegmentSolution((swing(BODY, 5),), 1, (), share, explained[None], unhidden, none, {})
        return solution_doubts.is_doubtful(problem, found)

    assert not doubted(total, ends_held(BODY, 5))
    assert not doubted(total * [1, 0.85, 0.85, 0.85, 1], ends_held(BODY, 5))
    assert doubted(total * [1, 1, 1, 0.75, 1], ends_held(BODY, 5))
    first = np.zeros((5, BODY.dof), bool)
    first[0] = True
    assert doubted(total, first) and not doubted(total, np.zeros((5, BODY.dof), bool))


def covering(cover: float, share: np.ndarray | None = None) -> SegmentSolution:
    """A solution that covers so much of the performers on every frame."""
    share = np.ones((1, LONG_GAP + 2, len(BODY))) if share is None else share
    frames = share.shape[1]
    none = np.zeros(frames)
    return SegmentSolution(
        (at_rest(BODY, frames),), 1, (), share, np.full((1, frames), cover), np.ones((1, frames)), none, {}
    )


@pytest.mark.parametrize(("hidden", "expected"), [(LONG_GAP, True), (LONG_GAP - 1, False)])
def test_a_limb_that_no_view_sees_for_longer_than_prediction_bridges_is_concealed(hidden: int, expected: bool) -> None:
    frames = LONG_GAP + 2
    problem = SegmentProblem(
        coloured(BODY, at_rest(BODY, frames), CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, frames),)
    )
    share = np.ones((2, frames, len(BODY)))
    share[0] = 0  # of what one view hides the other shows
    assert not solution_doubts.limb_hidden_for_long(problem, covering(1, share))
    share[1, 1 : 1 + hidden, BODY.index("forearm.L")] = 0
    assert solution_doubts.limb_hidden_for_long(problem, covering(1, share)) == expected
    hand = np.ones((2, frames, len(HUMAN)))
    hand[..., 1 : 1 + hidden, HUMAN.index("hand.L")] = 0
    whole = replace(problem, bodies=(HUMAN,), fixed=(ends_held(HUMAN, frames),))
    posed = replace(covering(1, hand), motions=(at_rest(HUMAN, frames),))
    assert not solution_doubts.limb_hidden_for_long(whole, posed), "it is where the forearm ends"
    hand[..., 1 : 1 + hidden, HUMAN.index("forearm.L")] = 0
    assert solution_doubts.limb_hidden_for_long(whole, posed) == expected
    trunk = np.ones_like(share)
    trunk[..., 0] = 0
    assert not solution_doubts.limb_hidden_for_long(problem, covering(1, trunk))
    keyed = replace(problem, fixed=(np.ones((frames, BODY.dof), bool),))
    assert not solution_doubts.limb_hidden_for_long(keyed, covering(1, share))
    blind = replace(problem, views=dark(CAMERAS[0], frames))
    assert not solution_doubts.limb_hidden_for_long(blind, covering(1, share))


@pytest.mark.parametrize(("before", "after", "expected"), [(1, 1, False), (0, 1, True), (1, 0, True), (-1, 1, True)])
def test_a_limb_that_is_clearly_seen_before_and_after_is_not_concealed(
    before: float, after: float, expected: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, arm = 3 * LONG_GAP, BODY.index("forearm.L")
    [chain] = [chain for chain in limbs(BODY) if arm in chain]
    problem = SegmentProblem(
        coloured(BODY, at_rest(BODY, frames), CAMERAS[:1]), (BODY,), 0, FPS, (ends_held(BODY, frames),)
    )
    clear = 2 * MIN_GAIN / LONG_GAP
    support = np.repeat([before * clear, 0.0, after * clear], LONG_GAP)
    monkeypatch.setattr(solution_doubts, "support_of_limbs", lambda *_: [(0, chain, support, lambda: support)])
    share = np.ones((1, frames, len(BODY)))
    share[0, LONG_GAP : 2 * LONG_GAP, arm] = 0
    assert solution_doubts.limb_hidden_for_long(problem, covering(1, share)) == expected
    share[0, : 2 * LONG_GAP, arm] = 0
    assert solution_doubts.limb_hidden_for_long(problem, covering(1, share)) == expected, "the key frame is enough"


def test_solutions_are_equals_of_the_best_within_what_is_chance() -> None:
    best, near, far = (
        covering(cover)
        for cover in (
            1000,
            1000 * (1 - 0.9 * solution_ranking.EQUAL_COVER),
            1000 * (1 - 1.1 * solution_ranking.EQUAL_COVER),
        )
    )
    assert solution_ranking.nearly_equal([far, best, near]) == [best, near]
    assert solution_ranking.nearly_equal([covering(0.0)] * 2)  # views that show nothing


def off(motion: Motion, parts: Sequence[int], angle: float) -> Motion:
    """A motion with some parts turned between its ends."""
    steps = np.zeros((len(motion), HUMAN.dof))
    steps[1:-1, 3:].reshape(len(motion) - 2, -1, 3)[:, parts, 0] = angle
    return motion.moved(steps)


TRUTH = at_rest(HUMAN, LENGTH)
PROBLEM = SegmentProblem((), (HUMAN,), 0, FPS, (ends_held(HUMAN, LENGTH),))
LOST = 0.9
"""So far from their true rotation, radians, limbs are not pulled back in the landscapes below."""


def error(found: SegmentSolution | Motion) -> float:
    motion = found if isinstance(found, Motion) else found.motions[0]
    return float(np.abs(motion.difference(TRUTH)).max())


class Finding:
    """Looks for limbs: takes a part of what is wrong away, if it begins where `begin` says."""

    def __init__(self, landscape: Landscape, share: float, begin: Motion | None = None) -> None:
        self.landscape, self.share, self.begin = landscape, share, begin

    def __call__(
        self, problem: SegmentProblem, _around: object, motions: Sequence[Motion], *_: object
    ) -> SegmentSolution:
        [motion] = motions
        if self.begin is not None and np.abs(self.begin.difference(motion)).max() > 0.1:
            return self.landscape.solution(problem, motion)
        return self.landscape.solution(problem, motion.moved(self.share * motion.difference(TRUTH)))


@pytest.mark.parametrize("paid", [0.5, 0.99, 1.01, 2.0])
def test_limbs_go_where_what_they_cover_there_is_worth_more_than_what_it_costs(paid: float) -> None:
    """A landscape in which putting the arms right costs a multiple of what it is worth, pixels that repeat one another
    counted once. Smoothness, which each solution has found itself, has no part in it.
    """
    landscape = Landscape(truth=TRUTH, reach=0.0)
    before = landscape.solution(PROBLEM, off(TRUTH, ARMS, 0.06))
    right = landscape.solution(PROBLEM, TRUTH)
    pixels, outlines = PROBLEM.settings.lengths
    gain = (right.cover - before.cover) / pixels**2
    find = Finding(landscape, 1.0)

    def search(*given: object) -> SegmentSolution:
        found = find(*given)
        assert found.evidence is not None and before.evidence is not None
        energy = np.full_like(before.evidence.outlines.energy, 0.0)
        energy[0, 0] = before.evidence.outlines.energy.sum() + 2 * paid * gain * outlines  # a square counts half
        evidence = replace(found.evidence, outlines=replace(found.evidence.outlines, energy=energy))
        return replace(found, evidence=evidence, energy=(np.inf,))

    found = search_rounds.searched(PROBLEM, before.motions, [before], landscape, search)
    assert (error(found) < 0.01) == (paid < 1)


@pytest.mark.parametrize(("gain", "moved"), [(0.5, False), (3, True)])
def test_with_one_moving_camera_limbs_are_replaced_only_if_others_cover_more_than_chance_explains(
    gain: float, moved: bool
) -> None:
    """Putting the arms right costs nothing, and covers the given multiple of what is chance more."""
    places = CAMERAS[0].t_cam_world + np.linspace(0, 0.1, LENGTH)[:, None]
    panned = replace(CAMERAS[0], R_cam_world=np.repeat(CAMERAS[0].R_cam_world, LENGTH, axis=0), t_cam_world=places)
    problem = replace(PROBLEM, views=dark(panned, LENGTH))
    turn = gain * solution_ranking.EQUAL_COVER * len(HUMAN) / len(ARMS) * np.pi * LENGTH / (LENGTH - 2)
    landscape = Landscape(truth=TRUTH, reach=0.0)
    before, right = (landscape.solution(problem, motion) for motion in (off(TRUTH, ARMS, turn), TRUTH))
    noise = solution_ranking.noise_at(problem, before, Workspace())
    worth = [solution_ranking.likelihood(problem, noise, solution) for solution in (before, right)]
    assert worth[1] > worth[0]
    assert (solution_ranking.likeliest(problem, noise, before, right) is right) == moved
    assert solution_ranking.likeliest(replace(problem, views=dark(CAMERAS[0], LENGTH)), noise, before, right) is right


def test_limbs_are_searched_for_around_the_best_solution_until_another_is_equal() -> None:
    """Every round halves what is wrong with the motion that it begins with."""
    landscape = Landscape(truth=TRUTH, reach=0.0)
    first, worse = (landscape.solution(PROBLEM, off(TRUTH, ARMS, angle)) for angle in (LOST, 2 * LOST))
    found = search_rounds.searched(PROBLEM, first.motions, [worse, first], landscape, Finding(landscape, 0.5))
    halvings = np.log2(LOST / error(found))
    assert 2 < halvings <= search_rounds.MAX_SEARCH_ROUNDS
    one_before, two_before = (landscape.solution(PROBLEM, off(TRUTH, ARMS, k * error(found))) for k in (2, 4))
    assert found in solution_ranking.nearly_equal([found, one_before])
    assert len(solution_ranking.nearly_equal([one_before, two_before])) == 1


@pytest.mark.parametrize(("apart", "rounds"), [(0.01, 1), (2 * LOST, 2)])
def test_starts_that_lead_to_the_same_motion_are_searched_around_once(apart: float, rounds: int) -> None:
    """Both starts cover as much; who passes by in one view had limbs looked for twice around the same motion."""
    landscape = Landscape(truth=TRUTH, reach=0.0)
    one, other = (landscape.solution(PROBLEM, off(TRUTH, ARMS, side * apart)) for side in (0.5, -0.5))
    begun: list[Motion] = []

    def search(problem: SegmentProblem, _: object, motions: Sequence[Motion], *__: object) -> SegmentSolution:
        begun.extend(motions)
        return landscape.solution(problem, motions[0])

    search_rounds.searched(PROBLEM, one.motions, [one, other], landscape, search)
    assert len(begun) == rounds


def test_a_search_ends_after_rounds_without_success() -> None:
    """Every round makes it worse by more than chance."""
    landscape = Landscape(truth=TRUTH, reach=0.0)
    seeds: list[int] = []
    before = landscape.solution(PROBLEM, off(TRUTH, ARMS, 0.1))

    def search(
        _problem: SegmentProblem, _around: object, motions: Sequence[Motion], seed: int, _: object
    ) -> SegmentSolution:
        seeds.append(seed)
        return landscape.solution(PROBLEM, off(TRUTH, ARMS, LOST))

    assert error(search_rounds.searched(PROBLEM, before.motions, [before], landscape, search)) < 1.01 * error(before)
    assert seeds == list(range(search_rounds.MAX_VAIN_ROUNDS))


@pytest.mark.parametrize(
    ("lost", "back", "depth"), [(True, False, True), (False, False, True), (True, True, True), (True, True, False)]
)
def test_for_one_among_others_a_single_search_decides_and_nothing_is_solved_if_it_finds_no_limb(
    monkeypatch: pytest.MonkeyPatch, lost: bool, back: bool, depth: bool
) -> None:
    """Where limbs that it finds elsewhere are led back, the first solution stands, too; not in a single view, in which
    they may be elsewhere in depth.
    """
    monkeypatch.setattr(SegmentProblem, "shows_depth", depth)
    landscape, solved = Landscape(truth=TRUTH, reach=0.0), list[object]()
    first = landscape.solution(PROBLEM, off(TRUTH, ARMS, LOST))

    def descend(problem: SegmentProblem, motions: Sequence[Motion], *_: object, **__: object) -> SegmentSolution:
        solved.append(motions)
        return landscape.solution(problem, first.motions[0] if back else motions[0])

    monkeypatch.setattr(search_rounds, "descend", descend)
    monkeypatch.setattr(search_rounds, "approach", lambda problem, motions, *_: Approach.start(problem, motions))
    monkeypatch.setattr(search_rounds, "found_limbs", lambda _problem, motions, *_: [TRUTH] if lost else list(motions))
    monkeypatch.setattr(search_rounds, "likeliest_at_rest", lambda *given, **_: given[-1])
    monkeypatch.setattr(search_rounds, "recombined", lambda _problem, best, *_: best)
    found = search_rounds.searched_among_others(PROBLEM, first, 0, landscape)
    if back and not depth:
        assert found is not first and len(solved) == 2
    else:
        assert (error(found) < 1) if lost and not back else (found is first and len(solved) == lost)


@pytest.mark.parametrize(("share", "held"), [(1.2, True), (0.8, False)])
def test_the_trunk_is_held_to_the_start_for_a_round_unless_the_start_covers_next_to_nothing(
    monkeypatch: pytest.MonkeyPatch, share: float, held: bool
) -> None:
    """Between key poses far apart, the curve leads the trunk away from the performer."""
    monkeypatch.setattr(search_rounds, "explains_little", lambda *_: True)
    landscape, trunks = Landscape(truth=TRUTH, reach=0.0), list[bool]()
    first = landscape.solution(PROBLEM, off(TRUTH, ARMS, LOST))
    cover = share * search_rounds.MIN_START_SHARE * first.cover
    monkeypatch.setattr(search_rounds, "cover_at", lambda _problem, _one, motions, _: cover if motions is start else 0)

    def search(_: object, around: SegmentProblem, motions: Sequence[Motion], *__: object) -> SegmentSolution:
        trunks.append(bool(around.fixed[0][:, :6].all()))
        return landscape.solution(PROBLEM, motions[0])

    start = [off(TRUTH, ARMS, LOST)]
    search_rounds.searched(PROBLEM, start, [first], landscape, search)
    assert any(trunks) == held and not trunks[0]


@pytest.mark.parametrize(("explains", "turned"), [(False, False), (True, False), (False, True)])
def test_if_only_uncovered_foreground_is_left_one_round_of_search_must_explain_it(
    monkeypatch: pytest.MonkeyPatch, explains: bool, turned: bool
) -> None:
    """It may be the bare arm of a bystander. A motion to which a whole turn was added is searched all the same."""
    landscape, searches = Landscape(truth=TRUTH, reach=0.0), list[object]()
    first, other = (landscape.solution(PROBLEM, off(TRUTH, ARMS, angle)) for angle in (0.4, 0.3))
    trial = SimpleNamespace(explains=lambda _: explains)
    monkeypatch.setattr(search_rounds.TrialRound, "around", lambda *_: trial)
    monkeypatch.setattr(multi_start.SettledSolution, "after", lambda *_: None)
    for doubt in ("images_contradict", "is_doubtful"):
        monkeypatch.setattr(multi_start, doubt, lambda *_: False)
    with_turn = ([TRUTH], other if turned else first)
    monkeypatch.setattr(multi_start, "with_whole_turn", lambda *_: with_turn)
    monkeypatch.setattr(multi_start, "searched", lambda *_, **__: searches.append(1) or first)
    multi_start.best_of_own_starts(PROBLEM, [TRUTH], first, landscape)
    assert len(searches) == (explains or turned)


@pytest.mark.parametrize(("around", "taken"), [("best", 1), ("worse", 0)])
def test_a_trial_round_around_the_best_is_not_repeated(around: str, taken: int) -> None:
    landscape = Landscape(truth=TRUTH, reach=0.0)
    first, worse = (landscape.solution(PROBLEM, off(TRUTH, ARMS, angle)) for angle in (0.4, 0.8))
    find, tried = Finding(landscape, 0.5), {"best": first, "worse": worse}[around]
    noise = solution_ranking.noise_at(PROBLEM, tried, Workspace())
    trial = search_rounds.TrialRound(SettledSolution(tried, noise, tried), find(PROBLEM, None, tried.motions))
    counts: list[int] = []
    for before in (None, trial):
        seeds: list[int] = []

        def search(*given: object, seeds: list[int] = seeds) -> SegmentSolution:
            seeds.append(given[3])
            return find(*given)

        search_rounds.searched(PROBLEM, first.motions, [worse, first], landscape, search, trial=before)
        counts.append(len(seeds))
    assert counts[0] - counts[1] == taken


@pytest.mark.parametrize("begin", ["worse", "best", "start"])
def test_if_the_best_solution_explains_little_limbs_are_searched_for_around_all_solutions_and_the_start(
    begin: str,
) -> None:
    """Whichever of them a round finds the limbs from, they are found."""
    landscape = Landscape(truth=TRUTH, reach=0.0)
    best, worse = (landscape.solution(PROBLEM, off(TRUTH, ARMS + LEGS, angle)) for angle in (1.8, 2.2))
    start = off(TRUTH, ARMS + LEGS, 2.6)
    assert solution_doubts.explains_little(PROBLEM, best)
    begins = {"worse": worse.motions[0], "best": best.motions[0], "start": start}
    search = Finding(landscape, 1.0, begins[begin])
    assert error(search_rounds.searched(PROBLEM, [start], [worse, best], landscape, search)) < 1e-6


def recombined(landscape: Landscape, *motions: Motion) -> tuple[SegmentSolution, list[SegmentSolution]]:
    """What comes of some solutions, the best first, and these solutions."""
    solutions = [landscape.solution(PROBLEM, motion) for motion in motions]
    noise = solution_ranking.noise_at(PROBLEM, solutions[0], landscape)
    return limb_exchange.recombined(PROBLEM, solutions[0], solutions, noise, landscape), solutions


def test_arms_right_in_one_solution_and_legs_right_in_another_are_put_together() -> None:
    landscape = Landscape(truth=TRUTH)
    one, other = off(TRUTH, ARMS, 1.0), off(TRUTH, LEGS, 0.9)
    for motions in ((one, other), (other, one)):
        found, _ = recombined(replace(landscape), *motions)
        assert error(found) < 0.02


def test_limbs_that_a_descent_reaches_are_not_lent() -> None:
    landscape = Landscape(truth=TRUTH, reach=0.0)
    found, solutions = recombined(landscape, *(off(TRUTH, parts, 0.08) for parts in (ARMS[:2], LEGS[:2])))
    assert found is solutions[0]


def test_limbs_of_what_covers_too_little_or_lies_in_the_same_places_are_not_tried() -> None:
    landscape = Landscape(truth=TRUTH)
    best, same, far = off(TRUTH, ARMS, 0.8), off(TRUTH, ARMS, 0.85), off(TRUTH, [*LEGS, 0, 1, 2], 2.5)
    covers = [landscape.solution(PROBLEM, motion).explained.sum() for motion in (best, same, far)]
    assert covers[1] > (1 - limb_exchange.LENDER_TOLERANCE) * covers[0] > covers[2]
    found, solutions = recombined(landscape, best, same, far)
    assert found is solutions[0] and not landscape.measured


def test_of_mixtures_that_cover_as_much_the_likeliest_counts() -> None:
    """One of two mixtures is as the landscape pulls; the other is held off it by limbs that it does not reach."""
    landscape = Landscape(truth=TRUTH)
    one, other = off(TRUTH, ARMS, 1.0), off(TRUTH, LEGS, 0.9)
    found, _ = recombined(landscape, one, other)
    exchanges = [(one, other, ARMS), (other, one, ARMS), (one, other, LEGS), (other, one, LEGS)]
    mixtures = [landscape.solution(PROBLEM, a.with_parts(parts, b)) for a, b, parts in exchanges]
    covering = solution_ranking.nearly_equal([*mixtures, found])
    assert found in covering and found.energy[-1] <= min(solution.energy[-1] for solution in covering) + 1e-6


def striding(frames: int) -> Motion:
    """Legs that swing against each other, once to and fro in a second."""
    motion = at_rest(HUMAN, frames)
    turns = np.zeros((frames, HUMAN.dof))
    for name, size in (("thigh.L", 0.5), ("thigh.R", -0.5)):
        turns[:, 3 + 3 * HUMAN.index(name)] = size * np.sin(2 * np.pi * (np.arange(frames) / FPS + 0.1))
    return motion.moved(turns)


def test_legs_that_were_taken_for_one_another_from_one_meeting_to_the_next_are_exchanged() -> None:
    """And those that were not, stay."""
    truth = striding(40)
    problem = SegmentProblem((), (HUMAN,), 0, FPS, (ends_held(HUMAN, 40),))
    landscape = Landscape(truth=truth)
    wrong = [exchange.motions[0] for exchange in exchanges(problem, [truth])]
    assert len(wrong) == 3  # between two meetings, and between each of them and the key pose beside it
    assert min(np.abs(motion.difference(truth)).max() for motion in wrong) > 2 * landscape.reach
    for motion in (*wrong, truth):
        solution = landscape.solution(problem, motion)
        found = limb_exchange.with_limbs_exchanged(problem, solution, landscape)
        assert np.abs(found.motions[0].difference(truth)).max() < 0.05


def test_legs_are_exchanged_where_that_is_likelier_though_they_cover_less() -> None:
    """Limbs that have only just been exchanged are still a little off."""
    truth = striding(40)
    problem = SegmentProblem((), (HUMAN,), 0, FPS, (ends_held(HUMAN, 40),))
    landscape = Landscape(truth=truth, cover=-1.0)
    (motion,) = next(exchanges(problem, [truth])).motions
    wrong = landscape.solution(problem, motion)
    found = limb_exchange.with_limbs_exchanged(problem, wrong, landscape)
    assert found.cover < wrong.cover
    assert np.abs(found.motions[0].difference(truth)).max() < 0.05


def test_legs_are_exchanged_though_they_become_likelier_only_once_they_are_at_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    truth = striding(40)
    problem = SegmentProblem((), (HUMAN,), 0, FPS, (ends_held(HUMAN, 40),))
    landscape = Landscape(truth=truth)
    (motion,) = next(exchanges(problem, [truth])).motions
    wrong = landscape.solution(problem, motion)
    legs = [HUMAN.index(name) for name in ("thigh.L", "thigh.R", "shin.L", "shin.R")]

    def soon(given: SegmentProblem, motions: Sequence[Motion], *_: object) -> SegmentSolution:
        here = slice(given.first, given.first + given.length)
        rests = any(not motions[0].difference(one[here]).any() for one in (motion, truth))
        return landscape.solution(given, motions[0] if rests else off(motions[0], legs, 2.0))

    def at_last(given: SegmentProblem, *_: object) -> SegmentSolution:
        return landscape.solution(given, truth[given.first : given.first + given.length])

    monkeypatch.setattr(limb_exchange, "descend", soon)
    monkeypatch.setattr(solution_ranking, "descend", at_last)
    found = limb_exchange.with_limbs_exchanged(problem, wrong, landscape)
    assert np.abs(found.motions[0].difference(truth)).max() < 0.05


@pytest.mark.parametrize("cover", [1000.0, -1.0])
def test_legs_of_one_performer_that_reach_across_each_other_come_back_to_their_places(cover: float) -> None:
    """They have followed each other's pictures, and nothing contradicts that, even if they cover more there. In one
    view depth is not known.
    """
    truth = striding(40)
    views = (*dark(CAMERAS[0], 40), *dark(CAMERAS[1], 40))
    problem = SegmentProblem(views, (HUMAN,), 0, FPS, (ends_held(HUMAN, 40),))
    (wrong,) = next(swaps(problem, [truth])).of_places(problem, [truth])
    landscape = Landscape(truth=truth, cover=cover)
    solution = replace(landscape.solution(problem, wrong), doubted=(0,))
    assert np.abs(wrong.difference(truth)).max() > 2 * landscape.reach
    found = limb_exchange.with_crossed_limbs_exchanged(problem, solution, landscape)
    assert np.abs(found.motions[0].difference(truth)).max() < 0.05
    assert found.doubted == solution.doubted and "initial solution" in found.seconds
    one_view = replace(problem, views=views[:1])
    assert limb_exchange.with_crossed_limbs_exchanged(one_view, solution, landscape) is solution


def test_legs_that_do_not_reach_across_each_other_cost_no_time() -> None:
    truth = striding(40)
    problem = SegmentProblem((*dark(CAMERAS[0], 40), *dark(CAMERAS[1], 40)), (HUMAN,), 0, FPS, (ends_held(HUMAN, 40),))
    landscape = Landscape(truth=truth)
    solution = landscape.solution(problem, truth)
    assert limb_exchange.with_crossed_limbs_exchanged(problem, solution, landscape) is solution
    assert not landscape.measured


def test_legs_that_cross_rightly_stay_as_they_were() -> None:
    """Not even solved further."""
    straight = striding(40)
    views = (*dark(CAMERAS[0], 40), *dark(CAMERAS[1], 40))
    problem = SegmentProblem(views, (HUMAN,), 0, FPS, (ends_held(HUMAN, 40),))
    (truth,) = next(swaps(problem, [straight])).of_places(problem, [straight])
    landscape = Landscape(truth=truth)
    solution = landscape.solution(problem, truth)
    found = limb_exchange.with_crossed_limbs_exchanged(problem, solution, landscape)
    assert found.motions is solution.motions


def test_an_exchange_is_refused_by_the_frames_beside_it() -> None:
    """Time grows with the number of exchanges, not with that times the length of the segment."""
    truth = striding(80)
    problem = SegmentProblem((), (HUMAN,), 0, FPS, (ends_held(HUMAN, 80),))
    landscape = Landscape(truth=truth)
    right = landscape.solution(problem, truth)
    found = limb_exchange.with_limbs_exchanged(problem, right, landscape)
    assert np.abs(found.motions[0].difference(truth)).max() < 1e-6
    lengths = [len(motion) for motion in landscape.measured]
    ways = [exchange.motions[0] for exchange in exchanges(problem, [truth])]
    exchanged = [len(np.flatnonzero(motion.difference(truth).any(axis=1))) for motion in ways]
    assert sum(length == 80 for length in lengths) <= 4  # the solution itself, settled before
    beside = 2 * (HELD_FRAMES + round(ADAPTATION_TIME * FPS))
    assert max(length for length in lengths if length < 80) == max(exchanged) + beside


@pytest.mark.parametrize(("rival", "repeats"), [(-np.inf, 4), (1900.0, 4), (2100.0, 1)])
def test_a_solution_is_solved_further_only_while_it_may_become_likelier_than_its_rival(
    monkeypatch: pytest.MonkeyPatch, rival: float, repeats: int
) -> None:
    """The first repetition gains 500, and every further one as much: 2000 can be reached."""
    solution = Landscape(truth=TRUTH).solution(PROBLEM, TRUTH)
    solved: list[SegmentSolution] = [solution]

    def next_one(*_: object) -> SegmentSolution:
        solved.append(replace(solution, iterations=len(solved)))
        return solved[-1]

    monkeypatch.setattr(solution_ranking, "descend", next_one)
    monkeypatch.setattr(solution_ranking, "continued", lambda _, found: found)
    monkeypatch.setattr(solution_ranking, "likelihood", lambda _problem, _noise, one: 500.0 * solved.index(one))
    noise = solution_ranking.noise_at(PROBLEM, solution, Workspace())
    found = solution_ranking.settled_further(PROBLEM, noise, solution, Workspace(), rival=rival)
    assert found is solved[-1]
    assert len(solved) == 1 + repeats


@pytest.mark.parametrize(
    ("reached", "given_up"),
    [
        ([900.0, 860.0, 870.0, 880.0], [False, True, True, True]),
        ([900.0, 890.0, 980.0, 1020.0], [False, True, False, False]),
        ([500.0, 700.0, 800.0, 850.0], [False, False, False, True]),
    ],
)
def test_a_descent_is_hopeless_if_gains_as_large_as_the_last_would_not_make_it_likelier_than_its_rival(
    monkeypatch: pytest.MonkeyPatch, reached: list[float], given_up: list[bool]
) -> None:
    solution = Landscape(truth=TRUTH).solution(PROBLEM, TRUTH)
    noise = solution_ranking.noise_at(PROBLEM, solution, Workspace())
    monkeypatch.setattr(solution_ranking, "_likelihood_of", lambda *_: reached.pop(0))
    hopeless = solution_ranking.never_likelier(PROBLEM, noise, 1000.0)
    assert [hopeless(solution.evidence, left) for left in (5, 4, 3, 2)] == given_up


@pytest.mark.parametrize("hopeless", [False, True])
def test_a_hopeless_descent_ends_with_the_iterations_of_its_stage(hopeless: bool) -> None:
    """A limb that is drawn far goes on beyond them otherwise."""
    landscape, asked = Landscape(truth=TRUTH, reach=2.0), list[int]()
    stage = replace(SETTLED[0], iterations=1, still=0.0, small=0.0)
    start = off(TRUTH, ARMS, 1.2)

    def test(_: object, left: int) -> bool:
        asked.append(left)
        return hopeless

    free, told = (gauss_newton.descend(PROBLEM, [start], landscape, (stage,), hopeless=given) for given in (None, test))
    assert asked[0] == 1 + MAX_EXTRA_ITERATIONS
    assert len(told.energy) == (2 if hopeless else len(free.energy))
    assert len(free.energy) > 2


def test_a_descent_that_is_in_vain_ends_at_once() -> None:
    landscape, start = Landscape(truth=TRUTH, reach=2.0), off(TRUTH, ARMS, 1.2)
    stage = replace(SETTLED[0], still=0.0, small=0.0)
    begun = [False, True]  # before the first step and before the second
    found = gauss_newton.descend(PROBLEM, [start], landscape, (stage,), vain=lambda _: begun.pop(0))
    assert len(found.energy) == 2 < len(gauss_newton.descend(PROBLEM, [start], landscape, (stage,)).energy)


def test_motions_are_alike_only_if_those_of_every_performer_are() -> None:
    """A head that is turned moves no joint."""
    motion = swing(HUMAN, 5)
    four = replace(PROBLEM, bodies=(HUMAN,) * 4, fixed=(ends_held(HUMAN, 5),) * 4)
    near, far = off(motion, list(range(len(HUMAN))), 0.03), off(motion, [HUMAN.index("head")], 2.0)
    assert solution_ranking.same_solution(four, [motion] * 4, [near] * 4)
    assert not solution_ranking.same_solution(four, [motion] * 4, [near, far, near, near])


@pytest.mark.parametrize(("frames", "same"), [(LENGTH - 2, False), (1, True)])
def test_a_single_arm_that_is_elsewhere_for_long_makes_another_solution(frames: int, same: bool) -> None:
    """Over all parts, it hardly shows in the mean."""
    steps = np.zeros((LENGTH, HUMAN.dof))
    steps[1 : 1 + frames, 3:].reshape(frames, -1, 3)[:, ARMS[0], 0] = 0.3
    other = TRUTH.moved(steps)
    assert np.sqrt(3 * np.mean(TRUTH.difference(other)[:, 3:] ** 2)) < solution_ranking.SAME_SOLUTION_ANGLE
    assert solution_ranking.same_solution(PROBLEM, [TRUTH], [other]) is same
