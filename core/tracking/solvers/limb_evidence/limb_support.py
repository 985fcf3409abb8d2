"""How much the images speak for a limb, or a part of one, where it is: against their being without it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from ....body.kinematics import scene_poses
from ....body.limbs import limbs
from ....body.motion import Motion
from ....evidence.rendering.label_images import EMPTY_DEPTH, LabelImages
from ....evidence.rendering.part_geometry import Geometry
from ....evidence.view_frames import views_with_foreground
from ....numerics.arrays import Array, Bools
from ..equations.problem import SegmentProblem
from .limb_images import MAX_STRIDE, UncoveredImages, ViewRatios
from .limb_likelihood import add_pixel_log_ratios, add_side_log_ratios, with_sides_of_view_learned
from .limb_model import FINE_POINTS, POINTS_PER_PART, LimbModel, LimbOfPerformer, limb_of

SupportOfLimb = tuple[int, list[int], Array, Callable[[], Array]]
"""What the images say for a limb, see `support_of_limbs`."""


def support_of_limbs(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[SupportOfLimb]:
    """Generate, for every limb of the performers who are not held, the log likelihood ratio of the images with the limb
    where it is against without it.

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
    for i in problem.searched if views else ():
        alone = problem.alone(i)
        # Finding a limb takes finer pixels than telling that it is not where it was found.
        ratios = [ViewRatios.of(view, alone, i, motions, MAX_STRIDE) for view in views]
        labels = [view.labels(geometry, poses) for view in ratios]
        depths = [each.depth_steps() for each in labels]
        for chain in limbs(problem.bodies[i]):
            # How clearly a limb is shown should not depend on whether it points at a camera.
            limb, parts = limb_of(problem, motions, (i, chain), rng, points, evenly=True)
            own = np.isin(np.arange(len(geometry.spans) + 1), parts)  # the last is nobody
            sides = np.zeros((len(chain), problem.length))
            # One view after the other: the images of all of them would take much memory in a long segment.
            for view, shown, depth, drawn in zip(ratios, labels, depths, rng.spawn(len(ratios)), strict=True):
                nearest = _without(depth, shown, own)
                beside = UncoveredImages(view.camera, view.first, (), nearest, view.slopes, stride=view.stride)
                learned = with_sides_of_view_learned(limb, beside, problem.whole_keys(i), drawn)
                add_side_log_ratios(limb, [learned], list(sides))
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
    pixels = np.zeros((*sides.shape, 1))
    for view in ratios:  # as above
        uncovered = view.uncovered(*drawn)
        add_pixel_log_ratios(replace(limb, sides=()), [uncovered], limb.begin[:, None], list(pixels))
    return np.asarray(sides + pixels[..., 0])
