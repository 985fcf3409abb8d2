"""An arm that no camera sees for twelve frames, tracked on pictures: a board passes between it and the cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, landmark_positions, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.evidence.occlusion import unseen
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.shot import KeyPoses, Performer
from kfmocap.core.tracking.results.track_result import TrackResult
from kfmocap.core.tracking.tracker import track
from synthetic import at_rest, figure, film, look_at, part, shot_of

BODY = figure()
BOARD = Body((part("board", -1, (0.62, -0.55, 0.75), (0.62, -0.55, 1.85), 0.5, 0.02),), {})
FRAMES, HIDDEN = 48, slice(24, 36)
KEYS = (0, FRAMES - 1)
CAMERAS = (look_at("left", (-0.3, -2.9, 1.5)), look_at("right", (0.9, -2.7, 1.2)))
ARM = ["forearm.L", "forearm.L tip"]


def waving() -> Motion:
    t = np.arange(FRAMES)
    zero = np.zeros(FRAMES)
    motion = at_rest(BODY, FRAMES)
    for bone, size, period in (("upper_arm.L", 0.25, 30), ("forearm.L", 0.4, 24)):
        turns = np.stack([zero, zero, size * np.sin(2 * np.pi * t / period)], axis=1)
        motion.rotations[:, BODY.index(bone)] = rotations.exp(turns)
    return motion


TRUTH = waving()


@pytest.fixture(scope="module")
def tracked(tmp_path_factory: pytest.TempPathFactory) -> dict[str, TrackResult]:
    """With the board, and without it."""
    board = at_rest(BOARD, FRAMES)
    away = np.ones(FRAMES, bool)
    away[HIDDEN] = False
    board.translations[away] += [0.0, 0.0, -4.0]
    home = tmp_path_factory.mktemp("film")
    shots = {
        name: shot_of(film(home / name, [BODY, BOARD][:count], [TRUTH, board][:count], CAMERAS), [BODY], [TRUTH], KEYS)
        for name, count in (("hidden", 2), ("seen", 1))
    }
    carried = Performer("board", BOARD, KeyPoses.whole(list(range(FRAMES)), board))
    shots["hidden"] = replace(shots["hidden"], performers=(*shots["hidden"].performers, carried))
    return {name: track(shot) for name, shot in shots.items()}


def arm_mm(tracked: TrackResult) -> np.ndarray:
    found, true = (landmark_positions(BODY, m, ARM) for m in (tracked.motions[0], TRUTH))
    return 1000 * np.linalg.norm(found - true, axis=2).mean(axis=1)


def test_it_is_known_when_nobody_sees_the_arm(tracked: dict[str, TrackResult]) -> None:
    blind = unseen(tracked["hidden"].visible[0])[:, BODY.index("forearm.L")]
    assert np.flatnonzero(blind).tolist() == list(range(FRAMES))[HIDDEN]


def test_a_hidden_arm_is_within_30_mm_and_back_to_usual_errors_two_frames_later(
    tracked: dict[str, TrackResult],
) -> None:
    hidden, seen = (arm_mm(tracked[name]) for name in ("hidden", "seen"))
    assert hidden[HIDDEN].mean() <= 30
    assert hidden[HIDDEN.stop + 2 :].max() <= 1.5 * seen.max()


def test_nine_tenths_of_the_tips_are_within_their_intervals(tracked: dict[str, TrackResult]) -> None:
    """Between 80 % and all of them, on the frames between the key poses, with the arm seen and hidden."""
    between = np.setdiff1d(np.arange(FRAMES), KEYS)
    for result in tracked.values():
        (R, T), (R_true, T_true) = (part_poses(BODY, motion) for motion in (result.motions[0], TRUTH))
        lengths = np.array([np.linalg.norm(part.tail_world - part.head_world) for part in BODY.parts])[:, None]
        error = np.linalg.norm((R[..., 1] - R_true[..., 1]) * lengths + T - T_true, axis=-1)[between]
        assert 0.8 <= np.mean(error <= result.errors[0].interval[between]) <= 1.0
        assert np.median(result.errors[0].interval[between]) < 0.1


def test_an_arm_that_is_hidden_is_less_certain_and_not_called_lost(tracked: dict[str, TrackResult]) -> None:
    forearm = BODY.index("forearm.L")
    hidden, seen = (tracked[name].errors[0] for name in ("hidden", "seen"))
    assert hidden.deviation[HIDDEN, forearm].mean() > 1.5 * seen.deviation[HIDDEN, forearm].mean()
    assert not hidden.maybe_lost().any() and not seen.maybe_lost().any()
