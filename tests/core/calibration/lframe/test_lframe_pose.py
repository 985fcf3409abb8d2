"""The L-frame as it is seen places the world; what it says of its own size does not bend it."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import ring
from kfmocap.core.calibration.lframe import lframe_pose
from kfmocap.core.calibration.lframe.lframe_pose import place_lframe, resting
from kfmocap.core.capture.capture import Markers
from kfmocap.core.numerics import rotations

MEASURES = np.array([[0.0, 0.0, 0.05], [0.4, 0.0, 0.05], [0.0, 0.6, 0.05], [0.2, 0.0, 0.05]])


@pytest.mark.parametrize("scale", [1.0, 1.1])
def test_scale_and_misfit_are_told_apart(monkeypatch: pytest.MonkeyPatch, scale: float) -> None:
    """Balls that are all too far apart by as much do not misfit, and the pose is right."""
    turn = rotations.exp(np.array([0.1, -0.3, 0.7]))
    seen = scale * MEASURES @ turn + [0.5, 0.2, 0.0]
    monkeypatch.setattr(lframe_pose, "_balls", lambda *_: seen)
    monkeypatch.setattr(lframe_pose, "_least_known", lambda *_: 0.001)
    found = place_lframe(ring(2, 3), None, MEASURES, 1.0)
    assert found.scale == pytest.approx(scale)
    np.testing.assert_allclose(found.misfit, 0, atol=1e-9)
    np.testing.assert_allclose(found.R, turn, atol=1e-9)
    np.testing.assert_allclose(found.R @ seen.mean(axis=0) + found.t, MEASURES.mean(axis=0), atol=1e-9)


@pytest.mark.parametrize(("frames", "share"), [(1, 1.0), (4, 0.5), (400, 0.1)])
def test_a_ball_at_rest_is_known_the_better_the_longer_it_is_seen_up_to_a_limit(frames: int, share: float) -> None:
    """Part of its error is the same on all frames."""
    points = np.full((frames, 4, 2), np.nan)
    points[:, 1] = [100.0, 50.0]
    found = resting([Markers(np.arange(frames), points, np.full((frames, 4), 0.3))])
    assert found.ball.tolist() == [1]
    np.testing.assert_allclose(found.sigma, 0.3 * share)


def test_a_frame_on_which_something_else_was_taken_for_a_ball_at_rest_does_not_count() -> None:
    points = np.full((9, 4, 2), np.nan)
    points[:, 0] = [100.0, 50.0]
    points[3, 0] = [160.0, 50.0]
    found = resting([Markers(np.arange(9), points, np.full((9, 4), 0.3))])
    np.testing.assert_allclose(found.uv, [[100.0, 50.0]])
