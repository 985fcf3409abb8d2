"""A limb of a single performer that the images show less clearly than on the key poses is searched for, and moved only
where it is likelier elsewhere."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limb_pairs, limbs
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.equations.segment_equations import SegmentNoise
from kfmocap.core.tracking.solvers.judgement.settled_solutions import SettledSolution, SettledSolutions
from kfmocap.core.tracking.solvers.limb_corrections import regained_limbs, weakly_shown_limbs
from kfmocap.core.tracking.solvers.thinned_frames import ThinnedProblem, kept_frames
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, dark, ends_held

BODY, FRAMES, FPS = human(), 16, 30.0
LIMBS = limbs(BODY)
REST = at_rest(BODY, FRAMES)
EVEN = np.linspace(60.0, 100.0, FRAMES)


def seen_by(cameras: int, performers: int = 1) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS[:cameras] for view in dark(camera, FRAMES))
    return SegmentProblem(views, (BODY,) * performers, 0, FPS, (ends_held(BODY, FRAMES),) * performers)


def turned(angle: float) -> Motion:
    """The first limb turned away between the key poses, by an angle in radians."""
    turns = np.zeros((FRAMES, 3))
    turns[1:-1, 0] = angle
    Q = REST.rotations.copy()
    Q[:, LIMBS[0][0]] = Q[:, LIMBS[0][0]] @ rotations.exp(turns)
    return Motion(REST.translations, Q)


def low(share: float, first: int, last: int) -> np.ndarray:
    shown = EVEN.copy()
    shown[first : last + 1] *= share
    return shown


@pytest.mark.parametrize(
    ("shown", "weak"),
    [
        (EVEN, False),
        (low(0.6, 6, 8), True),
        (low(0.6, 6, 6), False),  # a moment
        (low(0.8, 3, 12), False),  # shown a little less
        (low(0.5, 1, FRAMES - 2), True),  # lost nearly all the time: its median is low, too
        (0.1 * EVEN, False),  # hardly seen on the key poses either
    ],
)
def test_a_limb_is_weak_where_its_support_falls_below_that_of_the_key_poses(
    monkeypatch: pytest.MonkeyPatch, shown: np.ndarray, weak: bool
) -> None:
    def each(_problem: object, _motions: object) -> Iterator[tuple[object, ...]]:
        for k, chain in enumerate(LIMBS):
            yield 0, chain, np.zeros(FRAMES), lambda k=k: shown if k == 1 else EVEN

    monkeypatch.setattr(weakly_shown_limbs, "support_of_limbs", each)
    found = weakly_shown_limbs.weakly_shown_limbs(seen_by(2), [REST])
    assert found == ([(0, LIMBS[1])] if weak else [])


def searched(
    monkeypatch: pytest.MonkeyPatch, across: Motion | None, around: Motion | None, accepted: Motion | None
) -> tuple[Motion, list[Motion]]:
    """Search for the first limb; only one motion is likelier than what there is. Return the result, and what was
    tried."""
    problem, asked = seen_by(2), list[Motion]()
    begin = Landscape(truth=REST).solution(problem, REST)

    def proposed(motion: Motion | None, present: Motion) -> Motion | None:
        return None if motion is None or motion is present else motion

    def decided(*args: object, **_: object) -> SegmentSolution:
        solution, motion = args[1], args[4]
        assert isinstance(solution, SegmentSolution) and isinstance(motion, Motion)
        asked.append(motion)
        return replace(solution, motions=(motion,)) if motion is accepted else solution

    def led(_problem: object, motions: Sequence[Motion], _place: object) -> tuple[Motion] | None:
        motion = proposed(across, motions[0])
        return None if motion is None else (motion,)

    monkeypatch.setattr(weakly_shown_limbs, "found_across", led)
    monkeypatch.setattr(weakly_shown_limbs, "found_elsewhere", lambda _p, motions, *_: proposed(around, motions[0]))
    monkeypatch.setattr(weakly_shown_limbs, "likelier_with_limb", decided)
    monkeypatch.setattr(weakly_shown_limbs, "weakly_shown_limbs", lambda *_: [(0, LIMBS[0])])
    monkeypatch.setattr(weakly_shown_limbs, "with_pairs_found", lambda *given, **_: given[1])
    monkeypatch.setattr(SettledSolutions, "after", lambda *_: None)
    end = weakly_shown_limbs.with_weakly_shown_limbs_found(problem, begin, SettledSolutions(), Workspace())
    return end.motions[0], asked


def test_what_the_search_finds_around_either_path_is_kept_where_it_is_likelier(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    there, elsewhere = turned(0.9), turned(-0.9)
    assert searched(monkeypatch, there, elsewhere, accepted=there)[0] is there
    assert searched(monkeypatch, there, elsewhere, accepted=elsewhere)[0] is elsewhere
    assert searched(monkeypatch, there, elsewhere, accepted=None)[0] is REST


@pytest.mark.parametrize("both", [True, False])
def test_pairs_of_which_both_limbs_are_weak_are_searched_for_first(monkeypatch: pytest.MonkeyPatch, both: bool) -> None:
    asked: list[object] = []
    pair = limb_pairs(BODY)[0]
    weak = [(0, chain) for chain in (pair if both else pair[:1])]

    def paired(
        _: object, solution: SegmentSolution, pairs: list[object], *__: object, **___: object
    ) -> SegmentSolution:
        asked.extend(pairs)
        return solution

    monkeypatch.setattr(weakly_shown_limbs, "with_pairs_found", paired)
    monkeypatch.setattr(weakly_shown_limbs, "weakly_shown_limbs", lambda *_: weak)
    monkeypatch.setattr(weakly_shown_limbs, "_with_limb_found", lambda *given, **_: asked.append(given[2]) or given[1])
    begin = Landscape(truth=REST).solution(seen_by(2), REST)
    weakly_shown_limbs.with_weakly_shown_limbs_found(seen_by(2), begin, SettledSolutions(), Workspace())
    assert asked == ([pair, *weak] if both else weak)


@pytest.mark.parametrize("found", [True, False])
def test_where_frames_follow_each_other_closely_limbs_are_searched_for_on_some_and_decided_on_all(
    monkeypatch: pytest.MonkeyPatch, found: bool
) -> None:
    problem, lengths = seen_by(2), list[int]()
    begin, there = Landscape(truth=REST).solution(problem, REST), turned(0.9)
    kept, noise = kept_frames(problem, 2), SegmentNoise(*[np.zeros(0)] * 3)

    def searched_on(few: SegmentProblem, solution: SegmentSolution, *_: object) -> SegmentSolution:
        lengths.append(few.length)
        return replace(solution, motions=(there[kept],)) if found else solution

    def solved(whole: SegmentProblem, motions: Sequence[Motion], *_: object) -> SegmentSolution:
        assert len(motions[0]) == whole.length
        return replace(begin, motions=tuple(motions))

    monkeypatch.setattr(ThinnedProblem, "of", lambda whole, _: ThinnedProblem.at(whole, kept, 2))
    monkeypatch.setattr(weakly_shown_limbs, "descend", solved)
    monkeypatch.setattr(weakly_shown_limbs, "solved_from", solved)
    monkeypatch.setattr(weakly_shown_limbs, "likelier", lambda *given, **_: given[3])
    monkeypatch.setattr(weakly_shown_limbs, "weakly_shown_limbs", lambda *_: [(0, LIMBS[0])])
    monkeypatch.setattr(weakly_shown_limbs, "_with_limbs_found", searched_on)
    monkeypatch.setattr(SettledSolutions, "after", lambda *_: SettledSolution(begin, noise, begin))
    end = weakly_shown_limbs.with_weakly_shown_limbs_found(problem, begin, SettledSolutions(), Workspace())
    assert lengths == [len(kept)] and len(kept) < problem.length
    assert (end is begin) == (not found)
    np.testing.assert_allclose(end.motions[0].rotations[kept], (there if found else REST).rotations[kept], atol=1e-9)


def test_a_limb_that_is_found_where_it_was_costs_no_solving(monkeypatch: pytest.MonkeyPatch) -> None:
    assert searched(monkeypatch, None, None, accepted=None) == (REST, [])


def test_a_likelier_solution_with_the_limb_where_it_was_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """It would be chance."""
    near = turned(0.02)
    assert searched(monkeypatch, near, None, accepted=near)[0] is REST


@pytest.mark.parametrize(
    ("cameras", "performers", "doubted", "looked_for"),
    [(2, 1, (), True), (1, 1, (), False), (2, 2, (), False), (2, 1, (0,), False)],
)
def test_it_is_looked_for_where_several_views_show_one_performer_whom_nothing_contradicted(
    monkeypatch: pytest.MonkeyPatch, cameras: int, performers: int, doubted: tuple[int, ...], looked_for: bool
) -> None:
    """The limbs of one who was doubted are all searched for."""
    problem = replace(seen_by(cameras, performers), doubted=doubted)
    begin, asked = Landscape(truth=REST).solution(seen_by(2), REST), list[object]()
    begin = replace(begin, motions=(REST,) * performers)

    def found(_problem: object, solution: SegmentSolution, *_: object) -> SegmentSolution:
        asked.append(solution)
        return solution

    monkeypatch.setattr(regained_limbs, "with_weakly_shown_limbs_found", found)
    monkeypatch.setattr(regained_limbs, "_likelier_anywhere", lambda _problem, solution, *_: solution)
    for lost in ("bent_limbs", "refuted_limbs", "support_of_limbs"):
        monkeypatch.setattr(regained_limbs, lost, lambda *_: [])
    regained_limbs.with_limbs_regained(problem, begin, Workspace())
    assert bool(asked) is looked_for
