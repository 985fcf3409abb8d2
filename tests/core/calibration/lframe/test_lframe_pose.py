"""The L-frame as it is seen places the world; what it says of its own size does not bend it."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import ring
from kfmocap.core.calibration.lframe import lframe_pose
from kfmocap.core.calibration.lframe.lframe_pose import place_lframe
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
