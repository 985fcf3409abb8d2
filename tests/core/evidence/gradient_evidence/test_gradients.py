"""Gradient evidence: its sums are those of the derivatives of brightness residuals, camera by camera."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from operator import attrgetter

import cv2
import numpy as np
import pytest
from kfmocap.core.body import landmark_positions, part_poses
from kfmocap.core.body.joint_blocks import joint_blocks
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence import segment_evidence
from kfmocap.core.evidence.frame_comparison import SegmentInViews
from kfmocap.core.evidence.gradient_evidence.compared_pixels import LabelledFrames, compare
from kfmocap.core.evidence.gradient_evidence.gradients import (
    HUBER_LIMIT,
    GradientSums,
    brightness_constancy,
    huber_errors,
    huber_weights,
)
from kfmocap.core.evidence.gradient_evidence.image_wrenches import camera_twist
from kfmocap.core.evidence.gradient_evidence.pixel_gains import log_likelihoods
from kfmocap.core.evidence.rendering.label_images import LabelImages, render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry, PerformerParts
from kfmocap.core.evidence.sampling import Sampling
from kfmocap.core.evidence.segment_evidence import SegmentEvidence, accumulate_evidence
from kfmocap.core.evidence.smoothed_images import SmoothedImages
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from synthetic import (
    at_rest,
    cast,
    figure,
    look_at,
    numeric_jacobian,
    picture,
    pixel_grid,
    poses_of,
    random_motion,
    rigidly_moved,
    rigidly_moved_camera,
)

Array = np.ndarray
Brightness = Callable[[Array, Array], Array]
BODY = figure()
PARTS = PerformerParts(Geometry.of([BODY]))
P = len(BODY)
CAMERA = look_at("cam", (0.8, -2.2, 1.6))
ALL_COUNT = 1e9
"""A tolerance with which every pixel weighs one."""


def pattern(u: Array, v: Array) -> Array:
    """A smooth picture with long waves, and nothing in it that repeats."""
    return 0.5 + 0.2 * np.sin(0.13 * u + 0.4) * np.cos(0.11 * v) + 0.002 * u - 0.001 * v


def flashed(u: Array, v: Array) -> Array:
    """The same with light added: its derivatives are the pattern's, wherever the flash is flat."""
    return pattern(u, v) + 0.03


def gradient_images(pictures: Sequence[Brightness], size: tuple[int, int]) -> SmoothedImages:
    """Exact brightness and derivatives at the pixel centres."""
    u, v = pixel_grid(size).T
    step = 1e-4
    channels = [
        [f(u, v) for f in pictures],
        [(f(u + step, v) - f(u - step, v)) / (2 * step) for f in pictures],
        [(f(u, v + step) - f(u, v - step)) / (2 * step) for f in pictures],
    ]
    b, du, dv = (np.float32(c).reshape(-1, size[0]) for c in channels)
    return SmoothedImages(cv2.merge((b, du, dv)), len(pictures))


def sums_of(camera: Camera, images: SmoothedImages, labels: LabelImages, poses: tuple[Array, Array]) -> GradientSums:
    """Those of all pixels, of which all count."""
    frames = LabelledFrames(camera, images, labels, poses, first=0, stride=1)
    return brightness_constancy(compare(frames), ALL_COUNT)


def labels_of(motion: Motion, camera: Camera, stride: int = 1) -> tuple[LabelImages, tuple[Array, Array]]:
    poses = poses_of([BODY], [motion])
    return render_labels(Geometry.of([BODY]), camera.subsampled(stride), 0, *poses), poses


def carried(twists: Array, labels: LabelImages, poses: tuple[Array, Array], camera: Camera) -> tuple[Array, Array]:
    """Frame 0's pixels (N, 2), and where their points are in frame 1, when the parts move by twists (P, 12).

    Labels and depths are held: a pixel shows a point of its part. Twists about the world's origin move the part in
    frame 0 under the pixel, and carry the point along in frame 1.
    """
    (R, T), (Rc, tc), (Rc1, tc1) = poses, camera.pose(0), camera.pose(1)
    index = labels.index[: labels.ends[P]]
    v, u = np.divmod(index, labels.part.shape[2])
    part = labels.part.ravel()[index]
    z = 1 / labels.inverse_depth[: len(index)].astype(float)
    x_world = (np.stack([u * z, v * z, z], axis=1) @ np.linalg.inv(camera.matrix).T - tc) @ Rc
    moved = []
    for f in range(2):
        twist = twists[:, 6 * f : 6 * f + 6]
        turn = rotations.exp(twist[:, 3:])
        moved.append((turn @ R[f], np.einsum("pab,pb->pa", turn, T[f]) + twist[:, :3]))
    (R0, T0), (R1, T1) = moved
    local = np.einsum("nba,nb->na", R0[part], x_world - T0[part])
    later = ((np.einsum("nab,nb->na", R1[part], local) + T1[part]) @ Rc1.T + tc1) @ camera.matrix.T
    return np.stack([u, v], axis=1).astype(float), later[:, :2] / later[:, 2:]


def still_seen(labels: LabelImages, part: Array, later: Array) -> Array:
    """Which points are, in frame 1, at a pixel of their own part."""
    u, v = np.round(later).astype(int).T
    height, width = labels.part[1].shape
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    return inside & (labels.part[1, v.clip(0, height - 1), u.clip(0, width - 1)] == part)


@dataclass(frozen=True)
class Numeric:
    """Normal equations by central differences."""

    H: Array
    g: Array


def by_differences(
    labels: LabelImages, poses: tuple[Array, Array], pictures: Sequence[Brightness], camera: Camera
) -> Numeric:
    part = labels.part.ravel()[labels.index[: labels.ends[P]]]

    def residual(x: Array) -> Array:
        here, later = carried(np.tile(x, (P, 1)), labels, poses, camera)
        return pictures[1](*later.T) - pictures[0](*here.T)

    # All parts are moved at once: a pixel depends on its own alone.
    J, r = numeric_jacobian(residual, np.zeros(12)), residual(np.zeros(12))
    seen = still_seen(labels, part, carried(np.zeros((P, 12)), labels, poses, camera)[1])
    of = [(part == p) & seen for p in range(P)]
    return Numeric(np.stack([J[i].T @ J[i] for i in of]), np.stack([J[i].T @ r[i] for i in of]))


def distance(found: Array, expected: Array) -> float:
    """Relative error of each part's block, the worst."""
    axes = tuple(range(1, found.ndim))
    return float((np.abs(found - expected).max(axis=axes) / np.abs(expected).max(axis=axes)).max())


def test_standing_still_before_a_flash_the_sums_are_the_derivatives() -> None:
    """Nothing moves and the derivatives of both pictures agree: what is left is single precision."""
    labels, poses = labels_of(at_rest(BODY, 2), CAMERA)
    pictures = (pattern, flashed)
    sums = sums_of(CAMERA, gradient_images(pictures, CAMERA.size), labels, poses)
    expected = by_differences(labels, poses, pictures, CAMERA)
    assert distance(sums.H[0], expected.H) < 2e-5
    assert distance(sums.g[0], expected.g) < 2e-5
    assert sums.energy[0] == pytest.approx(0.03**2 * labels.ends[P], rel=1e-4)
    assert sums.weight[0] == labels.ends[P]


def test_identical_pictures_of_a_body_at_rest_pull_nowhere() -> None:
    labels, poses = labels_of(at_rest(BODY, 2), CAMERA)
    images = gradient_images((pattern, pattern), CAMERA.size)
    sums = sums_of(CAMERA, images, labels, poses)
    assert np.abs(sums.g).max() < 1e-6 * np.abs(sums.H).max()
    assert sums.energy[0] < 1e-9


def filmed(poses: tuple[Array, Array], camera: Camera) -> Sequence[Brightness]:
    """Pictures that are carried along by the trunk: what a body painted with the pattern would show."""
    R, T = poses
    K_inv = np.linalg.inv(camera.matrix)
    Rc, tc = camera.pose(0)

    def later(u: Array, v: Array) -> Array:
        """The trunk's middle plane, seen in frame 1, took its brightness from where it was in frame 0."""
        rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ K_inv.T @ Rc
        eye = camera.centre_world()
        n = np.array([0.0, -1.0, 0.0])
        t = (n @ (T[1, 0] - eye)) / (rays @ n)
        back = (eye + t[..., None] * rays - T[1, 0]) @ (R[1, 0] @ R[0, 0].T) + T[0, 0]
        uvw = (back @ Rc.T + tc) @ camera.matrix.T
        return pattern(uvw[..., 0] / uvw[..., 2], uvw[..., 1] / uvw[..., 2])

    return pattern, later


@pytest.mark.parametrize(("size", "limit"), [(1.0, 0.12), (0.25, 0.04)])
def test_of_moving_parts_the_sums_are_the_derivatives_to_first_order(size: float, limit: float) -> None:
    """Slopes are the means over both frames and each is taken where it is used.

    Against the derivatives proper they are off by half of what a slope changes from frame to frame, so the error goes
    with the motion; bilinear sampling of slopes with waves of some 50 pixels adds (2 pi / 50)^2 / 8, about 0.2 %.
    """
    delta = size * np.random.default_rng(4).normal(0, 0.012, (1, BODY.dof))
    rest = at_rest(BODY)
    moved = rest.moved(delta)
    labels, poses = labels_of(stacked([rest, moved]), CAMERA)
    pictures = filmed(poses, CAMERA)
    sums = sums_of(CAMERA, gradient_images(pictures, CAMERA.size), labels, poses)
    expected = by_differences(labels, poses, pictures, CAMERA)
    assert sums.weight[0] > 0.95 * labels.ends[P]  # few pixels are hidden in the next frame
    assert distance(sums.H[0], expected.H) < limit


def ramp(u: Array, v: Array) -> Array:
    return 0.2 + 0.003 * u + 0.002 * v


def moving_camera(*eyes: Sequence[float]) -> Camera:
    cameras = [look_at("moving", eye) for eye in eyes]
    R, t = (np.concatenate([getattr(c, name) for c in cameras]) for name in ("R_cam_world", "t_cam_world"))
    return replace(cameras[0], R_cam_world=R, t_cam_world=t)


def test_for_moving_parts_and_cameras_the_later_frames_sums_are_the_derivatives() -> None:
    """A ramp has one slope everywhere, so for the later frame's twists nothing is approximate."""
    camera = moving_camera((0.8, -2.2, 1.6), (0.7, -2.25, 1.65))
    rest = at_rest(BODY)
    delta = np.random.default_rng(4).normal(0, 0.01, (1, BODY.dof))
    labels, poses = labels_of(stacked([rest, rest.moved(delta)]), camera)
    images = gradient_images((ramp, ramp), camera.size)
    sums = sums_of(camera, images, labels, poses)
    expected = by_differences(labels, poses, (ramp, ramp), camera)
    assert distance(sums.H[0, :, 6:, 6:], expected.H[:, 6:, 6:]) < 2e-3
    # OpenCV samples to 1/32 pixel, a ten-thousandth of the grey levels here.
    assert distance(sums.g[0, :, 6:], expected.g[:, 6:]) < 1e-2


def test_slopes_are_the_mean_of_both_frames() -> None:
    labels, poses = labels_of(at_rest(BODY, 2), CAMERA)

    def H(*contrast: float) -> Array:
        pictures = [lambda u, v, c=c: c * pattern(u, v) for c in contrast]
        images = gradient_images(pictures, CAMERA.size)
        return sums_of(CAMERA, images, labels, poses).H

    assert distance(H(1.0, 1.4)[0], 1.2**2 * H(1.0, 1.0)[0]) < 1e-3


def two_frames(seed: int = 0, shift: float = 0.01) -> tuple[Motion, list[ViewFrames]]:
    """A rendered body that moves a little, seen by two cameras."""
    delta = np.random.default_rng(seed).normal(0, shift, (2, BODY.dof))
    motion = at_rest(BODY, 2).moved(delta)
    poses = poses_of([BODY], [motion])
    views = []
    for camera in (CAMERA, look_at("side", (-2.4, -1.0, 1.4))):
        views.append(ViewFrames(camera, np.stack([picture([BODY], poses, f, camera) for f in range(2)]), 0))
    return motion, views


def evidence_of(
    views: Sequence[ViewFrames],
    motion: Motion,
    *,
    stride: int = 1,
    tolerance: float = ALL_COUNT,
    by_part: bool = False,
) -> SegmentEvidence:
    poses = {0.0: poses_of([BODY], [motion])}
    sampling = Sampling(1.0, tolerance, stride, by_part=by_part)
    return accumulate_evidence(SegmentInViews(views, 0, poses, sampling), PARTS)


def test_pictures_that_do_not_follow_on_say_nothing() -> None:
    motion, views = two_frames()
    whole = evidence_of(views, motion)
    torn = evidence_of([replace(views[0], torn=np.array([True])), views[1]], motion)
    assert whole.gradients.H[0].any()
    for name in ("H", "g", "energy", "weight", "count"):
        assert not getattr(torn.gradients, name)[0].any()
        np.testing.assert_array_equal(getattr(torn.gradients, name)[1], getattr(whole.gradients, name)[1])


def test_evidence_pulls_a_wrong_pose_back() -> None:
    """One step of least squares on rendered pictures takes most of a small error away."""
    motion, views = two_frames()
    delta = np.random.default_rng(7).normal(0, 0.006, (1, BODY.dof))
    wrong = stacked([motion[:1], motion[1:].moved(delta)])
    evidence = evidence_of(views, wrong, tolerance=1.0)
    blocks = joint_blocks(
        BODY, poses_of([BODY], [wrong]), evidence.gradients.H.sum(0), evidence.gradients.g.sum(0), 0.0
    )
    step = np.linalg.solve(blocks.diagonal[1] + 1e-3 * np.eye(BODY.dof), -blocks.gradient[1])
    right = wrong.moved(np.stack([np.zeros(BODY.dof), step]))
    names = list(BODY.landmarks)
    true, before, after = (landmark_positions(BODY, m, names)[1] for m in (motion, wrong, right))
    assert np.linalg.norm(after - true) < 0.4 * np.linalg.norm(before - true)


def test_evidence_of_two_cameras_is_that_of_each_and_leaves_less_open() -> None:
    motion, views = two_frames()
    both = evidence_of(views, motion)
    for v in range(2):
        alone = evidence_of([views[v]], motion)
        np.testing.assert_array_equal(both.share[v], alone.share[0])
        for name in ("H", "g", "energy", "weight", "noise"):
            np.testing.assert_array_equal(getattr(both.gradients, name)[v], getattr(alone.gradients, name)[0])
    eigenvalues = [np.linalg.eigvalsh(H.sum(axis=0)) for H in (both.gradients.H[:1], both.gradients.H)]
    assert (eigenvalues[1] >= eigenvalues[0] - 1e-5 * eigenvalues[1].max()).all()  # knowing more never hurts


def test_evidence_in_runs_is_the_evidence_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    motion, views = two_frames()
    motion = motion[[0, 1, 1, 0, 1]]
    moving = moving_camera(*((0.8 + 0.02 * f, -2.2, 1.6) for f in range(5)))
    views = [replace(view, grey=view.grey[[0, 1, 1, 0, 1]], camera=moving) for view in views]
    whole = evidence_of(views, motion)
    monkeypatch.setattr(segment_evidence, "PAIRS_PER_BATCH", 3)
    parts = evidence_of(views, motion)
    for name in ("gradients.H", "gradients.g", "gradients.energy", "gradients.weight", "gradients.noise", "share"):
        a, b = attrgetter(name)(parts), attrgetter(name)(whole)
        # OpenCV rounds places to 1/32 pixel, and a place on the border goes another way in another window.
        np.testing.assert_allclose(a, b, rtol=1e-3, atol=5e-3 * np.abs(b).max())


def test_moving_the_world_moves_twists_by_the_adjoint() -> None:
    G, s = rotations.exp(np.array([0.2, -0.4, 0.9])), np.array([0.4, -0.3, 0.2])
    adjoint = np.zeros((6, 6))  # a twist (v, omega) about the origin, seen from the moved world
    adjoint[:3, :3] = adjoint[3:, 3:] = G
    adjoint[:3, 3:] = rotations.skew(s) @ G
    inverse = np.linalg.inv(np.kron(np.eye(2), adjoint))
    motion, views = two_frames()
    here = evidence_of(views, motion).gradients
    turned = [replace(view, camera=rigidly_moved_camera(view.camera, G, s)) for view in views]
    there = evidence_of(turned, rigidly_moved(BODY, motion, G, s)).gradients
    scale = np.abs(here.H).max(axis=(0, 1, 3, 4), keepdims=True)
    expected_H = inverse.T @ here.H @ inverse
    expected_g = here.g @ inverse
    # Labels of a few pixels change as outlines are rounded to 1/16 pixel.
    assert np.abs(there.H - expected_H).max() < 5e-3 * scale.max()
    assert np.abs(there.g - expected_g).max() < 5e-3 * np.abs(expected_g).max()


def test_the_joints_system_does_not_know_where_the_world_is() -> None:
    """Turns are about the parts' own axes; the root's translation turns with the world."""
    G, s = rotations.exp(np.array([0.2, -0.4, 0.9])), np.array([0.4, -0.3, 0.2])
    motion, views = two_frames()
    systems = []
    for g, t in ((np.eye(3), np.zeros(3)), (G, s)):
        moved = rigidly_moved(BODY, motion, g, t)
        e = evidence_of([replace(v, camera=rigidly_moved_camera(v.camera, g, t)) for v in views], moved)
        systems.append(joint_blocks(BODY, poses_of([BODY], [moved]), e.gradients.H.sum(0), e.gradients.g.sum(0), 0.0))
    turn = np.eye(BODY.dof)
    turn[:3, :3] = G
    assert distance(systems[1].diagonal, turn @ systems[0].diagonal @ turn.T) < 5e-3
    assert distance(systems[1].gradient, systems[0].gradient @ turn.T) < 5e-3


def reversed_sums(sums: GradientSums) -> tuple[Array, Array]:
    order = [*range(6, 12), *range(6)]
    return sums.H[::-1][:, :, order][..., order], sums.g[::-1][..., order]


def test_reversing_time_swaps_the_blocks() -> None:
    labels, poses = labels_of(at_rest(BODY, 2), CAMERA)
    pictures = (pattern, flashed)
    ahead, back = (sums_of(CAMERA, gradient_images(p, CAMERA.size), labels, poses) for p in (pictures, pictures[::-1]))
    H, g = reversed_sums(ahead)
    assert distance(back.H[0], H[0]) < 1e-5 and distance(back.g[0], g[0]) < 1e-5


def test_reversing_time_on_moving_pictures_nearly_swaps_the_blocks() -> None:
    """A pair's pixels are those of its earlier frame, so the other way round they are others."""
    motion, views = two_frames(shift=0.004)
    ahead = evidence_of(views, motion).gradients
    back = evidence_of([replace(view, grey=view.grey[::-1]) for view in views], motion[::-1]).gradients
    order = [*range(6, 12), *range(6)]
    for v in range(2):
        assert distance(back.H[v, 0][:, order][..., order], ahead.H[v, 0]) < 0.1


def test_joint_blocks_are_the_wrench_sums_through_the_twist_jacobian() -> None:
    rng = np.random.default_rng(0)
    F = 4
    motion = random_motion(BODY, F)
    poses = poses_of([BODY], [motion])
    rows = rng.normal(0, 1, (F - 1, P, 20, 13))
    H = np.einsum("fpni,fpnj->fpij", rows[..., :12], rows[..., :12])
    g = np.einsum("fpni,fpn->fpi", rows[..., :12], rows[..., 12])

    def twists(delta: Array, f: int) -> Array:
        R2, T2 = part_poses(BODY, motion[[f]].moved(delta[None]))
        turn = R2[0] @ np.swapaxes(poses[0][f], 1, 2)
        omega = rotations.log(turn)
        return np.concatenate([T2[0] - np.einsum("pab,pb->pa", turn, poses[1][f]), omega], axis=1)

    J = [numeric_jacobian(lambda d, f=f: twists(d, f), np.zeros(BODY.dof)) for f in range(F)]
    A, b = np.zeros((F, BODY.dof, F, BODY.dof)), np.zeros((F, BODY.dof))
    for f in range(F - 1):
        for p in range(P):
            both = np.zeros((12, F, BODY.dof))
            both[:6, f], both[6:, f + 1] = J[f][p], J[f + 1][p]
            A += np.einsum("iad,ij,jbe->adbe", both, H[f, p], both)
            b += np.einsum("iad,i->ad", both, g[f, p])
    blocks = joint_blocks(BODY, poses, H, g, 5.0)
    scale = np.abs(A).max()
    for f in range(F):
        assert np.abs(blocks.diagonal[f] - A[f, :, f]).max() < 1e-6 * scale
    for f in range(F - 1):
        assert np.abs(blocks.first[f] - A[f + 1, :, f]).max() < 1e-6 * scale
    assert not blocks.second.any() and blocks.energy == 5.0
    assert np.abs(blocks.gradient - b).max() < 1e-6 * np.abs(b).max()


def test_camera_twist_moves_points_alike_in_both_frames_of_reference() -> None:
    rng = np.random.default_rng(0)
    R, t = CAMERA.pose(0)
    twist, x = rng.normal(0, 1, 6), rng.normal(0, 1, 3)
    velocity = twist[:3] + np.cross(twist[3:], x)
    inside = camera_twist(R, t) @ twist
    np.testing.assert_allclose(inside[:3] + np.cross(inside[3:], R @ x + t), R @ velocity, atol=1e-12)


def test_points_hidden_in_the_next_frame_do_not_count() -> None:
    """The right arm is behind the trunk in the second frame."""
    motion = at_rest(BODY, 2)
    motion.rotations[1, 0] = rotations.exp(np.array([0.0, 1.6, 0.0]))  # the trunk's y axis points up
    labels, poses = labels_of(motion, look_at("front", (0, -2.5, 1.2)))
    images = gradient_images((pattern, pattern), CAMERA.size)
    sums = sums_of(look_at("front", (0, -2.5, 1.2)), images, labels, poses)
    arms = [int(np.argmin(labels.share[1]))]
    assert labels.share[1, arms[0]] < 0.1 and labels.share[0, arms[0]] > 0.9
    assert np.abs(sums.H[0, arms]).max() < 0.05 * np.abs(sums.H[0]).max()


def test_huber_weighs_small_residuals_fully_and_large_ones_by_their_inverse() -> None:
    r = np.float32([0.0, 0.1, HUBER_LIMIT, 2 * HUBER_LIMIT, -10 * HUBER_LIMIT])
    np.testing.assert_allclose(huber_weights(r, np.ones(5, np.float32)), [1, 1, 1, 0.5, 0.1], rtol=1e-6)
    np.testing.assert_allclose(huber_weights(r, np.full(5, 2, np.float32)), [1, 1, 1, 1, 0.2], rtol=1e-6)


def test_the_cost_is_hubers_error_under_the_noise_that_is_given() -> None:
    motion, views = two_frames()

    def measured(tolerance: float, noise: float | None = None) -> GradientSums:
        sampling, poses = Sampling(1.0, tolerance, 1), {0.0: poses_of([BODY], [motion])}
        given = None if noise is None else np.full((len(views), 1, 1 + len(BODY)), noise)
        return accumulate_evidence(SegmentInViews(views, 0, poses, sampling), PARTS, noise=given).gradients

    own, whole = measured(1.0), measured(ALL_COUNT)
    np.testing.assert_allclose(whole.cost * whole.count, whole.energy, rtol=1e-5)
    assert (own.cost < whole.cost).all()
    noise = float(own.noise[0, 0, 0])
    assert measured(1.0, noise).cost[0, 0] == pytest.approx(own.cost[0, 0], rel=1e-6)
    costs = [measured(1.0, k * noise).cost[0, 0] for k in (0.5, 1.0, 2.0)]
    assert costs[0] < costs[1] < costs[2]
    np.testing.assert_array_equal(measured(1.0, 2 * noise).H, own.H)


def test_hubers_error_is_square_then_linear() -> None:
    r, sigma = np.float32([0.5, HUBER_LIMIT, 2 * HUBER_LIMIT, -10 * HUBER_LIMIT]), np.ones(4, np.float32)
    expected = [0.25, HUBER_LIMIT**2, 3 * HUBER_LIMIT**2, 19 * HUBER_LIMIT**2]
    np.testing.assert_allclose(huber_errors(r, sigma), expected, rtol=1e-6)


def test_a_spot_of_other_light_hardly_pulls_under_robust_weights() -> None:
    motion, views = two_frames()
    spot = views[0].grey.copy()
    spot[1, 50:64, 70:84] = 255
    dazzled = [replace(views[0], grey=spot)]
    pull = [
        np.abs(a.gradients.g - b.gradients.g).max()
        for a, b in (
            (evidence_of(dazzled, motion, tolerance=t), evidence_of(views[:1], motion, tolerance=t))
            for t in (1.0, ALL_COUNT)
        )
    ]
    assert pull[0] < 0.2 * pull[1]


def brightened(view: ViewFrames, motion: Motion, part: int, by: Array) -> ViewFrames:
    """A view with light added, grey levels (h, w), where its second frame shows a part."""
    labels, _ = labels_of(motion, view.camera)
    grey = view.grey.astype(int)
    grey[1] += np.where(labels.part[1] == part, by, 0).astype(int)
    return replace(view, grey=np.clip(grey, 0, 255).astype(np.uint8))


def test_a_part_that_gets_brighter_as_a_whole_hardly_pulls_where_parts_may() -> None:
    motion, views = two_frames()
    part = int(np.argmax(evidence_of(views[:1], motion).gradients.H[0, 0, :, 0, 0]))
    lit = brightened(views[0], motion, part, np.full(views[0].grey.shape[1:], 8))

    def step(view: ViewFrames, own: bool) -> Array:
        sums = evidence_of([view], motion, tolerance=1.0, by_part=own).gradients
        return np.linalg.lstsq(sums.H[0, 0, part, 6:, 6:], sums.g[0, 0, part, 6:], rcond=1e-3)[0]

    pull = [np.abs(step(lit, own) - step(views[0], own)).max() for own in (True, False)]
    assert pull[0] < 0.3 * pull[1]


def test_a_part_with_more_noise_than_the_others_counts_less_where_parts_have_their_own() -> None:
    motion, views = two_frames()
    sizes = np.diff(labels_of(motion, views[0].camera)[0].ends)[:P]
    part, other = np.argsort(sizes)[::-1][:2].tolist()
    noise = np.random.default_rng(4).normal(0, 12, views[0].grey.shape[1:])
    noisy = brightened(views[0], motion, part, noise)

    def share(view: ViewFrames, own: bool) -> float:
        H = evidence_of([view], motion, by_part=own).gradients.H[0, 0]
        return float(np.trace(H[part]) / np.trace(H[other]))

    less = [share(noisy, own) / share(views[0], own) for own in (True, False)]
    assert less[0] < 0.2 * less[1]


def test_rendered_pictures_hold_still_on_the_body() -> None:
    """The pictures that these tests track are right: the true motion leaves next to no residual, a wrong one does."""
    motion, views = two_frames(shift=0.02)
    R, T = poses_of([BODY], [motion])
    label, _, _ = cast([BODY], R[0], T[0], CAMERA, 0, pixel_grid(CAMERA.size))
    assert len(set(label)) == P + 1
    right, wrong = (evidence_of(views[:1], m).gradients for m in (motion, motion[[0, 0]]))
    assert right.energy[0, 0] / right.weight[0, 0] < 0.1 * wrong.energy[0, 0] / wrong.weight[0, 0]


def test_residuals_are_as_likely_as_normal_ones_and_no_single_one_less_likely_than_an_outlier() -> None:
    sigma = np.full(4, 0.01)
    near = log_likelihoods(np.array([0.0, 0.005, 0.01, 0.015]), sigma)
    np.testing.assert_allclose(near[0] - near[1:], [0.125, 0.5, 1.125], rtol=0.01)
    near, far, farther = log_likelihoods(np.array([0.0, 0.3, 0.9]), sigma[:3])
    assert far == pytest.approx(farther) and 5 < near - far < 8


def test_pixels_of_a_view_that_sees_somebody_only_in_the_end_count_as_those_of_one_that_always_does() -> None:
    motion, views = two_frames()
    away = motion[[0]].moved(np.eye(1, BODY.dof, 1) * -100.0)
    late = stacked([away] * 5 + [motion])
    views = [replace(view, grey=view.grey[[0] * 5 + [0, 1]]) for view in views]
    shares = [evidence_of(views, m).pixel_share(0.01) for m in (late, late[[5, 5, 5, 5, 5, 5, 6]])]
    np.testing.assert_allclose(shares[0], shares[1], rtol=0.02)
