"""Cameras that do not fit are named, by how much, and put right; those that fit are left in peace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from keypoint_shots import NAMES, cameras, keypoints_of, person, seen_places, strolling, write_openpose
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import CalibrationError
from kfmocap.core.fitting import shot_cameras
from kfmocap.core.fitting.camera_fits.resection import adjusted
from kfmocap.core.fitting.camera_fits.shared_cameras import FreeCameras
from kfmocap.core.fitting.camera_fits.shared_keypoints import CameraEstimate, SharedKeypoints
from kfmocap.core.fitting.checks.early_check import early_frames, early_misfits
from kfmocap.core.fitting.checks.view_findings import CameraFit
from kfmocap.core.fitting.shot_cameras import checked_frames, fit_by_key_poses, fit_by_keypoints, refine_shot_cameras
from kfmocap.core.keypoints.keypoint_rays import Keypoints
from kfmocap.core.shot.footage import frames_at
from kfmocap.core.shot.shot import KeyPoses, Performer, Shot, View
from synthetic import figure, film, look_at, shot_of, swing

Array = np.ndarray
PERSON, FRAMES = person(), 45
WALK = strolling(PERSON, FRAMES)
PLACES = seen_places(PERSON, WALK)
BODY = figure()
TRUTH = swing(BODY, 16, size=0.9)[::4]
FRONT, SIDE = look_at("front", (0.5, -2.8, 1.5)), look_at("side", (-2.4, -1.4, 1.3))


def turned(camera: Camera, seed: int, degrees: float = 1.0) -> Camera:
    """As by somebody who has touched the tripod: about an axis across its view."""
    angle = np.random.default_rng([seed, 7]).uniform(0, 2 * np.pi)
    return adjusted(camera, np.radians(degrees) * np.array([0, 0, 0, np.cos(angle), np.sin(angle), 0.2, 0]))


def walk_shot(views: Sequence[Camera]) -> Shot:
    performer = Performer("woman", PERSON, KeyPoses.whole([0], WALK[[0]]))
    return Shot("walk", 30.0, (0, FRAMES - 1), tuple(View(c, Path("none")) for c in views), (performer,))


def detected(views: Sequence[Camera], seed: int) -> Keypoints:
    """By a detector that scatters by 2 cm, and means a place of its own, 1.5 cm off, by every joint in every view."""
    biased = [PLACES + np.random.default_rng([seed, v]).normal(0, 0.015, (1, len(NAMES), 3)) for v in range(len(views))]
    found = [keypoints_of([camera], biased[v], 0.02, seed + v) for v, camera in enumerate(views)]
    R, t = (np.concatenate([getattr(own, name) for own in found]) for name in ("R_cam_world", "t_cam_world"))
    rays, confidence = (np.concatenate([getattr(own, name) for own in found]) for name in ("rays", "confidence"))
    return Keypoints(NAMES, rays, confidence, R, t)


def as_believed(keypoints: Keypoints, believed: Sequence[Camera]) -> Keypoints:
    """The same pixels by cameras that stand otherwise; their lenses are right."""
    poses = [camera.poses(0, FRAMES) for camera in believed]
    return replace(keypoints, R_cam_world=np.stack([R for R, _ in poses]), t_cam_world=np.stack([t for _, t in poses]))


def off(fits: Sequence[CameraFit]) -> list[str]:
    return [fit.camera for fit in fits if fit.off]


@pytest.mark.parametrize(("count", "seed"), [(3, 0), (3, 1), (3, 2), (4, 3), (4, 4)])
def test_the_camera_that_was_touched_is_named_by_its_keypoints(count: int, seed: int) -> None:
    true = cameras(count)
    found, wrong = detected(true, seed), seed % count
    assert off(fit_by_keypoints(walk_shot(true), [found])) == []
    believed = [turned(camera, seed) if v == wrong else camera for v, camera in enumerate(true)]
    fits = fit_by_keypoints(walk_shot(believed), [as_believed(found, believed)])
    assert off(fits) == [true[wrong].name]
    shown = believed[wrong].project(PLACES[::5]) - true[wrong].project(PLACES[::5])
    assert fits[wrong].shift == pytest.approx(np.sqrt(np.mean(np.sum(shown**2, axis=-1))), rel=0.35)
    assert fits[wrong].brief == f"{fits[wrong].shift:.0f} px off the other cameras"


def test_two_cameras_that_were_touched_are_named() -> None:
    true = cameras(4)
    believed = [turned(true[0], 1, 1.5), true[1], turned(true[2], 5, 2.0), true[3]]
    fits = fit_by_keypoints(walk_shot(believed), [as_believed(detected(true, 0), believed)])
    assert off(fits) == ["cam01", "cam03"]


def test_two_views_do_not_tell_which_is_off() -> None:
    true = cameras(2)
    believed = [turned(true[0], 1), true[1]]
    assert fit_by_keypoints(walk_shot(believed), [as_believed(detected(true, 0), believed)]) == ()


def test_views_with_few_joints_are_not_compared() -> None:
    true = cameras(3)
    found = detected(true, 0)
    found.confidence[1, :, [NAMES.index(n) for n in NAMES if not n.endswith(("Knee", "Ankle"))]] = 0
    assert [fit.camera for fit in fit_by_keypoints(walk_shot(true), [found])] == []


def test_a_step_of_cameras_and_joints_changes_their_cost_as_its_slope_says() -> None:
    true = cameras(4)
    believed = [turned(true[0], 3), *true[1:]]
    shared = SharedKeypoints.of([as_believed(detected(true, 0), believed)], believed, 1.0)
    start = CameraEstimate(np.zeros((4, 7)), np.nan_to_num(shared.points_world))
    equations = FreeCameras.at(shared, start, [0])
    shifts, points = equations.solve(1.0)
    points = points + 0.3 * np.roll(points, 1, axis=0)  # not only along the step that is solved for
    small = 1e-4
    ahead, behind = (equations.cost_at(shared, start.moved((sign * shifts, sign * points))) for sign in (small, -small))
    assert equations.slope((shifts, points)) == pytest.approx((ahead - behind) / (2 * small), rel=1e-5)
    assert equations.slope(equations.solve(0.0)) < 0


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    return film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], [FRONT, SIDE])


def filmed(views: Sequence[View], cameras: Sequence[Camera]) -> Shot:
    taken = [replace(view, camera=camera) for view, camera in zip(views, cameras, strict=True)]
    return shot_of(taken, [BODY], [TRUTH], range(len(TRUTH)))


@pytest.mark.parametrize("seed", range(2))
def test_the_camera_that_was_touched_is_named_by_the_key_poses(views: list[View], seed: int) -> None:
    assert off(fit_by_key_poses(filmed(views, [FRONT, SIDE]))) == []
    fits = fit_by_key_poses(filmed(views, [FRONT, turned(SIDE, seed, 3.0)]))
    assert off(fits) == ["side"] and fits[1].shift > 2 * fits[1].deviation
    assert f"side: its picture is {fits[1].shift:.0f} px off the key poses" in fits[1].summary


def test_a_camera_that_is_off_before_a_plain_wall_may_have_been_held_in_the_hand(views: list[View]) -> None:
    """It says so itself, instead of a second finding; that of a camera that fits is not doubted."""
    shot, clutter = filmed(views, [FRONT, turned(SIDE, 0, 3.0)]), np.random.default_rng(0)
    fits = fit_by_key_poses(shot)
    assert [fit.camera for fit in fits] == ["front", "side"]
    assert "too plain" in fits[1].summary and "in the hand" in fits[1].summary
    assert isinstance(fits[0], CameraFit) and not fits[0].plain
    frames = checked_frames(shot)
    marks = [(tuple(at), int(grey)) for *at, grey in clutter.integers(0, [*SIDE.size, 255], (150, 3)).tolist()]
    pictures = []
    for view in shot.views:
        read = [image.copy() for image in frames_at(view, frames, 1.0, grey=False)]
        for image in read:
            wall = np.abs(image.astype(int) - np.median(image)).max(axis=-1, keepdims=True) < 3
            marked = image.copy()
            for at, grey in marks:
                cv2.circle(marked, at, 4, (grey, grey, grey), -1)
            image[:] = np.where(wall, marked, image)
        pictures.append(dict(zip(frames, read, strict=True)))
    [marked_side] = [fit for fit in fit_by_key_poses(shot, pictures) if fit.camera == "side" and fit.off]
    assert "too plain" not in marked_side.summary


@pytest.mark.parametrize("side", [turned(SIDE, 0, 3.0), SIDE])
def test_it_is_said_before_tracking_if_no_background_can_tell(views: list[View], side: Camera) -> None:
    shot = filmed(views, [FRONT, side])
    frames = sorted(early_frames(shot))
    pictures = [dict(zip(frames, frames_at(view, frames, 1.0, grey=False), strict=True)) for view in shot.views]
    said = early_misfits(shot, pictures)
    assert off(said) == ([] if side is SIDE else ["side"])
    assert all("too plain" in own.summary and "in the hand" in own.summary for own in said)


def test_pictures_that_tracking_has_read_tell_the_same(views: list[View]) -> None:
    shot = filmed(views, [FRONT, turned(SIDE, 0, 3.0)])
    frames = checked_frames(shot)
    pictures = [dict(zip(frames, frames_at(view, frames, 1.0, grey=False), strict=True)) for view in shot.views]
    for again, first in zip(fit_by_key_poses(shot, pictures), fit_by_key_poses(shot), strict=True):
        assert again.shift == pytest.approx(first.shift, abs=1e-6)


def test_what_cannot_be_seen_is_not_judged(views: list[View]) -> None:
    away = look_at("side", (-2.4, -1.4, 1.3), (-6.0, -1.4, 1.3))
    assert [fit.camera for fit in fit_by_key_poses(filmed(views, [FRONT, away]))] == ["front"]
    nobody = [look_at(c.name, (0, -3, 1), (0, -9, 1)) for c in (FRONT, SIDE)]
    assert fit_by_key_poses(filmed(views, nobody)) == ()
    shot = filmed(views, [FRONT, SIDE])
    posed = shot.performers[0].key_poses
    proposed = replace(shot.performers[0], key_poses=KeyPoses.proposed(posed.frames, posed.poses))
    assert fit_by_key_poses(replace(shot, performers=(proposed,))) == ()


def test_refining_without_key_poses_moves_the_camera_that_keypoints_contradict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    true = cameras(3)
    believed = [true[0], turned(true[1], 2, 1.5), true[2]]
    shot = walk_shot(believed)
    seen = []
    for camera, view in zip(true, shot.views, strict=True):
        write_openpose(tmp_path / camera.name, camera, [PLACES], 2.0)
        seen.append(replace(view, keypoints=tmp_path / camera.name))
    keys = KeyPoses.proposed([0], WALK[[0]])
    shot = replace(shot, views=tuple(seen), performers=(replace(shot.performers[0], key_poses=keys),))
    refinement = refine_shot_cameras(shot)
    assert refinement.views[0].camera is believed[0] and refinement.views[2].camera is believed[2]
    refined = refinement.cameras["cam02"]
    points = PLACES[::5]
    before, after = (np.abs(c.project(points) - true[1].project(points)).mean() for c in (believed[1], refined))
    assert after < 0.25 * before
    with pytest.raises(CalibrationError, match="key poses of the whole body, and there is none"):
        refine_shot_cameras(replace(shot, views=shot.views[:2]))


def test_refining_by_keypoints_leaves_cameras_alone_that_fit_the_key_poses(
    views: list[View], monkeypatch: pytest.MonkeyPatch
) -> None:
    """And refines all by the key poses where they do not fit these, too."""
    shot = filmed(views, [FRONT, SIDE])
    agreed = shot_cameras.Refinement(
        tuple(shot_cameras.RefinedCamera(c, 0.0, 1.0, clearness=1.0) for c in (FRONT, SIDE)), np.zeros(0, int)
    )
    monkeypatch.setattr(shot_cameras, "_by_keypoints", lambda _shot: agreed)
    assert refine_shot_cameras(shot) is agreed
    worse = replace(agreed, views=(agreed.views[0], replace(agreed.views[1], camera=turned(SIDE, 0, 3.0))))
    monkeypatch.setattr(shot_cameras, "_by_keypoints", lambda _shot: worse)
    assert refine_shot_cameras(shot).views[1].shift > 1
