"""Fitting to the performers' outlines on key frames, coarse to fine; shared by the fits of cameras and of bodies.

As in the iterative closest point algorithm, the outlines are searched for at every state and held while a step is
tested: the model's points move, and their distances along the outlines' normals must decrease.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..body.kinematics import Poses
from ..cameras.camera import Camera
from ..evidence.foreground_images.foreground import foreground_images
from ..evidence.outline_evidence.outline_lines import KEY_FRAME_PIECE, Lines, LineSearch, outline_lines
from ..evidence.part_shapes import shape_columns, stretched
from ..evidence.rendering.label_images import render_labels
from ..evidence.rendering.part_geometry import Geometry
from ..numerics.arrays import Array
from ..numerics.least_squares import GAUSS_NEWTON, LeastSquaresResult, StoppingRule, minimise
from ..numerics.normal_equations import NormalEquations
from ..runtime.progress import Progress, report_progress

_STRIDE = 2  # of the pixels at which the model's parts are looked up to find its outlines


@dataclass(frozen=True)
class RefinementStage:
    """One stage of a fit from coarse to fine.

    Attributes
    ----------
    reach : float
        Distance from the model's outlines within which the performers' are searched for, metres.
    tolerance : float
        Factor on the limit of the robust kernel: 1 near the solution, more far from it.
    iterations : int
        Largest number of iterations.
    excess : float
        Relative amount by which the model's solids may be wider than the performers: colours are learned only from
        pixels that surely show a performer.
    learns_once : bool
        Whether colours are learned only at the stage's start, rather than at every state.
    """

    reach: float
    tolerance: float
    iterations: int
    excess: float = 0.0
    learns_once: bool = False

    def precision(self) -> float:
        """Return the weight of squared distances from outlines, metres^-2; see `KEY_FRAME_PIECE`."""
        return 1 / (KEY_FRAME_PIECE * self.tolerance**2)


State = TypeVar("State")
Equations = TypeVar("Equations", bound=NormalEquations[Any, Any])


@dataclass(frozen=True, eq=False)
class OutlineProblem(Generic[State, Equations]):
    """The functions that define a fit to outlines.

    Attributes
    ----------
    linearise : callable
        Returns the normal equations at a state, with the outlines that a stage finds there.
    move : callable
        Returns the state after a step.
    cost_at : callable
        Returns the cost of a state with the outlines from which normal equations were made.
    step_size : callable
        Returns the distance between two states.
    settled : float
        A stage ends after a step smaller than this.
    """

    linearise: Callable[[State, RefinementStage], Equations]
    move: Callable[[State, Any], State]
    cost_at: Callable[[State, Equations], float]
    step_size: Callable[[State, State], float]
    settled: float


def coarse_to_fine(
    start: State,
    problem: OutlineProblem[State, Equations],
    stages: Sequence[RefinementStage],
    what: str,
    progress: Progress | None,
) -> LeastSquaresResult[State, Equations]:
    """Run one minimisation per stage, and return the last.

    Parameters
    ----------
    start : State
    problem : OutlineProblem
    stages : sequence of RefinementStage
        At least one.
    what : str
        Name of the stage that is reported to `progress`.
    progress : callable, optional
        See `core.runtime.progress.Progress`.

    Raises
    ------
    CancelledError
    """
    state = start
    for s, stage in enumerate(stages):

        def linearise(state: State, stage: RefinementStage = stage) -> Equations:
            return problem.linearise(state, stage)

        def report(iteration: int, _: State, s: int = s, stage: RefinementStage = stage) -> None:
            report_progress(progress, what, (s + iteration / stage.iterations) / len(stages))

        result = minimise(
            state,
            linearise,
            problem.move,
            trial_cost=problem.cost_at,
            damping=GAUSS_NEWTON,
            stopping=StoppingRule(stage.iterations, 0.0, problem.settled, problem.step_size),
            on_iteration=report,
        )
        state = result.state
    report_progress(progress, what, 1.0)
    return result


def key_foreground(
    pictures: NDArray[np.uint8], camera: Camera, geometry: Geometry, poses: Poses, stage: RefinementStage
) -> NDArray[np.uint8]:
    """Return the foreground images of key frames, (K, h, w), with colours learned at the present poses.

    Parameters
    ----------
    pictures : ndarray of uint8, shape (K, h, w, 3)
    camera : Camera
        The camera of the K key frames.
    geometry : Geometry
    poses : tuple of ndarray, shapes (K, P, 3, 3) and (K, P, 3)
    stage : RefinementStage
    """
    body = render_labels(geometry, camera, 0, *poses).part >= 0
    core = body
    if stage.excess:
        slimmer = np.tile([-stage.excess, -stage.excess / 2, -stage.excess, 0, 0, 0], (len(geometry.spans), 1))
        core = render_labels(stretched(geometry, slimmer), camera, 0, *poses).part >= 0
    masks = dict(enumerate(body))
    return foreground_images(pictures, masks, _scale(camera, poses), camera.stands_still, dict(enumerate(core)))


def key_outlines(
    foreground: NDArray[np.uint8], camera: Camera, geometry: Geometry, poses: Poses, stage: RefinementStage
) -> Lines:
    """Find the outlines in the foreground images of key frames; parameters as in `key_foreground`."""
    labels = render_labels(geometry, camera.subsampled(_STRIDE), 0, *poses)
    half = max(4, round(stage.reach * _scale(camera, poses)))
    every = np.broadcast_to(foreground, (int(geometry.performer.max()) + 1, *foreground.shape))
    return outline_lines(camera, every, labels, LineSearch(_STRIDE, half, stage.tolerance))


def _scale(camera: Camera, poses: Poses) -> float:
    """Return the pixels per metre at the performers."""
    return camera.pixels_per_metre(poses[1].mean(axis=(0, 1)))


def outline_products(lines: Lines, camera: Camera, poses: Poses) -> Array:
    """Sum the products of the search lines' rows per frame and part, shape (K, P, 11, 11).

    A row holds the wrench in camera axes (6), the derivatives of the distance by the logarithm of the focal length (1)
    and by the part's stretches (3), and the distance itself, metres.
    """
    wrench = lines.wrenches(camera)
    radial = ((lines.uv - camera.matrix[:2, 2]) * lines.normal).sum(axis=1)
    stretch, _ = shape_columns(lines, wrench, camera, poses)
    return lines.products(np.column_stack([wrench, radial, stretch, lines.shift]), *poses[1].shape[:2])
