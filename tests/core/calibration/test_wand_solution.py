"""Cameras from nothing but a wand's length and an L-frame's measures, as exact as the noise allows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from kfmocap.benchmarks.studies import wand_study
from kfmocap.benchmarks.studies.wand_captures import FPS, HARD, Faults, capture, ring, scattered, waved
from kfmocap.core.calibration.calibration_result import CalibrationResult
from kfmocap.core.calibration.quality import quality_numbers
from kfmocap.core.calibration.solving.camera_rig import CENTRE, FOCAL, K2
from kfmocap.core.calibration.wand_calibration import solve_capture
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.capture.capture import Capture
from kfmocap.core.errors import CancelledError
from kfmocap.core.numerics import rotations

SEED = 3


def errors(solution: CalibrationResult, cameras: list[Camera]) -> tuple[float, float, float]:
    """Largest errors of the focal length (share), of the centre (metres), and of the turn (radians)."""
    found = [solution.cameras[camera.name] for camera in cameras]
    pairs = list(zip(found, cameras, strict=True))
    focal = max(abs(a.matrix[0, 0] / b.matrix[0, 0] - 1) for a, b in pairs)
    centre = max(float(np.linalg.norm(a.centre_world() - b.centre_world())) for a, b in pairs)
    turn = max(float(np.linalg.norm(rotations.log(a.R_cam_world[0] @ b.R_cam_world[0].T))) for a, b in pairs)
    return focal, centre, turn


@pytest.fixture(scope="module")
def cameras() -> list[Camera]:
    return ring(4, SEED)


@pytest.fixture(scope="module")
def clean(cameras: list[Camera]) -> CalibrationResult:
    return solve_capture(capture(cameras, [scattered(300, SEED)] * 4, seed=SEED))


def test_everything_is_found_from_the_wand_alone(clean: CalibrationResult, cameras: list[Camera]) -> None:
    focal, centre, turn = errors(clean, cameras)
    assert focal < 0.002 and centre < 0.006 and turn < np.deg2rad(0.08)
    assert abs(clean.noise - 1) < 0.03
    assert not clean.findings
    assert list(clean.cameras) == [camera.name for camera in cameras]


def test_errors_are_what_the_covariance_says(clean: CalibrationResult, cameras: list[Camera]) -> None:
    off = np.log([clean.cameras[c.name].matrix[0, 0] / c.matrix[0, 0] for c in cameras])
    assert (np.abs(off) < 4 * clean.sigma[:, FOCAL]).all()


def test_errors_come_near_the_cramer_rao_bound() -> None:
    rows = [wand_study.measured(seed, Faults()) for seed in range(2)]
    ratio = wand_study.ratios(rows)
    assert max(ratio.values()) < 1.5


def test_outliers_swapped_ends_and_dropouts_are_recognised(cameras: list[Camera]) -> None:
    solution = solve_capture(capture(cameras, [scattered(300, SEED)] * 4, HARD, SEED))
    focal, centre, turn = errors(solution, cameras)
    assert focal < 0.003 and centre < 0.012 and turn < np.deg2rad(0.12)
    assert ((solution.used > 0.5) & (solution.used < 0.8)).all()


def test_the_order_of_the_cameras_does_not_matter(cameras: list[Camera]) -> None:
    given = capture(cameras[:3], [scattered(90, SEED)] * 3, seed=SEED)
    forward, backward = solve_capture(given), solve_capture(replace(given, views=given.views[::-1]))
    for name, camera in forward.cameras.items():
        other = backward.cameras[name]
        np.testing.assert_allclose(camera.matrix, other.matrix, rtol=1e-4)
        np.testing.assert_allclose(camera.centre_world(), other.centre_world(), atol=5e-4)


def test_two_cameras_are_enough() -> None:
    pair = ring(4, SEED)[:2]
    focal, centre, _ = errors(solve_capture(capture(pair, [scattered(300, SEED)] * 2, seed=SEED)), pair)
    assert focal < 0.005 and centre < 0.03


def test_a_view_whose_wand_is_named_the_other_way_round_is_found_out(cameras: list[Camera]) -> None:
    given = capture(cameras, [scattered(200, SEED)] * 4, seed=SEED)
    wand = given.views[2].wand
    views = list(given.views)
    views[2] = replace(views[2], wand=replace(wand, points=wand.points[:, ::-1], sigma=wand.sigma[:, ::-1]))
    focal, centre, _ = errors(solve_capture(replace(given, views=tuple(views))), cameras)
    assert focal < 0.004 and centre < 0.01


def with_lens(camera: Camera, shift: tuple[float, float], k2: float) -> Camera:
    matrix = camera.matrix.copy()
    matrix[:2, 2] += shift
    return replace(camera, matrix=matrix, distortions=np.array([-0.2, k2, 0.0, 0.0]))


def test_k2_and_principal_point_are_solved_for_only_where_they_show(
    cameras: list[Camera], clean: CalibrationResult
) -> None:
    assert not clean.free[:, K2].any() and not clean.free[:, CENTRE].any()
    odd = [with_lens(cameras[0], (0, 0), 0.15), with_lens(cameras[1], (25, -18), 0.0), *cameras[2:]]
    solution = solve_capture(capture(odd, [scattered(300, SEED)] * 4, seed=SEED))
    assert solution.free[0, K2] and solution.free[1, CENTRE].all()
    assert not solution.free[2:, K2].any() and not solution.free[2:, CENTRE].any()
    assert np.abs(solution.rig.centre[1] - odd[1].matrix[:2, 2]).max() < 5
    assert errors(solution, odd)[0] < 0.005


def test_known_intrinsics_stay_as_they_are(cameras: list[Camera]) -> None:
    given = capture(cameras, [scattered(150, SEED)] * 4, seed=SEED)
    views = list(given.views)
    views[0] = replace(views[0], matrix=cameras[0].matrix, distortions=cameras[0].distortions)
    views[1] = replace(views[1], focal=1.03 * cameras[1].matrix[0, 0])
    solution = solve_capture(replace(given, views=tuple(views)))
    np.testing.assert_array_equal(solution.cameras["cam01"].matrix, cameras[0].matrix)
    np.testing.assert_array_equal(solution.cameras["cam01"].distortions, cameras[0].distortions)
    assert errors(solution, cameras)[0] < 0.004


def unsynchronised(offsets: list[float], count: int = 240, faults: Faults | None = None, drift: float = 0.0) -> Capture:
    rate = 1 + drift * (np.arange(len(offsets)) == 1)
    paths = [waved((np.arange(count) - o) / r / FPS, SEED) for o, r in zip(offsets, rate, strict=True)]
    return capture(ring(4, SEED)[: len(offsets)], paths, faults, SEED, offsets=[None] * len(offsets))


@pytest.mark.parametrize(("true", "faults"), [([0.0, 29.6, -30.0], Faults()), ([0.0, 29.6, -30.0, 12.37], HARD)])
def test_offsets_of_many_frames_are_found_to_a_fraction_of_one(
    true: list[float], faults: Faults, cameras: list[Camera]
) -> None:
    solution = solve_capture(unsynchronised(true, faults=faults))
    assert np.abs(solution.rig.offset - true).max() < 0.05
    assert errors(solution, cameras[: len(true)])[0] < 0.004


def test_a_clock_that_drifts_is_found_when_asked_for() -> None:
    given = unsynchronised([0.0, 4.3, -7.1], 250, drift=1e-3)
    solution = solve_capture(given, drift=True)
    assert solution.rig.drift[1] == pytest.approx(1e-3, abs=1e-4)
    assert np.abs(solution.rig.drift[2:]).max() < 1e-4


def test_given_offsets_are_kept() -> None:
    given = unsynchronised([0.0, 5.0, -3.0])
    told = [replace(view, offset=o) for view, o in zip(given.views, [0.0, 5.0, None], strict=True)]
    solution = solve_capture(replace(given, views=tuple(told)))
    assert solution.rig.offset[:2].tolist() == [0.0, 5.0]
    assert solution.rig.offset[2:] == pytest.approx([-3.0], abs=0.05)


def test_the_numbers_of_the_report_are_plain_and_right(clean: CalibrationResult) -> None:
    report = quality_numbers(clean)
    first = report["cameras"][0]
    assert first["reprojection"]["rms"] == pytest.approx(0.3 * np.sqrt(1 - (5 * 300 + 32) / 4800), rel=0.06)
    assert first["depth"]["near"] < first["depth"]["middle"] < first["depth"]["far"]
    assert 0.1 < first["coverage"] < 0.6
    assert report["wand"]["held_out"]["mean"] == pytest.approx(0.5, abs=8e-4)
    assert report["wand"]["held_out"]["spread"] < 0.002
    assert report["lframe"]["scale"] == pytest.approx(1, abs=2e-3)
    assert first["offset_sigma"] is None and first["focal_sigma"] < 2


def test_solving_can_be_cancelled() -> None:
    told: list[str] = []

    def stop(what: str, fraction: float) -> bool:
        told.append(what)
        return what != "wand"

    with pytest.raises(CancelledError):
        solve_capture(capture(ring(3), [scattered(100)] * 3), stop)
    assert told[-1] == "wand" and "pairs" in told
