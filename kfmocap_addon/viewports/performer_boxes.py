"""Where in the picture of a view's camera performers are during the shot."""

from __future__ import annotations

import bpy
import numpy as np

from ..scene_io import active_performer

Part = tuple[float, float, float, float]
"""Left, bottom, right and top of a part of a picture, as shares of its width and height from its lower left."""
WHOLE: Part = (0.0, 0.0, 1.0, 1.0)
_MARGIN = 0.15
"""How much is shown beside performers, as a share of the part's larger side."""


def part_with_performers(scene: bpy.types.Scene, camera: bpy.types.Object) -> Part:
    """Return the part of a camera's picture that shows the performers on all frames of the shot; all of it where the
    camera moves, or nobody is in front of it.
    """
    from ...core.body import part_poses
    from ...core.errors import KFMocapError
    from ..scene_io.body import body_armature
    from ..scene_io.keys import motion_curves

    if camera.animation_data is not None and camera.animation_data.action is not None:
        return WHOLE
    start, length = scene.kfmocap.frame_start, max(scene.kfmocap.length, 1)
    clouds = []
    for slot in scene.kfmocap.performers:
        if active_performer.is_present(scene, slot):
            try:
                body = body_armature.body_from_armature(slot.armature)
                motion = motion_curves.read_motion(slot.armature, start, length)
            except KFMocapError:
                continue
            clouds.append(part_poses(body, motion)[1].reshape(-1, 3))
    if not clouds:
        return WHOLE
    points = np.concatenate(clouds)
    render = scene.render
    projection = camera.calc_matrix_camera(
        bpy.context.evaluated_depsgraph_get(),
        x=render.resolution_x,
        y=render.resolution_y,
        scale_x=render.pixel_aspect_x,
        scale_y=render.pixel_aspect_y,
    )
    whole = np.array(projection) @ np.linalg.inv(np.array(camera.matrix_world.normalized()))
    seen = np.concatenate([points, np.ones((len(points), 1))], axis=1) @ whole.T
    return around(seen[:, :2] / seen[:, 3:]) if (seen[:, 3] > 0).all() else WHOLE


def around(places: np.ndarray) -> Part:
    """Return the part of a picture around places (N, 2) in it, which are -1 to 1 from edge to edge, with a margin."""
    low, high = (places.min(axis=0) + 1) / 2, (places.max(axis=0) + 1) / 2
    margin = _MARGIN * float((high - low).max())
    left, bottom = np.clip(low - margin, 0.0, 1.0)
    right, top = np.clip(high + margin, 0.0, 1.0)
    if right - left < margin or top - bottom < margin:
        return WHOLE
    return float(left), float(bottom), float(right), float(top)
