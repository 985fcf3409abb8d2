"""Outlines of convex parts are where the eye sees them end."""

from __future__ import annotations

import numpy as np
import pytest
from kfmocap.core.body.silhouette import Solid
from scipy.spatial import ConvexHull
from synthetic import box


@pytest.mark.parametrize("seed", range(6))
def test_a_silhouette_is_the_hull_of_the_picture(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(0, 1, (30, 3))
    eye = np.array([0.5, -6.0, 1.0])
    solid = Solid.of(points)
    forward = -eye / np.linalg.norm(eye)
    right = np.cross(forward, [0, 0, 1.0])
    axes = np.stack([right / np.linalg.norm(right), np.cross(right / np.linalg.norm(right), forward), forward])
    seen = (points - eye) @ axes.T
    picture = seen[:, :2] / seen[:, 2:]
    outline = solid.silhouette(eye)
    assert set(outline.ravel()) == set(ConvexHull(picture).vertices)
    assert np.bincount(outline.ravel(), minlength=30).max() == 2  # one closed line


def test_every_edge_parts_two_triangles():
    solid = Solid.of(box((-1, -1, -1), (1, 1, 1)))
    assert len(solid.triangles) == 12 and len(solid.edges) == 18
    for edge, sides in zip(solid.edges, solid.sides, strict=True):
        for side in sides:
            assert set(edge) <= set(solid.triangles[side])


def test_from_inside_a_part_there_is_no_outline():
    assert len(Solid.of(box((-1, -1, -1), (1, 1, 1))).silhouette(np.zeros(3))) == 0
