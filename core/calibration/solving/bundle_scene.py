"""What a bundle adjustment of cameras, clocks and a wand solves for, and what it knows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Array
from .ball_observations import BallObservations
from .camera_rig import CAMERA_DOF, Rig
from .wand_motion import WAND_DOF, Wand

LFRAME_SIGMA = 1e-3
"""Standard deviation of an L-frame's measures, metres."""


@dataclass(frozen=True, eq=False)
class Scene:
    """The unknowns: cameras, the wand, and the L-frame's balls (4, 3), if they take part."""

    rig: Rig
    wand: Wand
    lframe_world: Array | None = None

    def moved(self, step: Array) -> Scene:
        """Return the scene after a step, which lists the unknowns of the wand, of the L-frame, and of the cameras."""
        wand, lframe, cameras = np.split(step, [first_lframe(self), first_camera(self)])
        balls = None if self.lframe_world is None else self.lframe_world + lframe.reshape(-1, 3)
        rig = self.rig.moved(cameras.reshape(-1, CAMERA_DOF))
        return Scene(rig, self.wand.moved(wand.reshape(-1, WAND_DOF)), balls)

    def in_world(self, R: Array, t: Array) -> Scene:
        """Return the same scene in a world whose points are R x + t, metres, with R (3, 3) and t (3,)."""
        lframe = None if self.lframe_world is None else self.lframe_world @ R.T + t
        return Scene(self.rig.in_world(R, t), self.wand.in_world(R, t), lframe)

    def scaled(self, scale: float) -> Scene:
        """Return the same scene enlarged by a factor."""
        lframe = None if self.lframe_world is None else scale * self.lframe_world
        return Scene(self.rig.scaled(scale), self.wand.scaled(scale), lframe)


@dataclass(frozen=True, eq=False)
class BundleEvidence:
    """The observations and priors of a bundle adjustment.

    Attributes
    ----------
    wand : BallObservations
    lframe : BallObservations, optional
        The L-frame's balls; without measures they are unknown points.
    lframe_measures : ndarray, shape (4, 3), optional
        Positions of the L-frame's balls in the world frame, metres.
    lframe_sigma : float
        Their standard deviation, metres.
    focal : ndarray, shape (C,), optional
        Given focal lengths, pixels; NaN where there is none.
    focal_sigma : float
        Their standard deviation, relative.
    smooth : bool
        Whether the wand is waved, and cameras see it between its frames.
    """

    wand: BallObservations
    lframe: BallObservations | None = None
    lframe_measures: Array | None = None
    lframe_sigma: float = LFRAME_SIGMA
    focal: Array | None = None
    focal_sigma: float = 0.1
    smooth: bool = False


def first_lframe(scene: Scene) -> int:
    """Return the index of the L-frame's unknowns in a step."""
    return len(scene.wand) * WAND_DOF


def first_camera(scene: Scene) -> int:
    """Return the index of the first camera's unknowns in a step."""
    return first_lframe(scene) + (0 if scene.lframe_world is None else scene.lframe_world.size)


def unknowns(scene: Scene) -> int:
    """Return the number of unknowns in a step."""
    return first_camera(scene) + len(scene.rig) * CAMERA_DOF
