"""Solutions are doubted, limbs are looked for, and the best of what is found counts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import chain, repeat

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.occlusion import LONG
from kfmocap.core.shot.shot import Settings
from kfmocap.core.tracking.solvers import multi_start
from kfmocap.core.tracking.solvers.limb_search import pairs
from kfmocap.core.tracking.solvers.multi_start import ALIKE, EQUAL, NEAR
from kfmocap.core.tracking.solvers.problem import Problem, Solution
from synthetic import at_rest, coloured, dark, ends_held, figure, look_at, swing

BODY = figure()
HUMAN = human(1.75)
ARMS, LEGS = (left + right for left, right in pairs(HUMAN))
CAMERAS = (look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3)))
SETTINGS = Settings()
FPS = 30.0


def test_fixed_degrees_of_freedom_do_not_move() -> None:
    F = 7
    start = swing(BODY, F, 0.3)
    fixed = ends_held(BODY, F)
    fixed[3, 6:9] = fixed[2, 0] = True
    found = multi_start.solve(Problem(dark(CAMERAS[0], F), (BODY,), 0, FPS, (fixed,)), [start], SETTINGS).motions[0]
    moved = start.difference(found)
    np.testing.assert_allclose(moved[fixed], 0, atol=1e-12)
    assert np.abs(moved[1:-1]).max() > 1e-2


def explained(problem: Problem, motion: Motion) -> Solution:
    """A motion as if it had been found."""
    _, evidence = problem.evidence(problem.geometry(), [motion], 1.0, 1.0, 2, 0.07)
    total, none = evidence.explained.sum(axis=0), np.zeros(len(motion))
    return Solution((motion,), 1, (0.0,), (), evidence.share, total, none, {})


def test_a_body_that_covers_background_is_doubted() -> None:
    truth = swing(BODY, 5, 0.2)
    problem = Problem(coloured(BODY, truth, CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, 5),))
    assert not multi_start.doubtful(problem, explained(problem, truth))
    beside = np.zeros((5, BODY.dof))
    beside[2, 0] = 0.35
    assert multi_start.doubtful(problem, explained(problem, truth.moved(beside)))


def test_whether_a_solution_is_doubted_goes_by_the_key_poses() -> None:
    """What is expected between them lies between what they explain."""
    total = np.array([100.0, 90, 80, 70, 60])
    share, none = np.ones((1, 5, len(BODY))), np.zeros(5)

    def doubted(explained: np.ndarray, fixed: np.ndarray) -> bool:
        problem = Problem((), (BODY,), 0, FPS, (fixed,))
        return multi_start.doubtful(problem, Solution((swing(BODY, 5),), 1, (), (), share, explained, none, {}))

    assert not doubted(total, ends_held(BODY, 5))
    assert not doubted(total * [1, 0.85, 0.85, 0.85, 1], ends_held(BODY, 5))
    assert doubted(total * [1, 1, 1, 0.75, 1], ends_held(BODY, 5))
    first = np.zeros((5, BODY.dof), bool)
    first[0] = True
    assert doubted(total, first) and not doubted(total, np.zeros((5, BODY.dof), bool))


def covering(cover: float, share: np.ndarray | None = None) -> Solution:
    """A solution that covers so much of the performers on every frame."""
    share = np.ones((1, LONG + 2, len(BODY))) if share is None else share
    frames = share.shape[1]
    none = np.zeros(frames)
    return Solution((at_rest(BODY, frames),), 1, (), (), share, np.full(frames, cover), none, {})


@pytest.mark.parametrize(("hidden", "expected"), [(LONG, True), (LONG - 1, False)])
def test_a_limb_that_no_view_sees_for_longer_than_prediction_bridges_is_concealed(hidden: int, expected: bool) -> None:
    frames = LONG + 2
    problem = Problem(coloured(BODY, at_rest(BODY, frames), CAMERAS), (BODY,), 0, FPS, (ends_held(BODY, frames),))
    share = np.ones((2, frames, len(BODY)))
    share[0] = 0  # of what one view hides the other shows
    assert not multi_start.concealed(problem, covering(1, share))
    share[1, 1 : 1 + hidden, BODY.index("forearm.L")] = 0
    assert multi_start.concealed(problem, covering(1, share)) == expected
    trunk = np.ones_like(share)
    trunk[..., 0] = 0
    assert not multi_start.concealed(problem, covering(1, trunk))
    keyed = replace(problem, fixed=(np.ones((frames, BODY.dof), bool),))
    assert not multi_start.concealed(keyed, covering(1, share))
    blind = replace(problem, views=dark(CAMERAS[0], frames))
    assert not multi_start.concealed(blind, covering(1, share))


def test_solutions_are_equals_of_the_best_within_what_is_chance() -> None:
    best, near, far = (covering(cover) for cover in (1000, 1000 * (1 - 0.9 * EQUAL), 1000 * (1 - 1.1 * EQUAL)))
    assert multi_start.equals([far, best, near]) == [best, near]
    assert multi_start.equals([covering(0.0)] * 2)  # views that tell nothing


@pytest.mark.parametrize(("gain", "moved"), [(0.5, False), (3, True)])
def test_limbs_stay_where_they_were_unless_others_cover_more_than_chance_would(
    monkeypatch: pytest.MonkeyPatch, gain: float, moved: bool
) -> None:
    before, after = covering(1000), covering(1000 * (1 + gain * EQUAL))
    monkeypatch.setattr(multi_start, "descend", lambda *_: before)
    monkeypatch.setattr(multi_start, "_looked_for", lambda *_: after)
    problem = Problem(dark(CAMERAS[0], LONG + 2), (BODY,), 0, FPS, (ends_held(BODY, LONG + 2),))
    found = multi_start.searched(problem, before.motions, [before], SETTINGS)
    assert found is (after if moved else before)


def test_limbs_are_looked_for_around_the_best_until_it_has_an_equal(monkeypatch: pytest.MonkeyPatch) -> None:
    first = covering(1000)
    better = [covering(1000 * (1 + 3 * EQUAL) ** k) for k in (1, 2, 2)]
    begins: list[object] = []

    def looked_for(_problem: object, _around: object, motions: object, *_: object) -> Solution:
        begins.append(motions)
        return better[len(begins) - 1]

    monkeypatch.setattr(multi_start, "descend", lambda *_: first)
    monkeypatch.setattr(multi_start, "_looked_for", looked_for)
    problem = Problem(dark(CAMERAS[0], LONG + 2), (BODY,), 0, FPS, (ends_held(BODY, LONG + 2),))
    worse = covering(900)  # is not looked around
    found = multi_start.searched(problem, first.motions, [worse, first], SETTINGS)
    assert [id(begin) for begin in begins] == [id(s.motions) for s in (first, better[0], better[1])]
    assert found is better[1]


def test_where_the_best_is_doubtful_limbs_are_looked_for_around_all_and_around_the_start(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    best, worse, start = covering(1000), covering(900), covering(1)
    begins: list[object] = []

    def looked_for(_problem: object, _around: object, motions: object, *_: object) -> Solution:
        begins.append(motions)
        return best

    monkeypatch.setattr(multi_start, "doubtful", lambda *_: True)
    monkeypatch.setattr(
        multi_start, "descend", lambda _problem, motions, *_: best if motions is best.motions else worse
    )
    monkeypatch.setattr(multi_start, "_looked_for", looked_for)
    problem = Problem(dark(CAMERAS[0], LONG + 2), (BODY,), 0, FPS, (ends_held(BODY, LONG + 2),))
    multi_start.searched(problem, start.motions, [worse, best], SETTINGS)
    assert [id(begin) for begin in begins] == [id(s.motions) for s in (worse, best, start)]


@dataclass
class Settled:
    """Stands in for `descend`, counts what it settles: the farther motions are from the truth the less they cover."""

    truth: Motion
    loss: float = 0.1
    settled: int = 0

    def __call__(self, _problem: object, motions: tuple[Motion, ...], *_: object) -> Solution:
        self.settled += 1
        return self.of(motions[0])

    def of(self, motion: Motion) -> Solution:
        error = float(np.sqrt(np.mean(motion.difference(self.truth) ** 2)))
        return replace(covering(1000 * (1 - self.loss * error)), motions=(motion,), energy=(error,))


def off(motion: Motion, parts: list[int], angle: float) -> Motion:
    """A motion with some parts turned between its ends."""
    steps = np.zeros((len(motion), HUMAN.dof))
    steps[1:-1, 3:].reshape(len(motion) - 2, -1, 3)[:, parts, 0] = angle
    return motion.moved(steps)


def recombined(monkeypatch: pytest.MonkeyPatch, settled: Settled, *solutions: Solution) -> Solution:
    """What comes of some solutions, the best first."""
    monkeypatch.setattr(multi_start, "descend", settled)
    problem = Problem(dark(CAMERAS[0], LONG + 2), (HUMAN,), 0, FPS, (np.zeros((LONG + 2, HUMAN.dof), bool),))
    return multi_start.recombined(problem, solutions[0], solutions, SETTINGS)


def test_arms_right_in_one_solution_and_legs_right_in_another_are_put_together(monkeypatch: pytest.MonkeyPatch) -> None:
    settled = Settled(swing(HUMAN, LONG + 2))
    best, other = (settled.of(off(settled.truth, parts, 5 * ALIKE)) for parts in ([0, *ARMS], LEGS))
    for solutions in ((best, other), (other, best)):
        found = recombined(monkeypatch, settled, *solutions)
        assert np.abs(found.motions[0].difference(settled.truth)).max() < 1e-9


def test_limbs_are_lent_only_where_that_covers_more_than_chance_would(monkeypatch: pytest.MonkeyPatch) -> None:
    settled = Settled(swing(HUMAN, LONG + 2), 0.05)
    best, other = (settled.of(off(settled.truth, parts, 2.2 * ALIKE)) for parts in (ARMS, LEGS))
    assert settled.of(settled.truth).explained.sum() > best.explained.sum()
    assert recombined(monkeypatch, settled, best, other) is best
    assert settled.settled > 0


def test_limbs_of_what_covers_too_little_or_lies_in_the_same_places_are_not_tried(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    settled = Settled(swing(HUMAN, LONG + 2))
    best, same = (settled.of(off(settled.truth, ARMS, angle)) for angle in (5 * ALIKE, 6 * ALIKE))
    far = settled.of(off(settled.truth, LEGS, 5 * ALIKE))
    far = replace(far, explained=(1 - 1.1 * NEAR) * best.explained)
    assert recombined(monkeypatch, settled, best, same, far) is best
    assert settled.settled == 0


def test_of_mixtures_that_cover_as_much_the_likeliest_counts(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = swing(HUMAN, LONG + 2)
    best, other = (replace(covering(1), motions=(off(truth, ARMS + LEGS, angle),)) for angle in (-1, 1))
    energies = chain((3.0, 2.0), repeat(4.0))
    even = replace(covering(2), motions=(truth,))
    monkeypatch.setattr(Settled, "of", lambda *_: replace(even, energy=(next(energies),)))
    assert recombined(monkeypatch, Settled(truth), best, other).energy == (2.0,)


def test_motions_are_alike_only_if_those_of_every_performer_are() -> None:
    motion = swing(HUMAN, 5)
    near, far = (off(motion, list(range(len(HUMAN))), angle * ALIKE) for angle in (0.5, 1.5))
    assert multi_start.alike([motion] * 4, [near] * 4)
    assert not multi_start.alike([motion] * 4, [near, far, near, near])
