"""Outlines that are held fixed while a step of a fit is tested, as in the iterative closest point algorithm.

Outlines are measured anew at every state. A step is judged by the outlines that it was computed from: the model's
points move, and their distances from these outlines along the normals must decrease.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...body.kinematics import Poses
from ...cameras.camera import Camera
from ...numerics.arrays import Array
from .outline_lines import Lines


@dataclass(frozen=True, eq=False)
class HeldOutlines:
    """The outlines in one view as measured at one state, by which other states are tested.

    Attributes
    ----------
    lines : Lines
        N lines.
    points_part : ndarray, shape (N, 3)
        Points of the model on the lines, in the frames of their parts, metres.
    precision : float
        Factor on squared distances (pixels) times the length that a line stands for (metres).
    """

    lines: Lines
    points_part: Array
    precision: float

    @classmethod
    def at(cls, lines: Lines, camera: Camera, poses: Poses, precision: float) -> HeldOutlines:
        """Hold lines that were measured with a camera and world poses (R, T) on K key frames."""
        (R, T), (Rc, tc) = poses, camera.poses(0, len(poses[0]))
        frame, part = lines.frame, lines.part
        world = np.einsum("nba,nb->na", Rc[frame], lines.points_cam - tc[frame])
        return cls(lines, np.einsum("nba,nb->na", R[frame, part], world - T[frame, part]), precision)

    def cost(self, camera: Camera, poses: Poses, change: Array) -> float:
        """Return the sum of squared distances, in variances, after a change of the camera, the poses and the parts.

        Parameters
        ----------
        camera : Camera
        poses : tuple of ndarray, shapes (K, P, 3, 3) and (K, P, 3)
        change : ndarray, shape (P, 6)
            Stretches and shifts of the parts since the lines were measured, see `part_shapes`.
        """
        (R, T), (Rc, tc) = poses, camera.poses(0, len(poses[0]))
        frame, part = self.lines.frame, self.lines.part
        points = self.points_part * (1 + change[part, :3]) + change[part, 3:]
        world = np.einsum("nab,nb->na", R[frame, part], points) + T[frame, part]
        return self.precision * self.lines.cost(camera, np.einsum("nab,nb->na", Rc[frame], world) + tc[frame])
