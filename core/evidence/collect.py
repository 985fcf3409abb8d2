"""Evidence of a whole segment: label images and wrench sums of every view and pair of frames, mapped to joints."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..body import Body, part_poses, twist_jacobian
from ..constraints import BandedBlocks
from ..motion import Motion
from ..visibility import Geometry, render_labels
from .gradients import Pixels, Poses, WrenchSums, brightness_constancy
from .images import ViewFrames

Array = NDArray[np.float64]

STRIDE = 2
"""Every how many pixels of the reduced frames, each way, the evidence is taken: neighbours say nearly the same."""
_WORKERS = 2


@dataclass(frozen=True, eq=False)
class Evidence:
    """Gradient evidence between the neighbouring frames of a segment, all views together.

    Attributes
    ----------
    H : ndarray, shape (V, F - 1, P, 12, 12)
    g : ndarray, shape (V, F - 1, P, 12)
        See `WrenchSums`; P counts the parts of all performers.
    energy, weight, noise : ndarray, shape (V, F - 1)
    share : ndarray, shape (V, F, P)
        Visible share of every part, see `LabelImage`.
    seconds : dict
        Time spent, by what.
    """

    H: Array
    g: Array
    energy: Array
    weight: Array
    noise: Array
    share: Array
    seconds: dict[str, float]


def scene_poses(bodies: Sequence[Body], motions: Sequence[Motion]) -> Poses:
    """World poses (F, P, 3, 3) and (F, P, 3) of all performers' parts, one performer after the other."""
    posed = [part_poses(body, motion) for body, motion in zip(bodies, motions, strict=True)]
    return np.concatenate([R for R, _ in posed], axis=1), np.concatenate([T for _, T in posed], axis=1)


def gradient_evidence(
    views: Sequence[ViewFrames],
    geometry: Geometry,
    poses: Poses,
    first: int,
    sigma: float,
    tolerance: float,
    stride: int = STRIDE,
) -> Evidence:
    """Collect the evidence of F frames.

    Parameters
    ----------
    views : sequence of ViewFrames
    geometry : Geometry
        Of all performers.
    poses : tuple
        From `scene_poses`, F frames.
    first : int
        Shot frame of the first of them.
    sigma : float
        Smoothing of the images, pixels of the reduced frames.
    tolerance : float
        See `brightness_constancy`.
    """
    F = len(poses[0])
    middle = F // 2 if F > 3 else F - 1  # halves, so that one view alone keeps two threads busy
    tasks = [(view, a, b) for view in views for a, b in ((0, middle), (middle, F - 1)) if b > a]
    with ThreadPoolExecutor(_WORKERS) as pool:
        jobs = [pool.submit(_run, *task, geometry, poses, first, sigma, tolerance, stride) for task in tasks]
        done = [job.result() for job in jobs]
    per_view = len(tasks) // len(views)
    rows = [done[i : i + per_view] for i in range(0, len(done), per_view)]
    sums = [[s for run in row for s in run[0]] for row in rows]
    # The frame where the halves meet was drawn twice.
    share = [np.concatenate([row[0][1]] + [run[1][1:] for run in row[1:]]) for row in rows]
    seconds = {k: sum(run[2][k] for run in done) / min(_WORKERS, len(tasks)) for k in done[0][2]}
    return Evidence(
        np.array([[s.H for s in row] for row in sums]),
        np.array([[s.g for s in row] for row in sums]),
        np.array([[s.energy for s in row] for row in sums]),
        np.array([[s.weight for s in row] for row in sums]),
        np.array([[s.noise for s in row] for row in sums]),
        np.array(share),
        seconds,
    )


def _run(
    view: ViewFrames,
    start: int,
    stop: int,
    geometry: Geometry,
    poses: Poses,
    first: int,
    sigma: float,
    tolerance: float,
    stride: int,
) -> tuple[list[WrenchSums], Array, dict[str, float]]:
    """Evidence of the pairs (j, j + 1), start <= j < stop, of one view."""
    R, T = poses
    seconds = {"label images": 0.0, "gradients": 0.0}
    grid = view.camera.subsampled(stride)
    sums: list[WrenchSums] = []
    shares = []
    for j in range(start, stop + 1):
        begin = time.perf_counter()
        labels = render_labels(geometry, grid, first + j, R[j], T[j])
        drawn = time.perf_counter()
        box = tuple(stride * edge for edge in labels.box())
        image = view.image(first + j, sigma, box)
        if j > start:
            pair = (first + j - 1, first + j)
            both = ((R[j - 1], T[j - 1]), (R[j], T[j]))
            sums.append(
                brightness_constancy(view.camera, pair, (last, image), pixels, labels, both, stride, tolerance)
            )
        last, pixels = image, Pixels.of(labels, view.camera, stride)
        shares.append(labels.share)
        seconds["label images"] += drawn - begin
        seconds["gradients"] += time.perf_counter() - drawn
    return sums, np.array(shares), seconds


def joint_blocks(body: Body, poses: Poses, H: Array, g: Array, energy: float) -> BandedBlocks:
    """Map twists to degrees of freedom.

    Parameters
    ----------
    body : Body
    poses : tuple
        (R, T) of its P parts, F frames.
    H, g : ndarray, shape (F - 1, P, 12, 12) and (F - 1, P, 12)
        Sums over the views of this body's parts.
    """
    J = twist_jacobian(body, *poses)
    F, D = len(J), body.dof
    flat = J.reshape(F, -1, D)
    blocks = BandedBlocks.zeros(F, D)
    for a in range(2):
        J_a = flat[a : F - 1 + a]
        for b in range(a + 1):
            half = H[:, :, 6 * a : 6 * a + 6, 6 * b : 6 * b + 6] @ J[b : F - 1 + b]
            block = np.swapaxes(J_a, 1, 2) @ half.reshape(F - 1, -1, D)
            (blocks.diagonal[a : F - 1 + a] if a == b else blocks.first)[:] += block
        part = g[:, :, 6 * a : 6 * a + 6].reshape(F - 1, -1, 1)
        blocks.gradient[a : F - 1 + a] += (np.swapaxes(J_a, 1, 2) @ part)[..., 0]
    return BandedBlocks(blocks.diagonal, blocks.first, blocks.second, blocks.gradient, energy)
