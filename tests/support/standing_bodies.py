"""Bodies whose feet stand, as tracked with errors that made normal equations leave open, and brought to rest."""

from __future__ import annotations

import numpy as np
from kfmocap.core.body import Body, human, part_poses
from kfmocap.core.body.motion import Motion
from kfmocap.core.body.soles import Soles
from kfmocap.core.numerics.banded_blocks import BandedBlocks
from kfmocap.core.shot.settings import Settings
from kfmocap.core.tracking.solvers.equations.problem import SegmentProblem
from kfmocap.core.tracking.solvers.plants.standing_feet import with_plants_at_rest
from kfmocap.core.tracking.solvers.protocol import SettledMotions, SolvedFrames
from scipy.linalg import solve_banded
from synthetic import CAMERAS, dark, ends_held

Array = np.ndarray
BODY, FPS, FRAMES = human(1.75), 30.0, 31
PLACE, STEP = 0.004, 0.0015
"""What the evidence leaves open of a degree of freedom on a frame, and from one frame to the next, radians and metres:
soles jitter by millimetres and drift by a centimetre."""
EXACT = np.ones(len(BODY))
"""Ratios of squared errors: they are as the evidence predicts."""
FIXED = ends_held(BODY, FRAMES)
SOLES = Soles.of(BODY)
assert SOLES is not None


def evidence() -> BandedBlocks:
    """Normal equations of independent degrees of freedom, at their solution."""
    made = BandedBlocks.zeros(FRAMES, BODY.dof)
    own = np.full(FRAMES, PLACE**-2 + 2 * STEP**-2)
    own[[0, -1]] -= STEP**-2
    made.diagonal[:] = own[:, None, None] * np.eye(BODY.dof)
    made.first[:] = -(STEP**-2) * np.eye(BODY.dof)
    return made


def tracked(truth: Motion, seed: int) -> Motion:
    """The truth with an error that the evidence leaves open, exact on the first and the last frame."""
    dice = np.random.default_rng(seed)
    inner = FRAMES - 2
    band = np.stack(
        [np.full(inner, -(STEP**-2)), np.full(inner, PLACE**-2 + 2 * STEP**-2), np.full(inner, -(STEP**-2))]
    )
    # A sum of the evidence's own residuals, solved for: its covariance is that of the normal equations.
    pull = dice.normal(0, 1 / PLACE, (inner, BODY.dof)) + np.diff(
        dice.normal(0, 1 / STEP, (inner + 1, BODY.dof)), axis=0
    )
    error = np.zeros((FRAMES, BODY.dof))
    error[1:-1] = solve_banded((1, 1), band, pull)
    return truth.moved(error)


def problem_of(*bodies: Body, plants: bool = True) -> SegmentProblem:
    views = tuple(view for camera in CAMERAS for view in dark(camera, FRAMES))
    return SegmentProblem(views, bodies, 0, FPS, tuple(FIXED for _ in bodies), settings=Settings(plants=plants))


def rested(*motions: Motion) -> SettledMotions:
    problem, ratios = problem_of(*(BODY for _ in motions)), [EXACT for _ in motions]
    return with_plants_at_rest(problem, [evidence() for _ in motions], motions, SolvedFrames(motions), ratios=ratios)


def soles_of(motion: Motion) -> Array:
    return SOLES.world(part_poses(BODY, motion))


def planted(motion: Motion) -> Array:
    return SOLES.planted(part_poses(BODY, motion), FPS)
