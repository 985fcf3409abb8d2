"""Nonlinear least squares by Levenberg-Marquardt, for states that are not plain vectors.

A problem is two functions: `linearise` gives the normal equations at a state, with robust weights applied (see
`robust_kernels`), and `move` applies a step. Whether the equations are stored dense, banded or sparse makes no
difference here (see `normal_equations`). To solve from coarse to fine, call `minimise` repeatedly. The method is
algorithm 3.16 of K. Madsen, H. B. Nielsen, O. Tingleff, Methods for non-linear least squares problems (2004), with
Marquardt's diagonal scaling; the interface resembles those of PoseLib and small_gicp.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np

from .arrays import Array, Bools
from .normal_equations import NormalEquations

State = TypeVar("State")
Equations = TypeVar("Equations", bound=NormalEquations[Any, Any])


@dataclass(frozen=True)
class Damping:
    """How the damping of Levenberg-Marquardt, a share of the diagonal, changes with the success of steps.

    Attributes
    ----------
    initial : float
        Damping of the first step; with 0 it is a Gauss-Newton step.
    grow : float
        Factor after a refused step.
    shrink : float
        Factor after an accepted step.
    least : float
        Lower bound of the damping after an accepted step, unless the damping was 0 from the start.
    most : float
        The search ends when the next step would need more damping than this.
    """

    initial: float = 1e-4
    grow: float = 8.0
    shrink: float = 0.1
    least: float = 1e-9
    most: float = 1e6

    def after_refusal(self, damping: float) -> float:
        """Damping to try next, after a step that raised the cost."""
        return max(self.grow * damping, _FIRST_DAMPING)

    def after_success(self, damping: float) -> float:
        """Damping of the next step, after one that lowered the cost."""
        smaller = self.shrink * damping
        return max(smaller, self.least) if self.initial or smaller >= _FIRST_DAMPING else 0.0


GAUSS_NEWTON = Damping(initial=0.0)
"""Full steps; damping is applied only if a step would raise the cost."""
_FIRST_DAMPING = 1e-4  # after an undamped step was refused


@dataclass(frozen=True)
class StoppingRule(Generic[State]):
    """When a minimisation ends.

    Attributes
    ----------
    iterations : int
        It ends after this many accepted steps.
    relative_gain : float
        It ends when a step lowers the cost by no more than this share of it.
    small_step : float
        It ends when a step is smaller than this.
    step_size : callable, optional
        Gives the size of the step from one state to the next, in the unit of `small_step`.
    small_refused : bool
        Whether a small step also ends it if the step is refused, without shorter ones being tried.
    least_promise : float
        A step whose predicted decrease of the cost is below this is not tried.
    negligible : callable, optional
        Whether a step from one state to the next is so small that it is not tried, either.
    """

    iterations: int = 50
    relative_gain: float = 1e-7
    small_step: float = 0.0
    step_size: Callable[[State, State], float] | None = None
    small_refused: bool = False
    least_promise: float = 0.0
    negligible: Callable[[State, State], bool] | None = None

    def converged(self, before: State, after: State, cost_before: float, cost_after: float) -> bool:
        """Whether the accepted step between two states is the last."""
        if cost_before - cost_after <= self.relative_gain * cost_after:
            return True
        return self.small(before, after)

    def small(self, before: State, after: State) -> bool:
        """Whether the step between two states is so small that no other follows it."""
        return self.step_size is not None and self.step_size(before, after) < self.small_step


@dataclass(frozen=True, eq=False)
class LeastSquaresResult(Generic[State, Equations]):
    """Outcome of `minimise`. Everything in it belongs to the returned state.

    Attributes
    ----------
    state : State
    cost_history : tuple of float
        Cost at the start and after every accepted step. It never rises, unless `linearise` changes the problem from
        state to state; see the `trial_cost` of `minimise`.
    converged : bool
        False if the iterations ran out, or if no damping gave a step that lowered the cost.
    linearised : callable
        Returns the normal equations at the state; the covariance of its unknowns follows from their `factor()`. If
        steps were tested by a `trial_cost`, every call linearises anew.
    """

    state: State
    cost_history: tuple[float, ...]
    converged: bool
    linearised: Callable[[], Equations]

    @property
    def cost(self) -> float:
        """Robust sum of squared residuals at the state."""
        return self.cost_history[-1]

    @property
    def iterations(self) -> int:
        """Accepted steps."""
        return len(self.cost_history) - 1


def minimise(
    state: State,
    linearise: Callable[[State], Equations],
    move: Callable[[State, Any], State],
    *,
    trial_cost: Callable[[State, Equations], float] | None = None,
    damping: Damping = Damping(),
    stopping: StoppingRule[State] = StoppingRule(),
    on_iteration: Callable[[int, State], None] | None = None,
) -> LeastSquaresResult[State, Equations]:
    """Minimise a robust sum of squares from a start.

    Every step is tested: one that raises the cost is refused and tried again with more damping.

    Parameters
    ----------
    state : State
        The start; states are values and are not changed.
    linearise : callable
        Normal equations at a state.
    move : callable
        Returns the state after a step that came from `NormalEquations.solve`. It may shorten or lengthen the step.
    trial_cost : callable, optional
        Returns the cost of a trial state, given the equations from which the step was computed. It is needed if
        `linearise` chooses associations or weights anew at every state, because these must not change while a step is
        tested; it is useful if it is much cheaper than `linearise`. By default a trial state is linearised, which gives
        its cost and the equations for the next step.
    damping : Damping
    stopping : StoppingRule
    on_iteration : callable, optional
        Called before every trial with the number of accepted steps and the state; may raise to cancel.

    Returns
    -------
    LeastSquaresResult
    """
    equations, share = linearise(state), damping.initial
    history, converged, stale = [equations.cost], False, False
    while not converged and len(history) <= stopping.iterations and share <= damping.most:
        if on_iteration is not None:
            on_iteration(len(history) - 1, state)
        if stale:
            equations, stale = linearise(state), False
        step = _finite_step(equations, share)
        if step is None:
            share = damping.after_refusal(share)
            continue
        # Without damping, the predicted gain is half the slope: along the step, the slope falls linearly to zero.
        if converged := -equations.slope(step) / 2 < stopping.least_promise:
            break
        trial = move(state, step)
        if converged := stopping.negligible is not None and stopping.negligible(state, trial):
            break
        ahead = linearise(trial) if trial_cost is None else equations
        cost = ahead.cost if trial_cost is None else trial_cost(trial, equations)
        if cost <= equations.cost:
            converged = stopping.converged(state, trial, equations.cost, cost)
            state, equations, stale = trial, ahead, trial_cost is not None
            history.append(cost)
            share = damping.after_success(share)
        else:
            # A step with almost no predicted gain is refused only because of rounding: the state is the minimum.
            converged = -equations.slope(step) <= stopping.relative_gain * equations.cost
            converged |= stopping.small_refused and stopping.small(state, trial)
            share = damping.after_refusal(share)
    last = (lambda: linearise(state)) if stale else (lambda: equations)
    return LeastSquaresResult(state, tuple(history), converged, last)


def moving_only(move: Callable[[State, Array], State], free: Bools) -> Callable[[State, Array], State]:
    """Return `move` for steps of the free unknowns alone: the others are held.

    Parameters
    ----------
    move : callable
        Applies a step of all N unknowns to a state.
    free : ndarray of bool, shape (N,)
    """

    def move_free(state: State, step: Array) -> State:
        whole = np.zeros(len(free))
        whole[free] = step
        return move(state, whole)

    return move_free


def _finite_step(equations: NormalEquations[Any, Any], damping: float) -> Any | None:
    """Return the damped step, or None where the damped matrix is not positive definite."""
    try:
        step = equations.solve(damping)
    except np.linalg.LinAlgError:
        return None
    return step if np.isfinite(equations.slope(step)) else None
