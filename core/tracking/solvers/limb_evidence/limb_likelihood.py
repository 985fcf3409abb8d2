"""Log likelihood ratios of poses of a limb: by the pixels that it covers, and by the edges at its sides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ....body.motion import Motion
from ....evidence.limb_sides import SideRatios
from ....numerics import rotations
from ....numerics.arrays import Array
from .limb_images import PartPoses, UncoveredImages
from .limb_model import LimbModel, posed

PATCH_RADIUS = 0.06
"""Pixels within this distance of each other on the body count as one observation, metres."""
MIN_GAIN = 50.0
"""Smallest gain in log likelihood, in natural units, for which a limb's motion is changed."""
RANDOM_POSE_SIGMA = 0.5
"""Standard deviation of poses drawn around each key pose, radians, for a joint with a range of half a circle."""
RANDOM_POSES = 60
"""Poses drawn around each key pose, to learn how brightness changes where no limb has its side."""
_POSE_BATCH, _MIN_FRAME_BATCH = 256, 16  # poses, but at least so many frames


def with_sides_learned(
    limb: LimbModel, uncovered: Sequence[UncoveredImages], keys: NDArray[np.intp], rng: Generator
) -> list[UncoveredImages]:
    """Return the views with the distribution of brightness changes across the limb's sides, learned on key poses."""
    each = zip(uncovered, rng.spawn(len(uncovered)), strict=True)
    return [with_sides_of_view_learned(limb, images, keys, own) for images, own in each]


def with_sides_of_view_learned(
    limb: LimbModel, images: UncoveredImages, keys: NDArray[np.intp], rng: Generator
) -> UncoveredImages:
    """Return one view as `with_sides_learned` does."""
    if images.slopes is None or not len(keys):
        return images
    drawn = rng.normal(size=(len(keys), RANDOM_POSES, *limb.range.shape)) * RANDOM_POSE_SIGMA * limb.range
    drawn += limb.begin[keys, None]
    found: list[list[NDArray[np.float32]]] = [[], []]
    for k, key in enumerate(keys.tolist()):
        frame = slice(key, key + 1)
        turns = np.concatenate([limb.begin[frame], drawn[k]])[None]
        for sides, poses in zip(limb.sides, posed(limb, frame, turns), strict=False):
            change, visible = images.changes(sides, frame, poses)
            for kind, some in zip(found, (slice(1), slice(1, None)), strict=True):
                kind.append(change[..., some][visible[..., some]])
    return replace(images, sides=SideRatios.learned(*map(np.concatenate, found)))


def side_log_ratios(limb: LimbModel, uncovered: Sequence[UncoveredImages]) -> Array:
    """Log likelihood ratio of a limb's present pose by the brightness across its sides, (F,)."""
    score = np.zeros(len(limb.begin))
    add_side_log_ratios(limb, uncovered, [score] * len(limb.chain))
    return score


def add_side_log_ratios(limb: LimbModel, uncovered: Sequence[UncoveredImages], scores: Sequence[Array]) -> None:
    """Add those of each of the n parts to its own one of n arrays (F,)."""
    every = slice(0, len(limb.begin))
    for score, sides, poses in zip(scores, limb.sides, posed(limb, every, limb.begin[:, None]), strict=False):
        for images in uncovered:
            score += images.beside(sides, every, poses)[:, 0]


def pixel_log_ratios(limb: LimbModel, uncovered: Sequence[UncoveredImages], drawn: Array) -> Array:
    """Log likelihood ratios of K poses of the limb on each frame, shape (F, K).

    A part counts by its area in the view, and pixels that two parts cover count once: otherwise a limb that points at
    the camera, or is folded, would count what little it covers several times.

    Parameters
    ----------
    limb : LimbModel
    uncovered : sequence of UncoveredImages
        One per view.
    drawn : ndarray, shape (F, K, n, 3), or (1, K, n, 3) if they are the same on all frames
        Rotation vectors.
    """
    score = np.zeros((len(limb.held), drawn.shape[1]))
    add_pixel_log_ratios(limb, uncovered, drawn, [score] * len(limb.chain))
    return score


def pixel_gains(limb: LimbModel, uncovered: Sequence[UncoveredImages], before: Motion, found: Motion) -> Array:
    """Return by how much likelier a limb's pixels and sides are in one motion of its performer than in another before,
    on each frame, natural units, (F,).
    """
    both = np.stack([rotations.log(motion.rotations[:, limb.chain]) for motion in (before, found)], axis=1)
    here, there = pixel_log_ratios(limb, uncovered, both).T
    return np.asarray(there - here)


def add_pixel_log_ratios(
    limb: LimbModel, uncovered: Sequence[UncoveredImages], drawn: Array, scores: Sequence[Array]
) -> None:
    """Add those of each of the n parts to its own one of n arrays (F, K)."""
    for some in _chunks(*scores[0].shape):
        chosen = drawn if len(drawn) == 1 else drawn[some]
        placed = list(posed(limb, some, chosen))
        bones = [(T, end, r) for (_, T), (_, end), r in zip(placed, placed[1:], limb.radii.tolist(), strict=False) if r]
        for part, poses in enumerate(placed):
            world = _placed(limb.points[part], poses)
            for images in uncovered:
                area = images.seen_areas(limb.areas[part], some, poses)
                scores[part][some] += area / PATCH_RADIUS**2 * images.at(part, some, world, bones[:part])
                if part < len(limb.sides):
                    scores[part][some] += images.beside(limb.sides[part], some, poses)


def _chunks(frames: int, poses: int) -> Iterator[slice]:
    step = max(_POSE_BATCH // poses, _MIN_FRAME_BATCH)
    return (slice(f, min(f + step, frames)) for f in range(0, frames, step))


def _placed(points: Array, poses: PartPoses) -> NDArray[np.float32]:
    """Transform points in a part's frame to the world, (m, 3, K, points)."""
    # Coordinate by coordinate: one product of matrices for all poses, and long rows for what follows. In double
    # precision: processors differ in products of single precision.
    R, T = poses
    turned = np.ascontiguousarray(np.moveaxis(R, 2, 1)) @ points.T
    turned += np.moveaxis(T, 2, 1)[..., None]
    return np.asarray(turned.astype(np.float32))
