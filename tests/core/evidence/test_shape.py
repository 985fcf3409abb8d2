"""The body's shape is fitted to its outlines on frames whose poses are known."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from kfmocap.core.body import Body
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.part_shapes import fitted_shape, stretched
from kfmocap.core.evidence.rendering.label_images import render_labels
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.view_frames import ViewFrames
from kfmocap.core.numerics import rotations
from scipy.spatial import ConvexHull
from synthetic import CAMERAS, at_rest, figure, look_at, poses_of, rigidly_moved, silhouette, swing

Array = np.ndarray
BODY = figure()
MOTION = swing(BODY, 5)[[0, 2]]
KEYS = (0, 1)


def widened(body: Body, factors: Sequence[float], shift: Sequence[float] = (0, 0, 0)) -> Body:
    """The body with all parts stretched and shifted along their own axes; its joints are where they were."""
    return replace(body, parts=tuple(replace(p, vertices=p.vertices * np.array(factors) + shift) for p in body.parts))


def filmed(bodies: Sequence[Body], motions: Sequence, cameras: Sequence[Camera]) -> list[ViewFrames]:
    """Views with foreground images alone."""
    poses = poses_of(bodies, motions)
    frames = range(len(motions[0]))
    dark = np.zeros((len(frames), CAMERAS[0].size[1], CAMERAS[0].size[0]), np.uint8)
    return [
        ViewFrames(c, dark, 0, np.stack([silhouette(bodies, poses, f, c, samples=3) for f in frames])[None])
        for c in cameras
    ]


def fitted(truth: Body, cameras: Sequence[Camera] = CAMERAS) -> Geometry:
    """The shape that is found from the default body."""
    poses = poses_of([BODY], [MOTION])
    frames = list(KEYS)
    views = filmed([truth], [MOTION], cameras)
    return fitted_shape(views, Geometry.of([BODY]), {0.0: (poses[0][frames], poses[1][frames])}, frames).geometry


def extents(geometry: Geometry) -> Array:
    return np.stack([np.ptp(geometry.vertices[span], axis=0) for span in geometry.spans])


def apart_mm(a: Geometry, b: Geometry) -> Array:
    """Largest distance of a vertex of each part."""
    distance = 1000 * np.linalg.norm(a.vertices - b.vertices, axis=1)
    return np.array([distance[span].max() for span in a.spans])


@pytest.mark.parametrize(
    ("factors", "shift"), [((1.2, 1, 1), (0, 0, 0)), ((1.15, 1, 1.2), (0, 0, 0)), ((1, 1, 1), (0.02, 0, 0))]
)
def test_a_body_of_another_shape_is_found_from_its_silhouettes(factors: tuple, shift: tuple) -> None:
    truth, start = Geometry.of([widened(BODY, factors, shift)]), Geometry.of([BODY])
    found = fitted(widened(BODY, factors, shift))
    before, after = apart_mm(start, truth), apart_mm(found, truth)
    assert after.mean() < 0.5 * before.mean()
    assert after[0] < 0.3 * before[0]  # of the trunk much is seen


def test_widths_are_found() -> None:
    ratio = extents(fitted(widened(BODY, (1.2, 1, 1)))) / extents(Geometry.of([BODY]))
    assert abs(ratio[0, 0] - 1.2) < 0.03
    assert np.abs(ratio[:, 0] - 1.2).max() < 0.1


def test_a_body_that_fits_stays_as_it_is() -> None:
    found = fitted(BODY)
    assert apart_mm(found, Geometry.of([BODY])).max() < 8
    assert np.abs(extents(found)[0] / extents(Geometry.of([BODY]))[0] - 1).max() < 0.02


def test_joints_stay_where_they_are() -> None:
    """The poses are not the shape's: a stretch leaves a part's joint, the origin of its frame, in its place."""
    geometry = Geometry.of([BODY])
    change = np.zeros((len(BODY), 6))
    change[:, :3] = [0.3, -0.2, 0.1]
    wide = stretched(geometry, change)
    at_joint = np.abs(geometry.vertices[:, 1]) < 1e-12  # the boxes begin at their joints
    assert at_joint.sum() == 4 * len(BODY)
    np.testing.assert_allclose(wide.vertices[at_joint, 1], 0, atol=1e-12)
    np.testing.assert_allclose(wide.vertices, geometry.vertices * [1.3, 0.8, 1.1])
    assert wide.owner is geometry.owner and wide.spans == geometry.spans


def test_what_no_camera_shows_stays_as_it_is() -> None:
    """A second performer stands behind the cameras."""
    away = rigidly_moved(BODY, at_rest(BODY, len(MOTION)), np.eye(3), np.array([0.0, -9.0, 0.0]))
    bodies, motions, frames = [BODY] * 2, [MOTION, away], list(KEYS)
    R, T = poses_of(bodies, motions)
    views = filmed([widened(BODY, (1.2, 1, 1))] * 2, motions, CAMERAS)
    start = Geometry.of(bodies)
    found = fitted_shape(views, start, {0.0: (R[frames], T[frames])}, frames).geometry
    changed = apart_mm(found, start)
    np.testing.assert_allclose(changed[4:], 0, atol=1e-9)
    assert (changed[:4] > 2).all()


def test_a_single_camera_leaves_the_depth_it_does_not_show() -> None:
    """Before the camera the trunk's width is seen; of how deep it is there is next to nothing."""
    camera, pose = look_at("front", (0, -6.0, 1.1), focal=420), at_rest(BODY)
    truth = widened(BODY, (1.2, 1, 1.2))
    R, T = poses_of([BODY], [pose])
    [view] = filmed([truth], [pose], [camera])
    found = fitted_shape([view], Geometry.of([BODY]), {0.0: (R, T)}, [0]).geometry
    ratio = extents(found) / extents(Geometry.of([BODY]))
    assert abs(ratio[0, 0] - 1.2) < 0.03 and abs(ratio[0, 2] - 1) < 0.1


def test_shapes_fitted_to_single_frames_join_to_the_one_that_fits_all() -> None:
    """A single camera sees the width on one frame and, the body having turned, the depth on the other."""
    camera = look_at("front", (0, -6.0, 1.1), focal=420)
    quarter = rotations.exp(np.array([0, 0, np.pi / 2]))
    ahead = at_rest(BODY)
    motions = [ahead, rigidly_moved(BODY, ahead, quarter, np.zeros(3))]
    both = Motion(*(np.concatenate([getattr(m, name) for m in motions]) for name in ("translations", "rotations")))
    truth, start = widened(BODY, (1.2, 1, 1.2)), Geometry.of([BODY])
    R, T = poses_of([BODY], [both])
    views = filmed([truth], [both], [camera])
    first, second = (fitted_shape(views, start, {0.0: (R[[f]], T[[f]])}, [f]) for f in (0, 1))
    together = fitted_shape(views, start, {0.0: (R, T)}, [0, 1])
    joined = first.joined([second.evidence])
    ratio = extents(joined.geometry) / extents(start)
    assert abs(ratio[0, 0] - 1.2) < 0.03 and abs(ratio[0, 2] - 1.2) < 0.03
    alone, after = (apart_mm(each.geometry, together.geometry)[0] for each in (first, joined))
    assert after < 0.2 * alone
    assert joined.evidence is first.evidence
    assert first.joined([]) is first and first.joined([first.evidence]) is first
    again = first.joined([second.evidence, second.evidence])  # a frame counts once
    np.testing.assert_array_equal(again.geometry.vertices, joined.geometry.vertices)


def test_joined_shapes_keep_as_near_to_the_default_body_as_fitted_ones() -> None:
    """A frame on which nothing is seen leaves limbs, which one camera hardly shows, where the fit has them."""
    camera, pose = look_at("front", (0, -6.0, 1.1), focal=420), at_rest(BODY, 2)
    truth, start = widened(BODY, (1.2, 1.1, 1.2)), Geometry.of([BODY])
    R, T = poses_of([BODY], [pose])
    views = filmed([truth], [pose], [camera])
    first, second = (fitted_shape(views, start, {0.0: (R[[f]], T[[f]])}, [f]) for f in (0, 1))
    seen = second.evidence
    nothing = replace(seen, matrix=np.zeros_like(seen.matrix), gradient=np.zeros_like(seen.gradient))
    changed, moved = (apart_mm(first.geometry, other) for other in (start, first.joined([nothing]).geometry))
    assert (changed[1:] > 8).all()
    assert (moved[1:] < 2).all()


def test_stretched_planes_are_those_of_the_stretched_vertices() -> None:
    geometry = Geometry.of([BODY, widened(BODY, (1.3, 0.9, 1.1))])
    change = np.random.default_rng(0).uniform(-0.3, 0.3, (len(geometry.spans), 6))
    found = stretched(geometry, change)
    np.testing.assert_allclose(np.linalg.norm(found.planes[:, :3], axis=1), 1)
    for i, span in enumerate(found.spans):
        planes, vertices = found.planes[found.face_owner == i], found.vertices[span]
        np.testing.assert_allclose(vertices, geometry.vertices[span] * (1 + change[i, :3]) + change[i, 3:])
        distance = vertices @ planes[:, :3].T + planes[:, 3]
        assert distance.max() < 1e-8
        assert ((np.abs(distance) < 1e-8).sum(axis=0) >= 3).all()  # every plane bears a face
        hull = np.unique(ConvexHull(vertices).equations.round(6), axis=0)
        np.testing.assert_allclose(np.unique(planes.round(6), axis=0), hull, atol=2e-6)


def test_a_stretched_body_is_drawn_as_one_that_was_made_so() -> None:
    """Labels and depths."""
    change = np.tile([0.2, 0.1, -0.1, 0.01, -0.02, 0.03], (len(BODY), 1))
    made = Geometry.of([widened(BODY, (1.2, 1.1, 0.9), (0.01, -0.02, 0.03))])
    poses = poses_of([BODY], [MOTION])
    one, other = (render_labels(g, CAMERAS[0], 0, *poses) for g in (stretched(Geometry.of([BODY]), change), made))
    np.testing.assert_array_equal(one.part, other.part)
    np.testing.assert_allclose(one.inverse_depth, other.inverse_depth, rtol=1e-4)
