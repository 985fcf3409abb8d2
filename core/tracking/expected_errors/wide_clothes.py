"""Limbs in wide clothes, such as a skirt or a robe: pictures show the clothes, and hardly where in them the limb is.

The key poses show how wide the clothes are: foreground that is farther from the limb than clothes that fit it, over
the length of the limb, in whichever view there is most of it. Outlines and gradients follow the clothes, so neither the
solver's own covariance nor key poses that are predicted without themselves show it: beside them a limb is still near.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ...body import Body
from ...body.kinematics import Poses
from ...body.limbs import limbs, without_end
from ...body.motion import Motion
from ...evidence.foreground_images.foreground import SURE_LOG_RATIO, log_ratio
from ...evidence.misfit import OUTSIDE_MARGIN, SEARCH_REACH
from ...evidence.rendering.label_images import render_labels
from ...evidence.rendering.part_geometry import Geometry
from ...evidence.view_frames import ViewFrames, views_with_foreground
from ...numerics.arrays import Array
from ..solvers.equations.measurement import poses_by_delay, view_instants
from ..solvers.equations.problem import SegmentProblem

LEAST_WIDTH = 0.02
"""Width of foreground beyond the margins beside a limb from which on it is in wide clothes, metres."""
_STRIDE = 4


def widths_of_clothes(problem: SegmentProblem, motions: Sequence[Motion]) -> list[Array]:
    """Return how far each part of every performer may be elsewhere in wide clothes, metres, (P,) each.

    It is the width of the foreground beside a limb from its beginning to the part, with the margins on both sides, the
    least of those on key poses of the whole body, as others may pass beside it on some; 0 for limbs in clothes that fit
    them, for the trunk, and without key poses on frames that are not damaged. With several performers it is not
    measured: another one beside a limb is foreground as well.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer.
    """
    found = [np.zeros(len(body)) for body in problem.bodies]
    views, keys = views_with_foreground(problem.views), problem.whole_keys(0)
    if problem.among_others or not views or not len(keys):
        return found
    poses = poses_by_delay(problem, view_instants(problem, motions))
    body, geometry = problem.bodies[0], problem.geometry()
    areas = []
    for key in keys.tolist():
        sound = [view for view in views if view.sound(problem.first + key, 1)[0].all()]
        beside = [_areas_beside(view, geometry, poses[view.delay], problem.first, key) for view in sound]
        areas += [np.max(beside, axis=0)] if beside else []
    return [_widths(body, np.min(areas, axis=0))] if areas else found


def _widths(body: Body, areas: Array) -> Array:
    """Widths beside the limbs of a body, (P,), from the areas beside its parts, square metres, (P,).

    What is beside a hand or a foot may be held, or be a shadow; these are as far off as the limb before them.
    """
    widths = np.zeros(len(body))
    lengths = np.array([np.linalg.norm(part.tail_world - part.head_world) for part in body.parts])
    for chain in limbs(body):
        clothed = without_end(chain)
        widths[clothed] = np.maximum.accumulate(areas[clothed] / lengths[clothed])
        widths[chain[len(clothed) :]] = widths[clothed[-1]]
    return np.where(widths < LEAST_WIDTH, 0.0, widths + 2 * OUTSIDE_MARGIN)


def _areas_beside(view: ViewFrames, geometry: Geometry, poses: Poses, first: int, frame: int) -> Array:
    """Areas of a view's foreground that is nearest to each part, but farther from it than clothes that fit, (P,)."""
    R, T = (values[[frame]] for values in poses)
    parts = render_labels(geometry, view.camera.subsampled(_STRIDE), first + frame, R, T).part[0]
    scale = view.camera.pixels_per_metre(T.mean(axis=(0, 1)), first + frame) / _STRIDE
    ratio = log_ratio(view.foreground_at(first + frame, 1, _STRIDE)[0, 0])
    model = parts >= 0
    if not model.any():
        return np.zeros(T.shape[1])
    beyond, nearest = cv2.distanceTransformWithLabels(
        (~model).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
    )
    part_of = np.zeros(nearest.max() + 1, int)
    part_of[nearest[model]] = parts[model]
    beside = (beyond > OUTSIDE_MARGIN * scale) & (beyond < SEARCH_REACH * scale)
    shown = np.clip(ratio[beside] / SURE_LOG_RATIO, 0, 1)
    return np.bincount(part_of[nearest[beside]], shown, T.shape[1]) / scale**2
