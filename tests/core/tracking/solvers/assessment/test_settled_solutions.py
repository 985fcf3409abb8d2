"""Solving a solution further, to compare it with others, may lead it astray in a single view."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.tracking.solvers.assessment import settled_solutions
from kfmocap.core.tracking.solvers.assessment.settled_solutions import SettledSolution, SettledSolutions
from kfmocap.core.tracking.solvers.assessment.solution_ranking import RESTING_GAIN, likelihood, noise_at
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem, SegmentSolution
from kfmocap.core.tracking.solvers.equations.segment_equations import SegmentNoise
from made_evidence import Landscape
from synthetic import CAMERAS, at_rest, dark, ends_held

BODY, FRAMES = human(), 8
TRUTH = at_rest(BODY, FRAMES)
ARM = BODY.index("upper_arm.L")


def turned(angle: float) -> Motion:
    """The arm elsewhere between the key poses."""
    Q = TRUTH.rotations.copy()
    Q[1:-1, ARM] = Q[1:-1, ARM] @ rotations.exp(np.array([angle, 0.0, 0.0]))
    return Motion(TRUTH.translations, Q)


@pytest.mark.parametrize(
    ("views", "begun", "ended", "kept"), [(1, 0.1, 0.8, "begun"), (1, 0.8, 0.1, "ended"), (2, 0.1, 0.8, "ended")]
)
def test_a_limb_is_not_drawn_away_from_where_a_single_view_shows_it(
    monkeypatch: pytest.MonkeyPatch, views: int, begun: float, ended: float, kept: str
) -> None:
    found = settled(monkeypatch, views, begun, ended, Landscape(truth=TRUTH))
    assert (found.motions[0].rotations == turned(begun if kept == "begun" else ended).rotations).all()


@pytest.mark.parametrize(("gains", "kept"), [(0.5, 0.8), (2.0, 0.5)])
def test_what_is_hardly_less_likely_for_having_been_solved_further_is_not_astray(
    monkeypatch: pytest.MonkeyPatch, gains: float, kept: float
) -> None:
    problem, unit = seen_by(1), Landscape(truth=TRUTH, cover=1.0)  # both angles are beyond its reach
    near, far = (unit.solution(problem, turned(angle)) for angle in (0.5, 0.8))
    noise = noise_at(problem, near, unit)
    loss = likelihood(problem, noise, near) - likelihood(problem, noise, far)
    world = Landscape(truth=TRUTH, cover=gains * RESTING_GAIN / loss)
    assert (settled(monkeypatch, 1, 0.5, 0.8, world).motions[0].rotations == turned(kept).rotations).all()


def test_the_noise_of_a_solution_is_estimated_once_for_all_limbs(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, world = seen_by(2), Landscape(truth=TRUTH)
    first, second = (world.solution(problem, turned(angle)) for angle in (0.1, 0.2))
    estimated: list[SegmentSolution] = []

    def noise(_: object, solution: SegmentSolution, __: object) -> SegmentNoise:
        estimated.append(solution)
        return noise_at(problem, solution, world)

    monkeypatch.setattr(settled_solutions, "noise_at", noise)
    monkeypatch.setattr(settled_solutions, "descend", lambda *_: first)
    known = SettledSolutions()
    for begin in (first, first, second):
        kept = known.noise(problem, begin, world)
        assert known.after(problem, begin, world).noise is kept
    assert [one.motions for one in estimated] == [first.motions, second.motions]


def seen_by(views: int) -> SegmentProblem:
    seen = tuple(view for camera in CAMERAS[:views] for view in dark(camera, FRAMES))
    return SegmentProblem(seen, (BODY,), 0, 30.0, (ends_held(BODY, FRAMES),))


def settled(
    monkeypatch: pytest.MonkeyPatch, views: int, begun: float, ended: float, landscape: Landscape
) -> SegmentSolution:
    """Settle a solution with the arm turned by one angle, of which solving it further makes another one."""
    problem = seen_by(views)
    end = landscape.solution(problem, turned(ended))
    monkeypatch.setattr(settled_solutions, "descend", lambda *_: end)
    return SettledSolution.after(problem, landscape.solution(problem, turned(begun)), landscape).solution
