"""Searching for lost limbs in foreground that the model does not cover.

Outlines attract over a few centimetres only; an arm that comes into sight again, or a leg half a step ahead, is farther
away. So the likeliest path of a limb is looked for (`limb_paths`), by how much uncovered foreground its poses would
cover. The result is a start for the solver.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.random import Generator

from ....body.body_size import body_size
from ....body.kinematics import scene_poses
from ....body.limbs import limbs
from ....body.motion import Motion, with_motion
from ....evidence.rendering.label_images import LabelImages
from ....evidence.rendering.part_geometry import Geometry
from ....evidence.view_frames import views_with_foreground
from ....numerics import rotations
from ....numerics.arrays import Array, Bools
from ....numerics.frame_ranges import lasting, runs
from ..assessment.solution_doubts import least_frames
from ..descent_stages import OUTLINE_REACH
from ..equations.measurement import Workspace
from ..equations.problem import SegmentProblem
from ..limb_evidence.limb_images import EVEN_LEVEL, UncoveredImages, ViewRatios
from ..limb_evidence.limb_likelihood import MIN_GAIN, pixel_gains, side_log_ratios, with_sides_learned
from ..limb_evidence.limb_model import MIN_HELD_WEIGHT, POINTS_PER_PART, LimbModel, LimbOfPerformer, limb_of
from .limb_paths import likeliest_limb
from .limbs_elsewhere import farthest_joints, frames_elsewhere
from .swapped_limbs import untangled_limbs

MIN_SEEN_SHARE = 0.1
"""A limb of which a smaller share is seen on pixels of its own colours may be elsewhere."""
MIN_GAIN_ELSEWHERE = 150.0
"""Least gain in log likelihood, in natural units, for which a limb of one of several performers is solved for where it
was found: who is hidden for a moment leaves much that a search mistakes for a limb."""
CLEAR_GAIN_RATIO = 2.0
"""Ratio of a gain to the least one from which on a single search decides: limbs that are right gained less than the
least one by chance, wherever they were found, and lost ones more than twice as much."""
FOUND_REACH = 0.1
"""Distance, metres, that a limb of one of several performers must be elsewhere by on some frame: poses that are drawn
scatter by some centimetres around a place that a descent would reach (`OUTLINE_REACH`)."""
CHILD_SIZE = 1.6
"""Size of a body (`core.body.body_size`), metres, below which its limbs gain less: pixels count by the area that they
show. The least gain was measured with adults of 1.65 m and more."""
ROUGH_GAIN_SHARE = 0.5
"""Share of the least gain from which on a path that was found roughly is worth improving: that also fits it to the
noise of the images."""
LEAST_SEEN_SHARE = 0.1
"""Least share of a limb, in relation to what is usually seen of it, by which a gain is divided."""


@dataclass(frozen=True, eq=False)
class LimbSearch:
    """How a limb is searched for.

    Attributes
    ----------
    free : bool
        Whether it is searched for regardless of how well it is seen where it is: a misplaced limb in front of the body
        seems right, as it covers foreground of similar colours.
    points : int
        Points of each part whose pixels are looked at.
    least_gain : float
        The limb stays where it is if the images gain less (`_gain_elsewhere`), natural units, or, if it is free and
        they hardly gain more, if other random poses lead elsewhere. By default neither is asked.
    before : Motion, optional
        F poses of the performer in relation to which they gain, if the search is around others.
    roughly : bool
        Whether the limb is moved to where it is found roughly, whatever is gained by it.
    """

    free: bool = True
    points: int = POINTS_PER_PART
    least_gain: float = -np.inf
    before: Motion | None = None
    roughly: bool = False


def can_search_limbs(problem: SegmentProblem) -> bool:
    """Whether limbs can be searched for: it needs foreground images, and with keypoints it is not done."""
    return not problem.keypoints and problem.settings.limb_search and bool(views_with_foreground(problem.views))


def found_limbs(problem: SegmentProblem, motions: Sequence[Motion], seed: int, workspace: Workspace) -> list[Motion]:
    """Search for every limb of the performers that are solved for, one limb after the other; the trunk stays as it is.

    Parameters
    ----------
    problem : SegmentProblem
        Only views with foreground images are used; they are taken to be simultaneous.
    motions : sequence of Motion
        F poses per performer; fixed degrees of freedom are kept.
    seed : int
        Seed of the random poses, together with that of the settings.
    workspace : Workspace
        Progress is reported before each limb.

    Returns
    -------
    list of Motion
        F poses per performer.
    """
    ratios = {i: views_of(problem, motions, i) for i in problem.sought}
    found, rng = list(motions), np.random.default_rng([seed, problem.settings.search_seed])
    chains = [(i, chain) for i in problem.sought for chain in limbs(problem.bodies[i])]
    search = LimbSearch(free=False, least_gain=-np.inf if problem.only is None else MIN_GAIN_ELSEWHERE)
    for done, (i, chain) in enumerate(chains):
        workspace.report(done / len(chains), found)
        found[i] = _with_limb_found(problem, ratios[i], found, (i, chain), search=search, rng=rng)
    return untangled_limbs(problem, found)


def freed_limb(
    problem: SegmentProblem,
    motions: Sequence[Motion],
    place: LimbOfPerformer,
    seed: int,
    search: LimbSearch = LimbSearch(),
    *,
    ratios: Sequence[ViewRatios] | None = None,
) -> Motion:
    """Search for one limb of a performer.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer; fixed degrees of freedom are kept.
    place : LimbOfPerformer
    seed : int
        Seed of the random poses, together with that of the settings.
    search : LimbSearch
    ratios : sequence of ViewRatios, optional
        What the views show of the performer, if it is known (`views_of`).

    Returns
    -------
    Motion
        F poses of the performer.
    """
    rng = np.random.default_rng([seed, problem.settings.search_seed])
    ratios = views_of(problem, motions, place[0]) if ratios is None else ratios
    return _with_limb_found(problem, ratios, motions, place, search=search, rng=rng)


def views_of(problem: SegmentProblem, motions: Sequence[Motion], performer: int) -> list[ViewRatios]:
    """Collect what the views show of a performer, the others being posed as in motions."""
    return [ViewRatios.of(view, problem, performer, motions) for view in views_with_foreground(problem.views)]


def _frames_clearly_elsewhere(limb: LimbModel, before: Motion, after: Motion) -> Bools:
    """Return on which frames a limb is elsewhere, without those beside each other on which it is so by less than
    `FOUND_REACH`, shape (F,).
    """
    distance = farthest_joints(limb.body, limb.chain, before, after)
    away = distance > OUTLINE_REACH
    for first, last in runs(away):
        away[first : last + 1] = distance[first : last + 1].max() > FOUND_REACH
    return away


def _gain_elsewhere(
    limb: LimbModel, uncovered: Sequence[UncoveredImages], seen: Array, before: Motion, found: Motion
) -> float:
    """Return by how much likelier a limb's pixels and sides are where it was found than where it was before.

    Only frames on which it is elsewhere count: on all others a search gains as well, as it follows the noise. Of a limb
    that is nearly out of sight there the images say little, so the gain is divided by the least share of it that is
    seen, in relation to the usual share; and so they do of the limbs of a child (`CHILD_SIZE`).

    Parameters
    ----------
    limb : LimbModel
    uncovered : sequence of UncoveredImages
    seen : ndarray, shape (F,)
        Visible shares of its parts where it was before, summed over parts and views.
    before, found : Motion
        F poses of the limb's performer.

    Returns
    -------
    float
        Log likelihood ratio, natural units, in these relations; 0 where the limb is nowhere elsewhere.
    """
    away = _frames_clearly_elsewhere(limb, before, found)
    if not away.any():
        return 0.0
    gain = pixel_gains(limb, uncovered, before, found)[away].sum()
    least = seen[away].min() / max(float(np.median(seen)), 1e-9)
    size = min(body_size(limb.body) / CHILD_SIZE, 1.0) ** 2
    return float(gain / (size * np.clip(least, LEAST_SEEN_SHARE, 1.0)))


def _with_limb_found(
    problem: SegmentProblem,
    ratios: Sequence[ViewRatios],
    motions: Sequence[Motion],
    place: LimbOfPerformer,
    *,
    search: LimbSearch,
    rng: Generator,
) -> Motion:
    """Move one limb of a performer to where it is likeliest; parameters as in `freed_limb`."""
    i, chain = place
    motion = motions[i]
    # Of one of several performers: by what is seen of their areas, more parts are found where others show them.
    limb, parts = limb_of(problem, motions, place, rng, search.points, evenly=problem.among_others)
    geometry, poses = problem.geometry(), scene_poses(problem.bodies, motions)
    uncovered = [view.uncovered(geometry, poses, parts) for view in ratios]
    uncovered = with_sides_learned(limb, uncovered, problem.whole_keys(i), rng)
    if not search.free:
        shown = scipy.special.expit(side_log_ratios(limb, uncovered))[:, None]
        limb = replace(limb, held=np.maximum(_seen_shares(ratios, geometry, poses, parts) * shown, MIN_HELD_WEIGHT))
        if problem.only is not None and not _is_hardly_seen(limb):
            return motion
    draws = _LimbDraws(limb, uncovered, motion, problem.fps, rng)
    found: Motion | None
    if search.roughly:
        found = draws.found_roughly()
    elif search.least_gain == -np.inf:
        found = draws.found()
    else:
        before = motion if search.before is None else search.before
        there = scene_poses(problem.bodies, with_motion(motions, i, before))
        seen = np.sum([view.labels(geometry, there).share[:, parts].sum(axis=1) for view in ratios], axis=0)
        gained, least = partial(_gain_elsewhere, limb, uncovered, seen, before), search.least_gain
        promising = ROUGH_GAIN_SHARE * least
        if search.free:
            found = draws.found_surely(gained, least, before)
        else:
            found = draws.found(lambda moved: gained(moved) >= least, lambda moved: gained(moved) >= promising)
    if found is None:
        return motion
    if limb.shoulder is None:
        return found
    return limb.shoulder.raising(limb.body.R_parent_rest[chain[0]], limb.parent[0], found)


@dataclass(frozen=True, eq=False)
class _LimbDraws:
    """Searches for one limb around a motion of F poses; each draws other random poses."""

    limb: LimbModel
    uncovered: Sequence[UncoveredImages]
    motion: Motion
    fps: float
    rng: Generator

    def found(
        self, enough: Callable[[Motion], bool] | None = None, promising: Callable[[Motion], bool] | None = None
    ) -> Motion | None:
        """Return the motion with the limb where it is likeliest; None unless that is likelier than where it is and, if
        it is asked, `enough`, and the motion that is found roughly `promising`.
        """
        rough = None if promising is None else lambda path: promising(self._posed(path))
        path, gain = likeliest_limb(self.limb, self.uncovered, self.fps, self.rng, rough)
        if gain < MIN_GAIN:
            return None
        found = self._posed(path)
        return found if enough is None or enough(found) else None

    def found_roughly(self) -> Motion:
        """Return the motion with the limb on the path that is found roughly, whatever that gains."""
        path, _ = likeliest_limb(self.limb, self.uncovered, self.fps, self.rng, lambda _: False)
        return self._posed(path)

    def found_surely(self, gained: Callable[[Motion], float], least_gain: float, before: Motion) -> Motion | None:
        """Return the motion that a search finds: where it hardly gains enough, only if a second search agrees. Where
        little shows a limb, each search finds another motion.

        They agree if the limb is elsewhere than before in both, and in the same place, as near as a descent reaches,
        for `least_frames` in a row.
        """
        gained, promising = cache(gained), ROUGH_GAIN_SHARE * least_gain
        both: list[Motion] = []
        for _ in range(2):
            found = self.found(lambda moved: gained(moved) >= least_gain, lambda moved: gained(moved) >= promising)
            if found is None:
                return None
            if gained(found) >= CLEAR_GAIN_RATIO * least_gain:
                return found
            both.append(found)
        pairs = ((before, both[0]), (before, both[1]), (both[0], both[1]))
        away, away_again, apart = (frames_elsewhere(self.limb.body, self.limb.chain, *pair) for pair in pairs)
        agreed = lasting(away & away_again & ~apart, least_frames(self.fps))
        return both[0] if agreed.any() else None

    def _posed(self, path: Array) -> Motion:
        """The motion with the limb's rotation vectors (F, n, 3), but for parts that are held."""
        Q, chain = self.motion.rotations.copy(), self.limb.chain
        held = self.limb.fixed.all(axis=-1)[..., None, None]
        Q[:, chain] = np.where(held, Q[:, chain], rotations.exp(path))
        return Motion(self.motion.translations, Q)


def _is_hardly_seen(limb: LimbModel) -> bool:
    """Whether a limb is hardly seen where it is (`MIN_SEEN_SHARE`) on two or more frames in a row."""
    unsure = limb.held[:, : len(limb.sides)].mean(axis=1) < MIN_SEEN_SHARE
    return bool(lasting(unsure, 2).any())


def _seen_shares(
    ratios: Sequence[ViewRatios], geometry: Geometry, poses: tuple[Array, Array], parts: list[int]
) -> Array:
    """Share of each part's area that is seen on foreground of its own colours, in the view that shows most, (F, n).

    It is reduced for a part that lies mostly on the background in another view, in proportion to its visible share
    there: such a part is misplaced.
    """
    held = np.zeros((len(poses[0]), len(parts)))
    free = np.zeros(held.shape)
    for view in ratios:
        labels = view.labels(geometry, poses)
        for k, part in enumerate(parts):
            right = _right_share(view, labels, part)
            held[:, k] = np.maximum(held[:, k], labels.share[:, part] * right)
            free[:, k] = np.maximum(free[:, k], labels.share[:, part] * np.clip(1 - 2 * right, 0, 1))
    return held * (1 - free)


def _right_share(view: ViewRatios, labels: LabelImages, part: int) -> Array:
    """Share of a part's visible pixels that are foreground of its own colours, on each frame, shape (F,)."""
    frames, *size = labels.part.shape
    pixels = np.flatnonzero(labels.part == part)
    frame, right = pixels // np.prod(size), view.foreground.ravel().take(pixels) > EVEN_LEVEL
    if view.coloured is not None:
        ratio = view.coloured.colours.ratio[part].take(view.coloured.palette.ravel().take(pixels))
        right = right * np.exp(np.minimum(ratio, 0).astype(float))
    count = np.bincount(frame, minlength=frames)
    return np.asarray(np.bincount(frame, right, frames) / np.maximum(count, 1))
