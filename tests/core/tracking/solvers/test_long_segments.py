"""In a long segment, what is in doubt for a moment is solved again around it, while the motion beside it stays."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limb_pairs, limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.occlusion import LONG_GAP
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers import gauss_newton_solver, long_refinement
from kfmocap.core.tracking.solvers.assessment import solution_doubts
from kfmocap.core.tracking.solvers.assessment.limb_signs import frames_weakly_shown
from kfmocap.core.tracking.solvers.assessment.solution_doubts import frames_in_doubt
from kfmocap.core.tracking.solvers.descent_stages import (
    POLISH,
    POLISHED_AT_ONCE,
    UNCONVERGED_MOVE,
    DescentStage,
)
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.equations.segment_equations import SegmentNoise
from kfmocap.core.tracking.solvers.limb_corrections import local_trials, regained_limbs
from kfmocap.core.tracking.solvers.limb_corrections.bridges import BRIDGING
from kfmocap.core.tracking.solvers.limb_corrections.limb_proposals import LimbGroup
from kfmocap.core.tracking.solvers.limb_corrections.local_trials import (
    ADAPTATION_TIME,
    HELD_FRAMES,
    Stretch,
    _windows,
    is_long,
    likelier_after_change,
    stretches_around,
)
from kfmocap.core.tracking.solvers.limb_evidence.limb_support import SupportOfLimb
from kfmocap.core.tracking.solvers.long_refinement import STEPS_ON_ALL_FRAMES
from kfmocap.core.tracking.solvers.thinned_frames import ThinnedProblem
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, coloured, dark, ends_held

BODY, FPS, LONG = human(), 30.0, 300
LIMBS, PAIR = limbs(BODY), limb_pairs(BODY)[0]
BESIDE = HELD_FRAMES + round(ADAPTATION_TIME * FPS)
SAMPLING = Sampling(1.0, 1.0, 2, 0.07)
MEASURED = [replace(POLISH[0], iterations=0, further=0)]


def seen(frames: int, every: int = 1) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS[:2] for view in dark(camera, frames))
    return SegmentProblem(views, (BODY,), 0, every * FPS, (ends_held(BODY, frames),))


def some_frames(length: int, *ranges: tuple[int, int]) -> np.ndarray:
    flags = np.zeros(length, dtype=bool)
    for first, last in ranges:
        flags[first : last + 1] = True
    return flags


def test_a_moment_is_tried_with_the_frames_that_may_adapt_to_it() -> None:
    near, far = (100, 104), (200, 200)
    found = stretches_around(seen(LONG), some_frames(LONG, near, far))
    assert found == [Stretch(near[0] - BESIDE, near[1] + BESIDE), Stretch(far[0] - BESIDE, far[1] + BESIDE)]
    assert stretches_around(seen(LONG), some_frames(LONG, (0, 2), (4, 5))) == [Stretch(0, 5 + BESIDE)]
    assert is_long(seen(LONG)) and not is_long(seen(6 * BESIDE))


@pytest.mark.parametrize("length", [LONG, 2 * LONG, 5 * LONG - 7])
def test_a_wide_doubt_is_parted_into_windows_that_grow_in_number_and_not_in_length(length: int) -> None:
    found = stretches_around(seen(LONG), np.ones(LONG, bool)) if length == LONG else _windows(0, length - 1, BESIDE)
    sizes = [window.last + 1 - window.first for window in found]
    assert min(sizes) > 4 * BESIDE and max(sizes) <= 8 * BESIDE + 1
    assert len(found) <= np.ceil(length / (6 * BESIDE)) + 1
    assert np.any([some_frames(length, (w.first, w.last)) for w in found], axis=0).all()


def test_windows_begin_from_what_was_solved_before_them_and_are_free_where_the_motion_is_still_in_doubt() -> None:
    length = 5 * LONG
    solved = some_frames(length, (0, 0), (length - 1, length - 1))
    for window in _windows(0, length - 1, BESIDE):
        ends = [slice(window.first, window.first + HELD_FRAMES), slice(window.last + 1 - HELD_FRAMES, window.last + 1)]
        ends[0] = slice(0, 1) if window.first == 0 else ends[0]
        ends[1] = slice(length - 1, length) if window.last == length - 1 else ends[1]
        assert window.held == tuple(bool(solved[end].all()) for end in ends)
        first, stop = (0 if held else BESIDE for held in window.held)
        solved[window.first + first : window.last + 1 - stop] = True
    assert solved.all() and window.held == (True, True)


@pytest.mark.parametrize("silent", ["_frames_on_background", "_frames_beside_limb"])
def test_frames_in_doubt_are_those_on_which_a_view_shows_a_limb_where_the_solution_has_none(
    monkeypatch: pytest.MonkeyPatch, silent: str
) -> None:
    """The limb covers background, and leaves foreground uncovered: either is enough."""
    monkeypatch.setattr(solution_doubts, silent, lambda problem, *_: np.zeros(problem.length, bool))
    frames, lost = 3 * LONG_GAP, slice(LONG_GAP, 2 * LONG_GAP + 2)
    truth = at_rest(BODY, frames)
    truth.rotations[:, BODY.index("upper_arm.L")] = rotations.exp(np.array([0.0, 0.0, 1.2]))
    lowered = truth.rotations.copy()
    lowered[lost] = at_rest(BODY, 1).rotations
    problem = SegmentProblem(coloured(BODY, truth, CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, frames),))
    found, right = (
        SegmentSolution.of(
            [motion],
            Workspace().measure(problem, [motion], SAMPLING).evidence,
            iterations=1,
            energy=[0.0],
        )
        for motion in (Motion(truth.translations, lowered), truth)
    )
    assert np.array_equal(np.flatnonzero(frames_in_doubt(problem, found)), np.arange(frames)[lost])
    assert not frames_in_doubt(problem, right).any()


@pytest.mark.parametrize("helped", [True, False])
@pytest.mark.parametrize("rate", [1, 3])
def test_around_frames_in_doubt_a_long_segment_is_solved_again_and_counts_as_doubted_no_more(
    monkeypatch: pytest.MonkeyPatch, helped: bool, rate: int
) -> None:
    """Whether frames follow each other closely or not."""
    problem, rest = seen(LONG, rate), at_rest(BODY, LONG)
    tried: list[tuple[int, int]] = []

    def result(motions: Sequence[Motion]) -> Any:
        return SimpleNamespace(motions=tuple(motions), seconds={}, variances=(), doubted=())

    def pursued(thinned: ThinnedProblem, start: Sequence[Motion], *_: object) -> Any:
        fixed, few = thinned.whole.fixed[0].all(axis=1), thinned.problem.fixed[0].all(axis=1)
        assert len(fixed) == len(start[0]) == thinned.frames[-1] + 1
        assert few[:HELD_FRAMES].all() and few[-HELD_FRAMES:].all() and not few[HELD_FRAMES:-HELD_FRAMES].any()
        assert (thinned.problem is thinned.whole) == (rate == 1)
        assert fixed[: thinned.frames[1] + 1].all() and not fixed[thinned.frames[1] + 1 : -thinned.every - 1].any()
        tried.append((thinned.whole.first, len(fixed)))
        return result([start[0].moved(np.where(fixed[:, None], 0.0, 0.1) * np.ones(BODY.dof))] if helped else start)

    for solving in ("first_solution", "descend", "unsettled"):
        monkeypatch.setattr(gauss_newton_solver, solving, lambda _problem, start, *_: result(start))
    monkeypatch.setattr(gauss_newton_solver, "doubted_performers", lambda *_: [0])
    monkeypatch.setattr(gauss_newton_solver, "frames_in_doubt", lambda few, _: some_frames(few.length, (40, 44)))
    monkeypatch.setattr(gauss_newton_solver, "can_search_limbs", lambda _: False)
    monkeypatch.setattr(gauss_newton_solver, "_pursued", pursued)
    monkeypatch.setattr(gauss_newton_solver, "continued", lambda _, after: after)
    monkeypatch.setattr(
        gauss_newton_solver,
        "replace",
        lambda one, **new: (
            SimpleNamespace(**{**vars(one), **new})
            if isinstance(one, SimpleNamespace)
            else dataclasses.replace(one, **new)
        ),
    )
    monkeypatch.setattr(ThinnedProblem, "variances", lambda *_: ())
    monkeypatch.setattr(ThinnedProblem, "on_all_frames", lambda _self, few: few)
    thinned = ThinnedProblem.of(problem, [rest])
    every = 1 if thinned is None else thinned.every
    found = gauss_newton_solver.solved(problem, [rest], Workspace())
    [(first, length)] = tried
    assert (every > 1) == (rate > 1) and 40 - BESIDE <= first / every < 40 and 5 < length / every < LONG / every
    moved = np.abs(found.motions[0].difference(rest)).max(axis=1) > 0.01
    assert moved.any() == helped and not moved[:first].any() and not moved[first + length :].any()
    assert not found.doubted


def supports(*weak: tuple[int, int, int]) -> list[SupportOfLimb]:
    """The support of all limbs, low for a limb from one frame to another."""
    each: list[SupportOfLimb] = []
    for k, chain in enumerate(LIMBS):
        shown = np.ones(LONG)
        for limb, first, last in weak:
            shown[first : last + 1] *= 0.3 if limb == k else 1.0
        each.append((0, chain, np.zeros(LONG), lambda shown=shown: shown))
    return each


def test_a_limb_is_weakly_shown_on_frames_with_little_support_in_the_mean_over_a_moment() -> None:
    [(_, _, _, shown)] = supports((0, 100, 109))[:1]
    weak = np.flatnonzero(frames_weakly_shown(seen(LONG), 0, shown()))
    assert np.array_equal(weak, np.arange(weak[0], weak[-1] + 1))
    assert 97 <= weak[0] <= 100 and 109 <= weak[-1] <= 112


def test_both_limbs_of_a_pair_are_searched_for_where_both_are_weakly_shown() -> None:
    one, other = (LIMBS.index(chain) for chain in PAIR)
    groups = [*(LimbGroup(0, (chain,)) for chain in PAIR), LimbGroup(0, PAIR)]
    ranges = stretches(groups, (one, 100, 119), (other, 110, 125), (other, 200, 209))
    assert [len(own) for own in ranges] == [1, 2, 1]
    [both] = ranges[2]
    assert 107 - BESIDE <= both.first <= 110 - BESIDE and 119 + BESIDE <= both.last <= 122 + BESIDE
    assert stretches(groups, (one, 100, 109), (other, 200, 209))[2] == []


def test_a_limb_for_which_another_sign_calls_is_searched_for_on_all_frames_window_by_window() -> None:
    one, other = (LIMBS.index(chain) for chain in PAIR)
    groups = [*(LimbGroup(0, (chain,)) for chain in PAIR), LimbGroup(0, PAIR)]
    weak, called, both = stretches(groups, (one, 100, 109))
    assert len(weak) == 1 and both == weak
    assert [(own.first, own.last) for own in called] == [
        (own.first, own.last) for own in stretches_around(seen(LONG), np.ones(LONG, bool))
    ]
    assert all(own.held == (True, True) for own in called), "the trunk and the other limbs are not in doubt"
    assert len(called) > 1 and stretches(groups[1:2], (other, 0, LONG - 1)) == [called]


def stretches(groups: Sequence[LimbGroup], *weak: tuple[int, int, int]) -> list[list[Stretch]]:
    return [ranges for _, ranges in regained_limbs._stretches_of(seen(LONG), groups, supports(*weak))]


@pytest.mark.parametrize("found", [True, False])
def test_in_a_long_segment_a_weakly_shown_limb_is_searched_for_around_that_moment(
    monkeypatch: pytest.MonkeyPatch, found: bool
) -> None:
    problem, rest = seen(LONG), at_rest(BODY, LONG)
    begin = replace(Landscape(truth=rest).solution(seen(LONG), rest), motions=(rest,))
    asked: list[LimbGroup] = []

    def searched(own: SegmentProblem, solution: SegmentSolution, group: LimbGroup, *_: object) -> SegmentSolution:
        asked.append(group)
        fixed = own.fixed[0].all(axis=1)
        assert own.length == len(solution.motions[0]) < LONG / 4
        assert fixed[:HELD_FRAMES].all() and fixed[-HELD_FRAMES:].all() and not fixed[HELD_FRAMES:-HELD_FRAMES].any()
        turned = solution.motions[0].moved(np.where(fixed[:, None], 0.0, 0.1) * np.ones((1, BODY.dof)))
        return replace(solution, motions=(turned,)) if found else solution

    def solved(_: SegmentProblem, motions: Sequence[Motion], *__: object) -> SegmentSolution:
        return replace(begin, motions=tuple(motions))

    monkeypatch.setattr(regained_limbs, "_support_of", lambda *_: supports((LIMBS.index(PAIR[0]), 100, 109)))
    monkeypatch.setattr(regained_limbs, "bent_limbs", lambda *_: [])
    monkeypatch.setattr(regained_limbs, "refuted_limbs", lambda *_: [])
    monkeypatch.setattr(regained_limbs, "unsettled", solved)
    monkeypatch.setattr(regained_limbs, "with_limbs_found", searched)
    end = regained_limbs.with_limbs_regained(problem, begin, Workspace())
    assert asked == [LimbGroup(0, (PAIR[0],))]
    assert (end.evidence is None) == found, "it would be that of other motions"
    moved = np.abs(end.motions[0].difference(rest)).max(axis=1) > 0.01
    assert moved[95:115].all() == found
    assert not moved[: 100 - BESIDE - 10].any() and not moved[110 + BESIDE + 10 :].any()


@pytest.mark.parametrize("found", [True, False])
def test_where_frames_follow_each_other_closely_rounds_are_made_on_some_of_them(
    monkeypatch: pytest.MonkeyPatch, found: bool
) -> None:
    """Only what they find is solved for on all frames, and the next limb is searched for around that."""
    problem, rest, turned = seen(LONG, 3), at_rest(BODY, LONG), 0.1 * np.ones(BODY.dof)
    made, begun = list[int](), list[int]()

    def measured(_: SegmentProblem, motions: Sequence[Motion], __: object) -> SegmentSolution:
        begun.append(len(motions[0]))
        return replace(Landscape(truth=rest).solution(problem, rest), motions=tuple(motions))

    def rounds(few: SegmentProblem, solution: SegmentSolution, *_: object) -> SegmentSolution | None:
        made.append(few.length)
        [kept] = solution.motions
        return replace(solution, motions=(kept.moved(turned * np.ones((len(kept), 1))),)) if found else None

    def moved(
        _: SegmentProblem, solution: SegmentSolution, __: object, motions: Sequence[Motion], ___: object
    ) -> SegmentSolution:
        made.append(len(motions[0]))
        assert (solution.motions[0] is rest) == (len(made) == 2)
        return replace(solution, motions=tuple(motions))

    monkeypatch.setattr(regained_limbs, "unsettled", measured)
    monkeypatch.setattr(regained_limbs, "likeliest_found", rounds)
    monkeypatch.setattr(regained_limbs, "with_limbs_moved", moved)
    [end] = regained_limbs._found_there(problem, (rest,), [LimbGroup(0, (chain,)) for chain in PAIR], Workspace())
    some = made[0]
    assert some < 0.6 * LONG and (end is rest) != found
    assert made == ([some, LONG] * 2 if found else [some] * 2)
    assert begun == ([some, LONG] * 2 if found else [some]), "what is unchanged is measured once"
    if found:
        np.testing.assert_allclose(rest.difference(end), np.tile(2 * turned, (LONG, 1)), atol=1e-3)


@pytest.mark.parametrize("rate", [1, 3])
def test_seeming_plants_are_held_only_around_frames_in_doubt(monkeypatch: pytest.MonkeyPatch, rate: int) -> None:
    """With few steps on all frames where some of them go on."""
    problem, rest = seen(LONG, rate), at_rest(BODY, LONG)
    thinned = ThinnedProblem.of(problem, [rest]) or ThinnedProblem.with_all(problem)
    asked: list[Sequence[DescentStage]] = []

    class AskedError(Exception):
        pass

    def descended(_: object, __: object, ___: object, stages: Sequence[DescentStage]) -> None:
        asked.append(stages)
        raise AskedError

    monkeypatch.setattr(gauss_newton_solver, "descend", descended)
    for solve in (
        lambda: gauss_newton_solver.solved(problem, [rest], Workspace()),
        lambda: gauss_newton_solver._pursued(thinned, [rest], Workspace()),
    ):
        with pytest.raises(AskedError):
            solve()
    first, around = asked
    assert not first[-1].plants and around[-1].plants
    assert first[-1].further > 0 and (around[-1].further == 0) == (rate > 1)


@pytest.mark.parametrize("better", [True, False])
def test_a_change_of_a_moment_is_solved_for_there_alone_and_taken_if_it_is_better(
    monkeypatch: pytest.MonkeyPatch, better: bool
) -> None:
    problem, rest = seen(LONG), at_rest(BODY, LONG)
    best = replace(Landscape(truth=rest).solution(problem, rest), motions=(rest,))
    changed = rest.moved(np.where(some_frames(LONG, (100, 109))[:, None], 0.2, 0.0) * np.ones(BODY.dof))
    noise = SegmentNoise(np.ones((2, LONG - 1, 1 + len(BODY))), np.ones((2, LONG - 1)), np.ones(2))
    asked: list[tuple[int, object]] = []

    def solved(own: SegmentProblem, motions: Sequence[Motion], _: object, stages: object, __: object) -> Any:
        asked.append((own.length, stages))
        return SimpleNamespace(motions=tuple(motions))

    def measured(_: object, motions: Sequence[Motion], *__: object) -> SegmentSolution:
        return replace(best, motions=tuple(motions))

    def likeliest(_problem: object, _noise: object, one: Any, other: Any) -> Any:
        return other if better else one

    monkeypatch.setattr(local_trials, "descend", solved)
    monkeypatch.setattr(local_trials, "solution_at", measured)
    monkeypatch.setattr(local_trials, "likeliest", likeliest)
    found = likelier_after_change(problem, noise, best, [changed], Workspace(), stages=BRIDGING)
    around = 10 + 2 * BESIDE
    assert asked == [(around, BRIDGING)] * 2
    assert (found is best) != better
    if better:
        np.testing.assert_array_equal(found.motions[0].rotations, changed.rotations)


@pytest.mark.parametrize("wide", [False, True])
def test_a_long_segment_is_refined_again_only_around_frames_on_which_a_joint_still_moves(
    monkeypatch: pytest.MonkeyPatch, wide: bool
) -> None:
    """Unless these are most of its frames. Few steps of the last stage are made on all frames, and the end is measured
    on all of them.
    """
    problem, rest = seen(LONG), at_rest(BODY, LONG)
    moving = np.where(some_frames(LONG, (10, 290) if wide else (100, 104)), 2 * UNCONVERGED_MOVE, 0.0)
    asked: list[tuple[int, Sequence[DescentStage]]] = []

    def solution(motion: Motion, moved: np.ndarray) -> SegmentSolution:
        return replace(Landscape(truth=rest).solution(problem, rest), motions=(motion,), moved=moved, variances=())

    def descended(own: SegmentProblem, start: Sequence[Motion], _: object, stages: Sequence[DescentStage]) -> Any:
        asked.append((own.length, stages))
        if own.length == LONG:
            return solution(start[0], moving if len(asked) == 1 else 0 * moving)
        fixed = own.fixed[0].all(axis=1)
        return solution(start[0].moved(np.where(fixed[:, None], 0.0, 0.1) * np.ones(BODY.dof)), np.zeros(own.length))

    monkeypatch.setattr(long_refinement.gauss_newton, "descend", descended)
    found = long_refinement.refine(problem, [rest], Workspace(), POLISHED_AT_ONCE)
    last = POLISHED_AT_ONCE[-1:]
    again = [(LONG, [*last])] if wide else [(5 + 2 * BESIDE, [*last]), (LONG, MEASURED)]
    at_once = [*POLISHED_AT_ONCE[:-1], replace(last[0], iterations=STEPS_ON_ALL_FRAMES, further=0)]
    assert asked == [(LONG, at_once), *again]
    changed = np.flatnonzero(rest.difference(found.motions[0]).any(axis=1))
    kept = [] if wide else np.arange(100 - BESIDE + HELD_FRAMES, 105 + BESIDE - HELD_FRAMES)
    np.testing.assert_array_equal(changed, kept)


@pytest.mark.parametrize("rate", [1, 40])
def test_a_limb_that_was_found_in_a_polished_segment_is_polished_around_that_moment(
    monkeypatch: pytest.MonkeyPatch, rate: int
) -> None:
    problem, rest = seen(LONG, rate), at_rest(BODY, LONG)
    polished = replace(Landscape(truth=rest).solution(problem, rest), motions=(rest,), variances=())
    found = rest.moved(np.where(some_frames(LONG, (100, 104))[:, None], 0.2, 0.0) * np.ones(BODY.dof))
    asked: list[tuple[int, Sequence[DescentStage]]] = []

    def descended(own: SegmentProblem, start: Sequence[Motion], _: object, stages: Sequence[DescentStage]) -> Any:
        asked.append((own.length, stages))
        return replace(polished, motions=tuple(start), moved=np.zeros(own.length))

    monkeypatch.setattr(long_refinement.gauss_newton, "descend", descended)
    end = long_refinement.polished_again(problem, polished, [found], Workspace())
    np.testing.assert_array_equal(end.motions[0].rotations, found.rotations)
    if is_long(problem):
        assert asked == [(5 + 2 * BESIDE, POLISH), (LONG, MEASURED)]
    else:
        assert asked == [(LONG, POLISH)]
