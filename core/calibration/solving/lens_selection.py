"""Selecting lens parameters to estimate: k2 and the principal point only if they are significant."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from scipy.special import chdtri

from ...numerics.arrays import Bools
from .assumed_lens import Lens
from .bundle import NEARLY_CONVERGED, adjust, covariance, variance_inflation
from .bundle_scene import BundleEvidence, Scene
from .camera_rig import CAMERA_DOF, CENTRE, K2

MAX_CENTRE_SIGMA = 0.01
"""Largest standard deviation of an estimated principal point, relative to the picture's width."""
MAX_K2_SIGMA = 0.1
"""Largest standard deviation of an estimated k2."""
_SIGNIFICANCE = 1e-4  # significance level


def select_lens_unknowns(
    scene: Scene, evidence: BundleEvidence, free: Bools, lenses: Sequence[Lens], cancel: Callable[[], None]
) -> Bools:
    """Return which unknowns to solve for, shape (C, 13): those of `free`, and k2 and principal points if significant.

    All are tried at once. A camera keeps those whose Wald statistic is significant and whose standard deviation is
    small enough; estimated without need, they only make the focal length less certain.

    Parameters
    ----------
    scene : Scene
        The solution so far.
    evidence : BundleEvidence
    free : ndarray of bool, shape (C, 13)
        The unknowns that are solved for already.
    lenses : sequence of Lens
        What is known about each camera's lens.
    cancel : callable
        Called in every iteration; may raise.
    """
    every = free.copy()
    for c, lens in enumerate(lenses):
        every[c, CENTRE] |= lens.matrix is None
        every[c, K2] |= lens.distortions is None
    if (every == free).all():
        return free
    fit = adjust(scene, evidence, every, stopping=NEARLY_CONVERGED, cancel=cancel)
    rig = fit.scene.rig
    inflation = variance_inflation(evidence.wand, fit.residual[: len(evidence.wand)])
    spread = covariance(fit.scene, evidence, fit.free) * inflation
    out = free.copy()
    for c, lens in enumerate(lenses):
        block = spread[c * CAMERA_DOF :, c * CAMERA_DOF :][:CAMERA_DOF, :CAMERA_DOF]
        if every[c, K2] and not free[c, K2]:
            k2 = rig.distortions[c, 1] - scene.rig.distortions[c, 1]
            out[c, K2] = k2**2 > chdtri(1, _SIGNIFICANCE) * block[K2, K2] and block[K2, K2] < MAX_K2_SIGMA**2
        if every[c, CENTRE].any() and not free[c, CENTRE].any():
            shift = rig.centre[c] - lens.centre
            own = block[CENTRE, CENTRE]
            sure = np.sqrt(np.linalg.eigvalsh(own)[-1]) < MAX_CENTRE_SIGMA * lens.size[0]
            out[c, CENTRE] = bool(shift @ np.linalg.solve(own, shift) > chdtri(2, _SIGNIFICANCE) and sure)
    return out
