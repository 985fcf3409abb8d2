"""A limb whose motion turns away exactly at a key pose is looked for again, and found where the pictures show it."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.arrays import Array
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers import gauss_newton
from kfmocap.core.tracking.solvers.assessment.limb_signs import bend_of
from kfmocap.core.tracking.solvers.assessment.settled_solutions import SettledSolutions
from kfmocap.core.tracking.solvers.assessment.solution_ranking import RESTING_GAIN
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.gauss_newton_solver import refined
from kfmocap.core.tracking.solvers.limb_corrections import (
    limb_gains,
    limb_groups,
    limb_paths,
    limb_proposals,
    limb_search,
    regained_limbs,
)
from kfmocap.core.tracking.solvers.limb_corrections.limb_gains import is_promising
from kfmocap.core.tracking.solvers.limb_corrections.limb_groups import with_limbs_found
from kfmocap.core.tracking.solvers.limb_corrections.limb_proposals import LimbGroup
from kfmocap.core.tracking.solvers.limb_corrections.limb_search import (
    CLEAR_GAIN_RATIO,
    FOUND_REACH,
    MIN_GAIN_ELSEWHERE,
    LimbSearch,
    freed_limb,
    views_of,
)
from kfmocap.core.tracking.solvers.limb_evidence.limb_model import LimbModel, limb_of
from kfmocap.core.tracking.solvers.limb_evidence.limb_support import SupportOfLimb
from kfmocap.core.tracking.solvers.thinned_frames import ThinnedProblem
from swinging_arm import ARM, BODY, FPS, FRAMES, TRUTH, WHOLE, astray
from synthetic import ends_held, look_at, poses_of, silhouette

CAMERAS = (
    look_at("front", (0.4, -4.0, 1.2), (0, 0, 0.95), size=(160, 120), focal=120.0),
    look_at("side", (4.0, 0.3, 1.1), (0, 0, 0.95), size=(160, 120), focal=120.0),
)


@pytest.fixture(scope="module")
def problem() -> SegmentProblem:
    poses = poses_of([BODY], [TRUTH])
    views = []
    for camera in CAMERAS:
        seen = np.stack([silhouette([BODY], poses, f, camera, samples=1) for f in range(FRAMES)])
        views.append(ViewFrames(camera, np.zeros_like(seen), 0, seen[None]))
    return SegmentProblem(tuple(views), (BODY,), 0, FPS, (ends_held(BODY, FRAMES),), (WHOLE[:1],), (WHOLE[-1:],))


def error_mm(motion: Motion, true: Motion = TRUTH) -> float:
    a, b = (landmark_positions(BODY, m, ["RElbow", "RWrist"]) for m in (motion, true))
    return float(1000 * np.linalg.norm(a - b, axis=-1).mean())


@pytest.fixture
def without_descent(monkeypatch: pytest.MonkeyPatch) -> None:
    """Motions stay what they are, so that looking for limbs does all the work. So small pictures gain little."""

    def measured(problem: SegmentProblem, motions: Sequence[Motion], *_: object, **__: object) -> SegmentSolution:
        evidence = Workspace().measure(problem, motions, Sampling(1.0, 1.0, 3, 0.07)).evidence
        return SegmentSolution.of(motions, evidence, iterations=1, energy=[0.0])

    monkeypatch.setattr("kfmocap.core.tracking.solvers.gauss_newton.refine", measured)
    monkeypatch.setattr(limb_gains, "LEAST_GAIN", RESTING_GAIN)
    limbs = ("limb_corrections.regained_limbs", "limb_corrections.limb_groups")
    for module in (*limbs, "assessment.settled_solutions", "assessment.solution_ranking"):
        monkeypatch.setattr(f"kfmocap.core.tracking.solvers.{module}.descend", measured)


@pytest.mark.usefixtures("without_descent")
def test_a_bent_limb_is_found_where_the_pictures_show_it(problem: SegmentProblem) -> None:
    found = refined(problem, [astray()], Workspace()).motions[0]
    assert bend_of(problem, 0, found, ARM) < 0.15 * bend_of(problem, 0, astray(), ARM)  # drawn poses scatter
    assert error_mm(found) < 0.35 * error_mm(astray())
    np.testing.assert_allclose(found.rotations[[0, -1]], TRUTH.rotations[[0, -1]], atol=1e-12)
    assert error_mm(refined(problem, [TRUTH], Workspace()).motions[0]) == 0


def test_a_bent_limb_that_was_found_is_bent_no_more_once_it_is_solved_for(problem: SegmentProblem) -> None:
    found = refined(problem, [astray()], Workspace()).motions[0]
    assert bend_of(problem, 0, found, ARM) < 0.5
    assert error_mm(found) < 0.1 * error_mm(astray())


@pytest.mark.usefixtures("without_descent")
def test_limbs_without_a_sign_are_looked_for_if_the_pictures_contradicted_the_performer(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(regained_limbs, "bent_limbs", lambda *_: [])
    monkeypatch.setattr(regained_limbs, "refuted_limbs", lambda *_: [])
    sure, unsure = (refined(replace(problem, doubted=who), [astray()], Workspace()).motions[0] for who in ((), (0,)))
    assert error_mm(sure) == error_mm(astray())
    assert error_mm(unsure) < 0.7 * error_mm(astray())
    true = refined(replace(problem, doubted=(0,)), [TRUTH], Workspace()).motions[0]
    assert error_mm(true) < 0.2 * error_mm(astray())


@pytest.mark.usefixtures("without_descent")
def test_a_doubted_performer_that_comes_to_rest_where_it_was_is_not_solved_further(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whatever is solved further becomes a little likelier."""
    further: list[object] = []
    monkeypatch.setattr(limb_groups, "settled_further", lambda *given, **_: further.append(given) or given[2])
    monkeypatch.setattr(limb_proposals, "freed_limb", lambda _problem, motions, place, _seed, **_: motions[place[0]])
    refined(replace(problem, doubted=(0,)), [TRUTH], Workspace())
    assert not further


@pytest.mark.usefixtures("without_descent")
@pytest.mark.parametrize("doubted", [(), (0,)])
def test_the_time_that_searches_take_counts(problem: SegmentProblem, doubted: tuple[int, ...]) -> None:
    """One limb is bent; of a doubtful performer, all are looked for."""
    begin = time.perf_counter()
    found = refined(replace(problem, doubted=doubted), [astray()], Workspace())
    taken = time.perf_counter() - begin
    assert 0.8 * taken < sum(found.seconds.values()) <= taken


@pytest.mark.usefixtures("without_descent")
def test_a_bent_limb_stays_where_it_covers_more_than_anything_that_is_found(problem: SegmentProblem) -> None:
    """The performer did turn away at the key pose."""
    poses, views = poses_of([BODY], [astray()]), []
    for view in problem.views:
        seen = np.stack([silhouette([BODY], poses, f, view.camera, samples=1) for f in range(FRAMES)])
        views.append(replace(view, foreground=seen[None]))
    found = refined(replace(problem, views=tuple(views)), [astray()], Workspace()).motions[0]
    assert error_mm(found, astray()) < 30


def test_a_limb_is_moved_only_if_pictures_gain_by_it_on_frames_on_which_it_was_elsewhere(
    problem: SegmentProblem,
) -> None:
    """A search follows the noise of the pictures on all other frames; what it gains there does not count."""
    lost = astray()
    gainful = LimbSearch(least_gain=MIN_GAIN_ELSEWHERE)
    assert error_mm(freed_limb(problem, [lost], (0, ARM), 0, gainful)) < 0.5 * error_mm(lost)
    assert freed_limb(problem, [lost], (0, ARM), 0, LimbSearch(least_gain=np.inf)) is lost
    assert freed_limb(problem, [TRUTH], (0, ARM), 0, gainful) is TRUTH


def test_a_limb_that_nothing_contradicts_is_solved_for_only_where_its_pixels_gain(problem: SegmentProblem) -> None:
    """Where the pictures contradict the performer, anything that is likelier is an improvement."""
    lost, ratios = astray(), views_of(problem, [TRUTH], 0)
    kept, doubted = (ThinnedProblem.with_all(one) for one in (problem, replace(problem, doubted=(0,))))
    assert is_promising(kept, [lost], (0, [ARM]), TRUTH, ratios)
    assert not is_promising(kept, [TRUTH], (0, [ARM]), lost, ratios)
    assert is_promising(doubted, [TRUTH], (0, [ARM]), lost, ratios)


@pytest.mark.parametrize("clear", [False, True])
def test_a_limb_of_one_of_several_that_gains_little_is_moved_only_if_other_random_poses_lead_to_the_same_place(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch, clear: bool
) -> None:
    """Where little shows a limb, each search finds it elsewhere. Of a limb that is lost for long, too, drawn poses
    scatter widely, but what it gains is beyond chance.
    """
    right, draws, gains = limb_search.likeliest_limb, [], list[float]()
    gain_of = limb_search._gain_elsewhere
    monkeypatch.setattr(limb_search, "_gain_elsewhere", lambda *given: gains.append(gain_of(*given)) or gains[-1])

    def by_turns(limb: LimbModel, *given: Any) -> tuple[Array, float]:
        path, gain = right(limb, *given)
        draws.append(gain)
        return (path if len(draws) % 2 else path + aside[:, None]), gain

    lost, aside = astray(), np.zeros((FRAMES, 3))
    monkeypatch.setattr(limb_search, "likeliest_limb", by_turns)
    freed_limb(problem, [lost], (0, ARM), 0, LimbSearch(least_gain=1e-9))
    least = LimbSearch(least_gain=gains[-1] / (1.1 if clear else 0.9) / CLEAR_GAIN_RATIO)
    draws.clear()
    assert error_mm(freed_limb(problem, [lost], (0, ARM), 0, least)) < 0.5 * error_mm(lost)
    assert len(draws) == (1 if clear else 2)
    draws.clear()
    aside[1:-1, 2] = 0.8
    assert (freed_limb(problem, [lost], (0, ARM), 0, least) is lost) is not clear
    draws.clear()
    assert error_mm(freed_limb(problem, [lost], (0, ARM), 0)) < 0.5 * error_mm(lost)  # of a single performer
    assert len(draws) == 1


def test_a_limb_of_one_of_several_gains_nothing_where_a_search_finds_it_a_few_centimetres_away(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """So far drawn poses scatter, and a descent reaches nearly as far."""

    def swung(angle: float) -> Motion:
        turn, Q = np.zeros((FRAMES, 3)), TRUTH.rotations.copy()
        turn[1:-1, 0] = angle
        Q[:, ARM[0]] = Q[:, ARM[0]] @ rotations.exp(turn)
        return Motion(TRUTH.translations, Q)

    def wrist_moved(motion: Motion) -> float:
        wrists = [landmark_positions(BODY, one, ["RWrist"]) for one in (motion, TRUTH)]
        return float(np.linalg.norm(wrists[0] - wrists[1], axis=-1).max())

    limb, _ = limb_of(problem, [TRUTH], (0, ARM), np.random.default_rng(0))
    monkeypatch.setattr(limb_search, "pixel_gains", lambda *_: np.ones(FRAMES))
    per_radian, seen = wrist_moved(swung(0.01)) / 0.01, np.ones(FRAMES)
    near, far = (swung(share * FOUND_REACH / per_radian) for share in (0.8, 1.3))
    assert limb_search._gain_elsewhere(limb, [], seen, TRUTH, near) == 0
    assert limb_search._gain_elsewhere(limb, [], seen, TRUTH, far) > 0


def test_a_search_for_a_limb_of_one_of_several_ends_where_its_rough_path_gains_too_little(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The fine rounds follow the noise of the pictures: they make any place seem better."""
    probabilities, fine = limb_paths.place_probabilities, []
    monkeypatch.setattr(limb_paths, "place_probabilities", lambda *given: fine.append(given) or probabilities(*given))
    of_several = LimbSearch(least_gain=MIN_GAIN_ELSEWHERE)
    freed_limb(problem, [astray()], (0, ARM), 0, of_several)
    assert len(fine) == 2
    freed_limb(problem, [TRUTH], (0, ARM), 0, of_several)
    assert len(fine) == 2
    freed_limb(problem, [TRUTH], (0, ARM), 0)  # of a single performer
    assert len(fine) == 4


@pytest.mark.parametrize("views", [1, 2])
def test_the_motion_of_one_performer_ends_with_noise_of_each_part_whatever_the_number_of_views(
    problem: SegmentProblem, views: int
) -> None:
    pictured = replace(problem, views=problem.views[:views], settings=Settings(limb_search=False))
    assert len(pictured.views) == views
    evidence = refined(pictured, [TRUTH], Workspace()).evidence
    assert evidence is not None and evidence.sampling.by_part


@pytest.mark.usefixtures("without_descent")
@pytest.mark.parametrize("right", [True, False])
def test_a_limb_is_also_searched_for_around_an_even_path_between_its_key_poses(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch, right: bool
) -> None:
    """It is nowhere near where it is now, where every search ends; what is found is kept if the pictures show it."""

    def near_even_path(_: SegmentProblem, motions: Sequence[Motion], *__: object, **___: object) -> Motion:
        led = np.abs(motions[0].difference(TRUTH)).max() < 0.01  # the arm swings evenly
        return (TRUTH if right else aside) if led else motions[0]

    aside = Motion(TRUTH.translations, TRUTH.rotations.copy())
    aside.rotations[1:-1, ARM[0]] = aside.rotations[1:-1, ARM[0]] @ rotations.exp(np.array([0.0, 0.0, -1.2]))
    monkeypatch.setattr(limb_proposals, "freed_limb", near_even_path)
    solution = refined(replace(problem, settings=Settings(limb_search=False)), [astray()], Workspace())
    found = with_limbs_found(problem, solution, LimbGroup(0, (ARM,)), SettledSolutions(), Workspace())
    if right:
        assert error_mm(found.motions[0]) < 1
    else:
        assert found is solution


@pytest.mark.usefixtures("without_descent")
def test_where_frames_follow_each_other_closely_what_shows_limbs_is_measured_on_some(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, known = np.array([0, 3, 6, 9, 11]), []

    def steadily_clearer(some: SegmentProblem, motions: Sequence[Motion]) -> list[tuple[object, ...]]:
        assert len(motions[0]) == some.length == len(frames)
        times = some.times / some.fps
        return [(0, ARM, times, lambda: 2 * times)]

    def refuted(_problem: object, support: Sequence[SupportOfLimb]) -> list[object]:
        known.extend((sides, shown()) for _, _, sides, shown in support)
        return []

    monkeypatch.setattr(ThinnedProblem, "of", lambda whole, _: ThinnedProblem.at(whole, frames, 3))
    monkeypatch.setattr(regained_limbs, "support_of_limbs", steadily_clearer)
    monkeypatch.setattr(regained_limbs, "refuted_limbs", refuted)
    solution = gauss_newton.descend(problem, [TRUTH], Workspace())
    assert regained_limbs.with_limbs_regained(problem, solution, Workspace()).motions is solution.motions
    [(sides, shown)] = known
    np.testing.assert_allclose(sides, np.arange(FRAMES) / FPS)
    np.testing.assert_allclose(shown, 2 * sides)


@pytest.mark.parametrize(("unhidden", "expected"), [(1.0, []), (0.5, [LimbGroup(1, (ARM,))])])
def test_a_weakly_shown_limb_of_one_of_several_is_searched_for_where_they_hide_one_another(
    problem: SegmentProblem, unhidden: float, expected: list[LimbGroup]
) -> None:
    """It was lost for most of the segment, so that it has not faded; on single frames it is shown well by chance."""
    two = replace(problem, bodies=(BODY, BODY), fixed=problem.fixed * 2, before=None, after=None)
    shown = np.where(np.isin(np.arange(FRAMES), [0, 4, 8, FRAMES - 1]), 60.0, 20.0)
    support = [(1, ARM, np.zeros(FRAMES), lambda: shown)]
    solution = SimpleNamespace(motions=(TRUTH, TRUTH), unhidden=np.full((2, FRAMES), unhidden))
    assert regained_limbs.suspected_groups(two, cast(SegmentSolution, solution), support) == expected


@pytest.mark.parametrize(("on_keys", "found"), [(60.0, True), (4.0, False)])
def test_a_limb_of_one_of_several_that_the_key_poses_do_not_show_is_not_searched_for(
    problem: SegmentProblem, on_keys: float, found: bool
) -> None:
    """Where pictures say nothing for a limb that is right, they would have it anywhere else."""
    two = replace(problem, bodies=(BODY, BODY), fixed=problem.fixed * 2, before=None, after=None)
    shown = np.where(np.isin(np.arange(FRAMES), [0, FRAMES - 1]), on_keys, -10.0)
    support = [(1, ARM, np.full(FRAMES, -20.0), lambda: shown)]
    solution = SimpleNamespace(motions=(TRUTH, TRUTH), unhidden=np.full((2, FRAMES), 0.5))
    groups = regained_limbs.suspected_groups(two, cast(SegmentSolution, solution), support)
    assert groups == ([LimbGroup(1, (ARM,))] if found else [])


def test_limbs_of_a_performer_who_is_held_are_not_searched_for(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    [free] = problem.fixed
    held = free | (np.arange(free.shape[1]) < free.shape[1] - 3)  # but for the last part
    two = replace(problem, bodies=(BODY, BODY), fixed=(free, held), before=None, after=None)
    monkeypatch.setattr(regained_limbs, "bent_limbs", lambda *_: [ARM])
    solution = SimpleNamespace(motions=(TRUTH, TRUTH), unhidden=np.ones((2, FRAMES)))
    assert regained_limbs.suspected_groups(two, cast(SegmentSolution, solution), []) == [LimbGroup(0, (ARM,))]


def test_what_views_show_of_a_performer_is_collected_once_for_all_of_its_limbs(
    problem: SegmentProblem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Limbs of one performer change nothing in how the others are drawn; those of the other performer do."""
    seen: list[int] = []
    searched: list[tuple[int, object]] = []

    def views_of(_problem: object, _motions: object, performer: int) -> list[int]:
        seen.append(performer)
        return [len(seen)]

    def found(
        _problem: object, solution: SegmentSolution, group: LimbGroup, *_: object, ratios: list[int]
    ) -> SegmentSolution:
        searched.append((group.performer, ratios[0]))
        return solution

    monkeypatch.setattr(regained_limbs, "views_of", views_of)
    monkeypatch.setattr(regained_limbs, "with_limbs_found", found)
    two = replace(
        problem, bodies=(BODY, BODY), fixed=problem.fixed * 2, before=problem.before * 2, after=problem.after * 2
    )
    groups = [LimbGroup(i, ([2 * i + k],)) for k in range(2) for i in (1, 0)]
    begin = cast(SegmentSolution, SimpleNamespace(motions=(TRUTH, TRUTH)))
    regained_limbs._searched(two, begin, groups, SettledSolutions(), Workspace())
    assert seen == [1, 0] and searched == [(1, 1), (1, 1), (0, 2), (0, 2)]
