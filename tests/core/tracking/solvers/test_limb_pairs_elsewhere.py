"""Both limbs of a pair are searched for at once, as with one of them elsewhere alone the images may be less likely."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.limbs import limb_pairs
from kfmocap.core.body.motion import Motion, with_motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.judgement.settled_solutions import SettledSolution, SettledSolutions
from kfmocap.core.tracking.solvers.judgement.solution_ranking import noise_at
from kfmocap.core.tracking.solvers.limb_corrections import limb_pairs_elsewhere, regained_limbs
from kfmocap.core.tracking.solvers.limb_corrections.search_rounds import MAX_VAIN_ROUNDS
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, dark, ends_held

BODY, FRAMES, FPS = human(), 16, 30.0
PAIR = limb_pairs(BODY)[0]
LOST = at_rest(BODY, FRAMES)


def turned(motion: Motion, chain: Sequence[int]) -> Motion:
    """A limb elsewhere between the key poses."""
    turns = np.zeros((FRAMES, 3))
    turns[1:-1, 0] = 0.9
    Q = motion.rotations.copy()
    Q[:, chain[0]] = LOST.rotations[:, chain[0]] @ rotations.exp(turns)
    return Motion(motion.translations, Q)


def seen_by(cameras: int) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS[:cameras] for view in dark(camera, FRAMES))
    return SegmentProblem(views, (BODY,), 0, FPS, (ends_held(BODY, FRAMES),))


BEGIN = Landscape(truth=LOST).solution(seen_by(2), LOST)


def limbs_moved(motion: Motion) -> int:
    return sum(not np.array_equal(motion.rotations[:, chain], LOST.rotations[:, chain]) for chain in PAIR)


def searched(
    monkeypatch: pytest.MonkeyPatch, reached: Sequence[Sequence[int]], likelihoods: Sequence[float]
) -> tuple[SegmentSolution, list[Motion]]:
    """Search where only some limbs are found elsewhere, and images are so likely with 0, 1, 2 limbs there. Return the
    result, and what was solved from."""
    asked: list[Motion] = []

    def found(_: object, motions: Sequence[Motion], place: tuple[int, list[int]], *__: object, **___: object) -> Motion:
        return turned(motions[0], place[1]) if place[1] in reached else motions[0]

    def solved(_: object, motions: Sequence[Motion], *__: object) -> SegmentSolution:
        asked.append(motions[0])
        return replace(BEGIN, motions=tuple(motions))

    def taken(_: object, __: SegmentSolution, ___: object, there: SegmentSolution, *____: object, **_____: object):
        return there

    monkeypatch.setattr(limb_pairs_elsewhere, "freed_limb", found)
    monkeypatch.setattr(limb_pairs_elsewhere, "solved_from", solved)
    monkeypatch.setattr(
        limb_pairs_elsewhere, "likelihood", lambda *given: likelihoods[limbs_moved(given[2].motions[0])]
    )
    monkeypatch.setattr(limb_pairs_elsewhere, "to_be_beaten", lambda *_: 0.0)
    monkeypatch.setattr(limb_pairs_elsewhere, "settled_further", lambda *given, **_: given[2])
    monkeypatch.setattr(limb_pairs_elsewhere, "likelier", taken)
    settled = SettledSolution(BEGIN, noise_at(seen_by(2), BEGIN, Workspace()), BEGIN)
    monkeypatch.setattr(SettledSolutions, "after", lambda *_: settled)
    known = SettledSolutions()
    return limb_pairs_elsewhere.with_pairs_found(seen_by(2), BEGIN, [PAIR], known, Workspace()), asked


def test_both_limbs_are_moved_where_the_images_are_less_likely_with_only_one_of_them_moved(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    found, asked = searched(monkeypatch, PAIR, likelihoods=(0.0, -500.0, 500.0))
    assert limbs_moved(found.motions[0]) == 2
    assert [limbs_moved(motion) for motion in asked] == [2]  # the next round finds both where they are


def test_the_search_ends_after_rounds_in_vain(monkeypatch: pytest.MonkeyPatch) -> None:
    found, asked = searched(monkeypatch, PAIR, likelihoods=(0.0, -500.0, -500.0))
    assert found is BEGIN and len(asked) == MAX_VAIN_ROUNDS


def test_limbs_that_are_found_where_they_were_cost_no_solving(monkeypatch: pytest.MonkeyPatch) -> None:
    found, asked = searched(monkeypatch, [], likelihoods=(0.0, 0.0, 0.0))
    assert found is BEGIN and not asked


@pytest.mark.parametrize(("cameras", "asked"), [(2, True), (1, False)])
def test_all_pairs_of_a_doubted_performer_are_searched_for_in_several_views(
    monkeypatch: pytest.MonkeyPatch, cameras: int, asked: bool
) -> None:
    """In a single view the likelier of two motions is not the truer one often enough."""
    pairs: list[object] = []

    def found(_: object, solution: SegmentSolution, given: Sequence[object], *__: object) -> SegmentSolution:
        pairs.extend(given)
        return solution

    monkeypatch.setattr(regained_limbs, "with_pairs_found", found)
    for name in ("_stirred", "_with_limb_looked_for"):
        monkeypatch.setattr(regained_limbs, name, lambda *given, **_: given[1])
    for lost in ("bent_limbs", "refuted_limbs"):
        monkeypatch.setattr(regained_limbs, lost, lambda *_: [])
    doubted = replace(seen_by(cameras), doubted=(0,))
    regained_limbs.with_limbs_regained(
        doubted, replace(BEGIN, motions=with_motion(BEGIN.motions, 0, LOST)), Workspace()
    )
    assert pairs == (limb_pairs(BODY) if asked else [])
