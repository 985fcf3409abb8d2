"""A body that turns all the way round in part of the time between two key poses, and travels meanwhile."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics.rotations import exp
from kfmocap.core.shot.motion_warping import turned
from kfmocap.core.tracking.solvers.equations.measurement import Workspace
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.starts import placed_turns as module
from kfmocap.core.tracking.solvers.starts import whole_turns
from kfmocap.core.tracking.solvers.starts.placed_turns import (
    LARGEST_STEP,
    STEPS,
    _likeliest_steps,
    _middle_of,
    placed_turns,
)
from made_evidence import Landscape
from synthetic import at_rest, coloured, ends_held, look_at

Array = np.ndarray
BODY, LENGTH, FPS = human(1.75), 16, 20.0
HELD = ends_held(BODY, LENGTH)
CAMERAS = (look_at("front", (0.4, -4.5, 1.2)), look_at("side", (-4.2, -1.6, 1.3)))
SIDEWAYS = np.array([0.0, 0.0, 1.0])
SHARE = np.clip(np.arange(LENGTH) / (0.6 * (LENGTH - 1)), 0, 1)
"""Of the turn and of the way, on each frame: both are over after three fifths of the time."""


def cartwheel(angle: float = 2 * np.pi) -> Motion:
    """A cartwheel with one arm raised, over 1.2 m."""
    motion = at_rest(BODY, LENGTH)
    Q = motion.rotations.copy()
    Q[:, 0] = Q[:, 0] @ exp((angle * SHARE)[:, None] * SIDEWAYS)
    Q[:, BODY.index("upper_arm.L")] = exp(np.array([0.0, -1.2, 0.0]))
    shift = np.outer(SHARE, [1.2, 0.0, 0.0]) - [0.6, 0.0, 0.0]
    return Motion(motion.translations + shift, Q)


TRUTH = cartwheel()
CURVE = Motion(np.linspace(TRUTH.translations[0], TRUTH.translations[-1], LENGTH), cartwheel(0.0).rotations)
PROBLEM = SegmentProblem(coloured(BODY, TRUTH, CAMERAS), (BODY,), 0, FPS, (HELD,))
ANY = -np.inf
"""Cover of a solution that any turn may beat."""


def off(motion: Motion) -> tuple[float, float]:
    """How far the trunk is from the truth on the worst frame: radians and metres."""
    away = motion.difference(TRUTH)
    (_, T), (_, T_true) = part_poses(BODY, motion), part_poses(BODY, TRUTH)
    return float(np.linalg.norm(away[:, 3:6], axis=1).max()), float(np.linalg.norm(T - T_true, axis=-1)[:, 0].max())


def test_a_cartwheel_that_is_over_early_is_found_where_and_when_it_happens() -> None:
    """The even turn along the curve is more than a right angle behind it, and half a metre."""
    angle, distance = off(turned(CURVE, HELD, SIDEWAYS))
    assert angle > np.pi / 2 and distance > 0.4
    starts = placed_turns(PROBLEM, [CURVE], ANY, Workspace())
    angle, distance = off(starts[0][0])
    assert angle < np.pi / 6 and distance < 0.2
    assert len(starts) <= 6
    for [motion] in starts:
        np.testing.assert_allclose(motion.difference(CURVE)[[0, -1]], 0, atol=1e-12)


def test_nobody_who_stays_upright_is_turned_over() -> None:
    """On the curve, or half a metre beside it. Outlines alone hardly tell a spin."""
    beside = np.outer(np.sin(np.pi * np.linspace(0, 1, LENGTH)), [0, 0.5, 0])
    for true in (CURVE, Motion(CURVE.translations + beside, CURVE.rotations)):
        problem = replace(PROBLEM, views=coloured(BODY, true, CAMERAS))
        for [motion] in placed_turns(problem, [CURVE], ANY, Workspace()):
            assert (np.abs(motion.rotations[:, 0, 1, 1] - 1) < 1e-6).all()


@pytest.mark.parametrize(("share", "worth"), [(0.98, 0), (1.02, 6)])
def test_turns_are_worth_solving_if_they_bring_the_placed_body_half_way_to_what_is_covered_already(
    monkeypatch: pytest.MonkeyPatch, share: float, worth: int
) -> None:
    rival, even = 2e4, np.linspace(0, STEPS, LENGTH)
    monkeypatch.setattr(
        module,
        "_likeliest_steps",
        lambda covers: (even, covers[0].sum() + share * 0.5 * (rival - covers[0].sum())),
    )
    assert len(placed_turns(PROBLEM, [CURVE], rival, Workspace())) == worth


def test_where_nothing_shows_the_body_it_travels_along_the_curve() -> None:
    """So it does where a view alone sees it, but for what that view shows."""
    dark = tuple(replace(view, foreground=np.zeros_like(view.foreground)) for view in PROBLEM.views)
    for [motion] in placed_turns(replace(PROBLEM, views=dark), [CURVE], ANY, Workspace()):
        np.testing.assert_allclose(_middle_of(BODY, motion), _middle_of(BODY, CURVE), atol=1e-6)


def test_the_steps_of_a_turn_begin_with_none_end_with_all_and_never_go_back() -> None:
    true = np.array([0, 0, 0, 2, 4, 6, 7, 8, 9, 10, 11, 12, 12])
    covers = np.random.default_rng(0).normal(0, 0.3, (STEPS + 1, len(true)))
    covers[true, np.arange(len(true))] += 2
    covers[5, 0] = covers[3, -1] = covers[1, 6] = 30.0
    covers[6, 6] += 40.0
    steps, cover = _likeliest_steps(covers)
    assert (steps[0], steps[-1]) == (0, STEPS)
    assert ((np.diff(steps) >= 0) & (np.diff(steps) <= LARGEST_STEP)).all()
    assert cover == pytest.approx(covers[steps.astype(int), np.arange(len(true))].sum())
    assert steps[6] == 6


@pytest.mark.parametrize(
    ("unexplained", "only", "views", "tried"),
    [(4, None, 2, True), (3, None, 2, False), (4, 0, 2, False), (4, None, 1, False)],
)
def test_they_are_tried_for_a_single_performer_in_several_views_whom_even_turns_leave_unexplained(
    monkeypatch: pytest.MonkeyPatch, unexplained: int, only: int | None, views: int, tried: bool
) -> None:
    """On a quarter of the frames."""
    landscape, asked = Landscape(truth=CURVE), list[object]()
    monkeypatch.setattr(whole_turns, "frames_unexplained", lambda *_: np.arange(unexplained))
    monkeypatch.setattr(whole_turns, "placed_turns", lambda *given: asked.append(given[1]) or [])
    problem = replace(PROBLEM, views=PROBLEM.views[:views], only=only)
    given = [CURVE]
    start, _ = whole_turns.with_whole_turn(problem, given, landscape.solution(problem, CURVE), landscape)
    assert [motions is given for motions in asked] == [True] * tried
    assert start is given


def test_a_placed_turn_is_taken_if_it_covers_most_once_it_is_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    landscape = Landscape(truth=TRUTH, reach=0.7)
    monkeypatch.setattr(whole_turns, "frames_unexplained", lambda *_: np.arange(LENGTH))
    monkeypatch.setattr(whole_turns, "placed_turns", lambda *_: [[CURVE], [TRUTH]])
    monkeypatch.setattr(whole_turns, "SOLVED_TURNS", 0)
    first = landscape.solution(PROBLEM, CURVE)
    assert whole_turns.with_whole_turn(PROBLEM, [CURVE], first, landscape)[1] is first
    monkeypatch.setattr(whole_turns, "SOLVED_TURNS", 2)
    start, found = whole_turns.with_whole_turn(PROBLEM, [CURVE], first, landscape)
    assert start == [TRUTH] and off(found.motions[0])[0] < 0.1
