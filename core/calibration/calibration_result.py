"""The result of a calibration: cameras, clocks, and their quality."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..cameras.camera import Camera
from ..capture.capture import Capture
from ..numerics.arrays import Array, Bools
from .findings import Finding
from .solving.ball_observations import BallObservations
from .solving.bundle_scene import Scene
from .solving.camera_rig import CAMERA_DOF, Rig
from .solving.clocks import Clocks
from .solving.wand_motion import Wand


@dataclass(frozen=True, eq=False)
class CalibrationResult:
    """Solved cameras and their quality.

    Attributes
    ----------
    capture : Capture
    rig : Rig
        Cameras and clocks in the L-frame's world.
    wand : Wand
    lframe_world : ndarray, shape (4, 3)
    seen : BallObservations
        The wand's balls that were used, with swapped ends swapped back.
    residual : ndarray, shape (n, 2)
        Predicted minus observed positions of the wand's balls, then the L-frame's, pixels.
    used : ndarray, shape (C,)
        Fraction of the wand's balls in each view that were used.
    free : ndarray of bool, shape (C, 13)
        Which unknowns were solved for, in the order of `camera_rig.CAMERA_DOF`.
    covariance : ndarray, shape (13 C, 13 C)
        Covariance of the unknowns of `Rig.moved`, in the world defined by the L-frame's measures.
    noise : float
        Noise of the balls, as a multiple of their sigma.
    lframe_scale : float
        Size of the L-frame according to the wand, relative to its own measures.
    moved : dict of int to float
        Cameras that were moved between the takes of the L-frame and of the wand, and by how many pixels. Their views of
        the L-frame were not used.
    held_out : ndarray, shape (h,)
        Lengths of the wand, metres, on frames that were held out of a separate solution.
    findings : tuple of Finding
        Problems of the capture that were found.
    """

    capture: Capture
    rig: Rig
    wand: Wand
    lframe_world: Array
    seen: BallObservations
    residual: Array
    used: Array
    free: Bools
    covariance: Array
    noise: float
    lframe_scale: float
    moved: dict[int, float]
    held_out: Array
    findings: tuple[Finding, ...]

    @property
    def cameras(self) -> dict[str, Camera]:
        """Cameras by their names."""
        counts = [4 if view.distortions is None else len(view.distortions) for view in self.capture.views]
        return {name: self.rig.camera(c, counts[c]) for c, name in enumerate(self.rig.names)}

    @property
    def scene(self) -> Scene:
        """All unknowns."""
        return Scene(self.rig, self.wand, self.lframe_world)

    @property
    def clocks(self) -> Clocks:
        """Clocks of the videos."""
        return Clocks.of(self.rig, self.sigma)

    @property
    def sigma(self) -> Array:
        """Standard deviations of the cameras' unknowns, shape (C, 13)."""
        return np.sqrt(np.diag(self.covariance)).reshape(-1, CAMERA_DOF)
