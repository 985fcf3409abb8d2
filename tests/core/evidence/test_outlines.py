"""Outline evidence: how far the body's outline is from the model's, and what that says of the pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body, part_poses, twist_jacobian
from kfmocap.core.body.motion import Motion, stacked
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.gradient_evidence.image_wrenches import camera_twist
from kfmocap.core.evidence.outline_evidence.outline_lines import (
    BISQUARE_LIMIT,
    EDGE_SIGMA,
    MODEL_SIGMA,
    Lines,
    LineSearch,
    outline_lines,
)
from kfmocap.core.evidence.outline_evidence.outline_sums import OutlineSums, outline_sums
from kfmocap.core.evidence.rendering.label_images import LabelImages, render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.numerics import rotations
from synthetic import (
    at_rest,
    cast,
    figure,
    look_at,
    numeric_jacobian,
    poses_of,
    rigidly_moved,
    rigidly_moved_camera,
    silhouette,
    swing,
)

Array = np.ndarray
BODY = figure()
TRUNK = Body(BODY.parts[:1], {})
CAMERA = look_at("cam", (0.8, -2.2, 1.6))
STRIDE, REACH = 2, 12
Arguments = tuple[Camera, Array, LabelImages, LineSearch]


def arguments(
    body: Body, motion: Motion, camera: Camera, foreground: Array, tolerance: float = 1.0, reach: int = REACH
) -> Arguments:
    geometry, poses = Geometry.of([body]), poses_of([body], [motion])
    labels = render_labels(geometry, camera.subsampled(STRIDE), 0, *poses)
    return camera, foreground[None], labels, LineSearch(STRIDE, reach, tolerance)


def seen(body: Body, motion: Motion, camera: Camera, shift: Sequence[float] = (0, 0)) -> Array:
    poses = poses_of([body], [motion])
    return np.stack([silhouette([body], poses, f, camera, shift) for f in range(len(motion))])


def sums_of(given: Arguments) -> OutlineSums:
    """The sums over frames from the first on."""
    camera, _, labels, _ = given
    n, P = labels.share.shape
    return outline_sums(lines_across(given), camera, 0, (n, P))


def lines_across(given: Arguments) -> Lines:
    return outline_lines(*given)


def lines_of(
    body: Body, motion: Motion, camera: Camera = CAMERA, shift: Sequence[float] = (0, 0), tolerance: float = 1.0
) -> Lines:
    return lines_across(arguments(body, motion, camera, seen(body, motion, camera, shift), tolerance))


@pytest.mark.parametrize("shift", [(0, 0), (0.4, 0), (-1.3, 2.1), (2.5, -3.0)])
def test_shifts_are_how_far_the_silhouette_is_displaced_along_the_normals(shift: tuple[float, float]) -> None:
    lines = lines_of(TRUNK, at_rest(TRUNK), shift=shift)
    apart = np.abs(lines.shift - lines.normal @ shift)
    assert len(lines.shift) > 40
    assert np.median(apart) < 0.15
    assert np.quantile(apart, 0.9) < 0.4  # beside a corner, a line meets the side round it
    np.testing.assert_allclose(np.linalg.norm(lines.normal, axis=1), 1)


def test_places_lie_on_the_outline_and_normals_point_outward() -> None:
    motion = swing(BODY, 2)
    lines = lines_of(BODY, motion)
    R, T = poses_of([BODY], [motion])
    for f in range(2):
        own = lines.frame == f
        inside, outside = (
            cast([BODY], R[f], T[f], CAMERA, f, lines.uv[own] + d * lines.normal[own])[0] for d in (-0.3, 0.3)
        )
        assert (inside == lines.part[own]).mean() > 0.97 and (outside == -1).mean() > 0.97
        Rc, tc = CAMERA.pose(f)
        x = (lines.points_cam[own] - tc) @ Rc
        np.testing.assert_allclose(CAMERA.project(x, f), lines.uv[own], atol=1e-9)
        for i, part in enumerate(BODY.parts):
            local = (x[lines.part[own] == i] - T[f, i]) @ R[f, i]
            distance = (local @ part.planes[:, :3].T + part.planes[:, 3]).max(axis=1)
            np.testing.assert_allclose(distance, 0, atol=1e-9)  # on the surface


def test_the_pieces_of_an_outline_are_as_long_as_it_is() -> None:
    lines = lines_of(TRUNK, at_rest(TRUNK))
    corners = CAMERA.project(TRUNK.parts[0].vertices @ TRUNK.R_parent_rest[0].T + TRUNK.offsets[0])
    x, y = corners.T
    width, height = np.ptp(x), np.ptp(y)
    assert 2 * np.hypot(width, height) < (lines.length * 190 / lines.points_cam[:, 2]).sum() < 2 * (width + height)


def test_rows_are_derivatives_of_the_projected_outline() -> None:
    """By central differences along the manifold: a point of the outline moves with its part."""
    motion = swing(BODY, 2)[1:]
    lines = lines_of(BODY, motion)
    R, T = part_poses(BODY, motion)
    Rc, tc = CAMERA.pose(0)
    x = (lines.points_cam - tc) @ Rc
    local = np.einsum("nba,nb->na", R[0, lines.part], x - T[0, lines.part])

    def along(delta: Array) -> Array:
        R2, T2 = part_poses(BODY, motion.moved(delta[None]))
        moved = np.einsum("nab,nb->na", R2[0, lines.part], local) + T2[0, lines.part]
        return np.einsum("na,na->n", CAMERA.project(moved), lines.normal)

    expected = numeric_jacobian(along, np.zeros(BODY.dof))
    J = twist_jacobian(BODY, R, T)[0, lines.part]
    found = np.einsum("ni,ij,njd->nd", lines.wrenches(CAMERA), camera_twist(Rc, tc), J)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()


def test_sums_are_those_of_the_weighted_rows() -> None:
    motion = swing(BODY, 3)
    given = arguments(BODY, motion, CAMERA, seen(BODY, motion, CAMERA, (1.5, -0.5)), tolerance=2.0)
    lines, sums = lines_across(given), sums_of(given)
    rows = lines.wrenches(CAMERA) @ camera_twist(*CAMERA.pose(0))
    weight = lines.weight * lines.length
    assert sums.H.shape == (3, len(BODY), 6, 6)
    for f in range(3):
        energy = 0.0
        for p in range(len(BODY)):
            own = (lines.frame == f) & (lines.part == p)
            assert own.any()
            weighted = rows[own] * weight[own, None]
            np.testing.assert_allclose(sums.H[f, p], rows[own].T @ weighted, atol=1e-9 * np.abs(sums.H).max())
            np.testing.assert_allclose(sums.g[f, p], -weighted.T @ lines.shift[own], atol=1e-9 * np.abs(sums.g).max())
            energy += float(lines.error[own] @ lines.length[own])
        assert sums.energy[f] == pytest.approx(energy)


def test_the_cost_of_a_shift_is_the_error_whose_weight_it_has() -> None:
    """Tukey's: its derivative by the shift is twice the weighted shift, and beyond the limit it stays the same."""
    given = arguments(TRUNK, at_rest(TRUNK), CAMERA, seen(TRUNK, at_rest(TRUNK), CAMERA, (2.0, 1.0)))
    back, here, ahead = (outline_lines(*given, halo=h) for h in (1e-4, 0.0, -1e-4))  # these shift edges
    slope = (ahead.error - back.error) / (ahead.shift - back.shift)
    np.testing.assert_allclose(slope, 2 * here.weight * here.shift, atol=1e-5 * np.abs(here.weight).max())
    lost = lines_of(TRUNK, at_rest(TRUNK), shift=(9.0, 0))
    assert (lost.error[lost.weight == 0] > here.error.mean()).all() and (lost.weight == 0).any()


def test_the_sums_pull_the_trunk_to_where_it_is_seen() -> None:
    """A step of Gauss-Newton: the pose goes on the silhouette of a body that is 3 cm and 0.05 rad from it."""
    truth = at_rest(TRUNK)
    wrong = truth.moved(np.array([[0.03, 0, -0.02, 0, 0, 0.05]]))
    poses = poses_of([TRUNK], [wrong])
    H, g = np.zeros((6, 6)), np.zeros(6)
    for camera in (CAMERA, look_at("side", (-2.4, -1.0, 1.4))):
        sums = sums_of(arguments(TRUNK, wrong, camera, seen(TRUNK, truth, camera), 2.0))
        J = twist_jacobian(TRUNK, *poses)[0, 0]
        H, g = H + J.T @ sums.H[0, 0] @ J, g + J.T @ sums.g[0, 0]
    right = wrong.moved(-np.linalg.solve(H, g)[None])
    assert np.linalg.norm(right.difference(truth)[0, :3]) < 0.2 * np.linalg.norm(wrong.difference(truth)[0, :3])
    assert np.linalg.norm(right.difference(truth)[0, 3:]) < 0.3 * np.linalg.norm(wrong.difference(truth)[0, 3:])


def folded() -> Motion:
    """The left arm lies across the trunk, before the camera."""
    motion = at_rest(BODY)
    motion.rotations[0, 1] = rotations.exp(np.array([0, 0, -0.6]))
    motion.rotations[0, 2] = rotations.exp(np.array([0, 0, -2.2]))
    return motion


def test_where_another_part_lies_beyond_there_is_no_line() -> None:
    camera = look_at("front", (0, -2.5, 1.2))
    poses = {side: poses_of([BODY], [m]) for side, m in (("out", at_rest(BODY)), ("before", folded()))}
    counts = {}
    for side, motion in (("out", at_rest(BODY)), ("before", folded())):
        lines = lines_of(BODY, motion, camera)
        R, T = poses[side]
        beyond = cast([BODY], R[0], T[0], camera, 0, lines.uv + 1.5 * STRIDE * lines.normal)[0]
        assert (beyond == -1).mean() > 0.97
        counts[side] = np.bincount(lines.part, minlength=len(BODY))
    shown, _, _ = cast([BODY], *(a[0] for a in poses["before"]), camera, 0, lines.uv - 2 * lines.normal)
    assert (shown >= 0).all()
    assert counts["before"][2] < 0.6 * counts["out"][2]


def test_a_line_is_not_drawn_to_another_limb_whose_place_the_model_predicts() -> None:
    """Before the camera two figures stand apart by less than a line's length: neither takes the other's edge."""
    motion = at_rest(TRUNK)
    beside = Motion(motion.translations + [0.55, 0, 0], motion.rotations)
    camera, bodies, motions = look_at("front", (0.2, -2.5, 1.2)), [TRUNK, TRUNK], [motion, beside]
    geometry, poses = Geometry.of(bodies), poses_of(bodies, motions)
    labels = render_labels(geometry, camera.subsampled(STRIDE), 0, *poses)
    foreground = np.stack([silhouette(bodies, poses, 0, camera)[None]] * 2)
    lines = outline_lines(camera, foreground, labels, LineSearch(STRIDE, reach=24, tolerance=2.0))
    between = ((lines.part == 0) & (lines.normal[:, 0] > 0.9)) | ((lines.part == 1) & (lines.normal[:, 0] < -0.9))
    assert between.sum() > 20
    assert np.median(np.abs(lines.shift[between])) < 0.3 and lines.weight[between].min() > 0


def test_moving_the_world_moves_the_evidence() -> None:
    G, s = rotations.exp(np.array([0.2, -0.4, 0.9])), np.array([0.4, -0.3, 0.2])
    adjoint = np.zeros((6, 6))  # a twist (v, omega) about the origin, seen from the moved world
    adjoint[:3, :3] = adjoint[3:, 3:] = G
    adjoint[:3, 3:] = rotations.skew(s) @ G
    inverse = np.linalg.inv(adjoint)
    motion = swing(BODY, 2)
    picture = seen(BODY, motion, CAMERA, (1.0, 0.5))
    here = sums_of(arguments(BODY, motion, CAMERA, picture, 2.0))
    moved = rigidly_moved(BODY, motion, G, s)
    there = sums_of(arguments(BODY, moved, rigidly_moved_camera(CAMERA, G, s), picture, 2.0))
    assert np.abs(there.H - inverse.T @ here.H @ inverse).max() < 1e-3 * np.abs(here.H).max()
    assert np.abs(there.g - here.g @ inverse).max() < 1e-3 * np.abs(here.g).max()
    np.testing.assert_allclose(there.energy, here.energy, rtol=1e-3)


def test_frames_are_independent_of_one_another() -> None:
    motion = swing(BODY, 3)
    picture = seen(BODY, motion, CAMERA, (1.0, 0.5))
    together = sums_of(arguments(BODY, motion, CAMERA, picture))
    for f in range(3):
        alone = sums_of(arguments(BODY, motion[[f]], CAMERA, picture[[f]]))
        for name in ("H", "g", "energy"):
            # OpenCV reads pictures to 1/32 pixel, and rounds another way farther down the stack.
            a, b = getattr(together, name)[f], getattr(alone, name)[0]
            assert np.abs(a - b).max() < 5e-3 * np.abs(b).max()


def test_a_moving_camera_sees_every_frame_from_its_place() -> None:
    eyes = [look_at("dolly", (0.8 - 0.3 * f, -2.2, 1.6)) for f in range(2)]
    R, t = (np.concatenate([getattr(e, n) for e in eyes]) for n in ("R_cam_world", "t_cam_world"))
    dolly, motion = replace(eyes[0], R_cam_world=R, t_cam_world=t), at_rest(BODY, 2)
    picture = seen(BODY, motion, dolly)
    both = sums_of(arguments(BODY, motion, dolly, picture))
    for f, eye in enumerate(eyes):
        alone = sums_of(arguments(BODY, motion[[f]], eye, picture[[f]]))
        np.testing.assert_allclose(both.H[f], alone.H[0], atol=1e-9 * np.abs(both.H).max())


def test_there_is_no_line_beyond_the_picture() -> None:
    """The figure stands half out of the picture: its arm is cut by the edge, which is no outline of it."""
    camera = look_at("close", (0.3, -1.1, 1.4))
    lines = lines_of(BODY, at_rest(BODY), camera)
    width, height = camera.size
    assert len(lines.uv) > 20 and not (lines.part == 2).any()
    assert (lines.uv >= -STRIDE).all() and (lines.uv <= [width + STRIDE, height + STRIDE]).all()
    edge = np.minimum(lines.uv, [width - 1, height - 1] - lines.uv)  # to the left and top, or right and bottom
    along_edge = (edge.min(axis=1) < 1) & (np.abs(lines.shift) > 2)
    assert not along_edge[lines.weight > 1e-3].any()


def test_behind_the_camera_there_is_no_line() -> None:
    away = look_at("away", (0.8, -2.2, 1.6), (1.6, -5.5, 2.1))
    lines = lines_across(arguments(BODY, at_rest(BODY), away, np.full((1, 120, 160), 128, np.uint8)))
    assert len(lines.frame) == 0
    sums = sums_of(arguments(BODY, at_rest(BODY), away, np.full((1, 120, 160), 128, np.uint8)))
    assert not sums.H.any() and not sums.g.any() and sums.energy[0] == 0


def test_weights_fall_to_zero_at_the_bisquares_limit() -> None:
    camera = look_at("front", (0, -2.5, 1.1))
    pixels = MODEL_SIGMA * 190 / (2.5 - 0.14)
    limit = BISQUARE_LIMIT * np.hypot(pixels, EDGE_SIGMA)
    mean = []
    for d in (0.0, 0.4 * limit, 0.8 * limit, 1.15 * limit):
        lines = lines_of(TRUNK, at_rest(TRUNK), camera, (d, 0))
        sides = np.abs(lines.normal[:, 0]) > 0.99
        assert sides.sum() > 20
        mean.append(lines.weight[sides].mean())
    assert mean[0] > mean[1] > mean[2] > 0 and mean[3] < 1e-3 * mean[0]
    wide = lines_of(TRUNK, at_rest(TRUNK), camera, (1.15 * limit, 0), tolerance=1.5)
    assert wide.weight[np.abs(wide.normal[:, 0]) > 0.99].mean() > 0.05 * mean[0]


def test_where_nothing_is_seen_outlines_say_nothing() -> None:
    lines = lines_across(arguments(BODY, at_rest(BODY), CAMERA, np.full((1, 120, 160), 128, np.uint8)))
    assert len(lines.weight) > 40
    np.testing.assert_allclose(lines.weight, 0, atol=1e-3)


def test_a_part_is_the_less_sure_the_vaguer_it_is_seen() -> None:
    motion = at_rest(TRUNK)
    sharp = seen(TRUNK, motion, CAMERA).astype(float)
    totals = []
    for contrast in (1.0, 0.2, 0.05):
        faint = (128 + contrast * (sharp - 128)).round().astype(np.uint8)
        lines = lines_across(arguments(TRUNK, motion, CAMERA, faint))
        totals.append(float(lines.weight.sum()))
    assert totals[0] > totals[1] > totals[2] > 0


def test_sums_of_two_frames_are_stacked() -> None:
    motion = stacked([at_rest(BODY), folded()])
    sums = sums_of(arguments(BODY, motion, CAMERA, seen(BODY, motion, CAMERA)))
    assert isinstance(sums, OutlineSums) and sums.g.shape == (2, len(BODY), 6) and sums.energy.shape == (2,)
    assert (np.linalg.eigvalsh(sums.H) > -1e-6 * np.abs(sums.H).max()).all()
