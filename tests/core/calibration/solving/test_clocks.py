"""Offsets of videos follow from the lags of pairs: in either direction, at any frame rates, by the surest pairs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import ring
from kfmocap.core.calibration.solving import clocks
from kfmocap.core.calibration.solving.clocks import Lag, find_lag, find_offsets
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.capture.capture import Markers

WANDS = [Markers(np.arange(1), np.full((1, 2, 2), float(v)), np.ones((1, 2))) for v in range(3)]
"""Three videos, told apart by where the wand is."""


def offsets(
    monkeypatch: pytest.MonkeyPatch, lags: Mapping[tuple[int, int], Lag], rate: list[float], given: list[float | None]
) -> list[float]:
    """The offsets found if the lags of pairs of videos are these."""

    def lag(one: Markers, other: Markers, _ratio: float) -> Lag | None:
        return lags.get((int(one.points[0, 0, 0]), int(other.points[0, 0, 0])))

    monkeypatch.setattr(clocks, "find_lag", lag)
    return find_offsets(WANDS[: len(rate)], np.array(rate), given)[0].tolist()


@pytest.mark.parametrize(("given", "expected"), [([3.0, None], [3.0, 10.0]), ([None, 10.0], [3.0, 10.0])])
def test_an_offset_follows_from_the_other_whichever_is_known(
    monkeypatch: pytest.MonkeyPatch, given: list[float | None], expected: list[float]
) -> None:
    """The second video has two frames for one of the first; frame f of that is its frame 2 f + 4."""
    assert offsets(monkeypatch, {(0, 1): Lag(4.0, 0.2, 100)}, [1.0, 2.0], given) == expected


def test_the_surest_pairs_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those whose balls are nearest to their epipolar lines, on the most frames."""
    lags = {(0, 1): Lag(1.0, 0.2, 100), (0, 2): Lag(9.0, 0.3, 100), (1, 2): Lag(2.0, 0.3, 400)}
    assert offsets(monkeypatch, lags, [1.0, 1.0, 1.0], [0.0, None, None]) == [0.0, 1.0, 3.0]
    lags[0, 2] = Lag(9.0, 0.1, 100)
    assert offsets(monkeypatch, lags, [1.0, 1.0, 1.0], [0.0, None, None])[2] == 9.0


def test_a_video_without_a_lag_has_no_offset(monkeypatch: pytest.MonkeyPatch) -> None:
    found = offsets(monkeypatch, {(0, 1): Lag(4.0, 0.2, 100)}, [1.0, 1.0, 1.0], [None, None, None])
    np.testing.assert_array_equal(found, [0.0, 4.0, np.nan])


def waved(camera: Camera, late: float, *, turned: bool = False) -> Markers:
    """A wand in a video that began some frames early, its ends in the other order if `turned`."""
    frames = np.arange(400)
    t = (frames - late)[:, None] / 30
    centre = np.concatenate([0.6 * np.sin(1.3 * t), 0.6 * np.cos(0.9 * t), 1.2 + 0.4 * np.sin(2.1 * t)], axis=1)
    along = np.concatenate([np.sin(1.7 * t), np.cos(2.3 * t), np.sin(0.7 * t + 1)], axis=1)
    half = 0.25 * along / np.linalg.norm(along, axis=1, keepdims=True)
    points = camera.project(np.stack([centre - half, centre + half], axis=1))
    return Markers(frames, points[:, ::-1] if turned else points, np.ones((len(frames), 2)))


@pytest.mark.parametrize("turned", [False, True])
def test_a_lag_is_found_whichever_end_of_the_wand_comes_first(turned: bool) -> None:
    one, other = ring(2, 3)
    found = find_lag(waved(one, 0.0), waved(other, 3.25, turned=turned))
    assert found is not None
    assert found.lag == pytest.approx(3.25, abs=0.1)
    assert found.distance < 0.5
