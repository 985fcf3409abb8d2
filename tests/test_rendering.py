"""The parts of the footage renderer that need no Blender."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body import human, part_poses
from kfmocap.core.motion import Motion
from render.figure import make_figure, stance
from render.lens import padded_pinhole, through_lens
from render.surface import surface_nets
from render_walk import cameras


@pytest.fixture(scope="module")
def figure():
    return make_figure(human(1.75), voxel=0.03)


def test_surface_nets_close_a_sphere_and_face_outwards():
    vertices, quads = surface_nets(lambda p: np.linalg.norm(p, axis=1) - 0.5, np.full(3, -0.7), np.full(3, 0.7), 0.05)
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 0.5, atol=1e-3)
    a, b, c, _ = (vertices[quads[:, k]] for k in range(4))
    assert (np.sum(np.cross(b - a, c - a) * a, axis=1) > 0).all()
    edges = np.sort(np.stack([quads, np.roll(quads, -1, axis=1)], axis=-1).reshape(-1, 2), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()


def test_skin_rests_unchanged_in_its_own_stance(figure):
    np.testing.assert_allclose(figure.posed(stance(figure.body))[0], figure.vertices, atol=1e-12)


def test_skin_moves_with_a_body_that_moves_as_a_whole(figure):
    rest = stance(figure.body)
    moved = Motion(rest.translations + [1.0, 2.0, 3.0], rest.rotations)
    np.testing.assert_allclose(figure.posed(moved)[0], figure.vertices + [1.0, 2.0, 3.0], atol=1e-12)


def test_skin_encloses_every_joint(figure):
    _, T = part_poses(figure.body, stance(figure.body))
    for name, joint in zip(figure.body.names, T[0], strict=True):
        rays = figure.vertices - joint
        near = rays[np.argsort(np.linalg.norm(rays, axis=1))[:40]]
        assert 0.01 < np.linalg.norm(near[0]) < 0.15, name


def test_lens_puts_a_rendered_point_where_the_camera_projects_it():
    camera = cameras()[2]
    pinhole = padded_pinhole(camera)
    rays = np.array([[-0.3, -0.2, 1.0], [0.35, 0.2, 1.0], [0.1, -0.15, 1.0]])
    R, t = camera.pose(0)
    for point in (rays * 5 - t) @ R:
        u, v = pinhole.project(point)
        rows, columns = np.indices(pinhole.size[::-1])
        spot = 250 * np.exp(-((columns - u) ** 2 + (rows - v) ** 2) / (2 * 2.5**2))
        seen = through_lens(spot.round().astype(np.uint8), pinhole, camera).astype(float)
        rows, columns = np.indices(seen.shape)
        centre = [np.sum(columns * seen) / seen.sum(), np.sum(rows * seen) / seen.sum()]
        np.testing.assert_allclose(centre, camera.project(point), atol=0.1)
