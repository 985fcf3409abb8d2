"""Cameras refined from key poses over footage whose true cameras are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import ROOT
from kfmocap.core.body import part_poses
from kfmocap.core.body.kinematics import scene_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.errors import CalibrationError, CancelledError, FootageError
from kfmocap.core.evidence.outline_evidence.outline_lines import Lines
from kfmocap.core.fitting.camera_fits import resection
from kfmocap.core.fitting.camera_fits.camera_refinement import Refinement, refine_cameras
from kfmocap.core.fitting.camera_fits.resection import CAMERA_DOF, CameraState, adjusted
from kfmocap.core.fitting.key_frame_views import KeyFrameView
from kfmocap.core.fitting.outline_fit import outline_products
from kfmocap.core.numerics import rotations
from kfmocap.core.shot.footage import frames_at
from kfmocap.core.shot.shot import KeyPoses, Shot, View
from kfmocap.core.tracking.prepare import load_shot
from synthetic import (
    CAMERAS,
    figure,
    film,
    look_at,
    numeric_jacobian,
    picture,
    poses_of,
    random_motion,
    rigidly_moved,
    rigidly_moved_camera,
    shot_of,
    swing,
)

Array = np.ndarray
BODY = figure()
D, P = BODY.dof, len(BODY)
FINE = swing(BODY, 16, size=0.9)
TRUTH = FINE[::4]
KEYS = range(len(TRUTH))


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[View]:
    return film(tmp_path_factory.mktemp("film"), [BODY], [TRUTH], CAMERAS)


def perturbed(camera: Camera, seed: int, size: float = 1.0) -> Camera:
    """Moved by some centimetres, turned by a degree, of a lens 1 % longer or shorter."""
    step = np.random.default_rng(seed).normal(0, [0.03] * 3 + [0.015] * 3 + [0.01])
    return adjusted(camera, size * step)


def shot(views: Sequence[View], cameras: Sequence[Camera], poses: Motion = TRUTH) -> Shot:
    taken = [replace(view, camera=camera) for view, camera in zip(views, cameras, strict=True)]
    return shot_of(taken, [BODY], [poses], KEYS)


def apart(cameras: Sequence[Camera], truth: Sequence[Camera] = CAMERAS) -> list[float]:
    """How far apart cameras show the body's joints, root mean square, pixels."""
    joints = part_poses(BODY, TRUTH)[1]
    frames = range(len(joints))
    return [
        float(np.sqrt(np.mean([np.sum((a.project(joints[f], f) - b.project(joints[f], f)) ** 2, -1) for f in frames])))
        for a, b in zip(cameras, truth, strict=True)
    ]


def found(refinement: Refinement) -> list[Camera]:
    return [view.camera for view in refinement.views]


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_cameras_that_were_moved_are_found_again(views: list[View], seed: int) -> None:
    wrong = [perturbed(camera, 10 * seed + i) for i, camera in enumerate(CAMERAS)]
    refinement = refine_cameras(shot(views, wrong))
    before, after = apart(wrong), apart(found(refinement))
    assert max(after) < 0.6 < 1.5 < max(before)
    for view, error, camera in zip(refinement.views, after, wrong, strict=True):
        assert error < 2 * view.deviation and view.clearness > 0.5 and not view.lost
        assert view.shift == pytest.approx(apart([view.camera], [camera])[0], rel=0.05)
        assert view.camera.name == camera.name


def test_true_cameras_stay(views: list[View]) -> None:
    refinement = refine_cameras(shot(views, CAMERAS))
    assert max(apart(found(refinement))) < 0.4


def test_a_wrong_lens_is_made_good(views: list[View]) -> None:
    """By its focal length alone: pixels stay square, and the principal point where it is."""
    wrong = [adjusted(CAMERAS[0], np.array([0, 0, 0, 0, 0, 0, 0.08])), CAMERAS[1]]
    camera = found(refine_cameras(shot(views, wrong)))[0]
    assert apart([camera], CAMERAS[:1])[0] < 0.5 * apart(wrong[:1], CAMERAS[:1])[0]
    assert np.log(camera.matrix[0, 0] / CAMERAS[0].matrix[0, 0]) < 0.075
    assert camera.matrix[0, 0] == pytest.approx(camera.matrix[1, 1], rel=1e-12)
    assert np.array_equal(camera.matrix[:2, 2], CAMERAS[0].matrix[:2, 2])


def test_true_cameras_hardly_follow_key_poses_that_are_a_little_wrong(
    views: list[View], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What all cameras see alike is an error of the pose, not of each camera."""
    rng = np.random.default_rng(4)
    step = rng.normal(0, 0.05, (len(TRUTH), D))
    step[:, :3] = rng.normal(0, 0.01, (len(TRUTH), 3))
    posed = shot(views, CAMERAS, TRUTH.moved(step))
    careful = apart(found(refine_cameras(posed)))
    monkeypatch.setattr(resection, "POSED_ROOT_SIGMA", 1e-6)
    monkeypatch.setattr(resection, "POSED_JOINT_SIGMA", 1e-6)
    believing = apart(found(refine_cameras(posed)))
    assert max(careful) < 1.0 and np.mean(careful) < 0.7 * np.mean(believing)


def test_moving_the_world_moves_the_cameras(views: list[View]) -> None:
    wrong = [perturbed(camera, i) for i, camera in enumerate(CAMERAS)]
    here = found(refine_cameras(shot(views, wrong)))
    G, s = rotations.exp(np.array([0.1, -0.2, 1.3])), np.array([2.0, -1.0, 0.3])
    elsewhere = shot(views, [rigidly_moved_camera(camera, G, s) for camera in wrong], rigidly_moved(BODY, TRUTH, G, s))
    for a, b in zip(here, found(refine_cameras(elsewhere)), strict=True):
        there = rigidly_moved_camera(a, G, s)
        assert np.abs(there.R_cam_world - b.R_cam_world).max() < 2e-3
        assert np.abs(there.centre_world() - b.centre_world()).max() < 5e-3


def test_a_view_that_shows_the_performers_elsewhere_is_called_lost(views: list[View]) -> None:
    """It is turned by 20 degrees, and stays; the other one is refined all the same."""
    wrong = [perturbed(CAMERAS[0], 0), adjusted(CAMERAS[1], np.array([0, 0, 0, 0, 0.35, 0, 0]))]
    refinement = refine_cameras(shot(views, wrong))
    assert [view.lost for view in refinement.views] == [False, True]
    assert refinement.views[1].camera is wrong[1] and refinement.views[1].shift == 0
    assert apart(found(refinement))[0] < 1.0


def test_a_view_without_performers_stays_as_it_was(views: list[View]) -> None:
    away = look_at("side", (-2.4, -1.4, 1.3), (-6.0, -1.4, 1.3))
    refinement = refine_cameras(shot(views, [perturbed(CAMERAS[0], 0), away]))
    assert refinement.views[1].clearness == 0 and refinement.views[1].shift == 0
    assert refinement.views[1].camera is away
    assert apart(found(refinement)[:1], CAMERAS[:1])[0] < 0.8


def test_a_moving_camera_is_moved_alike_on_all_frames(tmp_path: Path) -> None:
    path = [look_at("moving", (0.5 + 0.1 * f, -2.8, 1.5)) for f in KEYS]
    R, t = (np.concatenate([getattr(c, name) for c in path]) for name in ("R_cam_world", "t_cam_world"))
    truth = replace(path[0], R_cam_world=R, t_cam_world=t)
    seen = film(tmp_path, [BODY], [TRUTH], [truth, CAMERAS[1]])
    wrong = adjusted(truth, np.array([0.02, 0.01, 0.03, 0.01, 0.02, -0.01, 0.0]))
    camera = refine_cameras(shot(seen, [wrong, CAMERAS[1]])).views[0].camera
    assert camera.R_cam_world.shape == (len(TRUTH), 3, 3)
    assert apart([camera], [truth])[0] < 0.4 * apart([wrong], [truth])[0]


def test_a_view_between_the_frames_is_compared_with_the_poses_between_them(tmp_path: Path) -> None:
    """The body crosses the picture: half a frame later it is some pixels farther."""
    path = 0.03 * np.arange(-8, 8)[:, None] * [-0.5, 0.8, 0.0]
    crossing = Motion(FINE.translations + path, FINE.rotations)
    front = film(tmp_path / "front", [BODY], [crossing[::4]], CAMERAS[:1])[0]
    late = film(tmp_path / "late", [BODY], [crossing[2::4]], CAMERAS[1:])[0]
    errors = {
        offset: apart(found(refine_cameras(shot([front, replace(late, offset=offset)], CAMERAS, crossing[::4]))))[1]
        for offset in (0.0, -0.5)
    }
    assert errors[-0.5] < 0.6 and errors[-0.5] < 0.3 * errors[0.0]


def test_refining_says_what_it_lacks(views: list[View]) -> None:
    whole = shot(views, CAMERAS)
    person = whole.performers[0]
    partial = person.key_poses.fixed.copy()
    partial[:, 5] = False
    keys = KeyPoses(person.key_poses.frames, person.key_poses.poses, partial)
    with pytest.raises(CalibrationError, match="key poses of the whole body, and there is none"):
        refine_cameras(replace(whole, performers=(replace(person, key_poses=keys),)))
    away = [look_at(c.name, (0, -3, 1), (0, -9, 1)) for c in CAMERAS]
    with pytest.raises(CalibrationError, match="no camera shows the performers"):
        refine_cameras(shot(views, away))
    with pytest.raises(FootageError, match="the calibration of 'front' 80x60"):
        refine_cameras(shot(views, [CAMERAS[0].reduced(2), CAMERAS[1]]))


@pytest.mark.parametrize("stage", ["footage", "refining cameras"])
def test_it_can_be_cancelled(views: list[View], stage: str) -> None:
    with pytest.raises(CancelledError):
        refine_cameras(shot(views, CAMERAS), lambda what, _: what != stage)


def test_progress_goes_from_nothing_to_all(views: list[View]) -> None:
    told: list[tuple[str, float]] = []
    refine_cameras(shot(views, CAMERAS), lambda what, share: told.append((what, share)) is None)
    for what in ("footage", "refining cameras"):
        shares = [share for name, share in told if name == what]
        assert shares == sorted(shares) and shares[0] == 0 and shares[-1] <= 1
    assert told[-1] == ("refining cameras", 1.0)


def test_the_refined_shot_has_the_refined_cameras(views: list[View]) -> None:
    before = shot(views, [perturbed(camera, i) for i, camera in enumerate(CAMERAS)])
    refinement = refine_cameras(before)
    after = refinement.applied(before)
    assert [view.camera for view in after.views] == list(refinement.cameras.values())
    assert [view.footage for view in after.views] == [view.footage for view in before.views]
    assert list(refinement.frames) == list(KEYS)


def test_pictures_are_rectified_with_the_lens_as_it_is_now(tmp_path: Path) -> None:
    """The same pictures as the tracker's for the camera as given; others when the focal length has changed."""
    camera = replace(CAMERAS[0], distortions=np.array([-0.3, 0.1, 0.0, 0.0]))
    shade = picture([BODY], poses_of([BODY], [TRUTH]), 0, camera)
    assert cv2.imwrite(str(tmp_path / "0.png"), shade)
    view = View(camera, tmp_path / "0.png")
    stored = np.stack(list(frames_at(replace(view, camera=camera.rectified()), [0], 1.0, grey=False)))
    look = KeyFrameView(np.array([0]), stored, 1.0, 0.0)
    assert np.array_equal(look.rectified(camera), np.stack(list(frames_at(view, [0], 1.0, grey=False))))
    longer = adjusted(camera, np.array([0, 0, 0, 0, 0, 0, 0.1]))
    assert not np.array_equal(look.rectified(longer), look.rectified(camera))
    assert np.array_equal(look.rectified(camera.rectified()), stored)


def test_rows_are_the_derivatives_of_the_pictures() -> None:
    """By camera, shape and key pose, against finite differences on the manifold."""
    rng = np.random.default_rng(1)
    poses = random_motion(BODY, 2, turn=0.4, shift=0.1)
    camera = CAMERAS[0]
    state = CameraState.start([camera], [BODY], {0.0: (poses,)})
    frame, part = (a.ravel() for a in np.indices((2, P)))
    local = np.stack([rng.uniform(p.vertices.min(axis=0), p.vertices.max(axis=0)) for p in BODY.parts])[part]
    normal = rng.normal(size=(2 * P, 2))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)

    def shown(step: Array) -> Array:
        """Along their normals, the pictures of points that stretch and shift with their parts."""
        moved = state.moved(step)
        R, T = scene_poses([BODY], moved.motions[0.0])
        change = step[state.shape_columns()][part]
        points = np.einsum("nab,nb->na", R[frame, part], local * (1 + change[:, :3]) + change[:, 3:]) + T[frame, part]
        return np.sum(normal * moved.cameras[0].project(points), axis=1)

    R, T = scene_poses([BODY], [poses])
    world = np.einsum("nab,nb->na", R[frame, part], local) + T[frame, part]
    seen = world @ camera.R_cam_world[0].T + camera.t_cam_world[0]
    one = np.ones(2 * P)
    lines = Lines(frame, part, camera.project(world), normal, one, seen, one, one, one)
    sums = outline_products(lines, camera, (R, T))
    B = resection._jacobian(BODY, camera, (R, T))
    rows = np.einsum("kpr,kprc->kpc", sums[..., :-1, -1], B)
    columns = resection._columns(state.camera_columns(0), state.shape_columns(), state.pose_columns()[0])
    analytic = np.zeros((2 * P, len(state.change)))
    np.put_along_axis(analytic, columns.reshape(2 * P, -1), rows.reshape(2 * P, -1), axis=1)
    numeric = numeric_jacobian(shown, np.zeros(len(state.change)))
    np.testing.assert_allclose(analytic, numeric, atol=2e-6 * np.abs(numeric).max())


def test_a_camera_on_some_frames_has_their_poses() -> None:
    R = rotations.exp(np.random.default_rng(0).normal(size=(5, 3)))
    camera = replace(CAMERAS[0], R_cam_world=R, t_cam_world=np.arange(15.0).reshape(5, 3))
    picked = camera.at([1, 4])
    assert np.array_equal(picked.R_cam_world, R[[1, 4]]) and np.array_equal(picked.t_cam_world[1], [12, 13, 14])
    assert CAMERAS[0].at([1, 4]) is CAMERAS[0]


def test_unknowns_do_not_overlap() -> None:
    state = CameraState.start(CAMERAS, [BODY, BODY], {0.0: (TRUTH, TRUTH)})
    columns = [state.camera_columns(0), state.camera_columns(1), state.shape_columns(), *state.pose_columns()]
    together = np.concatenate([c.ravel() for c in columns])
    assert np.array_equal(together, np.arange(len(state.change)))
    assert len(state.change) == 2 * CAMERA_DOF + 2 * P * 6 + 2 * len(TRUTH) * D
    assert (state.prior() > 0).all()


def test_the_cameras_of_a_rendered_walk_are_found() -> None:
    """Of a skinned body, which no rigid parts fit, with four key poses; the pictures are 640 pixels wide."""
    true = load_shot(ROOT / "examples" / "walk" / "shot.toml")
    cameras = [view.camera for view in true.views]
    wrong = [perturbed(camera, seed) for seed, camera in enumerate(cameras)]
    views = [replace(view, camera=camera) for view, camera in zip(true.views, wrong, strict=True)]
    refinement = refine_cameras(replace(true, views=tuple(views)))
    [person] = true.performers
    joints = part_poses(person.body, person.key_poses.poses)[1].reshape(-1, 3)

    def away(camera: Camera, truth: Camera) -> float:
        return float(np.sqrt(np.mean(np.sum((camera.project(joints) - truth.project(joints)) ** 2, axis=-1))))

    before = [away(camera, truth) for camera, truth in zip(wrong, cameras, strict=True)]
    after = [away(camera, truth) for camera, truth in zip(found(refinement), cameras, strict=True)]
    assert max(after) < 1.2 and np.mean(after) < 0.2 * np.mean(before)
    assert not any(view.lost for view in refinement.views)
