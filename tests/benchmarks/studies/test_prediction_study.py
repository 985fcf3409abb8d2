"""The study of hidden limbs bridges gaps as the solvers do: a limb that swings is predicted, one at rest is kept."""

from __future__ import annotations

from itertools import islice

import numpy as np
import pytest
from kfmocap.benchmarks.studies import prediction_study
from kfmocap.benchmarks.studies.prediction_study import WAYS, bridged
from kfmocap.core.body import Body, human
from kfmocap.core.body.motion import Motion
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.shot import KeyPoses, Performer

FRAMES, PERIOD, GAP = 78, 20.0, 12
SHORT = 30


@pytest.fixture
def body() -> Body:
    return human(1.8)


def swinging(body: Body, swing: float) -> Motion:
    """The right arm swings about its shoulder, radians."""
    Q = np.tile(np.eye(3), (FRAMES, len(body), 1, 1))
    angle = swing * np.sin(2 * np.pi * np.arange(FRAMES) / PERIOD)
    Q[:, body.index("upper_arm.R")] = rotations.exp(angle[:, None] * [0.0, 0.0, 1.0])
    return Motion(np.zeros((FRAMES, 3)), Q)


def test_an_arm_that_swings_is_predicted_by_both_solvers_and_one_at_rest_stays(body: Body) -> None:
    for swing, places in ((0.0, 3), (0.6, None)):
        found = list(islice(bridged(body, swinging(body, swing), GAP, "RWrist"), places))
        repeated, predicted, smooth, expected = np.mean(found, axis=0)
        if swing:
            assert predicted < 0.5 * repeated
            assert expected < 0.5 * smooth
        else:
            assert max(repeated, predicted, smooth, expected) < 1e-6


def test_a_table_has_a_row_for_every_gap(
    body: Body, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    motion = swinging(body, 0.3)[:SHORT]
    performer = Performer("person", body, KeyPoses.whole(list(range(SHORT)), motion))

    class Shot:
        frames, performers = (5, 5 + SHORT - 1), (performer,)

    asked = []
    monkeypatch.setattr(prediction_study, "load_shot", lambda _, keyframes=None: asked.append(keyframes) or Shot)
    monkeypatch.setattr(prediction_study, "GAPS", (3, 5))
    assert prediction_study.main(["shot.toml"]) == 0
    assert asked == [None, range(5, 5 + SHORT)]
    lines = capsys.readouterr().out.splitlines()
    assert all(name in lines[0] for name in WAYS)
    assert [line.split("|")[1:3] for line in lines[2:]] == [
        [f" {end}      ", f"{gap:>14} "] for end in ("Wrist", "Ankle") for gap in (3, 5)
    ]
