"""The likeliest path of a limb through poses that are drawn at random on every frame.

Poses are drawn around the present path, and some from the whole range of the joints. Each is scored by the images, and
dynamic programming finds the likeliest path through them. This is repeated with poses drawn ever closer to the path.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from ....numerics import rotations
from ....numerics.arrays import Array
from ....numerics.likeliest_path import likeliest_path, place_probabilities
from ....numerics.repeatable import on_grid
from ..limb_evidence.limb_images import UncoveredImages
from ..limb_evidence.limb_likelihood import pixel_log_ratios
from ..limb_evidence.limb_model import LimbModel

ROUND_SIGMAS = (1.0, 0.5, 0.25, 0.12)
"""Standard deviation of the poses drawn in each round, radians, for a joint with a range of half a circle; for others
in proportion to their range."""
FIRST_FINE_SIGMA = ROUND_SIGMAS[len(ROUND_SIGMAS) // 2]
"""That of the first round which only improves the path."""
DRAWS_PER_ROUND = 80
"""Poses drawn per round; those at one and two thirds of the way to each are scored as well."""
UNIFORM_DRAWS = 60
"""Poses of the first round that are drawn from the whole range of the joints; each is the best of `CANDIDATES_PER_DRAW`
draws, judged by a few points."""
CANDIDATES_PER_DRAW = 64
ERROR_RATE = 5.0
"""Usual rate of change of the error of a joint with a range of half a circle, rad/s: half the speed of a joint that
moves fast, as where nothing moves fast the curve through the key poses is right."""
HELD_SIGMA = 0.1
"""Standard deviation, radians, of the departure of a limb that is clearly seen where it is."""
BENDING_AXES = np.array([1, 0, 1])
"""A part's axes about which it bends: the second one, about which it twists, lies along the bone."""
TWIST_SHARE = 0.2
"""Weight of a part's twist in the length of a limb's path, relative to that of its direction; also that of its last
part's direction, which is hardly visible."""
_FEW_POINTS = 2


def likeliest_limb(
    limb: LimbModel,
    uncovered: Sequence[UncoveredImages],
    fps: float,
    rng: Generator,
    promising: Callable[[Array], bool] | None = None,
) -> tuple[Array, float]:
    """Return the likeliest rotation vectors (F, n, 3) of the limb, and by how much likelier they are than the present.

    Their difference from the present ones should change slowly (`ERROR_RATE`); how fast the limb itself moves costs
    nothing. Those that are found roughly are not improved unless they are `promising`; they count as no likelier then.
    """
    begin = limb.begin
    low = np.minimum(limb.body.limits[limb.chain, :, 0], begin.min(axis=0))
    high = np.maximum(limb.body.limits[limb.chain, :, 1], begin.max(axis=0))
    present, step = _directions(limb, begin[:, None]), ERROR_RATE / fps
    path = begin
    values: list[float] = []
    for spread in ROUND_SIGMAS:
        if spread == FIRST_FINE_SIGMA and promising is not None and not promising(path):
            return path, 0.0
        offsets = rng.normal(size=(DRAWS_PER_ROUND, *limb.range.shape)) * spread * limb.range
        offsets = np.concatenate([np.zeros((1, *limb.range.shape)), offsets / 3, 2 * offsets / 3, offsets])
        drawn = path[:, None] + offsets
        if not values:
            drawn = np.concatenate([drawn, _uniform_draws(limb, uncovered, (low, high), rng.spawn(1)[0])], axis=1)
        drawn = np.where(limb.fixed[:, None], path[:, None], np.clip(drawn, low, high))
        score, away = pixel_log_ratios(limb, uncovered, drawn), _directions(limb, drawn) - present
        score -= 0.5 * np.einsum("fn,fkna->fk", limb.held, (away / HELD_SIGMA) ** 2)
        places = (away / step).reshape(*score.shape, -1)
        best, value = likeliest_path(score, places)
        if not values:
            values.append(float(score[:, 0].sum()))
        values.append(value)
        # Draws that are far apart are different poses, so the best is taken; later their mean is smoother.
        wide = spread > FIRST_FINE_SIGMA
        frames = np.arange(len(drawn))
        path = drawn[frames, best] if wide else np.einsum("fk,fkna->fna", place_probabilities(score, places), drawn)
        path = np.where(limb.fixed, begin, on_grid(path))
    return path, values[-1] - values[0]


def _directions(limb: LimbModel, drawn: Array) -> Array:
    """Directions of the parts in poses (F, K, n, 3) of the limb, (F, K, n, 6), in units of the joints' ranges.

    Three numbers are the direction of the bone beyond that of the bone before it, which is 0 in a limb that is turned
    as a whole; the others, which count less (`TWIST_SHARE`), that of an axis across it. Unlike rotation vectors they do
    not leap where a joint has turned by half a circle, as an arm that swings round.
    """
    R, before, found = np.eye(3), np.zeros(3), np.empty((*drawn.shape, 2))
    bend, twist = (limb.range * BENDING_AXES).max(axis=1), limb.range[:, 1]
    for k, part in enumerate(limb.chain):
        R = R @ (limb.body.R_parent_rest[part] @ rotations.exp(drawn[:, :, k]))
        along = R[..., 1]
        found[:, :, k, :, 0] = (along - before) / bend[k] * (1.0 if k < len(limb.sides) else TWIST_SHARE)
        found[:, :, k, :, 1] = TWIST_SHARE * R[..., 0] / twist[k]
        before = along
    return found.reshape(*drawn.shape[:3], 6)


def _uniform_draws(
    limb: LimbModel, uncovered: Sequence[UncoveredImages], bounds: tuple[Array, Array], rng: Generator
) -> NDArray[np.float64]:
    """Poses of the limb (F, `UNIFORM_DRAWS`, n, 3) from between bounds (n, 3), as drawing around its present pose
    rarely reaches far: of poses drawn once for all frames, each frame has the best of every `CANDIDATES_PER_DRAW`.

    What decides where the limb lies is drawn: how its first part turns and, in every second pose, how far the others
    bend. The rest, such as a forearm's twist and the hand, stays as it usually is: drawn as well, it would thin out the
    poses, and make the path from one to the next long.
    """
    drawn = rng.uniform(*bounds, size=(UNIFORM_DRAWS * CANDIDATES_PER_DRAW, *limb.range.shape))
    bending = np.ptp(bounds, axis=0) * BENDING_AXES
    shaping = bending > bending.max(axis=1, keepdims=True) / 2
    shaping[0], shaping[len(limb.sides) :] = True, False
    usual, begin = np.median(limb.begin, axis=0), np.arange(len(drawn)) // CANDIDATES_PER_DRAW % 2 == 0
    drawn = np.where(shaping, drawn, usual)
    drawn[begin, 1:] = usual[1:]
    roughly = replace(limb, points=limb.points[:, :_FEW_POINTS], radii=np.zeros(len(limb.radii)), sides=())
    score = pixel_log_ratios(roughly, uncovered, drawn[None])
    winner = score.reshape(len(score), UNIFORM_DRAWS, CANDIDATES_PER_DRAW).argmax(
        axis=2
    ) + CANDIDATES_PER_DRAW * np.arange(UNIFORM_DRAWS)
    return np.asarray(drawn[winner])
