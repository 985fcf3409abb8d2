"""Small balls measured by a model of their image.

A ball of a few pixels has no measurable edge, and the centroid of its colour lies off its centre: towards the lit side,
away from the rod that hides a part of it, and wherever the background's texture resembles it. So its image is computed
instead (`ball_rendering`) and fitted to the pixels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Array, Bools
from ...numerics.least_squares import GAUSS_NEWTON, StoppingRule, minimise
from ...numerics.normal_equations import DenseEquations
from ...numerics.robust_kernels import Cauchy
from .ball_appearance import BallAppearance, BallGuess, BallImage
from .ball_rendering import (
    CENTRE,
    LIGHT,
    MIN_LIGHT,
    PATH,
    RADIUS,
    ROD_LIGHT,
    SHADE,
    STARTS,
    UNKNOWNS,
    WIDTH,
    BallWindow,
    Image,
    linear,
)
from .free_unknowns import FreeUnknowns, centre_step

_LIMB_WIDTH = 3.0  # pixels beyond the outline that are compared
_STEPS = np.array([0.05, 0.05, 0.03, 0.02, 0.02, 0.05, 0.05, 0.05, 0.1, 0.1, 0.05, 0.1, 0.1, 0.1, 0.05, 0.05])
"""Steps of the finite differences, by unknown."""
_MAX_STEPS = np.array([0.5, 0.5, 0.2, 0.15, 0.15, 0.5, 0.5, 0.5, 0.7, 0.7, 0.2, 0.7, 0.7, 0.7, 0.2, 0.2])
"""Largest change in one iteration, by unknown."""
_BRIGHTNESS, _COLOURS = 1.7, 0.8
"""Weights of brightness and of the two differences of colour of a ball that rests: of these, video keeps one for every
four pixels, which shifts them by up to half a pixel, on all frames alike. A ball that moves lies elsewhere on each."""
_COMPARED = np.array([_BRIGHTNESS, _COLOURS, _COLOURS])[:, None] * [
    [0.114, 0.587, 0.299],
    [0.5, -0.331, -0.169],
    [-0.081, -0.419, 0.5],
]
"""Brightness and differences of colour (ITU-R BT.601) of blue, green and red."""
_PIXEL_SIGMA = 0.02  # of what the model leaves, levels from 0 to 1
_KERNEL = Cauchy(3.0)  # of differences in units of that
_PIXELS_PER_OBSERVATION = 2.0  # pixels that count as one observation, as blur correlates them
_APPEARANCE_SIGMA = 0.1  # standard deviation of how balls of one view look, about what they have in common
_MIN_SIGMA = 0.03  # standard deviation that the best of images leaves, pixels
_ROD_SIGMA = 0.1  # what the shape of a rod where it meets the ball adds along the rod, pixels
_ROD_SHARE = 0.2  # and as a share of the path: a rod turns while the shutter is open
_PATH_SHARE = 0.03  # of the path: its speed need not be even
_STOPPING = StoppingRule(iterations=10, small_step=1e-2, step_size=centre_step, small_refused=True)
"""The centre is known to 0.03 pixels at best."""


def fit_ball(image: Image, plate: Array | None, guess: BallGuess) -> BallImage | None:
    """Fit the image of a ball.

    Parameters
    ----------
    image : ndarray, shape (h, w, 3)
        Levels from 0 to 255.
    plate : ndarray, shape (h, w, 3), optional
        The same camera's picture without the ball (a clean plate), levels from 0 to 255. Where it does not fit around
        the ball, a plane through the pixels around it is the background.
    guess : BallGuess

    Returns
    -------
    BallImage or None
        None where the ball lies too near the picture's edge.
    """
    window = BallWindow.around(image, plate, guess)
    if window is None:
        return None
    fit = _BallFit.of(window, guess)
    found = minimise(fit.unknowns.start, fit.linearised, fit.moved, damping=GAUSS_NEWTON, stopping=_STOPPING)
    x, rod_sigma = found.state, np.hypot(_ROD_SIGMA, _ROD_SHARE * np.linalg.norm(found.state[PATH]))
    covariance = found.linearised().factor().covariance()[CENTRE, CENTRE]
    covariance += _MIN_SIGMA**2 * np.eye(2) + _PATH_SHARE**2 * np.outer(x[PATH], x[PATH])
    covariance += rod_sigma**2 * guess.rods.T @ guess.rods
    (least, most), ways = np.linalg.eigh(covariance)
    return BallImage(
        centre=x[CENTRE],
        radius=float(x[RADIUS]),
        path=x[PATH],
        appearance=BallAppearance(
            x[LIGHT],
            x[SHADE],
            float(x[WIDTH] / x[RADIUS]) if fit.unknowns.free[WIDTH] else np.nan,
            np.where(fit.unknowns.free[ROD_LIGHT], x[ROD_LIGHT], np.nan),
        ),
        sigma=float(np.sqrt((least + most) / 2)),
        elongation=(most - least) / (most + least) * ways[:, 1],
        explained=fit.explained(x),
    )


@dataclass(frozen=True, eq=False)
class _BallFit:
    """The fit of a ball's image as a least-squares problem.

    Attributes
    ----------
    window : BallWindow
    guess : BallGuess
    unknowns : FreeUnknowns
        Sixteen, see `ball_rendering`.
    inside : ndarray of bool, shape (n, n)
        Which pixels of the window are compared.
    """

    window: BallWindow
    guess: BallGuess
    unknowns: FreeUnknowns
    inside: Bools

    @classmethod
    def of(cls, window: BallWindow, guess: BallGuess) -> _BallFit:
        """Return the problem for the pixels around a ball."""
        inside = np.linalg.norm(window.places - guess.centre, axis=-1) < guess.reach + _LIMB_WIDTH
        start, sigma, free = _start(window, guess)
        return cls(window, guess, FreeUnknowns(start, sigma, free, _STEPS, _MAX_STEPS), inside)

    def residuals(self, images: Array) -> Array:
        """Return by how much images (k, n, n, 3) differ from the one that was observed, standard deviations, (k, m)."""
        off = (images - self.window.observed)[:, self.inside] / _PIXEL_SIGMA
        return off.reshape(len(off), -1) if self.guess.path.any() else (off @ _COMPARED.T).reshape(len(off), -1)

    def linearised(self, x: Array) -> DenseEquations:
        """Return the normal equations of the free unknowns at x."""
        values = self.residuals(self.window.rendered(self.unknowns.varied(x), self.guess))
        now, J = values[0], self.unknowns.derivatives(values)
        weighted = J * (_KERNEL.weight(now**2) / _PIXELS_PER_OBSERVATION)
        H, g = self.unknowns.with_prior(x, weighted @ J.T, weighted @ now)
        return DenseEquations(
            H, g, float(_KERNEL.cost(now**2).sum()) / _PIXELS_PER_OBSERVATION + self.unknowns.prior_cost(x)
        )

    def moved(self, x: Array, step: Array) -> Array:
        """Return the unknowns after a step."""
        after = self.unknowns.moved(x, step)
        after[RADIUS] = max(after[RADIUS], 0.5)
        after[WIDTH] = np.clip(after[WIDTH], 0.05, after[RADIUS])
        return after

    def explained(self, x: Array) -> float:
        """Return the share of the squared difference from the background that the ball explains."""
        now, without = (
            self.residuals(images)[0]
            for images in (self.window.rendered(x[None], self.guess), self.window.empty(x, self.guess)[None])
        )
        weight = _KERNEL.weight(now**2)
        return 1 - float(weight @ now**2) / max(float(weight @ without**2), 1e-12)


def _start(window: BallWindow, guess: BallGuess) -> tuple[Array, Array, Bools]:
    """Return the initial unknowns, their standard deviations, and which of them are solved for, shape (16,) each."""
    core = np.linalg.norm(window.places - guess.centre, axis=-1) < max(0.7 * guess.radius, 1.0)
    light = np.median(linear(255 * window.observed[core]), axis=0) if guess.light is None else guess.light
    length, rods = float(np.linalg.norm(guess.path)), len(guess.rods)
    start, sigma = np.zeros(UNKNOWNS), np.ones(UNKNOWNS)
    start[CENTRE], sigma[CENTRE] = guess.centre, 2.0
    start[RADIUS], sigma[RADIUS] = guess.radius, guess.radius_sigma * guess.radius
    sigma[SHADE] = 0.3
    start[LIGHT], sigma[LIGHT] = np.log(np.maximum(light, MIN_LIGHT)), 1.0 if guess.light is None else 0.4
    start[PATH], sigma[PATH] = guess.path, 0.2 + guess.path_sigma * length
    start[WIDTH], sigma[WIDTH] = 0.3 * guess.radius, 0.1 * guess.radius
    start[ROD_LIGHT] = np.log(0.05)
    start[STARTS][:rods], sigma[STARTS] = guess.starts, 0.25
    if guess.appearance is not None:
        start[LIGHT], sigma[LIGHT] = guess.appearance.light, _APPEARANCE_SIGMA
        start[SHADE], sigma[SHADE] = guess.appearance.shade, _APPEARANCE_SIGMA
        if rods and np.isfinite(guess.appearance.width):
            start[WIDTH], sigma[WIDTH] = guess.appearance.width * guess.radius, _APPEARANCE_SIGMA * guess.radius
            start[ROD_LIGHT], sigma[ROD_LIGHT] = guess.appearance.rod_light, _APPEARANCE_SIGMA
    free = np.ones(UNKNOWNS, bool)
    free[PATH] = length > 0
    free[WIDTH] = free[ROD_LIGHT] = rods > 0
    free[STARTS] = False
    free[STARTS][:rods] = guess.starts < 1
    return start, sigma, free
