"""Label and depth images against rays cast at the parts face by face."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
from kfmocap.core.body import Body, human
from kfmocap.core.body.motion import Motion
from kfmocap.core.cameras.camera import Camera
from kfmocap.core.evidence.rendering.label_images import LabelImages, render_labels
from kfmocap.core.evidence.rendering.nearest_pixels import pixels_at
from kfmocap.core.evidence.rendering.part_geometry import Geometry
from kfmocap.core.evidence.rendering.static_parts import StaticParts
from kfmocap.core.numerics import rotations
from synthetic import (
    at_rest,
    box,
    cast,
    figure,
    look_at,
    part,
    pixel_grid,
    poses_of,
    rigidly_moved,
    rigidly_moved_camera,
    swing,
)

Array = np.ndarray
NEARBY = look_at("near", (1.2, -2.6, 1.7), focal=170, size=(200, 150))


def seen(camera: Camera, *performers: tuple[Body, Motion], first: int = 0) -> LabelImages:
    bodies, motions = zip(*performers, strict=True)
    return render_labels(Geometry.of(bodies), camera, first, *poses_of(bodies, motions))


def truth(camera: Camera, *performers: tuple[Body, Motion], frame: int = 0) -> tuple[Array, Array]:
    """Label and depth image by casting rays."""
    bodies, motions = zip(*performers, strict=True)
    R, T = poses_of(bodies, motions)
    shape = camera.size[::-1]
    label, depth, _ = cast(bodies, R[frame], T[frame], camera, frame, pixel_grid(camera.size))
    return label.reshape(shape), depth.reshape(shape)


def solid(centre: tuple[float, float, float], half: float = 0.3, depth: float = 0.2) -> tuple[Body, Motion]:
    """One box with its middle at `centre`."""
    x, y, z = centre
    body = Body((part("solid", -1, (x, y, z - half), (x, y, z + half), half, depth),), {})
    return body, at_rest(body)


def rims(label: Array) -> Array:
    """Pixels with another label within one pixel, which a filled outline may claim."""
    near = [cv2.morphologyEx(label.astype(np.int16), op, np.ones((3, 3), np.uint8)) for op in (0, 1)]
    return near[0] != near[1]


@pytest.mark.parametrize("body", [figure(), human()], ids=["figure", "human"])
def test_labels_and_depths_are_those_of_cast_rays(body: Body) -> None:
    motion = swing(body, 5, seed=3)
    images = seen(NEARBY, (body, motion))
    depths = images.depth_images()
    for f in range(5):
        label, depth = truth(NEARBY, (body, motion), frame=f)
        inner = ~rims(label)
        assert (label >= 0).sum() > 1500
        # The painter's order is by the middles of the parts: where parts meet at a joint it may err.
        wrong = (images.part[f] != label) & inner
        assert wrong.sum() < 0.03 * (label >= 0).sum()
        same = inner & (label >= 0) & (images.part[f] == label)
        np.testing.assert_allclose(depths[f][same], depth[same], rtol=2e-5)
        assert np.isinf(depths[f][images.part[f] < 0]).all()


@pytest.mark.parametrize("body", [figure(), human()], ids=["figure", "human"])
def test_outlines_are_the_hulls_of_the_projected_vertices_clockwise(body: Body) -> None:
    motion = swing(body, 4, seed=5)
    R, T = poses_of([body], [motion])
    outlines = seen(NEARBY, (body, motion)).outlines
    for k, (a, b) in enumerate(pairwise(outlines.ends)):
        f, i = divmod(k, len(body))
        pixels = NEARBY.project(body.parts[i].vertices @ R[f, i].T + T[f, i], f)
        hull = cv2.convexHull(np.float32(pixels), clockwise=True)[:, 0]
        (u, v), n = outlines.uv[a:b].T, np.roll(outlines.uv[a:b], -1, axis=0)
        area = (u * n[:, 1] - n[:, 0] * v).sum() / 2  # of what goes clockwise as the picture is seen, positive
        np.testing.assert_allclose(area, cv2.contourArea(hull), rtol=1e-4)
        for corner in hull:  # the hull's corners are among the outline's
            assert np.linalg.norm(outlines.uv[a:b] - corner, axis=1).min() < 1e-3


def test_a_part_before_and_behind_the_camera_has_no_outline() -> None:
    body, motion = solid((0, 0, 1), 0.3, 0.3)
    labels = seen(look_at("within", (0, 0.05, 1), (0, 5, 1)), (body, motion))
    assert not len(labels.outlines.uv) and (labels.part == -1).all()


def test_a_plane_square_to_the_view_has_one_depth() -> None:
    camera = look_at("front", (0, -3, 1), (0, 0, 1))
    body, motion = solid((0, 0, 1), 0.3, 0.2)
    # Flat front: a box without taper.
    body = Body((replace(body.parts[0], vertices=box([-0.3, 0, -0.2], [0.3, 0.6, 0.2])),), {})
    images = seen(camera, (body, motion))
    np.testing.assert_allclose(1 / images.inverse_depth, 2.8, rtol=1e-5)
    width = 0.6 / 2.8 * 190
    assert images.part[0].max(axis=0).tolist().count(0) == pytest.approx(width, abs=1.5)


def test_depth_at_the_rim_is_never_behind_the_part() -> None:
    body, motion = human(), at_rest(human())
    images = seen(NEARBY, (body, motion))
    R, T = poses_of([body], [motion])
    Rc, tc = NEARBY.pose(0)
    for i, p in enumerate(body.parts):
        z = ((p.vertices @ R[0, i].T + T[0, i]) @ Rc.T + tc)[:, 2]
        depths = 1 / images.inverse_depth[images.ends[i] : images.ends[i + 1]]
        assert (depths <= z.max() * (1 + 1e-5)).all() and (depths >= 0.7 * z.min()).all()


def test_pixels_are_listed_by_frame_and_part() -> None:
    body, motion = figure(), swing(figure(), 3)
    images = seen(NEARBY, (body, motion))
    n, P = images.share.shape
    assert (n, P) == (3, 4) and len(images.ends) == n * P + 1
    assert len(images.index) == len(images.inverse_depth) == (images.part >= 0).sum()
    for k in range(n * P):
        index = images.index[images.ends[k] : images.ends[k + 1]]
        frame = index // images.part[0].size
        assert (frame == k // P).all() and (images.part.ravel()[index] == k % P).all()


def test_box_bounds_what_is_seen() -> None:
    images = seen(NEARBY, (figure(), swing(figure(), 3)))
    left, top, right, bottom = images.box()
    _, v, u = np.nonzero(images.part >= 0)
    assert (left, top, right, bottom) == (u.min(), v.min(), u.max() + 1, v.max() + 1)
    assert seen(NEARBY, solid((9, 0, 1))).box() == (0, 0, 0, 0)


def test_a_lone_part_in_full_view_is_wholly_visible() -> None:
    for camera in (NEARBY, look_at("far", (3, -6, 3)), look_at("above", (0.1, -0.5, 4))):
        assert seen(camera, solid((0, 0, 1))).share[0, 0] == pytest.approx(1, abs=0.02)


def test_a_part_outside_the_picture_or_behind_the_camera_is_not_visible() -> None:
    camera = look_at("front", (0, -3, 1), (0, 0, 1))
    for centre in ((5, 0, 1), (0, 0, 6), (0, -6, 1)):
        images = seen(camera, solid(centre))
        assert images.share[0, 0] == 0 and (images.part < 0).all()


@pytest.mark.parametrize(("side", "up"), [(1, 0), (-1, 0), (0, 1), (0, -1)])
def test_a_part_half_out_of_the_picture_is_half_visible(side: int, up: int) -> None:
    camera = look_at("front", (0, -3, 1), (0, 0, 1))
    x, z = side * 3 * 80 / 190, 1 + up * 3 * 60 / 190
    assert seen(camera, solid((x, 0, z), 0.25, 0.05)).share[0, 0] == pytest.approx(0.5, abs=0.08)


def test_the_rim_of_a_thin_part_is_not_counted_as_more_of_it() -> None:
    """A filled outline of 4 pixels' width covers nearly 5; a part of that width is still half visible."""
    x, z = 0.0, 1 - 3 * 60 / 190
    thin = Body((part("thin", -1, (x, 0, z - 0.3), (x, 0, z + 0.3), 0.03, 0.03),), {})
    share = seen(look_at("front", (0, -3, 1), (0, 0, 1)), (thin, at_rest(thin))).share[0, 0]
    assert share == pytest.approx(0.5, abs=0.06)


def test_a_part_behind_another_is_hidden_and_one_half_behind_is_half_visible() -> None:
    camera = look_at("front", (0, -3, 1), (0, 0, 1))
    front = solid((0, 0, 1), 0.4, 0.1)
    hidden = seen(camera, front, solid((0, 1, 1), 0.3, 0.1)).share[0]
    assert hidden[0] > 0.97 and hidden[1] == 0
    # The front box ends at x = 0.4 (0.32 at its tapered top), 2.9 m away; a ray there is at 4/2.9 of it at y = 1.
    edge = 0.36 / 2.9 * 4
    half = seen(camera, front, solid((edge, 1, 1), 0.2, 0.05)).share[0, 1]
    assert half == pytest.approx(0.5, abs=0.1)


def test_performers_hide_one_another_and_keep_their_own_numbers() -> None:
    camera = look_at("front", (0, -4, 1.1), (0, 0, 1.1))
    body = figure()
    P, rest = len(body), at_rest(body)
    before = rigidly_moved(body, rest, np.eye(3), np.array([0.0, -0.8, 0.0]))
    both = seen(camera, (body, rest), (body, before))
    assert both.share.shape == (1, 2 * P)
    assert both.share[0, 0] < 0.05 and both.share[0, P] > 0.97
    swapped = seen(camera, (body, before), (body, rest))
    np.testing.assert_array_equal(np.where(both.part >= 0, (both.part + P) % (2 * P), -1), swapped.part)
    np.testing.assert_array_equal(np.roll(both.share, P, axis=1), swapped.share)


def test_performers_who_stand_apart_see_nothing_of_one_another() -> None:
    camera = look_at("front", (0, -6, 1.1), (0, 0, 1.1), size=(320, 160))
    people = [
        (figure(), rigidly_moved(figure(), swing(figure(), 2), np.eye(3), np.array([x, 0.0, 0]))) for x in (-1.3, 1.3)
    ]
    both = seen(camera, *people)
    alone = [seen(camera, person) for person in people]
    np.testing.assert_allclose(both.share, np.concatenate([a.share for a in alone], axis=1))
    np.testing.assert_allclose(both.depth_images(), np.minimum(*(a.depth_images() for a in alone)), rtol=1e-6)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("eye", [(0.3, -4.5, 1.4), (0.3, 4.5, 1.4)], ids=["from the front", "from behind"])
def test_of_two_performers_the_nearer_hides_the_farther(
    eye: tuple[float, float, float], order: tuple[int, int]
) -> None:
    """Whichever is listed first and wherever the camera stands, labels are those of cast rays."""
    body, camera = figure(), look_at("camera", eye, (0.1, 0.0, 1.2))
    rest = at_rest(body)
    people = [(body, Motion(rest.translations + shift, rest.rotations)) for shift in ([0.0, -0.7, 0], [0.1, 0.7, 0])]
    performers = [people[i] for i in order]
    images, label = seen(camera, *performers), truth(camera, *performers)[0]
    inner = ~rims(label) & (label >= 0)
    assert inner.sum() > 700 and set(label[inner] // len(body)) == {0, 1}
    assert (images.part[0] != label)[inner].mean() < 0.03
    nearer = int(np.argmin([np.linalg.norm(motion.translations[0] - eye) for _, motion in performers]))
    alone = seen(camera, performers[nearer]).share[0]
    own = slice(nearer * len(body), (nearer + 1) * len(body))
    np.testing.assert_allclose(images.share[0, own], alone)
    farther = np.delete(images.share[0], np.arange(own.start, own.stop))
    assert farther.min() < 0.5


def test_every_frame_of_a_moving_camera_has_its_own_pose() -> None:
    eyes = [look_at("cam", (x, -3, 1.4)) for x in (-1.0, 0.0, 1.0)]
    moving = replace(
        eyes[0],
        R_cam_world=np.concatenate([c.R_cam_world for c in eyes]),
        t_cam_world=np.concatenate([c.t_cam_world for c in eyes]),
    )
    body, motion = figure(), at_rest(figure(), 2)
    images = seen(moving, (body, motion), first=1)
    for j in range(2):
        fixed = seen(eyes[1 + j], (body, motion[[j]]))
        np.testing.assert_array_equal(images.part[j], fixed.part[0])
        np.testing.assert_allclose(images.depth_images()[j], fixed.depth_images()[0], rtol=1e-6)


def test_moving_the_world_changes_nothing_seen() -> None:
    body, motion = figure(), swing(figure(), 2)
    G, s = rotations.exp(np.array([0.3, -0.5, 1.1])), np.array([2.0, 1.0, -0.7])
    here = seen(NEARBY, (body, motion))
    there = seen(rigidly_moved_camera(NEARBY, G, s), (body, rigidly_moved(body, motion, G, s)))
    # Outlines are rounded to 1/16 pixel: one may fall on the other side.
    assert (here.part != there.part).mean() < 1e-3
    same = here.part == there.part
    np.testing.assert_allclose(here.depth_images()[same], there.depth_images()[same], rtol=1e-4)


def test_coinciding_faces_are_listed_once() -> None:
    geometry = Geometry.of([figure()])
    assert len(geometry.planes) == 4 * 6
    np.testing.assert_array_equal(geometry.counts, [8] * 4)
    np.testing.assert_array_equal(np.bincount(geometry.face_owner), [6] * 4)


def test_some_parts_alone_are_seen_as_if_the_others_were_away() -> None:
    body, camera = figure(), look_at("front", (0.4, -3.0, 1.3))
    geometry, (R, T) = Geometry.of([body]), poses_of([body], [swing(body, 3)])
    kept = [3, 1]
    alone = render_labels(geometry.subset(kept), camera, 0, R[:, kept], T[:, kept])
    away = T.copy()
    away[:, [0, 2]] -= 100 * camera.pose(0)[0][2]  # behind the camera
    whole = render_labels(geometry, camera, 0, R, away)
    np.testing.assert_array_equal(np.array([*kept, -1])[alone.part], whole.part)
    np.testing.assert_allclose(alone.depth_images(), whole.depth_images(), rtol=1e-5)


def test_label_images_without_some_parts_are_those_of_the_others() -> None:
    body = human()
    geometry, poses = Geometry.of([body]), poses_of([body], [swing(body, 3, seed=3)])
    left_out = [body.index("upper_arm.L"), body.index("forearm.L"), body.index("chest")]
    label, depth = render_labels(geometry, NEARBY, 0, *poses).without(left_out)
    kept = np.setdiff1d(np.arange(len(body)), left_out)
    others = render_labels(geometry.subset(kept.tolist()), NEARBY, 0, *(each[:, kept] for each in poses))
    np.testing.assert_array_equal(label, np.array([*kept, -1])[others.part])
    np.testing.assert_array_equal(depth, others.depth_steps())


@pytest.mark.parametrize("moving", [0, 1, 2])
def test_parts_that_are_drawn_once_are_seen_among_others_as_if_all_were_drawn_together(moving: int) -> None:
    bodies = [human(1.7), human(1.8), human(1.6)]
    motions = [swing(body, 4, 0.5, k) for k, body in enumerate(bodies)]
    motions = [Motion(m.translations + [0.15 * k, 0.3 * k, 0], m.rotations) for k, m in enumerate(motions)]
    camera, geometry, poses = NEARBY, Geometry.of(bodies), poses_of(bodies, motions)
    own, rest = (np.flatnonzero(mask) for mask in (geometry.performer == moving, geometry.performer != moving))
    whole = render_labels(geometry, camera, 0, *poses)
    still = StaticParts.drawn(geometry, rest, camera, 0, poses)
    alone = render_labels(geometry.subset(own.tolist()), camera, 0, *(a[:, own] for a in poses))
    seen = still.among(alone, own)
    hidden = still.hidden(seen)
    np.testing.assert_array_equal(seen.part, whole.part)
    np.testing.assert_array_equal(seen.share, whole.share)
    np.testing.assert_array_equal(seen.far_to_near, whole.far_to_near)
    np.testing.assert_array_equal(seen.depth_images(), whole.depth_images())
    P = len(geometry.performer)
    for f, k in np.ndindex(4, P):
        listed = seen.index[slice(*seen.ends[f * P + k :][:2])]
        expected = whole.index[slice(*whole.ends[f * P + k :][:2])] if k in own else []
        np.testing.assert_array_equal(listed, expected)
    shown, without = whole.areas()
    areas = still.areas(seen, hidden, alone, own)
    np.testing.assert_array_equal(areas[0], shown)
    np.testing.assert_array_equal(areas[1, own], without[own])
    assert len(hidden.index) > 50, "they do hide each other"
    assert (whole.part.ravel()[hidden.index] // len(bodies[0]) == moving).all()


@pytest.mark.parametrize("step", [0.15, 1.0, 30.0])
def test_pixels_without_other_performers_are_those_of_each_drawn_alone(step: float) -> None:
    """Whether they stand behind each other, beside each other, or the last is out of sight."""
    bodies = [human(1.7), human(1.8), human(1.6)]
    motions = [swing(body, 4, 0.5, k) for k, body in enumerate(bodies)]
    motions = [Motion(m.translations + [step * (k - 1), 0.3 * k, 0], m.rotations) for k, m in enumerate(motions)]
    geometry, poses = Geometry.of(bodies), poses_of(bodies, motions)
    _, without = render_labels(geometry, NEARBY, 0, *poses).areas()
    for m, motion in enumerate(motions):
        alone = render_labels(Geometry.of([bodies[m]]), NEARBY, 0, *poses_of([bodies[m]], [motion]))
        np.testing.assert_array_equal(without[geometry.performer == m], alone.areas()[0])


@pytest.mark.parametrize("kind", [np.float32, float])
def test_pixels_are_the_nearest_and_something_else_beyond_each_picture(kind: type) -> None:
    """Pictures lie one after the other in memory: a place above one is not below the other."""
    rng = np.random.default_rng(0)
    images = rng.integers(0, 100, (3, 5, 7)).astype(np.int16)
    frame, u, v = rng.integers(0, 3, (40, 1)), rng.uniform(-3, 10, (40, 6)), rng.uniform(-3, 8, (40, 6))
    u[0, :2], v[0, 2:4] = (1e12, -1e12), (1e12, -1e12)
    found = pixels_at(images, frame, u.astype(kind), v.astype(kind), np.int16(-2))
    for (k, j), pixel in np.ndenumerate(found):
        column, row = round(float(kind(u[k, j]))), round(float(kind(v[k, j])))
        inside = 0 <= column < 7 and 0 <= row < 5
        assert pixel == (images[frame[k, 0], row, column] if inside else -2)


@pytest.mark.parametrize("performers", [1, 2])
@pytest.mark.parametrize("stride", [1, 3])
def test_pixels_are_looked_up_in_the_pictures_of_the_performer_whose_part_they_show(
    performers: int, stride: int
) -> None:
    bodies = (figure(), human(1.75))[:performers]
    labels = seen(NEARBY.subsampled(stride), *((body, swing(body, 3, 0.2 + 0.1 * i)) for i, body in enumerate(bodies)))
    width, height = NEARBY.size
    pictures = np.random.default_rng(0).integers(0, 256, (performers, 3, height, width), np.uint8)
    frame, u, v = labels.places
    whose = labels.performer[labels.part.ravel()[labels.index]]
    assert set(whose) == set(range(performers))
    np.testing.assert_array_equal(labels.pixels_of(pictures, stride), pictures[whose, frame, stride * v, stride * u])
