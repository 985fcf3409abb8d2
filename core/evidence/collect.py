"""Evidence of a whole segment: label images and wrench sums of every view and pair of frames, mapped to joints."""

from __future__ import annotations

import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..body import Body, part_poses, twist_jacobian
from ..constraints import BandedBlocks
from ..motion import Motion
from ..visibility import Geometry, render_labels
from .gradients import Poses, WrenchSums, brightness_constancy
from .images import ViewFrames

Array = NDArray[np.float64]

RUN = 32
"""How many pairs of frames are worked on at a time: enough to keep NumPy busy, few enough to stay in the cache."""
_WORKERS = 2


@dataclass(frozen=True, eq=False)
class Evidence:
    """Gradient evidence between the neighbouring frames of a segment, all views together.

    Attributes
    ----------
    H : ndarray, shape (V, F - 1, P, 12, 12)
    g : ndarray, shape (V, F - 1, P, 12)
        See `WrenchSums`; P counts the parts of all performers.
    energy, weight, noise, density : ndarray, shape (V, F - 1)
    share : ndarray, shape (V, F, P)
        Visible share of every part, see `LabelImages`.
    stride : int
        Every how many pixels, each way, the evidence was taken.
    seconds : dict
        Time spent, by what.
    """

    H: Array
    g: Array
    energy: Array
    weight: Array
    noise: Array
    density: Array
    share: Array
    stride: int
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
    stride: int,
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
    stride : int
        Every how many pixels, each way, the evidence is taken: neighbours say nearly the same.
    """
    F = len(poses[0])
    starts = range(0, max(F - 1, 1), RUN)
    tasks = [(view, a, min(a + RUN, F - 1)) for view in views for a in starts]
    with ThreadPoolExecutor(_WORKERS) as pool:
        jobs = [pool.submit(_run, *task, geometry, poses, first, sigma, tolerance, stride) for task in tasks]
        done = [job.result() for job in jobs]
    rows = [done[i : i + len(starts)] for i in range(0, len(done), len(starts))]

    def joined(name: str) -> Array:
        return np.stack([np.concatenate([getattr(run.sums, name) for run in row]) for row in rows])

    # The frame where two runs meet was drawn twice.
    share = np.stack([np.concatenate([row[0].share[:1]] + [run.share[1:] for run in row]) for row in rows])
    workers = min(_WORKERS, len(tasks))
    seconds = {
        "label images": sum(run.seconds[0] for run in done) / workers,
        "gradients": sum(run.seconds[1] for run in done) / workers,
    }
    sums = {f.name: joined(f.name) for f in fields(WrenchSums)}
    return Evidence(**sums, share=share, stride=stride, seconds=seconds)


@dataclass(frozen=True, eq=False)
class _Run:
    """Evidence of a few frames of one view, and the seconds for its label images and its gradients."""

    sums: WrenchSums
    share: Array
    seconds: tuple[float, float]


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
) -> _Run:
    """Evidence of frames start to stop, inclusive, of one view."""
    begin = time.perf_counter()
    R, T = (a[start : stop + 1] for a in poses)
    labels = render_labels(geometry, view.camera.subsampled(stride), first + start, R, T)
    drawn = time.perf_counter()
    left, top, right, bottom = (stride * edge for edge in labels.box())
    images = view.images(first + start, len(R), sigma, (left, top, right, bottom))
    sums = brightness_constancy(view.camera, first + start, images, labels, (R, T), stride, tolerance)
    return _Run(sums, labels.share, (drawn - begin, time.perf_counter() - drawn))


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
