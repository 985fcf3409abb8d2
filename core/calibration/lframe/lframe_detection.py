"""Identifying the L-frame's four balls in one view.

Three balls on a line and one beside it fit any such picture with either end as the corner. But an L-frame on the floor
is seen from above, and then only one of the two has the right orientation.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations

import cv2
import numpy as np

from ...errors import CalibrationError
from ...numerics.arrays import Array
from ..balls.found_balls import Balls

TRIED_FOCALS = (0.6, 0.8, 1.0, 1.3, 1.7, 2.3)
"""Focal lengths that are tried if none is known, relative to the picture's longer side."""
_MAX_MOVEMENT = 1.0  # pixels
_MIN_SEEN_SHARE = 0.5  # least fraction of the frames on which a static ball is found in one place
_MAX_CANDIDATES = 12  # largest number of static balls among which the four are searched for
_STRAIGHTNESS_SIGMA = 0.04  # deviation of the long arm's balls from a line, relative to its length: lenses bend lines
_MAX_RATIO_CHANGE = 2.5  # factor by which perspective may change the ratio of their distances
_SIZE_SIGMA = 0.12  # standard deviation of the balls' sizes in the picture, relative to the expected ones
_MIRROR_MARGIN = 9.0  # how much better, in squared standard deviations, a mirrored L-frame must fit


def static_balls(seen: Sequence[Balls], most: int = _MAX_CANDIDATES) -> Balls:
    """Return the balls that stand still in several pictures, averaged, the largest first."""
    seen = [balls for balls in seen if len(balls)]
    if not seen:
        return Balls.joined([])
    whole, home = Balls.joined(seen), np.repeat(np.arange(len(seen)), [len(b) for b in seen])
    left, found = np.ones(len(whole), bool), []
    for k in range(len(whole)):
        near = left & (np.linalg.norm(whole.centres - whole.centres[k], axis=1) < _MAX_MOVEMENT)
        left &= ~near
        if left[k] or len(set(home[near])) < _MIN_SEEN_SHARE * len(seen):
            continue
        # Errors common to all frames, from compression and shading, do not average out.
        sigma = np.sqrt(np.mean(whole.sigma[near] ** 2))
        centre, shape = (np.median(values[near], axis=0) for values in (whole.centres, whole.shapes))
        found.append(Balls(centre[None], shape[None], sigma[None]))
    order = np.argsort([-ball.semi_axes[0, 1] for ball in found])[:most]
    return Balls.joined([found[i] for i in order])


class LFrameUnseenError(CalibrationError):
    """A picture shows nothing that could be the L-frame."""


@dataclass(frozen=True)
class _LFrameFit:
    """The fit of four balls to an L-frame: sum of squared deviations, in standard deviations, and which balls."""

    cost: float
    balls: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class LFrameModel:
    """An L-frame and a camera that sees it.

    Attributes
    ----------
    points : ndarray, shape (4, 3)
        The corner, two more along the long arm, and the short arm's, metres.
    diameter : float or None
        Diameter of its balls, metres.
    middle : ndarray, shape (2,)
        Middle of the picture, pixels.
    focals : sequence of float
        Focal lengths to try, pixels.
    """

    points: Array
    diameter: float | None
    middle: Array
    focals: Sequence[float]

    def mirrored(self) -> LFrameModel:
        """Return the mirror image, with the short arm on the other side."""
        return replace(self, points=self.points * [1, -1, 1])


def identified(balls: Balls, frame: LFrameModel, where: str) -> list[int]:
    """Return the indices of the L-frame's balls, in the order of its points.

    Parameters
    ----------
    balls : Balls
        Those that stand still, see `static_balls`.
    frame : LFrameModel
    where : str
        Video and camera, for error messages.

    Raises
    ------
    LFrameUnseenError
        No four of the balls form an L-frame seen from above.
    CalibrationError
        They form only its mirror image.
    """
    if len(balls) < 4:
        raise LFrameUnseenError(
            f"{len(balls)} of the L-frame's 4 balls were found",
            where=where,
            todo="see that all four are in the picture and lit, and that the colour is theirs",
        )
    right, wrong = (
        min((_fit(balls, four, f) for four in _shaped(balls, f.points)), key=lambda fit: fit.cost, default=None)
        for f in (frame, frame.mirrored())
    )
    if wrong is not None and (right is None or right.cost > wrong.cost + _MIRROR_MARGIN):
        raise CalibrationError(
            "the L-frame in the picture is the mirror image of its measures",
            where=where,
            todo="x goes along the long arm from the corner, y along the short one, z up: check the signs",
        )
    if right is None or not np.isfinite(right.cost):
        raise LFrameUnseenError(
            f"no four of {len(balls)} balls of its colour lie as the L-frame's do", where=where, todo="check its points"
        )
    return list(right.balls)


def _shaped(balls: Balls, points: Array) -> Iterator[tuple[int, ...]]:
    """Generate sets of four balls that may be an L-frame seen from above: three on a line with its spacing, one
    aside.
    """
    c = balls.centres
    spacing = np.linalg.norm(points[1] - points[0]) / np.linalg.norm(points[2] - points[1])
    side = _cross(points[2] - points[0], points[3] - points[0])
    for a, b, e in permutations(range(len(balls)), 3):
        long = c[e] - c[a]
        length = float(np.linalg.norm(long))
        near, far = float(np.linalg.norm(c[b] - c[a])), float(np.linalg.norm(c[e] - c[b]))
        bent = abs(_cross(long, c[b] - c[a])) / max(length, 1e-9)
        between = 0 < float((c[b] - c[a]) @ long) < length**2
        if (
            not between
            or bent > _STRAIGHTNESS_SIGMA * length + _MAX_MOVEMENT
            or not 1 / _MAX_RATIO_CHANGE < near / far / spacing < _MAX_RATIO_CHANGE
        ):
            continue
        for d in set(range(len(balls))) - {a, b, e}:
            # Seen from above, left turns stay left turns; v points down.
            if _cross(long, c[d] - c[a]) * side < 0:
                yield a, b, e, d


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _fit(balls: Balls, four: tuple[int, ...], frame: LFrameModel) -> _LFrameFit:
    """Compare positions and sizes with the best pose of the L-frame."""
    centres, radii = balls.centres[list(four)], balls.semi_axes[list(four), 1]
    return _LFrameFit(min(_pose_cost(centres, radii, frame, focal) for focal in frame.focals), four)


def _pose_cost(centres: Array, radii: Array, frame: LFrameModel, focal: float) -> float:
    K = np.array([[focal, 0, frame.middle[0]], [0, focal, frame.middle[1]], [0, 0, 1.0]])
    _, turns, shifts, _ = cv2.solvePnPGeneric(frame.points, centres, K, np.zeros(4), flags=cv2.SOLVEPNP_SQPNP)
    # The unknown lens distortion bends the line a little.
    tolerance = _MAX_MOVEMENT + 0.01 * float(np.linalg.norm(centres[2] - centres[0]))
    best = np.inf
    for turn, shift in zip(turns, shifts, strict=True):
        R = cv2.Rodrigues(turn)[0]
        x = frame.points @ R.T + shift[:, 0]
        if (x[:, 2] <= 0).any() or (-R.T @ shift)[2, 0] <= frame.points[:, 2].max():
            continue
        off = (x[:, :2] / x[:, 2:] * focal + frame.middle - centres) / tolerance
        sizes = np.log(2 * radii * x[:, 2] / focal)
        expected = sizes.mean() if frame.diameter is None else np.log(frame.diameter)
        best = min(best, float(np.sum(off**2) + np.sum((sizes - expected) ** 2) / _SIZE_SIGMA**2))
    return best
