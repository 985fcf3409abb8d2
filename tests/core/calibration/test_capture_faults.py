"""No degenerate capture passes silently: each has a name and a cure."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.benchmarks.studies.wand_captures import (
    LFRAME,
    WAND_LENGTH,
    Faults,
    capture,
    ends,
    look_at,
    ring,
    scattered,
    waved,
    without,
)
from kfmocap.core.calibration.calibration_result import CalibrationResult
from kfmocap.core.calibration.wand_calibration import solve_capture
from kfmocap.core.capture.capture import Capture, Markers
from kfmocap.core.errors import CaptureError

CAMERAS = ring(3)
POSITIONS = scattered(120)


def whole(positions: np.ndarray = POSITIONS, **changes: object) -> Capture:
    return capture(CAMERAS, [positions] * 3, **changes)  # type: ignore[arg-type]


def hidden(given: Capture, view: int, frames: np.ndarray) -> Capture:
    """The capture as if one view had not seen the wand on some frames."""
    views = list(given.views)
    views[view] = replace(views[view], wand=without(views[view].wand, frames))
    return replace(given, views=tuple(views))


def refusal(given: Capture) -> CaptureError:
    with pytest.raises(CaptureError) as caught:
        solve_capture(given)
    assert caught.value.todo and caught.value.name in str(caught.value)
    return caught.value


def flags(solution: CalibrationResult) -> dict[str, str | None]:
    """Names of what is flagged, and where."""
    assert all(finding.what and finding.todo for finding in solution.findings)
    return {finding.name: finding.where for finding in solution.findings}


def test_a_sound_capture_has_no_findings() -> None:
    assert not solve_capture(whole()).findings


def test_too_few_shared_frames_are_refused() -> None:
    given = hidden(whole(), 2, np.arange(120) >= 10)
    error = refusal(given)
    assert (error.name, error.where) == ("too-few-shared-frames", "cam03")


def test_few_frames_in_common_though_many_seen_are_refused() -> None:
    many = scattered(240)
    given = capture(CAMERAS, [many] * 3)
    given = hidden(given, 2, np.arange(240) < 110)
    given = hidden(hidden(given, 0, np.arange(240) >= 120), 1, np.arange(240) >= 120)
    error = refusal(given)
    assert (error.name, error.where) == ("too-few-shared-frames", "cam03")


def test_barely_enough_shared_frames_are_flagged() -> None:
    assert flags(solve_capture(hidden(whole(), 2, np.arange(120) >= 40)))["too-few-shared-frames"] == "cam03"


def test_cameras_that_are_not_linked_are_refused() -> None:
    cameras = ring(4)
    given = capture(cameras, [POSITIONS] * 4)
    for view in range(4):
        given = hidden(given, view, (np.arange(120) < 60) == (view < 2))
    error = refusal(given)
    assert error.name == "cameras-not-linked" and "cam01, cam02" in str(error) and "cam03, cam04" in str(error)


def test_a_camera_whose_wand_is_another_is_refused() -> None:
    given = capture(CAMERAS, [POSITIONS, POSITIONS, scattered(120, seed=5)])
    error = refusal(given)
    assert (error.name, error.where) == ("camera-fits-no-other", "cam03")


@pytest.mark.parametrize(("axis", "place"), [(0, -0.3), (0, 0.6), (1, 0.0), (2, 0.5), (2, 1.0), (2, 1.6)])
def test_a_wand_in_a_plane_is_refused(axis: int, place: float) -> None:
    middle, across = POSITIONS.mean(axis=1), POSITIONS[:, 0] - POSITIONS[:, 1]
    middle[:, axis], across[:, axis] = place, 0
    assert refusal(whole(ends(middle, across, WAND_LENGTH))).name == "wand-in-a-plane"


def test_a_wand_in_a_plane_for_one_camera_is_flagged() -> None:
    positions = POSITIONS.copy()
    middle, across = positions[:60].mean(axis=1), positions[:60, 0] - positions[:60, 1]
    middle[:, 2], across[:, 2] = 0.8, 0
    positions[:60] = ends(middle, across, WAND_LENGTH)
    assert flags(solve_capture(hidden(whole(positions), 2, np.arange(120) >= 60)))["wand-in-a-plane"] == "cam03"


def test_a_wand_at_one_depth_is_flagged() -> None:
    rng = np.random.default_rng(0)
    eye = CAMERAS[0].centre_world()
    aim = np.array([0, 0, 1.0]) - eye + rng.uniform(-1, 1, (150, 3))
    aim -= np.outer(aim @ (eye / np.linalg.norm(eye)), eye / np.linalg.norm(eye))
    inwards = -eye / np.linalg.norm(eye)
    middle = eye + 4.0 * inwards + aim + rng.uniform(-0.08, 0.08, (150, 1)) * inwards
    across = rng.normal(0, 1, (150, 3))
    across -= 0.9 * np.outer(across @ inwards, inwards)
    assert flags(solve_capture(whole(ends(middle, across, WAND_LENGTH))))["wand-at-one-depth"] == "cam01"


@pytest.mark.parametrize(("length", "refused"), [(0.07, False), (0.008, True)])
def test_a_wand_that_is_too_small_is_flagged_or_refused(length: float, refused: bool) -> None:
    given = whole(scattered(120, length=length), length=length)
    if refused:
        assert refusal(given).name == "wand-too-small"
    else:
        assert "wand-too-small" in flags(solve_capture(given))


def test_a_mirrored_lframe_is_refused() -> None:
    assert refusal(whole(lframe=LFRAME * [1, -1, 1])).name == "lframe-mirrored"


@pytest.mark.parametrize("ball", [1, 2, 3])
def test_lframe_lengths_that_contradict_one_another_are_refused(ball: int) -> None:
    built = LFRAME.copy()
    built[ball] *= 1.06
    assert refusal(whole(lframe=built)).name == "lframe-lengths-contradict"


def test_lframe_balls_in_another_order_are_refused() -> None:
    assert refusal(whole(lframe=LFRAME[[2, 1, 0, 3]])).name == "lframe-lengths-contradict"


@pytest.mark.parametrize("told", [0.45, 0.52])
def test_a_wrong_wand_length_is_refused_with_the_right_one(told: float) -> None:
    error = refusal(whole(length=told))
    found = re.search(r"the wand is (0\.\d+) m long", str(error))
    assert error.name == "wand-length-wrong" and found and abs(float(found[1]) - WAND_LENGTH) < 2e-3


def test_measures_in_millimetres_are_refused() -> None:
    given = whole()
    error = refusal(replace(given, wand_length=1000 * WAND_LENGTH, lframe_points=1000 * LFRAME))
    assert error.name == "wand-length-wrong" and "in metres" in str(error)


def test_slow_motion_is_refused() -> None:
    """Its wand hardly moves: with long focal lengths it is on one spot."""
    wands = [waved(np.arange(300) / 30), waved(np.arange(300) / 120 + 2), waved(np.arange(300) / 30)]
    error = refusal(capture(CAMERAS, wands, offsets=[0, None, None]))
    assert (error.name, error.where) == ("camera-fits-no-other", "cam02") and "slowed down" in str(error)


def test_a_frame_rate_that_is_wrong_by_a_thousandth_is_not_taken_for_a_tripod_alone() -> None:
    times = [np.arange(1200) / 30, np.arange(1200) / 29.97, np.arange(1200) / 30]
    given = capture(CAMERAS, [waved(t) for t in times], offsets=[0, None, None])
    [finding] = solve_capture(given).findings
    assert (finding.name, finding.where) == ("camera-moved", "cam02") and "--drift" in finding.todo
    assert not solve_capture(given, drift=True).findings


def fisheye(seen: Markers, focal: float, centre: np.ndarray) -> Markers:
    """Markers of a lens without distortion, as one shows them whose picture is as far from its centre as the angle."""
    away = seen.points - centre
    radius = np.linalg.norm(away, axis=-1, keepdims=True)
    return replace(seen, points=centre + away / radius * 1.6 * focal * np.arctan(radius / focal))


def test_fisheye_lenses_are_not_taken_for_tripods_that_moved() -> None:
    angles = np.radians([5, 80, 170, 260])
    eyes = np.column_stack([3 * np.cos(angles), 3 * np.sin(angles), np.full(4, 2.0)])
    focal, target = 600.0, np.array([0, 0, 1.0])
    cameras = [look_at(f"cam{c}", eye, target, focal, (0, 0, 0, 0)) for c, eye in enumerate(eyes)]
    positions = waved(np.arange(400) / 30)
    middle, along = positions.mean(axis=1) * [2.0, 2.0, 1.0], positions[:, 0] - positions[:, 1]
    given = capture(cameras, [ends(middle, along, WAND_LENGTH)] * 4)
    views = [
        replace(view, wand=fisheye(view.wand, focal, middle), lframe=fisheye(view.lframe, focal, middle))
        for view, middle in zip(given.views, (camera.matrix[:2, 2] for camera in cameras), strict=True)
    ]
    assert list(flags(solve_capture(replace(given, views=tuple(views))))) == ["lens-not-fitted"]


@pytest.mark.parametrize("degrees", [0.15, 3.0])
def test_a_camera_that_moved_while_the_wand_was_waved_is_flagged(degrees: float) -> None:
    cameras = ring(4)
    moved = turned(cameras[1], degrees)
    given = capture(cameras, [scattered(200)] * 4)
    after = capture([cameras[0], moved, *cameras[2:]], [scattered(200)] * 4)
    views = list(given.views)
    late = views[1].wand.frames >= 120
    points = np.where(late[:, None, None], after.views[1].wand.points, views[1].wand.points)
    views[1] = replace(views[1], wand=replace(views[1].wand, points=points))
    solution = solve_capture(replace(given, views=tuple(views)))
    assert flags(solution)["camera-moved"] == "cam02"


def test_where_all_pictures_are_unsteady_no_tripod_is_blamed() -> None:
    """As with image stabilisers: each picture drifts by some pixels, smoothly, within a second."""
    rng, given = np.random.default_rng(0), capture(ring(3), [waved(np.arange(300) / 30)] * 3)
    kernel = np.exp(-0.5 * (np.arange(-30, 31) / 10) ** 2)
    views = []
    for view in given.views:
        drift = np.stack([np.convolve(rng.normal(size=360), kernel, "valid") for _ in range(2)], axis=1)
        points = view.wand.points + (5 * drift / drift.std())[:, None]
        views.append(replace(view, wand=replace(view.wand, points=points)))
    findings = solve_capture(replace(given, views=tuple(views))).findings
    assert "pictures-unsteady" in {finding.name for finding in findings}
    assert not [finding for finding in findings if finding.name == "camera-moved" and "on frames" in finding.what]


def test_a_camera_that_moved_between_the_takes_is_flagged_and_its_lframe_left_out() -> None:
    cameras = ring(4)
    given = capture(cameras, [scattered(150)] * 4)
    before = capture([turned(cameras[0], 1.0), *cameras[1:]], [scattered(150)] * 4)
    views = (replace(given.views[0], lframe=before.views[0].lframe), *given.views[1:])
    solution = solve_capture(replace(given, views=views))
    assert flags(solution)["camera-moved"] == "cam01"
    assert np.linalg.norm(solution.rig.centres_world[0] - cameras[0].centre_world()) < 0.02


def test_two_cameras_of_which_one_moved_between_the_takes_are_refused() -> None:
    given = whole()
    before = capture([turned(CAMERAS[0], 2.0), *CAMERAS[1:]], [POSITIONS] * 3)
    views = (replace(given.views[0], lframe=before.views[0].lframe), given.views[1])
    assert refusal(replace(given, views=views)).name == "camera-moved"


@pytest.mark.parametrize("take", ["lframe", "wand"])
def test_videos_of_two_cameras_that_are_exchanged_are_named(take: str) -> None:
    given = whole()
    first, second, *others = given.views
    views = (
        replace(first, **{take: getattr(second, take)}),
        replace(second, **{take: getattr(first, take)}),
        *others,
    )
    error = refusal(replace(given, views=views))
    assert error.name == "views-exchanged"
    assert "cam01 and cam02" in str(error)


def turned(camera, degrees: float):  # type: ignore[no-untyped-def]
    """The camera turned about an axis askew to its view."""
    import cv2

    turn = cv2.Rodrigues(np.deg2rad(degrees) * np.array([0.6, 0.8, 0.0]))[0]
    centre = camera.centre_world()
    R = turn @ camera.R_cam_world[0]
    return replace(camera, R_cam_world=R[None], t_cam_world=(-R @ centre)[None])


def test_an_lframe_that_one_camera_alone_sees_is_refused() -> None:
    given = whole()
    views = [replace(v, lframe=without(v.lframe, v.lframe.frames >= 0)) for v in given.views]
    assert refusal(replace(given, views=(given.views[0], *views[1:]))).name == "lframe-not-seen"


def test_offsets_of_a_wand_that_jumps_are_refused() -> None:
    assert refusal(whole(offsets=[None] * 3)).name == "wand-jumps"


def test_an_offset_that_cannot_be_determined_is_refused() -> None:
    paths = [waved(np.arange(150) / 30)] * 2 + [waved(np.arange(150) / 30 + 100)]
    given = capture(CAMERAS, paths, offsets=[0.0, 0.0, None])
    given = hidden(given, 2, np.arange(150) >= 25)
    assert refusal(given).name in ("offset-unknown", "too-few-shared-frames")


def test_wrong_offsets_are_refused() -> None:
    paths = [waved(np.arange(300) / 30 + shift) for shift in (0.0, 0.0, 1.5)]
    error = refusal(capture(CAMERAS, paths))
    assert (error.name, error.where) == ("camera-fits-no-other", "cam03")


def test_a_still_wand_is_refused() -> None:
    still = np.tile(POSITIONS[:1], (120, 1, 1))
    assert refusal(whole(still)).name == "wand-in-a-plane"


def test_balls_noisier_than_they_claim_are_flagged() -> None:
    given = capture(CAMERAS, [POSITIONS] * 3, Faults(noise=2.0))
    views = tuple(replace(v, wand=replace(v.wand, sigma=v.wand.sigma / 10)) for v in given.views)
    assert "noise-high" in flags(solve_capture(replace(given, views=views)))


def test_a_sliver_of_the_picture_is_flagged() -> None:
    cameras = [*CAMERAS[:2], look_at("wide", np.array([0.0, -9, 2]), np.array([0, 0, 1.0]), 1000, (0, 0, 0, 0))]
    assert flags(solve_capture(capture(cameras, [POSITIONS] * 3)))["picture-little-covered"] == "wide"
