"""Bundle adjustment of cameras and of a performer's joints, with limbs of constant length.

A limb is like a wand of unknown but constant length. This constraint determines the focal lengths of cameras that all
point to one place, which matching points alone do not. The scale is that of an average person of the performer's
height.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...numerics.arrays import Array, Bools
from ...numerics.least_squares import StoppingRule, minimise, moving_only
from ...numerics.normal_equations import SparseEquations
from ...numerics.robust_kernels import RAYLEIGH_MEDIAN
from ..solving.camera_rig import CAMERA_DOF, FOCAL, SHIFT, TURN
from .limb_residuals import JOINTS, Columns, JointScene, JointSightings, joint_equations, pictured

SINGLE_BONES = ("shin", "thigh", "forearm", "upper_arm")
"""The limbs that are single bones, which take many directions; between the other pairs, the trunk may bend."""
USUAL_NOISE = 0.01
"""Usual standard deviation of a detector's keypoints, as a share of the performer's size in the picture."""
_MIN_NOISE = 0.3  # pixels
_ROUNDS = 4  # of adjusting and estimating the noise, at most


@dataclass(frozen=True, eq=False)
class JointFit:
    """An adjusted scene.

    Attributes
    ----------
    scene : JointScene
    sizes : ndarray, shape (V, F, L)
        Lengths of the residuals, pixels; NaN where there is none.
    focal_deviation : ndarray, shape (V,)
        Standard deviation of the focal lengths, as a share; 0 where they are known.
    """

    scene: JointScene
    sizes: Array
    focal_deviation: Array


def adjust_joints(
    scene: JointScene,
    seen: JointSightings,
    height: float,
    *,
    known_lens: Bools,
    cancel: Callable[[], None],
) -> JointFit:
    """Minimise the robust sum of squares of a scene, and estimate the noise of every view.

    Parameters
    ----------
    scene : JointScene
        The start.
    seen : JointSightings
    height : float
        Of the performer, metres.
    known_lens : ndarray of bool, shape (V,)
        Views whose focal lengths are held.
    cancel : callable
        Called in every iteration; may raise.
    """
    free = _free(scene, known_lens)
    sizes = _sizes(scene, seen)
    noise = _noise(sizes, seen)
    for _ in range(_ROUNDS):
        sigma = noise

        def equations(state: JointScene, sigma: Array = sigma) -> SparseEquations:
            return joint_equations(state, seen, height, noise=sigma, free=free)

        found = minimise(
            scene,
            equations,
            moving_only(JointScene.moved, free),
            stopping=StoppingRule(30, relative_gain=1e-5),
            on_iteration=lambda iteration, state: cancel(),
        )
        scene = found.state
        sizes = _sizes(scene, seen)
        noise = _noise(sizes, seen)
        if np.abs(noise / sigma - 1).max() < 0.02:
            break
    return JointFit(scene, sizes, _focal_deviation(scene, seen, height, noise, known_lens))


def _focal_deviation(scene: JointScene, seen: JointSightings, height: float, noise: Array, known_lens: Bools) -> Array:
    """Standard deviations of the logarithms of the focal lengths, shape (V,), 0 where they are held.

    What a detector calls a hip is not the same point from every side, and this error is the same on all frames.
    Therefore only different kinds of joints are independent, and each kind is left out once (the jackknife). The
    covariance of the adjustment is a lower bound.
    """
    V = len(scene.rig)
    focal = CAMERA_DOF * np.arange(-V, 0) + FOCAL
    kinds = np.array([name[1:] for name in JOINTS])
    changes = []
    for kind in dict.fromkeys(kinds):
        rest = replace(scene, joints_world=np.where((kinds == kind)[:, None], np.nan, scene.joints_world))
        free = _free(rest, known_lens)
        step = np.zeros(len(free))
        step[free] = joint_equations(rest, seen, height, noise=noise, free=free).solve(0.0)
        changes.append(step[focal])
    n, spread = len(changes), np.array(changes) - np.mean(changes, axis=0)
    free = _free(scene, known_lens)
    factor, unit = joint_equations(scene, seen, height, noise=noise, free=free).factor(), np.zeros((len(free), V))
    unit[focal, np.arange(V)] = 1.0
    variance = (unit[free] * factor.solve(unit[free])).sum(axis=0)
    return np.asarray(np.where(known_lens, 0.0, np.sqrt(np.maximum((n - 1) / n * (spread**2).sum(axis=0), variance))))


def cost_of_joints(scene: JointScene, seen: JointSightings, height: float) -> float:
    """Return the robust sum of squares of a scene with the usual noise of a detector, by which starts are compared."""
    noise = np.maximum(USUAL_NOISE * _extent(seen), _MIN_NOISE)
    free = np.ones(Columns.of(scene).count, bool)
    return joint_equations(scene, seen, height, noise=noise, free=free).cost


def _free(scene: JointScene, known_lens: Bools) -> Bools:
    """Return which unknowns are solved for: all but the first camera's pose, clocks, lens distortions and known
    lenses.
    """
    known = int(np.isfinite(scene.joints_world).all(axis=-1).sum())
    cameras = np.zeros((len(scene.rig), CAMERA_DOF), bool)
    cameras[1:, TURN] = cameras[1:, SHIFT] = True
    cameras[:, FOCAL] = ~known_lens
    return np.concatenate([np.ones(3 * known + len(scene.lengths), bool), cameras.ravel()])


def _sizes(scene: JointScene, seen: JointSightings) -> Array:
    index, _, residual = pictured(scene, seen)
    sizes = np.full(seen.confidence.shape, np.nan)
    sizes[tuple(index.T)] = np.linalg.norm(residual, axis=1)
    return sizes


def _noise(sizes: Array, seen: JointSightings) -> Array:
    """Noise of each view, pixels: a common share of the performer's size in its pictures.

    If each view had its own noise, two views would be fitted exactly, with no noise, and the others would be ignored.
    """
    extent = _extent(seen)
    shares = sizes / extent[:, None, None]
    share = np.median(shares[np.isfinite(shares)]) / RAYLEIGH_MEDIAN
    return np.maximum(share * extent, _MIN_NOISE)


def _extent(seen: JointSightings) -> Array:
    """Diagonal size of the performer in the pictures of each view, pixels, shape (V,)."""
    spans = np.nanmax(seen.points, axis=2, initial=-np.inf) - np.nanmin(seen.points, axis=2, initial=np.inf)
    spans = np.linalg.norm(np.where(np.isfinite(spans), spans, np.nan), axis=-1)
    return np.asarray(np.nanmedian(spans, axis=1))
