"""The wand's two balls through a video: which of what was found on every frame they are.

Every two balls that could be the wand's by their sizes and their distance are a state of the frame; the path through
the states that moves least and fits best is found by dynamic programming. What lies still is no wand.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..capture.colours import Colour
from ..numerics.arrays import Array
from ..numerics.median_image import median_image
from ..shot.interlacing import shows_two_fields
from .balls.ball_detection import Picture, background_of, find_balls, without_rods
from .balls.found_balls import Balls
from .balls.passing_balls import Backdrop, BallSample, PassingBalls, PassingFrame
from .balls.small_balls import MAX_RADIUS

Image = NDArray[Any]

_MAX_BALLS_OF_A_COLOUR = 8  # balls on a frame, the largest
_MAX_PAIRS = 40  # of these, the likeliest: the path through them takes the square of it
_MAX_PIECE_SHARE = 0.5  # of a trace's length that a small ball of its colour in it is, at most
_MAX_SIZE_RATIO = 1.8  # the one ball's size to the other's
_MAX_LENGTH_RATIO = 1.5  # than the wand seen from the side, by the ball's sizes
_MISSING_COST = 8.0  # what a frame without a pair costs
_LOG_SIZE_SIGMA = 0.2  # deviation of the logarithm of the balls' sizes, one to the other
_STEP_SIGMA_DIAMETERS = 2.0  # diameters from frame to frame that cost as much as one standard deviation
_STEP_SIGMA_LENGTHS = 0.3  # the same in lengths of the wand, where these are known
_MAX_STEP_COST = 60.0  # the most that a step costs
_CELL_SIZE = 3.0  # pixels
_STILL_COST = 20.0  # what a ball costs that lies on the same place on all frames
_MAX_STILL_SHARE = 0.25  # share of the frames that a waved ball may be on one place
_CROSSING_DISTANCE = 2.5  # radii between balls of one colour that may be taken for each other


@dataclass(frozen=True, eq=False)
class Pairs:
    """What could be the wand on one frame.

    Attributes
    ----------
    balls : tuple of Balls
        The first ends, and the second ends in the same order.
    found : tuple of ndarray, shape (m, 2)
        Centres of all balls that have the colour of the first end, and of the second, pixels.
    """

    balls: tuple[Balls, Balls]
    found: tuple[Array, Array]

    def __len__(self) -> int:
        return len(self.balls[0])

    @property
    def centres(self) -> Array:
        """Shape (n, 2, 2), pixels."""
        return np.stack([b.centres for b in self.balls], axis=1)

    @property
    def radii(self) -> Array:
        """Minor semi-axes, shape (n, 2), pixels: motion blurs the other."""
        return np.stack([b.semi_axes[:, 1] for b in self.balls], axis=1)

    @property
    def sigma(self) -> Array:
        """Standard deviations of the centres' coordinates, shape (n, 2), pixels."""
        return np.stack([b.sigma for b in self.balls], axis=1)


@dataclass(frozen=True, eq=False)
class WandAppearance:
    """What a camera's video shows behind the wand, and how its balls look there.

    Attributes
    ----------
    background : ndarray of uint8, shape (h, w, 3)
        See `background_of`.
    backdrop : Backdrop
        The same with the footage's noise.
    passing : tuple of PassingBalls or None
        For each colour, where enough balls were seen clearly to learn from.
    interlaced : bool
        Whether the video is interlaced.
    """

    background: Image
    backdrop: Backdrop
    passing: tuple[PassingBalls | None, ...]
    interlaced: bool = False

    @classmethod
    def learned(cls, images: Sequence[Image], colours: Sequence[Colour]) -> WandAppearance:
        """From frames from all over the video."""
        plate = median_image(images)
        background = background_of([plate])
        pictures = [Picture.of(image, background) for image in images]
        backdrop = Backdrop.of([picture.even for picture in pictures], background)
        samples = [[ball for picture in pictures for ball in _samples(picture, colour)] for colour in colours]
        passing = (PassingBalls.learned(backdrop, [b for b in own if backdrop.passes(b)]) for own in samples)
        return cls(background, backdrop, tuple(passing), shows_two_fields(images, plate))


def _samples(picture: Picture, colour: Colour) -> Iterator[BallSample]:
    balls = find_balls(picture, colour)
    for centre, radius in zip(balls.centres, balls.semi_axes[:, 1], strict=True):
        yield BallSample(picture.even, centre, float(radius))


def find_pairs(
    image: Image, colours: Sequence[Colour], longest: float | None, appearance: WandAppearance | None
) -> Pairs:
    """Every two balls in a picture that could be a wand.

    Parameters
    ----------
    image : ndarray of uint8, shape (h, w, 3)
        Blue, green, red.
    colours : sequence of Colour
        The first ball's and the second's, or one for both.
    longest : float or None
        The wand's length over the balls' diameter, where it is known.
    appearance : WandAppearance or None
        What is known of this video.
    """
    passing = (None,) * len(colours) if appearance is None else appearance.passing
    picture = Picture.of(image, appearance.background if appearance is not None and None in passing else None)
    frame = None if appearance is None else appearance.backdrop.frame(picture.even)
    found = [_found(picture, colour, frame, own) for colour, own in zip(colours, passing, strict=True)]
    first, second = found[0], found[-1]
    a, b = first.balls, second.balls
    i, j = np.triu_indices(len(a), 1) if len(found) == 1 else np.indices((len(a), len(b))).reshape(2, -1)
    r, s = a.semi_axes[i, 1], b.semi_axes[j, 1]
    apart = np.linalg.norm(a.centres[i] - b.centres[j], axis=1)
    likely = (np.maximum(r, s) < _MAX_SIZE_RATIO * np.minimum(r, s)) & (apart > 0.8 * np.minimum(r, s))
    if longest is not None:
        likely &= apart < _MAX_LENGTH_RATIO * longest * (r + s)
    i, j = i[likely][:_MAX_PAIRS], j[likely][:_MAX_PAIRS]
    ends = first.measured(picture, i, b.centres[j]), second.measured(picture, j, a.centres[i])
    good = ends[0][1] & ends[1][1]
    return Pairs((ends[0][0][good], ends[1][0][good]), (a.centres, b.centres))


@dataclass(frozen=True, eq=False)
class _FoundBalls:
    """Balls of a colour in a picture; those from `outlined` on were brought out of a background that is known."""

    balls: Balls
    outlined: int

    def measured(self, picture: Picture, which: NDArray[np.int64], others: Array) -> tuple[Balls, NDArray[np.bool_]]:
        """Some of the balls, measured without what a rod to the other end may hide, and which of them are balls."""
        chosen, own = self.balls[which], which < self.outlined
        balls, good = without_rods(picture, chosen[own], others[own, None])
        order = np.argsort(np.concatenate([np.flatnonzero(own), np.flatnonzero(~own)]))
        whole = np.concatenate([good, np.ones(int((~own).sum()), bool)])
        return Balls.joined([balls, chosen[~own]])[order], whole[order]


def _found(picture: Picture, colour: Colour, frame: PassingFrame | None, passing: PassingBalls | None) -> _FoundBalls:
    """Return the balls of a colour: those that are seen by themselves, and those that pass before the background."""
    balls = find_balls(picture, colour)
    if passing is None or frame is None:
        balls = balls[:_MAX_BALLS_OF_A_COLOUR]
        return _FoundBalls(balls, len(balls))
    small = passing.find(frame)
    others = Balls(small.centres, small.shapes, small.sigma)
    # A clear ball is measured best by itself; a small piece of one that its motion makes pale is not.
    apart = np.linalg.norm(balls.centres[:, None] - others.centres, axis=-1)
    length, long = balls.semi_axes[:, :1], others.semi_axes[:, 0]
    piece = (length < MAX_RADIUS) & (length < _MAX_PIECE_SHARE * long) & (apart < long + 1)
    whole = ~piece.any(axis=1)
    balls, apart = balls[whole][:_MAX_BALLS_OF_A_COLOUR], apart[whole][:_MAX_BALLS_OF_A_COLOUR]
    others = others[~(apart < np.maximum(balls.semi_axes[:, :1], others.semi_axes[:, 0]) + 1).any(axis=0)]
    return _FoundBalls(Balls.joined([balls, others]), len(balls))


def likeliest_pairs(seen: Sequence[Pairs], longest: float | None = None) -> NDArray[np.int64]:
    """Return which pair of every frame is the wand, -1 where none is, shape (frames,); `longest` as of `find_pairs`."""
    fast = max(_STEP_SIGMA_DIAMETERS, _STEP_SIGMA_LENGTHS * (longest or 0.0))
    before, reached, back = _Reached.nowhere(), np.zeros(1), []
    for pairs, own in zip(seen, _own_costs(seen), strict=True):
        costs = reached[:, None] + before.steps_to(pairs, fast)
        previous = np.argmin(costs, axis=0)
        reached = costs[previous, np.arange(len(previous))] + np.append(own, _MISSING_COST)
        before = before.followed(pairs, int(previous[-1]))
        back.append(previous)
    path = []
    state = int(np.argmin(reached))
    for pairs, previous in zip(reversed(seen), reversed(back), strict=True):
        path.append(state if state < len(pairs) else -1)
        state = int(previous[state])
    return np.array(path[::-1], np.int64)


def _own_costs(seen: Sequence[Pairs]) -> list[Array]:
    """Return what the pairs of every frame cost by themselves: balls of unlike sizes, balls that lie still."""
    crowds = [_Crowd.of([pairs.found[end] for pairs in seen]) for end in range(2)]
    return [
        (np.diff(np.log(pairs.radii), axis=1)[:, 0] / _LOG_SIZE_SIGMA) ** 2
        + sum(
            _STILL_COST * np.maximum(crowds[end].shares(pairs.centres[:, end]) - _MAX_STILL_SHARE, 0)
            for end in range(2)
        )
        for pairs in seen
    ]


@dataclass(frozen=True, eq=False)
class _Crowd:
    """On how many frames there is a ball in each cell of the picture, and of how many."""

    counts: Counter[tuple[int, int]]
    frames: int

    @classmethod
    def of(cls, places: Sequence[Array]) -> _Crowd:
        cells = [np.unique(np.floor(p / _CELL_SIZE).astype(int), axis=0) for p in places]
        return cls(Counter(map(tuple, np.concatenate([*cells, np.empty((0, 2), int)]).tolist())), len(places))

    def shares(self, places: Array) -> Array:
        """On what share of the frames there is a ball at each place, shape (n,)."""
        around = [(a, b) for a in (-1, 0, 1) for b in (-1, 0, 1)]
        cells = np.floor(places / _CELL_SIZE).astype(int)
        return np.array([sum(self.counts[u + a, v + b] for a, b in around) / self.frames for u, v in cells])


@dataclass(frozen=True, eq=False)
class _Reached:
    """Where the wand was last in every state of a frame; the last state is that it is not seen.

    Attributes
    ----------
    centres : ndarray, shape (n + 1, 2, 2)
        NaN where it was not seen yet.
    radii : ndarray, shape (n + 1,)
    ago : ndarray, shape (n + 1,)
        Frames since then.
    """

    centres: Array
    radii: Array
    ago: Array

    @classmethod
    def nowhere(cls) -> _Reached:
        return cls(np.full((1, 2, 2), np.nan), np.ones(1), np.ones(1))

    def steps_to(self, pairs: Pairs, fast: float) -> Array:
        """Return what it costs to get from each state to each pair of the next frame, and to none, shape (n + 1, m +
        1).

        `fast` is how many diameters from frame to frame cost as much as one standard deviation.
        """
        far = np.linalg.norm(pairs.centres[None] - self.centres[:, None], axis=-1)
        diameters = 2 * self.radii * np.sqrt(self.ago)
        costs = np.sum((far / (fast * diameters[:, None, None])) ** 2, axis=-1)
        costs = np.minimum(np.where(np.isnan(costs), 0, costs), _MAX_STEP_COST)
        return np.column_stack([costs, np.zeros(len(costs))])

    def followed(self, pairs: Pairs, missed_from: int) -> _Reached:
        """Return the states of the next frame; the one without a pair came from `missed_from`."""
        return _Reached(
            np.concatenate([pairs.centres, self.centres[[missed_from]]]),
            np.append(pairs.radii.mean(axis=1), self.radii[missed_from]),
            np.append(np.ones(len(pairs)), self.ago[missed_from] + 1),
        )


def swapped_ends(centres: Array, radii: Array) -> NDArray[np.bool_]:
    """On which frames two balls of one colour must change places to be the same ends throughout.

    Ends are followed from frame to frame; where they are too near each other, or were not seen, that fails, and the
    end that is mostly the upper one in each run between is taken for the same end: from all sides it is the same.

    Parameters
    ----------
    centres : ndarray, shape (n, 2, 2)
        NaN where the wand was not seen.
    radii : ndarray, shape (n,)
        Pixels.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    swapped = np.zeros(len(centres), bool)
    sure = np.linalg.norm(centres[:, 1] - centres[:, 0], axis=1) > _CROSSING_DISTANCE * radii
    for run in np.split(np.arange(len(centres)), np.flatnonzero(~sure | ~np.roll(sure, 1))):
        for before, frame in pairwise(run):
            stay, change = (
                float(np.sum((centres[frame][::order] - centres[before][:: -1 if swapped[before] else 1]) ** 2))
                for order in (1, -1)
            )
            swapped[frame] = change < stay
        first, second = (centres[run, end, 1] for end in (0, 1))
        lower = np.where(swapped[run], second - first, first - second)
        if np.nansum(lower) > 0:
            swapped[run] ^= True
    return swapped
