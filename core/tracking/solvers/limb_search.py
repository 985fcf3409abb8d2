"""Lost limbs are looked for where the images show a performer and the model does not.

Outlines pull over a few centimetres; an arm that comes out of hiding, or a leg half a step ahead, is farther away.
Poses of a limb are drawn around its motion, each is scored by how much of the uncovered foreground it would cover, and
dynamic programming finds the likeliest way through them between the key poses; then poses are drawn nearer to that.
Where two like limbs meet, silhouettes do not show which is which afterwards: the smoothest motion decides. The result
is a start for the solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
import scipy  # its parts are loaded when they are used
from numpy.random import Generator
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

from ...body import Body, part_poses
from ...body.kinematics import scene_poses
from ...body.motion import Motion
from ...cameras.camera import Camera
from ...evidence.foreground import SCALE, STRONGEST, log_ratio
from ...evidence.label_images import NEAR, Geometry, LabelImages, StillParts, render_labels
from ...evidence.limb_sides import PartSides, SideRatios, SlopeImages
from ...evidence.part_colours import ColouredFrames
from ...evidence.view_frames import ViewFrames, views_with_foreground
from ...numerics import rotations
from ...numerics.arrays import Array, Bools
from ...numerics.repeatable import on_grid, transformed
from .measurement import Workspace
from .problem import SegmentProblem

Poses = tuple[Array, Array]
"""Orientations and places of a part on m frames, K each: (m, K, 3, 3) and (m, K, 3)."""

SPREADS = (1.0, 0.5, 0.25, 0.12)
"""Standard deviations of the poses drawn, round after round, radians: of a joint that can turn half a circle; that of
others is in proportion to their range."""
DRAWS = 80
"""Poses drawn per round; a third and two thirds of the way to each are tried as well."""
ANYWHERE = 60
"""Poses per round, the first alone, that may be anywhere within the joints' limits: each the best of `HEAT` by a few
points."""
HEAT = 32
SPEED = 3.0
"""How fast the error of a joint that can turn half a circle usually changes, rad/s: half as fast as the joint turns."""
PATCH = 0.06
"""Pixels within this length of each other on the body count as one, metres."""
HELD = 0.1
"""How far a limb that is seen, and covers foreground, may be from where it is, radians."""
LEAST_HELD = 0.02
"""How much of that holds for a limb that is not seen: poses that the images cannot distinguish stay what they are."""
LEAST_GAIN = 50.0
"""By how much a limb's motion has to become likelier to be changed, in natural units."""
MEETING = 0.05
"""Duration over which the way between two limbs is smoothed, seconds."""
PARTED = 0.75
"""Limbs meet where they are less far apart than this share of how far they part in between."""
BESIDE = 0.2
"""How long before and after a meeting their velocities are compared, seconds."""
ELSEWHERE = 60
"""Poses drawn around each key pose that show how brightness changes where no limb ends."""
ZERO = 128
"""What a foreground image has where a performer is as likely as anything else."""
DEPTH_STEP = 0.002
NOBODY = (1 << 16) - 1
"""Depth where there is no part, in steps of `DEPTH_STEP`, metres."""
_STRIDE = 3
_POINTS = 16
_FEW_POINTS = 2
_AT_A_TIME = 16  # frames
_LEAST_RANGE = 0.05


def limbs(body: Body) -> list[list[int]]:
    """Chains of at least two parts from where the tree branches last to its tips, as indices, the tip last.

    Collar bones are not of them: poses drawn of an arm would be spread over turns that move it little.
    """
    children = np.bincount([p for p in body.parents if p >= 0], minlength=len(body))
    chains = []
    for tip in np.flatnonzero(children == 0):
        chain = [int(tip)]
        while (parent := body.parents[chain[0]]) > 0 and children[parent] == 1 and not body.is_stiff[parent]:
            chain.insert(0, parent)
        if len(chain) > 1:
            chains.append(chain)
    return chains


def without_end(chain: Sequence[int]) -> list[int]:
    """The parts of a limb that say where it is: how a hand or a foot is turned, the last of three, is hardly seen."""
    return list(chain[: max(2, len(chain) - 1)])


def pairs(body: Body) -> list[tuple[list[int], list[int]]]:
    """The left and the right ones of limbs that look alike, by Blender's names."""
    chains = {tuple(body.names[part] for part in chain): chain for chain in limbs(body)}
    sides = [(names, tuple(name.removesuffix(".L") + ".R" for name in names)) for names in chains]
    return [(chains[left], chains[right]) for left, right in sides if left != right and right in chains]


def pictures_find_limbs(problem: SegmentProblem) -> bool:
    """Whether limbs may be looked for in the pictures; where there are keypoints, these show where limbs are."""
    return not problem.keypoints and problem.settings.limb_search and bool(views_with_foreground(problem.views))


def found_limbs(problem: SegmentProblem, motions: Sequence[Motion], seed: int, workspace: Workspace) -> list[Motion]:
    """Look for every limb of every performer; the trunk stays as it is.

    Parameters
    ----------
    problem : SegmentProblem
        Views without foreground images are not looked at. Views are taken to be simultaneous.
    motions : sequence of Motion
        F poses per performer; their fixed degrees of freedom are kept.
    seed : int
        Of the poses drawn, with the setting's.
    workspace : Workspace
        Progress is reported before each limb.
    """
    views = views_with_foreground(problem.views)
    looks = {i: [_ViewRatios.of(view, problem, i, motions) for view in views] for i in problem.sought}
    found, rng = list(motions), np.random.default_rng([seed, problem.settings.search_seed])
    chains = [(i, chain) for i in problem.sought for chain in limbs(problem.bodies[i])]
    for done, (i, chain) in enumerate(chains):
        workspace.report(done / len(chains), found)
        found[i] = _with_limb_found(problem, looks[i], found, (i, chain), rng)
    return untangled_limbs(problem, found)


def freed_limb(problem: SegmentProblem, motions: Sequence[Motion], place: tuple[int, list[int]], seed: int) -> Motion:
    """Look for one limb of a performer as if it were nowhere seen where it is: in front of the body, a limb in a wrong
    place seems right.

    Parameters
    ----------
    problem : SegmentProblem
    motions : sequence of Motion
        F poses per performer; their fixed degrees of freedom are kept.
    place : tuple
        Index of the performer, and the limb as a chain of its parts.
    seed : int
        Of the poses drawn, with the setting's.

    Returns
    -------
    Motion
        That of the performer.
    """
    rng = np.random.default_rng([seed, problem.settings.search_seed])
    looks = [_ViewRatios.of(view, problem, place[0], motions) for view in views_with_foreground(problem.views)]
    return _with_limb_found(problem, looks, motions, place, rng, free=True)


def untangled_limbs(problem: SegmentProblem, motions: Sequence[Motion]) -> list[Motion]:
    """Give all like limbs of every performer their own way, see `untangled`."""
    found = list(motions)
    for i in problem.sought:
        body = problem.bodies[i]
        for pair in pairs(body):
            free = ~problem.fixed[i][:, 3:].reshape(len(found[i]), -1, 3)[:, pair[0] + pair[1]].any(axis=(1, 2))
            found[i] = untangled(body, found[i], pair, problem.fps, free)
    return found


@dataclass(frozen=True, eq=False)
class _ViewRatios:
    """Every _STRIDE-th pixel of a view's frames: a performer's log likelihood ratios, (F, h, w), and the colours of its
    parts; and how brightness changes.
    """

    camera: Camera
    first: int
    ratio: NDArray[np.float32]
    coloured: ColouredFrames | None
    still: StillParts | None
    slopes: SlopeImages | None

    @classmethod
    def of(cls, view: ViewFrames, problem: SegmentProblem, performer: int, motions: Sequence[Motion]) -> _ViewRatios:
        foreground = view.foreground_at(problem.first, problem.length, _STRIDE)[performer]
        coloured = view.part_colours(problem.first, problem.length, _STRIDE)
        camera, still = view.camera.subsampled(_STRIDE), None
        if problem.only is not None:
            geometry = problem.geometry()
            others = np.flatnonzero(geometry.performer != performer)
            still = StillParts.drawn(geometry, others, camera, problem.first, scene_poses(problem.bodies, motions))
        ratio = log_ratio(foreground)
        slopes = None if coloured is None else _slopes_around(view, problem, ratio)
        return cls(camera, problem.first, ratio, coloured, still, slopes)

    def labels(self, geometry: Geometry, poses: tuple[Array, Array], without: Sequence[int] = ()) -> LabelImages:
        """Label images of all parts but for some; beside those that are still, numbered as all are."""
        parts = np.setdiff1d(np.arange(len(geometry.spans)), without)
        if self.still is not None:
            parts = np.setdiff1d(parts, self.still.parts)
        some = geometry if len(parts) == len(geometry.spans) else geometry.subset(parts.tolist())
        moving = render_labels(some, self.camera, self.first, poses[0][:, parts], poses[1][:, parts])
        return moving if self.still is None else self.still.among(moving, parts)

    def uncovered(self, geometry: Geometry, poses: tuple[Array, Array], parts: Sequence[int]) -> _Uncovered:
        """What it shows for some parts of a performer, where the others do not hide them."""
        labels = self.labels(geometry, poses, parts)
        nobody = labels.part < 0
        beside = np.where(nobody, self.ratio, np.float32(0))
        if self.coloured is None:
            return _Uncovered(self.camera, self.first, (_as_steps(beside),) * len(parts), None, None)
        ratio, palette = self.coloured.colours.ratio, self.coloured.palette
        behind = labels.part  # of nobody, anyone
        if self.still is None:
            behind = np.setdiff1d(np.arange(len(geometry.spans)), parts)[behind]
        images = []
        for part in parts:
            own = self.coloured.of(part)
            before = np.where(self.coloured.colours.distinct[part][behind], own - ratio[behind, palette], np.float32(0))
            images.append(_as_steps(np.where(nobody, beside + own, before)))
        return _Uncovered(self.camera, self.first, tuple(images), _depth_steps(labels), self.slopes)


def _slopes_around(view: ViewFrames, problem: SegmentProblem, ratio: NDArray[np.float32]) -> SlopeImages | None:
    """How brightness changes where some frame may show the performer."""
    shown = (ratio > 0).any(axis=0)
    if not shown.any():
        return None
    rows, columns = (np.flatnonzero(shown.any(axis=axis)) for axis in (1, 0))
    left, top = _STRIDE * int(columns[0]), _STRIDE * int(rows[0])
    right, bottom = _STRIDE * (int(columns[-1]) + 1), _STRIDE * (int(rows[-1]) + 1)
    start = problem.first - view.first
    grey = view.grey[start : start + problem.length, top:bottom, left:right]
    return SlopeImages.of(view.camera, problem.first, grey, (left, top))


def _depth_steps(labels: LabelImages) -> NDArray[np.uint16]:
    """How far the parts are, in steps of `DEPTH_STEP`."""
    return np.minimum(labels.depth_images() / np.float32(DEPTH_STEP), np.float32(NOBODY)).astype(np.uint16)


def _as_steps(ratio: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Log likelihood ratios as foreground images have them: there may be many images."""
    return np.rint(np.clip(ratio, -STRONGEST, STRONGEST) * np.float32(SCALE) + np.float32(ZERO)).astype(np.uint8)


def _looked_up(images: NDArray[Any], columns: Array, rows: Array, beyond: float) -> NDArray[Any]:
    """The nearest pixels of images (m, h, w) to places (m, K, points) in them."""
    found = np.empty(columns.shape, images.dtype)
    for image, u, v, out in zip(images, columns, rows, found, strict=True):
        cv2.remap(image, u, v, cv2.INTER_NEAREST, out, cv2.BORDER_CONSTANT, beyond)
    return found


@dataclass(frozen=True, eq=False)
class _Uncovered:
    """How much likelier each pixel of a view is with each of some parts there than as the others are.

    `ratio` are n images (F, h, w) as foreground images are; `depth` (F, h, w) is how far the others are, in steps of
    `DEPTH_STEP`, if it matters.
    """

    camera: Camera
    first: int
    ratio: tuple[NDArray[np.uint8], ...]
    depth: NDArray[np.uint16] | None
    slopes: SlopeImages | None
    sides: SideRatios | None = None

    def changes(self, sides: PartSides, frames: slice, poses: Poses) -> tuple[NDArray[np.float32], Bools]:
        """The changes of brightness across the sides of a part in its poses on some frames, grey levels per pixel, and
        which of them others do not hide; shape (m, 2, n, K).
        """
        assert self.slopes is not None and self.depth is not None
        Rc, tc = self.camera.poses(self.first + frames.start, len(poses[0]))
        centre = -np.einsum("mji,mj->mi", Rc, tc).astype(np.float32)
        R, T = (each.astype(np.float32) for each in poses)
        change, seen = self.slopes.steepest(frames, *sides.seen_from(centre, R, T))
        pixels = seen[:, :2].reshape(len(seen), 2, -1, seen.shape[-1]) / np.float32(_STRIDE)
        others = _looked_up(self.depth[frames], pixels[:, 0], pixels[:, 1], 0).reshape(change.shape)
        return change, seen[:, 2] < others * np.float32(DEPTH_STEP)

    def beside(self, sides: PartSides, frames: slice, poses: Poses) -> NDArray[np.float32]:
        """How much likelier what shows across the sides of a part is with it in its poses, (m, K)."""
        if self.sides is None:
            return np.zeros(poses[1].shape[:2], np.float32)
        return self.sides.of(*self.changes(sides, frames, poses)).sum(axis=(1, 2))

    def at(self, part: int, frames: slice, points_world: NDArray[np.float32]) -> NDArray[np.float32]:
        """Ratios of the pixels that points (m, 3, K, points) of a part on some frames fall on, 0 beyond the picture and
        behind others; shape (m, K).
        """
        Rc, tc = self.camera.poses(self.first + frames.start, len(points_world))
        K = self.camera.matrix
        x = transformed((K @ Rc).astype(np.float32), points_world.reshape(len(points_world), 3, -1))
        x += (tc @ K.T).astype(np.float32)[..., None]
        depth = np.maximum(x[:, 2:], np.float32(NEAR))
        columns, rows = (x[:, :2] / depth).reshape(points_world[:, :2].shape).swapaxes(0, 1)
        steps = _looked_up(self.ratio[part][frames], columns, rows, ZERO).astype(np.int16) - np.int16(ZERO)
        if self.depth is not None:
            others = _looked_up(self.depth[frames], columns, rows, 0)
            steps *= depth.reshape(others.shape) < others * np.float32(DEPTH_STEP)
        return np.asarray(steps.mean(axis=-1, dtype=np.float32) / np.float32(SCALE))


@dataclass(frozen=True, eq=False)
class _Limb:
    """One limb and what is known of it: n parts, F frames.

    `range` is (n, 3), 1 for half a circle; points (n, points, 3) are in the parts' frames, and each part shows its
    area, square metres, on the average; `parent` are the poses of what the limb hangs on; `begin` (F, n, 3) are the
    rotation vectors of where it is; `fixed` (F, n, 3) are the degrees of freedom that stay; `held` (F, n) is how surely
    it is where it is; `sides` are those of its first parts, see `without_end`.
    """

    body: Body
    chain: list[int]
    range: Array
    points: Array
    areas: Array
    parent: tuple[Array, Array]
    begin: Array
    fixed: NDArray[np.bool_]
    held: Array
    sides: tuple[PartSides, ...]


def support_of_limbs(
    problem: SegmentProblem, motions: Sequence[Motion]
) -> Iterator[tuple[int, list[int], Array, Callable[[], Array]]]:
    """How much likelier what the pictures show is with each limb where it is than without it.

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
        Logarithm of the ratio of likelihoods on each frame, of what shows across its sides.
    callable
        Returns the same of all that shows, (F,): its sides, and what its pixels would show without it. It is 0 where
        all views have the limb behind something else.
    """
    rng = np.random.default_rng(problem.settings.search_seed)
    views = [view for view in views_with_foreground(problem.views) if view.colours is not None]
    geometry, poses = problem.geometry(), scene_poses(problem.bodies, motions)
    for i in problem.sought if views else ():
        looks = [_ViewRatios.of(view, problem, i, motions) for view in views]
        labels = [look.labels(geometry, poses) for look in looks]
        depths = [_depth_steps(each) for each in labels]
        for chain in limbs(problem.bodies[i]):
            limb, parts = _limb_in(problem, motions, (i, chain), rng)
            own = np.isin(np.arange(len(geometry.spans) + 1), parts)  # the last is nobody
            beside = [
                _Uncovered(look.camera, look.first, (), np.where(own[shown.part], NOBODY, depth), look.slopes)
                for look, shown, depth in zip(looks, labels, depths, strict=True)
            ]
            sides = _sides_shown(limb, _with_sides_learned(limb, beside, problem.whole_keys(i), rng))
            yield i, chain, sides, partial(_all_shown, limb, looks, (geometry, poses, parts), sides)


def _all_shown(
    limb: _Limb, looks: Sequence[_ViewRatios], drawn: tuple[Geometry, tuple[Array, Array], Sequence[int]], sides: Array
) -> Array:
    """How much all that shows of a limb, with what its sides show, speaks for where it begins, (F,)."""
    uncovered = [look.uncovered(*drawn) for look in looks]
    return sides + _covered(replace(limb, sides=()), uncovered, limb.begin[:, None])[:, 0]


def _with_limb_found(
    problem: SegmentProblem,
    looks: Sequence[_ViewRatios],
    motions: Sequence[Motion],
    place: tuple[int, list[int]],
    rng: Generator,
    *,
    free: bool = False,
) -> Motion:
    """One performer's motion with one limb, a chain of its parts, where it is likeliest; `free` as in `freed_limb`."""
    i, chain = place
    motion = motions[i]
    limb, parts = _limb_in(problem, motions, place, rng)
    geometry, poses = problem.geometry(), scene_poses(problem.bodies, motions)
    uncovered = [look.uncovered(geometry, poses, parts) for look in looks]
    uncovered = _with_sides_learned(limb, uncovered, problem.whole_keys(i), rng)
    if not free:
        shown = scipy.special.expit(_sides_shown(limb, uncovered))[:, None]
        limb = replace(limb, held=np.maximum(_held(looks, geometry, poses, parts) * shown, LEAST_HELD))
    path, gain = _likeliest(limb, uncovered, problem.fps, rng)
    if gain < LEAST_GAIN:
        return motion
    Q = motion.rotations.copy()
    Q[:, chain] = np.where(limb.fixed.all(axis=-1)[..., None, None], Q[:, chain], rotations.exp(path))
    return Motion(motion.translations, Q)


def _limb_in(
    problem: SegmentProblem, motions: Sequence[Motion], place: tuple[int, list[int]], rng: Generator
) -> tuple[_Limb, list[int]]:
    """A limb as motions have it, seen nowhere where it is, and its parts of all performers'."""
    i, chain = place
    body, span = problem.bodies[i], problem.spans()[i]
    parts = [span.start + part for part in chain]
    R, T = part_poses(body, motions[i])
    limb = _Limb(
        body,
        chain,
        np.clip(np.ptp(body.limits[chain], axis=2) / np.pi, _LEAST_RANGE, 1.0),
        *_samples(problem.geometry(), parts, rng),
        (R[:, body.parents[chain[0]]], T[:, body.parents[chain[0]]]),
        rotations.log(motions[i].rotations[:, chain]),
        problem.fixed[i][:, 3:].reshape(problem.length, -1, 3)[:, chain],
        np.full((problem.length, len(chain)), LEAST_HELD),
        tuple(PartSides.of(body.parts[part]) for part in without_end(chain)),
    )
    return limb, parts


def _with_sides_learned(
    limb: _Limb, looks: Sequence[_Uncovered], keys: NDArray[np.intp], rng: Generator
) -> list[_Uncovered]:
    """Views that also know how brightness changes across the limb's sides, as its key poses show it."""
    return [_with_learned(limb, look, keys, own) for look, own in zip(looks, rng.spawn(len(looks)), strict=True)]


def _with_learned(limb: _Limb, look: _Uncovered, keys: NDArray[np.intp], rng: Generator) -> _Uncovered:
    if look.slopes is None or not len(keys):
        return look
    drawn = rng.normal(size=(len(keys), ELSEWHERE, *limb.range.shape)) * SPREADS[1] * limb.range
    drawn += limb.begin[keys, None]
    found: list[list[NDArray[np.float32]]] = [[], []]
    for k, key in enumerate(keys.tolist()):
        frame = slice(key, key + 1)
        for kind, turns in enumerate((limb.begin[None, frame], drawn[k][None])):
            for sides, poses in zip(limb.sides, _posed(limb, frame, turns), strict=False):
                change, visible = look.changes(sides, frame, poses)
                found[kind].append(change[visible])
    return replace(look, sides=SideRatios.learned(*map(np.concatenate, found)))


def _sides_shown(limb: _Limb, looks: Sequence[_Uncovered]) -> Array:
    """How much what the limb's sides show speaks for where it begins, (F,)."""
    score = np.zeros(len(limb.begin))
    for some in _chunks(len(score)):
        for sides, poses in zip(limb.sides, _posed(limb, some, limb.begin[some, None]), strict=False):
            for look in looks:
                score[some] += look.beside(sides, some, poses)[:, 0]
    return score


def _likeliest(limb: _Limb, uncovered: Sequence[_Uncovered], fps: float, rng: Generator) -> tuple[Array, float]:
    """The limb's rotation vectors (F, n, 3) that are likeliest around those it begins with, and by how much.

    How far they are from those costs by how fast it changes; how fast the limb itself moves costs nothing.
    """
    begin = limb.begin
    low = np.minimum(limb.body.limits[limb.chain, :, 0], begin.min(axis=0))
    high = np.maximum(limb.body.limits[limb.chain, :, 1], begin.max(axis=0))
    cost = SPEED * limb.range / fps
    path = begin
    values: list[float] = []
    for spread in SPREADS:
        offsets = rng.normal(size=(DRAWS, *limb.range.shape)) * spread * limb.range
        offsets = np.concatenate([np.zeros((1, *limb.range.shape)), offsets / 3, 2 * offsets / 3, offsets])
        drawn = path[:, None] + offsets
        if not values:
            drawn = np.concatenate([drawn, _anywhere(limb, uncovered, (low, high), rng.spawn(1)[0])], axis=1)
        drawn = np.where(limb.fixed[:, None], path[:, None], np.clip(drawn, low, high))
        score = _covered(limb, uncovered, drawn)
        score -= 0.5 * np.einsum("fn,fkna->fk", limb.held, ((drawn - begin[:, None]) / (HELD * limb.range)) ** 2)
        places = ((drawn - begin[:, None]) / cost).reshape(*score.shape, -1)
        best, value = _best_way(score, places)
        if not values:
            values.append(float(score[:, 0].sum()))
        values.append(value)
        # While draws are far apart the best are of different kinds; later their mean is smoother than any of them.
        wide = spread > SPREADS[len(SPREADS) // 2]
        frames = np.arange(len(drawn))
        path = drawn[frames, best] if wide else np.einsum("fk,fkna->fna", _shares(score, places), drawn)
        path = np.where(limb.fixed, begin, on_grid(path))
    return path, values[-1] - values[0]


def _anywhere(
    limb: _Limb, uncovered: Sequence[_Uncovered], bounds: tuple[Array, Array], rng: Generator
) -> NDArray[np.float64]:
    """Poses of the limb (F, `ANYWHERE`, n, 3) drawn between bounds (n, 3), the same on all frames, of which every frame
    has its own winners: what is far from where the limb begins is hardly met by drawing around it.
    """
    drawn = rng.uniform(*bounds, size=(ANYWHERE * HEAT, *limb.range.shape))
    score = _covered(replace(limb, points=limb.points[:, :_FEW_POINTS], sides=()), uncovered, drawn[None])
    winner = score.reshape(len(score), ANYWHERE, HEAT).argmax(axis=2) + HEAT * np.arange(ANYWHERE)
    return np.asarray(drawn[winner])


def _held(looks: Sequence[_ViewRatios], geometry: Geometry, poses: tuple[Array, Array], parts: list[int]) -> Array:
    """The share of each part that is seen and on foreground of its own colours, in the view that shows most of it,
    (F, n).

    A part that is mostly on the background in another view is not there: it is held the less, the more of it is seen.
    """
    held = np.zeros((len(poses[0]), len(parts)))
    free = np.zeros(held.shape)
    for look in looks:
        labels, performer = look.labels(geometry, poses), look.ratio > 0
        for k, part in enumerate(parts):
            seen = labels.part == part
            like = 1.0 if look.coloured is None else np.exp(np.minimum(look.coloured.of(part), 0).astype(float))
            right = (seen & performer) * like
            right = right.sum(axis=(1, 2)) / np.maximum(seen.sum(axis=(1, 2)), 1)
            held[:, k] = np.maximum(held[:, k], labels.share[:, part] * right)
            free[:, k] = np.maximum(free[:, k], labels.share[:, part] * np.clip(1 - 2 * right, 0, 1))
    return held * (1 - free)


def _samples(geometry: Geometry, parts: Sequence[int], rng: Generator) -> tuple[Array, Array]:
    """Points within the parts, (n, points, 3), and the area that each shows on the average: by Cauchy's formula a
    quarter of its surface, square metres.
    """
    vertices = [geometry.vertices[geometry.spans[part]] for part in parts]
    points = [rng.dirichlet(np.full(len(v), 0.3), _POINTS) @ v for v in vertices]
    return np.array(points), shown_areas(geometry, parts)


def shown_areas(geometry: Geometry, parts: Sequence[int]) -> Array:
    """The areas that parts show on the average, square metres: by Cauchy's formula a quarter of their surfaces."""
    return np.array([ConvexHull(geometry.vertices[geometry.spans[part]]).area / 4 for part in parts])


def _covered(limb: _Limb, uncovered: Sequence[_Uncovered], drawn: Array) -> Array:
    """How much likelier the images are with the limb in each of K poses drawn (F, K, n, 3), shape (F, K).

    Poses that are the same on all frames may be (1, K, n, 3).
    """
    score = np.zeros((len(limb.held), drawn.shape[1]))
    for some in _chunks(len(score)):
        chosen = drawn if len(drawn) == 1 else drawn[some]
        for part, (area, poses) in enumerate(zip(limb.areas, _posed(limb, some, chosen), strict=True)):
            world = _placed(limb.points[part], poses)
            for look in uncovered:
                score[some] += area / PATCH**2 * look.at(part, some, world)
                if part < len(limb.sides):
                    score[some] += look.beside(limb.sides[part], some, poses)
    return score


def _chunks(frames: int) -> Iterator[slice]:
    return (slice(f, min(f + _AT_A_TIME, frames)) for f in range(0, frames, _AT_A_TIME))


def _posed(limb: _Limb, frames: slice, drawn: Array) -> Iterator[Poses]:
    """The poses of each of the limb's parts on m frames as drawn, rotation vectors (m or 1, K, n, 3)."""
    R, T = limb.parent[0][frames, None], limb.parent[1][frames, None]
    Q = rotations.exp(drawn)
    for k, part in enumerate(limb.chain):
        T = T + R @ limb.body.offsets[part]
        R = R @ (limb.body.R_parent_rest[part] @ Q[:, :, k])
        yield R, T


def _placed(points: Array, poses: Poses) -> NDArray[np.float32]:
    """World points (m, 3, K, points) of a part in poses, from points in its frame."""
    # Coordinate by coordinate: one product of matrices for all poses, and long rows for what follows. In double
    # precision: processors differ in products of single precision.
    R, T = poses
    turned = np.ascontiguousarray(np.moveaxis(R, 2, 1)) @ points.T
    turned += np.moveaxis(T, 2, 1)[..., None]
    return np.asarray(turned.astype(np.float32))


def _best_way(score: Array, places: Array) -> tuple[NDArray[np.intp], float]:
    """The best way through K places on each of F frames (Viterbi), and its value.

    The value is the sum of the places' scores (F, K) less half the squared distances between places (F, K, d).
    """
    F, K = score.shape
    best, total = np.zeros(F, np.intp), score[0]
    back = np.zeros((F, K), np.intp)
    before, after = _link_factors(places)
    for f in range(1, F):
        through = before[f - 1] @ after[f].T
        through += total[:, None]
        back[f] = through.argmax(axis=0)
        total = through.max(axis=0) + score[f]
    best[-1] = total.argmax()
    for f in range(F - 1, 0, -1):
        best[f - 1] = back[f, best[f]]
    return best, float(total.max())


def _shares(score: Array, places: Array) -> Array:
    """The probability of every place, (F, K), where ways are the likelier the better; parameters as of `_best_way`."""
    last = len(score) - 1
    ahead, behind = score.copy(), np.zeros(score.shape)
    before, after = _link_factors(places)
    # The factors between neighbouring frames are made twice: those of a long segment would fill the memory.
    for f in range(last):
        ahead[f + 1] += _log_sum(ahead[f], np.exp(before[f] @ after[f + 1].T))
    for f in range(last - 1, -1, -1):
        behind[f] = _log_sum(behind[f + 1] + score[f + 1], np.exp(before[f] @ after[f + 1].T).T)
    log = ahead + behind
    share = np.exp(log - log.max(axis=1, keepdims=True))
    return np.asarray(share / share.sum(axis=1, keepdims=True))


def _log_sum(log: Array, factors: Array) -> Array:
    """Logarithms of sums of K numbers, given by their logarithms, with each column of factors (K, L)."""
    top = log.max()
    return np.asarray(top + np.log(np.maximum(np.exp(log - top) @ factors, np.finfo(float).tiny)))


def _link_factors(places: Array) -> tuple[Array, Array]:
    """Rows before[f] and after[f], (K, d + 2), of places (F, K, d): before[f] @ after[f + 1].T is less half the squared
    distance from each of a frame's places to each of the next frame's, (K, K).
    """
    norm = -0.5 * np.einsum("fkd,fkd->fk", places, places)[..., None]
    one = np.ones_like(norm)
    return np.concatenate([places, norm, one], axis=2), np.concatenate([places, one, norm], axis=2)


def untangled(
    body: Body, motion: Motion, pair: tuple[list[int], list[int]], fps: float, free: NDArray[np.bool_] | None = None
) -> Motion:
    """Give each of two like limbs its own way again where they were taken for one another.

    They may have been exchanged wherever they are nearest to each other; those exchanges are undone that leave the
    smoothest motion. At the first and last frame they are what they are.

    Parameters
    ----------
    body : Body
    motion : Motion
        F poses.
    pair : tuple of lists of int
        See `pairs`.
    fps : float
    free : ndarray of bool, shape (F,), optional
        The frames on which the limbs may be exchanged.
    """
    apart, meetings = _meetings(body, motion, pair, fps)
    frames = np.zeros(len(motion), dtype=bool)
    for (a, b), swapped in zip(
        zip(meetings, [*meetings, len(motion)][1:], strict=True), _exchanges(apart, meetings, fps), strict=True
    ):
        frames[a:b] = swapped
    frames &= True if free is None else free
    return exchanged(body, motion, pair, frames) if frames.any() else motion


def exchanges(problem: SegmentProblem, motions: Sequence[Motion]) -> Iterator[tuple[Motion, ...]]:
    """The motions with two like limbs exchanged between two of their meetings, one such stretch at a time.

    A solver that took the limbs for one another at both meetings has made its way between them smooth: that they were
    exchanged, only the images show. Key poses are meetings too: limbs may be taken for one another right beside them.
    """
    for i in problem.sought:
        body, motion = problem.bodies[i], motions[i]
        for pair in pairs(body):
            apart, meetings = _meetings(body, motion, pair, problem.fps)
            distance = np.linalg.norm(apart, axis=1)
            fixed = problem.fixed[i][:, 3:].reshape(len(motion), -1, 3)[:, pair[0] + pair[1]].any(axis=(1, 2))
            ends = np.flatnonzero(fixed[[0, -1]]) * (len(motion) - 1)
            for a, b in pairwise(sorted({*meetings.tolist(), *ends.tolist()})):
                frames = np.zeros(len(motion), dtype=bool)
                frames[a + fixed[a] : b] = True
                if not (fixed & frames).any() and max(distance[a], distance[b]) < PARTED * distance[a:b].max():
                    new = exchanged(body, motion, pair, frames)
                    yield (*motions[:i], new, *motions[i + 1 :])


def _meetings(
    body: Body, motion: Motion, pair: tuple[list[int], list[int]], fps: float
) -> tuple[Array, NDArray[np.intp]]:
    """How far apart two like limbs are in the directions of their bones, (F, d), and where that is least."""
    R, _ = part_poses(body, motion)
    trunk = np.flatnonzero(body.ancestry[pair[0][0]] & body.ancestry[pair[1][0]])[-1]
    left, right = (np.swapaxes(R[:, [trunk]], -1, -2) @ R[:, chain] for chain in pair)
    apart = (right - left)[..., 1].reshape(len(motion), -1)
    apart = scipy.ndimage.gaussian_filter1d(apart, MEETING * fps, axis=0, mode="nearest")
    distance = np.linalg.norm(apart, axis=1)
    return apart, 1 + np.flatnonzero((distance[1:-1] < distance[:-2]) & (distance[1:-1] < distance[2:]))


def exchanged(body: Body, motion: Motion, pair: tuple[list[int], list[int]], frames: NDArray[np.bool_]) -> Motion:
    """A motion whose two like limbs point to where the other one did on some frames, a mask (F,)."""
    R, _ = part_poses(body, motion)
    Q = motion.rotations.copy()
    for chain, other in (pair, pair[::-1]):
        parent = R[:, body.parents[chain[0]]]
        for part, like in zip(chain, other, strict=True):
            turned = np.swapaxes(parent @ body.R_parent_rest[part], -1, -2) @ R[:, like]
            Q[frames, part] = rotations.orthonormal(turned[frames])
            parent = R[:, like]
    return Motion(motion.translations, Q)


def _exchanges(apart: Array, meetings: NDArray[np.intp], fps: float) -> list[bool]:
    """After which meetings two limbs, `apart` by (F, d), are to be exchanged so that their velocities go on."""
    reach, last = max(2, round(BESIDE * fps)), len(apart) - 1
    ways: dict[int, tuple[float, list[bool]]] = {1: (0.0, [])}
    for f in meetings:
        p, q = max(f - reach, 0), min(f + reach, last)
        before = (apart[f] - apart[p]) / (f - p)
        jump = {s: float((((s * apart[q] - apart[f]) / (q - f) - before) ** 2).sum()) for s in (1, -1)}
        ways = {
            side: min(
                ((cost + jump[side * was], [*way, side < 0]) for was, (cost, way) in ways.items()), key=lambda w: w[0]
            )
            for side in (1, -1)
        }
    return ways[1][1]
