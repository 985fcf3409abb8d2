"""Views taken between the frames: interpolated poses, their Jacobians, and tracking with them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from kfmocap.core.body import landmark_positions
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.time_shift import delayed, poses_after
from kfmocap.core.numerics import rotations
from kfmocap.core.numerics.banded_blocks import BandedBlocks, block_diagonal
from kfmocap.core.review.overlay import contact_sheet
from kfmocap.core.shot.frame_numbers import footage_delay
from kfmocap.core.shot.settings import Settings
from kfmocap.core.shot.shot import Shot, View
from kfmocap.core.tracking.solvers.paper_relaxation.motion_steps import StepEquations
from kfmocap.core.tracking.solvers.paper_relaxation.step_rows import shared_out
from kfmocap.core.tracking.tracker import track
from synthetic import CAMERAS, at_rest, figure, film, numeric_jacobian, random_motion, shot_of, swing

BODY = figure()
D = BODY.dof
LENGTH = 9
FINE = swing(BODY, 4 * LENGTH, size=0.9)
"""The truth at every quarter of a frame."""
TRUTH = FINE[::4]
SOLVERS = [Settings(limb_search=False), Settings(solver="relaxation", sweeps=300, correlation_length=0.03)]
"""Pixels weigh so much in the relaxation that the pictures decide on these small ones, not smoothness: the key pose at
the end is then met after some hundred sweeps."""


def turning(frames: int) -> Motion:
    """Every joint turns, and the root moves, at a constant rate."""
    rng = np.random.default_rng(3)
    rate, speed = rng.normal(0, 0.2, (len(BODY), 3)), rng.normal(0, 0.1, 3)
    time = np.arange(frames)
    start = at_rest(BODY, frames)
    return Motion(start.translations + time[:, None] * speed, rotations.exp(time[:, None, None] * rate))


def test_motion_at_a_constant_rate_is_met_between_the_frames_and_beyond_them() -> None:
    fine = turning(21)
    for quarters in (-3, -1, 1, 2):
        found = delayed(fine[4:17:4], quarters / 4)
        assert np.abs(found.motion.difference(fine[4 + quarters : 17 + quarters : 4])).max() < 1e-12
        assert found.earlier.min() == 0 and found.earlier.max() == 2


@pytest.mark.parametrize("delay", [-0.4, 0.3, 0.5])
@pytest.mark.parametrize("known", [(False, False), (True, False), (True, True)])
def test_increments_between_frames_follow_from_those_of_the_frames(delay: float, known: tuple[bool, bool]) -> None:
    all_frames, F = random_motion(BODY, 6, turn=0.3), 4
    before = all_frames[:1] if known[0] else None
    after = all_frames[5:] if known[1] else None
    motion = all_frames[1:5]
    found = delayed(motion, delay, before, after)

    def between(x: np.ndarray) -> np.ndarray:
        return found.motion.difference(delayed(motion.moved(x.reshape(F, D)), delay, before, after).motion).ravel()

    numeric = numeric_jacobian(between, np.zeros(F * D))
    analytic = weights(found, F)
    np.testing.assert_allclose(analytic, numeric, atol=1e-6 * np.abs(numeric).max())


def weights(found: object, F: int) -> np.ndarray:
    """The Jacobian of all instants by all frames that are not held, dense."""
    W = np.zeros((F, D, F + 2, D))
    for r, first in enumerate(found.earlier - found.start + 1):
        for a in (0, 1):
            W[r, :, first + a] += block_diagonal(found.jacobians[a])[r]
    return W[:, :, 1:-1].reshape(F * D, F * D)


@pytest.mark.parametrize("delay", [-0.4, 0.3])
@pytest.mark.parametrize("known", [(False, False), (True, False), (False, True)])
def test_a_system_between_the_frames_is_spread_as_the_dense_one(delay: float, known: tuple[bool, bool]) -> None:
    rng, F = np.random.default_rng(0), 5
    motion = random_motion(BODY, F + 2, turn=0.3)
    found = delayed(motion[1:-1], delay, motion[:1] if known[0] else None, motion[-1:] if known[1] else None)
    blocks = BandedBlocks.zeros(F, D)
    blocks.diagonal[:], blocks.first[:] = rng.normal(size=(F, D, D)), rng.normal(size=(F - 1, D, D))
    blocks.diagonal[:] += np.swapaxes(blocks.diagonal, 1, 2).copy()
    blocks.gradient[:] = rng.normal(size=(F, D))
    W = weights(found, F)
    spread = found.spread(blocks)
    np.testing.assert_allclose(dense(spread), W.T @ dense(blocks) @ W, atol=1e-12)
    np.testing.assert_allclose(spread.gradient.ravel(), W.T @ blocks.gradient.ravel(), atol=1e-12)


def dense(blocks: BandedBlocks) -> np.ndarray:
    F = len(blocks.gradient)
    out = np.zeros((F, D, F, D))
    for k, band in enumerate((blocks.diagonal, blocks.first, blocks.second)):
        for j, block in enumerate(band):
            out[j + k, :, j], out[j, :, j + k] = block, block.T
    return out.reshape(F * D, F * D)


@pytest.mark.parametrize("delay", [-0.3, 0.0, 0.5])
def test_rows_between_the_frames_are_shared_out_whole(delay: float) -> None:
    rows = np.random.default_rng(0).uniform(size=(6, 3))
    found = shared_out(rows, delay)
    np.testing.assert_allclose(found.sum(axis=0), rows.sum(axis=0))
    middle = (1 - abs(delay)) * rows[2] + abs(delay) * rows[2 - int(np.sign(delay))]
    np.testing.assert_allclose(found[2], middle)


@pytest.mark.parametrize("delay", [-0.3, 0.5])
def test_rows_of_the_relaxation_between_the_frames_are_those_of_the_poses_there(delay: float) -> None:
    """The derivative by a step of what is seen some time after the frames, of which the last look beyond them."""
    motion = random_motion(BODY, 5, turn=0.3)
    rng, F = np.random.default_rng(1), len(motion)
    there = delayed(motion, delay)
    wanted = there.motion.moved(rng.normal(0, 0.05, (F, D)))
    blocks = BandedBlocks.zeros(F, D)
    blocks.diagonal[:] = np.eye(D)
    blocks.gradient[:] = -there.motion.difference(wanted)
    rows = StepEquations.of(there.spread(blocks), motion)

    def energy(x: np.ndarray) -> float:
        turns = rotations.exp(x.reshape(F - 1, -1, 3)[:, 1:])
        T, Q = motion.translations.copy(), [motion.rotations[0]]
        T[1:] += np.cumsum(x.reshape(F - 1, D)[:, :3], axis=0)
        for before, after, turn in zip(motion.rotations[:-1], motion.rotations[1:], turns, strict=True):
            Q.append(Q[-1] @ np.swapaxes(before, -1, -2) @ after @ turn)
        step = there.motion.difference(delayed(Motion(T, np.stack(Q)), delay).motion)
        return float((step**2).sum() / 2 + (blocks.gradient * step).sum())

    numeric = numeric_jacobian(energy, np.zeros((F - 1) * D)).reshape(F - 1, D)
    np.testing.assert_allclose(rows.gradient(rows.steps), numeric, atol=1e-5 * np.abs(numeric).max())


@pytest.mark.parametrize(
    ("offset", "delay"), [(0.0, 0.0), (-7.0, 0.0), (2.25, -0.25), (-2.25, 0.25), (3.5, 0.5), (-3.5, 0.5), (0.75, 0.25)]
)
def test_a_delay_is_what_the_nearest_frame_leaves_of_the_offset(offset: float, delay: float) -> None:
    assert footage_delay(View(CAMERAS[0], Path("none.mp4"), offset)) == delay


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> dict[int, list[View]]:
    """Both cameras, by how many quarters of a frame their frame k is later than the shot's frame k."""
    home = tmp_path_factory.mktemp("film")
    return {late: film(home / str(late), [BODY], [FINE[late::4]], CAMERAS) for late in (0, 1, 2)}


@pytest.fixture(scope="module", params=SOLVERS, ids=lambda s: s.solver)
def synchronous(request: pytest.FixtureRequest, filmed: dict[int, list[View]]) -> tuple[Settings, float]:
    """A solver, and its error with both cameras in time."""
    return request.param, error(shot_of(filmed[0], [BODY], [TRUTH], (0, LENGTH - 1), request.param))


def error(shot: Shot) -> float:
    names = list(BODY.landmarks)
    found, truth = (landmark_positions(BODY, m, names) for m in (track(shot).motions[0], TRUTH))
    return 1000 * float(np.linalg.norm(found - truth, axis=2).mean())


@pytest.mark.parametrize("late", [1, 2])
def test_a_view_between_the_frames_tracks_as_exactly_as_one_in_time(
    filmed: dict[int, list[View]], synchronous: tuple[Settings, float], late: int
) -> None:
    (front, _), (_, side), (settings, error_in_time) = filmed[0], filmed[late], synchronous

    def with_side(view: View) -> float:
        return error(shot_of([front, view], [BODY], [TRUTH], (0, LENGTH - 1), settings))

    known = with_side(replace(side, offset=-late / 4))
    assert known < 1.1 * error_in_time + 1
    assert known < 0.8 * with_side(side)


def test_whole_offsets_change_nothing(filmed: dict[int, list[View]], tmp_path: Path) -> None:
    """The footage begins two frames before the shot."""
    early = film(tmp_path, [BODY], [FINE[np.r_[0, 0, 0 : 4 * LENGTH : 4]]], CAMERAS[1:])[0]
    shots = [
        shot_of([filmed[0][0], view], [BODY], [TRUTH], (0, LENGTH - 1))
        for view in (filmed[0][1], replace(early, offset=2.0))
    ]
    one, other = (track(shot).motions[0] for shot in shots)
    np.testing.assert_array_equal(one.rotations, other.rotations)
    np.testing.assert_array_equal(one.translations, other.translations)


def test_outlines_are_drawn_where_the_body_was(filmed: dict[int, list[View]]) -> None:
    late = replace(filmed[2][0], offset=-0.5)
    moment = [poses_after([TRUTH], 0.5, range(LENGTH))[0]]
    drawn = contact_sheet(shot_of([late], [BODY], [TRUTH], (0, LENGTH - 1)), [TRUTH], [3])
    in_time = contact_sheet(shot_of([filmed[2][0]], [BODY], [TRUTH], (0, LENGTH - 1)), moment, [3])
    np.testing.assert_array_equal(drawn, in_time)
