"""Which views of a segment see the performers, and subsets of the views that are measured in turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...body import part_poses
from ...body.motion import Motion
from ...cameras.camera import Camera
from ...numerics.arrays import Array
from .equations.problem import SegmentProblem


def views_in_sight(problem: SegmentProblem, motions: Sequence[Motion]) -> int:
    """Return how many views have a joint of a performer in their picture on some frame."""
    joints = np.concatenate([part_poses(body, m)[1] for body, m in zip(problem.bodies, motions, strict=True)], axis=1)
    return sum(_in_picture(view.camera, joints, problem.first) for view in problem.views)


def _in_picture(camera: Camera, points: Array, first: int) -> bool:
    """Return whether any of the points (F, K, 3) of consecutive frames is in the picture of its frame."""
    if camera.moving:
        uv = np.stack([camera.project(own, first + f) for f, own in enumerate(points)])
    else:
        uv = camera.project(points)
    return bool(camera.shows(uv).any())


def view_subset(problem: SegmentProblem, least: int, turn: int) -> SegmentProblem:
    """Return the problem with every k-th view, so that at least `least` remain; each turn takes the next subset."""
    every = max(1, len(problem.views) // least)
    return replace(problem, views=problem.views[turn % every :: every])
