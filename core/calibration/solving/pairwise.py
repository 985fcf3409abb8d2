"""Two views of a wand whose cameras are unknown: fundamental matrix, focal lengths, relative pose in metres.

Where the optical axes meet, as those of cameras around a stage do, the fundamental matrix alone hardly determines the
focal lengths (R. Hartley and A. Zisserman, Multiple View Geometry, 2nd ed., sec. 19.4). The wand does: with wrong ones
its length changes from place to place. So pairs of focal lengths are tried on a grid.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from itertools import product

import cv2
import numpy as np

from ...numerics.arrays import Array, Bools
from .assumed_lens import Lens
from .wand_triangulation import triangulated

FOCAL_GRID = np.geomspace(0.4, 5.0, 10)
"""Focal lengths that are tried at first, as shares of a picture's longer side."""
TRIED_DISTORTIONS = (0.0, -0.03, -0.07, -0.12, -0.2, 0.04)
"""Distortions that are tried: how much farther out the picture's corner belongs, as a share."""
MIN_FRAMES = 8
"""Frames that two views must share for a fundamental matrix (of two balls each, some wrong)."""
REFINED_GUESSES = 3
"""Guesses of two cameras that are refined: the best on the coarse grid."""
_THRESHOLD = 2.0  # pixels off the epipolar line within which a point agrees
_PLANE_SAMPLE = 300  # correspondences in which a plane is looked for
_FOCAL_FRAMES = 60  # frames on which focal lengths are tried


@dataclass(frozen=True, eq=False)
class Epipolar:
    """Two views' epipolar geometry.

    Attributes
    ----------
    F : ndarray, shape (3, 3)
        x_jᵀ F x_i = 0 for points about the principal points, without distortion.
    bend : float
        The lens distortion with which they agree, see `Lens.straight`.
    agreeing : ndarray of bool, shape (n,)
        The correspondences that fit.
    flatness : float
        How many correspondences a homography explains per agreeing one: near 1 all points lie in a plane.
    """

    F: Array
    bend: float
    agreeing: Bools
    flatness: float


@dataclass(frozen=True, eq=False)
class Start:
    """A guess of two cameras, the first at the origin.

    Attributes
    ----------
    focal : ndarray, shape (2,)
        Pixels.
    R, t : ndarray, shapes (3, 3) and (3,)
        x_j = R x_i + t, metres.
    spread : float
        Of the wand's length, as a share: small where the guess is good.
    """

    focal: Array
    R: Array
    t: Array
    spread: float


def epipolar(points_i: Array, points_j: Array, lens_i: Lens, lens_j: Lens) -> Epipolar | None:
    """Return the epipolar geometry on which most correspondences agree; None if there is none.

    Distortion is tried in steps, the same for both views: without it, points near the edges would not agree.

    Parameters
    ----------
    points_i, points_j : ndarray, shape (n, 2)
        Corresponding points in both views, distorted pixels.
    lens_i, lens_j : Lens
    """
    best: Epipolar | None = None
    flat = np.zeros(len(points_i), bool)
    known = lens_i.distortions is not None and lens_j.distortions is not None
    for bend in (0.0,) if known else TRIED_DISTORTIONS:
        x, y = lens_i.straight(points_i, bend), lens_j.straight(points_j, bend)
        plane = _in_a_plane(x, y)
        flat = plane if plane.sum() > flat.sum() else flat
        F = _fundamental(x, y)
        if F is None:
            continue
        agreeing = sampson(F, x, y) < _THRESHOLD
        if best is None or agreeing.sum() > best.agreeing.sum():
            best = Epipolar(F, bend, agreeing, 0.0)
    if best is None:
        best = Epipolar(np.zeros((3, 3)), 0.0, flat, 1.0)  # no matrix at all is a plane's mark
    if best.agreeing.sum() < MIN_FRAMES:
        return None
    return replace(best, flatness=min(1.0, flat.sum() / best.agreeing.sum()))


def _fundamental(x: Array, y: Array) -> Array | None:
    """Return the fundamental matrix that most correspondences agree on, None where there is none."""
    cv2.setRNGSeed(1)
    try:
        F, _ = cv2.findFundamentalMat(x, y, cv2.USAC_MAGSAC, _THRESHOLD, 0.9999, 5000)
    except cv2.error:  # raised where every sample is degenerate
        return None
    return F if F is not None and F.shape == (3, 3) else None


def sampson(F: Array, x: Array, y: Array) -> Array:
    """Sampson's distance of correspondences to an epipolar geometry, shape (n,), pixels."""
    a, b = np.column_stack([x, np.ones(len(x))]), np.column_stack([y, np.ones(len(y))])
    Fa, Fb = a @ F.T, b @ F
    return np.asarray(
        np.abs((b * Fa).sum(axis=1)) / np.sqrt((Fa[:, :2] ** 2).sum(axis=1) + (Fb[:, :2] ** 2).sum(axis=1) + 1e-30)
    )


def _in_a_plane(x: Array, y: Array) -> Bools:
    """Return which correspondences one homography explains, from the view in which the plane is seen more steeply."""
    return max(_transferred(x, y), _transferred(y, x), key=lambda fits: fits.sum())


def _transferred(x: Array, y: Array) -> Bools:
    """Return which points x a homography brings to y."""
    some = np.linspace(0, len(x) - 1, min(_PLANE_SAMPLE, len(x))).astype(int)
    cv2.setRNGSeed(1)
    # Not MAGSAC: it takes no homography between views from the plane's two sides.
    H, _ = cv2.findHomography(x[some], y[some], cv2.RANSAC, 2 * _THRESHOLD, None, 300, 0.999)
    if H is None:
        return np.zeros(len(x), bool)
    moved = np.column_stack([x, np.ones(len(x))]) @ H.T
    return np.asarray(np.linalg.norm(moved[:, :2] / moved[:, 2:] - y, axis=1) < 2 * _THRESHOLD)


def starts(geometry: Epipolar, ends: tuple[Array, Array], lenses: tuple[Lens, Lens], length: float) -> list[Start]:
    """Return a few guesses of two cameras, the best first, from the wand's ends in both views.

    Parameters
    ----------
    geometry : Epipolar
    ends : tuple of ndarray, shape (n, 2, 2)
        The wand's ends in either view, on frames on which both agree with the geometry.
    lenses : tuple of Lens
    length : float
        Of the wand, metres.
    """
    (ends_i, ends_j), (lens_i, lens_j) = ends, lenses
    chosen = np.linspace(0, len(ends_i) - 1, min(_FOCAL_FRAMES, len(ends_i))).astype(int)
    x = lens_i.straight(ends_i[chosen].reshape(-1, 2), geometry.bend)
    y = lens_j.straight(ends_j[chosen].reshape(-1, 2), geometry.bend)

    def tried(focals: Iterable[tuple[float, float]]) -> list[Start]:
        found = (_start(geometry.F, (x, y), (f, g), length) for f, g in focals)
        return sorted((guess for guess in found if guess is not None), key=lambda guess: guess.spread)

    coarse = tried(product(lens_i.focals, lens_j.focals))[:REFINED_GUESSES]
    fine = [tried(product(_around(lens_i, s.focal[0]), _around(lens_j, s.focal[1])))[0] for s in coarse]
    return sorted(fine, key=lambda guess: guess.spread)


def _around(lens: Lens, focal: float) -> Array:
    """Focal lengths half-way to those that were tried beside one."""
    if len(lens.focals) == 1:
        return lens.focals
    return np.asarray(focal * np.sqrt(lens.focals[1] / lens.focals[0]) ** np.array([-1.0, 0.0, 1.0]))


def _start(F: Array, points: tuple[Array, Array], focals: tuple[float, float], length: float) -> Start | None:
    """Two cameras of given focal lengths, scaled by the wand; None where they stand before each other's rays."""
    (x, y), (f, g) = points, focals
    U, _, Vt = np.linalg.svd(np.diag([g, g, 1.0]) @ F @ np.diag([f, f, 1.0]))
    U, Vt = U * np.sign(np.linalg.det(U)), Vt * np.sign(np.linalg.det(Vt))
    W = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    a, b = np.column_stack([x / f, np.ones(len(x))]), np.column_stack([y / g, np.ones(len(y))])
    a, b = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in (a, b))
    best, most = None, 0.75 * len(x)
    for R in (U @ W @ Vt, U @ W.T @ Vt):
        for t in (U[:, 2], -U[:, 2]):
            meeting = triangulated(np.stack([np.zeros(3), -R.T @ t]), np.stack([a, b @ R]))
            front = (meeting[:, 2] > 0) & ((meeting @ R.T + t)[:, 2] > 0)
            if front.sum() > most:
                best, most = (R, t, meeting), front.sum()
    if best is None:
        return None
    R, t, meeting = best
    lengths = np.linalg.norm(meeting[0::2] - meeting[1::2], axis=1)
    lengths = lengths[np.isfinite(lengths)]
    if len(lengths) < MIN_FRAMES // 2 or not (middle := float(np.median(lengths))) > 0:
        return None
    spread = float(np.median(np.abs(lengths / middle - 1)))
    return Start(np.array([f, g]), R, t * length / middle, spread)
