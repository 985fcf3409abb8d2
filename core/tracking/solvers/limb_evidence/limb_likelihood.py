"""Log likelihood ratios of poses of a limb: by the pixels that it covers, and by the edges at its sides."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ....body import Body, part_poses
from ....body.kinematics import scene_poses
from ....body.limbs import limbs, without_end
from ....body.motion import Motion
from ....evidence.limb_sides import PartSides, SideRatios
from ....evidence.rendering.label_images import EMPTY_DEPTH, LabelImages
from ....evidence.rendering.part_geometry import Geometry
from ....evidence.view_frames import views_with_foreground
from ....numerics import rotations
from ....numerics.arrays import Array, Bools
from ..equations.problem import SegmentProblem
from .limb_images import (
    MAX_STRIDE,
    PartPoses,
    UncoveredImages,
    ViewRatios,
    axis_areas,
    shown_areas,
    shown_widths,
)
from .raised_shoulder import RaisedShoulder

LimbOfPerformer = tuple[int, list[int]]
"""Index of a performer, and a limb of it as a chain of its parts."""
SupportOfLimb = tuple[int, list[int], Array, Callable[[], Array]]
"""What the images say for a limb, see `support_of_limbs`."""
PATCH_RADIUS = 0.06
"""Pixels within this distance of each other on the body count as one observation, metres."""
MIN_HELD_WEIGHT = 0.02
"""Weight with which a limb that is not seen is kept where it is: among poses that the images cannot distinguish, the
present one is preferred."""
MIN_GAIN = 50.0
"""Smallest gain in log likelihood, in natural units, for which a limb's motion is changed."""
RANDOM_POSE_SIGMA = 0.5
"""Standard deviation of poses drawn around each key pose, radians, for a joint with a range of half a circle."""
RANDOM_POSES = 60
"""Poses drawn around each key pose, to learn how brightness changes where no limb has its side."""
POINTS_PER_PART = 16
"""Points of each part whose pixels are looked at."""
FINE_POINTS = 48
"""Points of each part where both limbs of a pair are searched for, and to tell how clearly limbs of several performers
are shown: which of their pixels are looked at must not decide whether they are searched for."""
_POSE_BATCH, _MIN_FRAME_BATCH = 256, 16  # poses, but at least so many frames
_MIN_RANGE = 0.05


@dataclass(frozen=True, eq=False)
class LimbModel:
    """A limb of n parts on F frames, as the search needs it.

    Attributes
    ----------
    body : Body
    chain : list of int
        The limb's parts, from the trunk outward.
    range : ndarray, shape (n, 3)
        Range of each joint's rotation vector in half circles.
    points : ndarray, shape (n, points, 3)
        Points inside each part, in its frame, metres.
    areas : ndarray, shape (n, 3)
        Projected area of each part along the axes of its frame, square metres.
    radii : ndarray, shape (n,)
        Half the mean projected width of each part, metres; 0 where pixels that it covers count for other parts, too.
    parent : tuple of ndarray, shapes (F, 3, 3) and (F, 3)
        World poses of the part that the limb hangs on.
    begin : ndarray, shape (F, n, 3)
        Present rotation vectors of the limb.
    fixed : ndarray of bool, shape (F, n, 3)
        Degrees of freedom that stay as they are.
    held : ndarray, shape (F, n)
        How clearly each part is seen where it is, 0 to 1.
    sides : tuple of PartSides
        Sides of the limb's parts but the last, see `without_end`.
    shoulder : RaisedShoulder, optional
        The collar bone that rises with an arm.
    """

    body: Body
    chain: list[int]
    range: Array
    points: Array
    areas: Array
    radii: Array
    parent: tuple[Array, Array]
    begin: Array
    fixed: NDArray[np.bool_]
    held: Array
    sides: tuple[PartSides, ...]
    shoulder: RaisedShoulder | None = None


def limb_of(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    place: LimbOfPerformer,
    rng: Generator,
    points: int = POINTS_PER_PART,
    *,
    evenly: bool = False,
) -> tuple[LimbModel, list[int]]:
    """Return a limb as motions have it, with the least `held`, and the indices of its parts among all performers'.

    If it is shown evenly, its parts count by their mean areas in every pose, and each for itself.
    """
    i, chain = place
    body, span = problem.bodies[i], problem.spans()[i]
    parts = [span.start + part for part in chain]
    R, T = part_poses(body, motions[i])
    geometry = problem.geometry()
    if evenly:
        areas, radii = np.repeat(shown_areas(geometry, parts)[:, None], 3, axis=1), np.zeros(len(parts))
    else:
        areas, radii = np.array([axis_areas(geometry, part) for part in parts]), shown_widths(geometry, parts) / 2
    limb = LimbModel(
        body,
        chain,
        np.clip(np.ptp(body.limits[chain], axis=2) / np.pi, _MIN_RANGE, 1.0),
        _samples(geometry, parts, rng, points),
        areas,
        radii,
        (R[:, body.parents[chain[0]]], T[:, body.parents[chain[0]]]),
        rotations.log(motions[i].rotations[:, chain]),
        problem.fixed_axes(i)[:, chain],
        np.full((problem.length, len(chain)), MIN_HELD_WEIGHT),
        tuple(PartSides.of(body.parts[part]) for part in without_end(chain)),
        RaisedShoulder.of(problem, i, chain, R),
    )
    return limb, parts


def support_of_limbs(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[SupportOfLimb]:
    """Generate, for every limb, the log likelihood ratio of the images with the limb where it is against without it.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer.

    Yields
    ------
    int
        Index of the performer.
    list of int
        The limb as a chain of its parts.
    ndarray, shape (F,)
        Log likelihood ratio on each frame by the brightness across the limb's sides alone.
    callable
        Computes the ratio on each frame by sides and pixels together, (F,). It is 0 where the limb is hidden in all
        views.
    """
    for i, chain, sides, shown in _support_by_part(problem, motions):
        yield i, chain, sides.sum(axis=0), partial(_summed, shown)


def support_of_parts(problem: SegmentProblem, motions: Sequence[Motion]) -> list[Array]:
    """Return, per performer, the log likelihood ratio of the images with each part of a limb where it is against
    without it, (F, P); 0 for the trunk, and for a part that is hidden in all views. Parameters as in
    `support_of_limbs`.
    """
    found = [np.zeros((problem.length, len(body))) for body in problem.bodies]
    for i, chain, _, shown in _support_by_part(problem, motions):
        found[i][:, chain] = shown().T
    return found


def _support_by_part(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[SupportOfLimb]:
    """Generate what `support_of_limbs` does for each of the n parts of a limb, (n, F) instead of (F,).

    The limbs of a performer change nothing in the images of the others, which are drawn once for all of them.
    """
    rng = np.random.default_rng(problem.settings.search_seed)
    points = FINE_POINTS if problem.among_others else POINTS_PER_PART
    views = [view for view in views_with_foreground(problem.views) if view.colours is not None]
    geometry, poses = problem.geometry(), scene_poses(problem.bodies, motions)
    for i in problem.sought if views else ():
        alone = problem.alone(i)
        # Finding a limb takes finer pixels than telling that it is not where it was found.
        ratios = [ViewRatios.of(view, alone, i, motions, MAX_STRIDE) for view in views]
        labels = [view.labels(geometry, poses) for view in ratios]
        depths = [each.depth_steps() for each in labels]
        for chain in limbs(problem.bodies[i]):
            # How clearly a limb is shown should not depend on whether it points at a camera.
            limb, parts = limb_of(problem, motions, (i, chain), rng, points, evenly=True)
            own = np.isin(np.arange(len(geometry.spans) + 1), parts)  # the last is nobody
            beside = [
                UncoveredImages(
                    view.camera,
                    view.first,
                    (),
                    _without(depth, shown, own),
                    view.slopes,
                    stride=view.stride,
                )
                for view, shown, depth in zip(ratios, labels, depths, strict=True)
            ]
            sides = np.zeros((len(chain), problem.length))
            _add_side_log_ratios(limb, with_sides_learned(limb, beside, problem.whole_keys(i), rng), list(sides))
            yield i, chain, sides, partial(_log_ratios, limb, ratios, (geometry, poses, parts), sides)


def _without(depth: NDArray[np.uint16], shown: LabelImages, own: Bools) -> NDArray[np.uint16]:
    """Return depth images without some of the parts in the label images that they were made of, (P + 1,); these do not
    stand still.
    """
    images = depth.copy()
    images.ravel()[shown.index[own[shown.part.ravel()[shown.index]]]] = EMPTY_DEPTH
    return images


def evaluated(support: Iterable[SupportOfLimb]) -> list[SupportOfLimb]:
    """Compute all ratios of `support_of_limbs` at once, for several uses; the images behind them are not kept."""
    return [(i, chain, sides, _returning(shown())) for i, chain, sides, shown in support]


def least_supported(
    support: Iterable[SupportOfLimb], measure: Callable[[int, Array], float], limit: float
) -> list[LimbOfPerformer]:
    """Return the limbs whose support measures less than a limit, the lowest first.

    Parameters
    ----------
    support : iterable of SupportOfLimb
    measure : callable
        Takes the index of a performer, and the support of one of its limbs, (F,).
    limit : float
    """
    measured = [(measure(i, shown()), (i, chain)) for i, chain, _, shown in support]
    low = [one for one in measured if one[0] < limit]
    return [place for _, place in sorted(low, key=lambda one: one[0])]


def _returning(shown: Array) -> Callable[[], Array]:
    return lambda: shown


def _summed(by_part: Callable[[], Array]) -> Array:
    return np.asarray(by_part().sum(axis=0))


def _log_ratios(
    limb: LimbModel,
    ratios: Sequence[ViewRatios],
    drawn: tuple[Geometry, tuple[Array, Array], Sequence[int]],
    sides: Array,
) -> Array:
    """Log likelihood ratio of a limb's present pose by its pixels, plus that of its sides, by part, (n, F)."""
    uncovered, pixels = [view.uncovered(*drawn) for view in ratios], np.zeros((*sides.shape, 1))
    _add_pixel_log_ratios(replace(limb, sides=()), uncovered, limb.begin[:, None], list(pixels))
    return np.asarray(sides + pixels[..., 0])


def with_sides_learned(
    limb: LimbModel, uncovered: Sequence[UncoveredImages], keys: NDArray[np.intp], rng: Generator
) -> list[UncoveredImages]:
    """Return the views with the distribution of brightness changes across the limb's sides, learned on key poses."""
    return [
        _with_learned(limb, images, keys, own) for images, own in zip(uncovered, rng.spawn(len(uncovered)), strict=True)
    ]


def _with_learned(limb: LimbModel, images: UncoveredImages, keys: NDArray[np.intp], rng: Generator) -> UncoveredImages:
    if images.slopes is None or not len(keys):
        return images
    drawn = rng.normal(size=(len(keys), RANDOM_POSES, *limb.range.shape)) * RANDOM_POSE_SIGMA * limb.range
    drawn += limb.begin[keys, None]
    found: list[list[NDArray[np.float32]]] = [[], []]
    for k, key in enumerate(keys.tolist()):
        frame = slice(key, key + 1)
        turns = np.concatenate([limb.begin[frame], drawn[k]])[None]
        for sides, poses in zip(limb.sides, _posed(limb, frame, turns), strict=False):
            change, visible = images.changes(sides, frame, poses)
            for kind, some in zip(found, (slice(1), slice(1, None)), strict=True):
                kind.append(change[..., some][visible[..., some]])
    return replace(images, sides=SideRatios.learned(*map(np.concatenate, found)))


def side_log_ratios(limb: LimbModel, uncovered: Sequence[UncoveredImages]) -> Array:
    """Log likelihood ratio of a limb's present pose by the brightness across its sides, (F,)."""
    score = np.zeros(len(limb.begin))
    _add_side_log_ratios(limb, uncovered, [score] * len(limb.chain))
    return score


def _add_side_log_ratios(limb: LimbModel, uncovered: Sequence[UncoveredImages], scores: Sequence[Array]) -> None:
    """Add those of each of the n parts to its own one of n arrays (F,)."""
    every = slice(0, len(limb.begin))
    for score, sides, poses in zip(scores, limb.sides, _posed(limb, every, limb.begin[:, None]), strict=False):
        for images in uncovered:
            score += images.beside(sides, every, poses)[:, 0]


def _samples(geometry: Geometry, parts: Sequence[int], rng: Generator, count: int) -> Array:
    """Random points inside the parts, (n, points, 3)."""
    vertices = [geometry.vertices[geometry.spans[part]] for part in parts]
    return np.array([rng.dirichlet(np.full(len(v), 0.3), count) @ v for v in vertices])


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
    _add_pixel_log_ratios(limb, uncovered, drawn, [score] * len(limb.chain))
    return score


def _add_pixel_log_ratios(
    limb: LimbModel, uncovered: Sequence[UncoveredImages], drawn: Array, scores: Sequence[Array]
) -> None:
    """Add those of each of the n parts to its own one of n arrays (F, K)."""
    for some in _chunks(*scores[0].shape):
        chosen = drawn if len(drawn) == 1 else drawn[some]
        placed = list(_posed(limb, some, chosen))
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


def _posed(limb: LimbModel, frames: slice, drawn: Array) -> Iterator[PartPoses]:
    """Generate the world poses of the limb's parts on m frames from rotation vectors (m or 1, K, n, 3)."""
    R, T = limb.parent[0][frames, None], limb.parent[1][frames, None]
    Q = rotations.exp(drawn)
    for k, part in enumerate(limb.chain):
        hung, offset = R, limb.body.offsets[part]
        R = hung @ (limb.body.R_parent_rest[part] @ Q[:, :, k])
        if k == 0 and limb.shoulder is not None:
            offset = np.einsum("fkab,b->fka", limb.shoulder.turns(frames, R[..., 1]), offset)
            T = T + np.einsum("fkab,fkb->fka", np.broadcast_to(hung, R.shape), offset)
        else:
            T = T + hung @ offset
        yield R, T


def _placed(points: Array, poses: PartPoses) -> NDArray[np.float32]:
    """Transform points in a part's frame to the world, (m, 3, K, points)."""
    # Coordinate by coordinate: one product of matrices for all poses, and long rows for what follows. In double
    # precision: processors differ in products of single precision.
    R, T = poses
    turned = np.ascontiguousarray(np.moveaxis(R, 2, 1)) @ points.T
    turned += np.moveaxis(T, 2, 1)[..., None]
    return np.asarray(turned.astype(np.float32))
