"""Levenberg-Marquardt for many small problems at once, each with the two unknowns x and y."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.symmetric import Symmetric2x2

__all__ = ["Evaluation", "Minimum", "Problem", "minimize"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]
ProblemT = TypeVar("ProblemT", bound="Problem")

_ROUNDING = 1e-12
"""Rise of the cost, in parts of 1 + cost, that may be rounding alone: such a step near the minimum is a good one.

Residuals of ranges far longer than their standard deviation round at about range / std times 1e-16.
"""


@dataclass(frozen=True)
class Evaluation:
    """Cost, gradient and Gauss-Newton matrix (B,) of the problems at one point each.

    The matrix may be that of Newton's method where it is positive definite.
    """

    cost: FloatArray
    gradient_x: FloatArray
    gradient_y: FloatArray
    hessian: Symmetric2x2


class Problem(Protocol):
    """B problems. ``cost`` is half a sum of squares of residuals scaled by their standard deviation."""

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return the evaluation at points (B,)."""
        ...

    def take(self: ProblemT, rows: IntArray) -> ProblemT:
        """Return the problems of some rows."""
        ...


@dataclass(frozen=True)
class Minimum:
    """Where each problem (B,) ended, the cost and the Gauss-Newton matrix there, and whether it settled."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: Symmetric2x2
    converged: BoolArray
    evaluations: IntArray


@dataclass
class _State:
    rows: IntArray
    x: FloatArray
    y: FloatArray
    damping: FloatArray
    at: Evaluation

    def keep(self, mask: BoolArray) -> _State:
        return _State(self.rows[mask], self.x[mask], self.y[mask], self.damping[mask], _choose(self.at, mask))


def minimize(
    problem: Problem,
    start_x: FloatArray,
    start_y: FloatArray,
    *,
    tolerance: float = 1e-9,
    max_iterations: int = 100,
) -> Minimum:
    """Minimize all problems from their starts (B,); rows that have settled are dropped from the work.

    A row has settled when its next full step is shorter than ``tolerance`` standard deviations (the step in the
    metric of the Gauss-Newton matrix). Rows whose start is not finite, and rows that have not settled after
    ``max_iterations`` steps, are marked not converged and keep their last point.
    """
    x, y = start_x.copy(), start_y.copy()
    converged = np.zeros(x.shape, dtype=bool)
    evaluations = np.zeros(x.shape, dtype=np.int64)
    rows = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    active = problem.take(rows)
    state = _State(rows, x[rows], y[rows], np.zeros(rows.shape), active.evaluate(x[rows], y[rows]))
    evaluations[rows] += 1
    for _ in range(max_iterations):
        if not state.rows.size:
            break
        step_x, step_y, length = _step(state)
        settled = length <= tolerance
        if settled.any():
            done = state.rows[settled]
            x[done], y[done] = (state.x + step_x)[settled], (state.y + step_y)[settled]
            converged[done] = True
            active = active.take(np.flatnonzero(~settled))
            state = state.keep(~settled)
            step_x, step_y = step_x[~settled], step_y[~settled]
        evaluations[state.rows] += 1
        state = _try_step(active, state, step_x, step_y)
    x[state.rows], y[state.rows] = state.x, state.y
    final = problem.evaluate(x, y)
    return Minimum(x, y, final.cost, final.hessian, converged, evaluations)


def _step(state: _State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the damped step, and its length in standard deviations (infinite unless it is a full step)."""
    hessian = state.at.hessian
    ridge = state.damping * hessian.trace
    damped = Symmetric2x2(hessian.xx + ridge, hessian.xy, hessian.yy + ridge)
    step_x, step_y = damped.solve(-state.at.gradient_x, -state.at.gradient_y)
    with np.errstate(invalid="ignore", over="ignore"):
        decrease = -(step_x * state.at.gradient_x + step_y * state.at.gradient_y)
        length = np.sqrt(np.maximum(decrease, 0.0))
    unusable = ~np.isfinite(length)
    step_x, step_y = np.where(unusable, 0.0, step_x), np.where(unusable, 0.0, step_y)
    return step_x, step_y, np.where(unusable | (state.damping > 0.1), np.inf, length)


def _try_step(problem: Problem, state: _State, step_x: FloatArray, step_y: FloatArray) -> _State:
    x, y = state.x + step_x, state.y + step_y
    trial = problem.evaluate(x, y)
    with np.errstate(invalid="ignore"):
        not_worse = trial.cost <= state.at.cost + _ROUNDING * (1.0 + state.at.cost)
        better = not_worse & ((step_x != 0.0) | (step_y != 0.0))
    eased = np.where(state.damping > 1e-6, state.damping * 0.1, 0.0)
    return _State(
        state.rows,
        np.where(better, x, state.x),
        np.where(better, y, state.y),
        np.where(better, eased, np.maximum(state.damping * 10.0, 1e-3)),
        _merge(better, trial, state.at),
    )


def _choose(at: Evaluation, mask: BoolArray) -> Evaluation:
    hessian = at.hessian
    return Evaluation(
        at.cost[mask],
        at.gradient_x[mask],
        at.gradient_y[mask],
        Symmetric2x2(hessian.xx[mask], hessian.xy[mask], hessian.yy[mask]),
    )


def _merge(first: BoolArray, one: Evaluation, other: Evaluation) -> Evaluation:
    def pick(a: FloatArray, b: FloatArray) -> FloatArray:
        return np.where(first, a, b)

    return Evaluation(
        pick(one.cost, other.cost),
        pick(one.gradient_x, other.gradient_x),
        pick(one.gradient_y, other.gradient_y),
        Symmetric2x2(
            pick(one.hessian.xx, other.hessian.xx),
            pick(one.hessian.xy, other.hessian.xy),
            pick(one.hessian.yy, other.hessian.yy),
        ),
    )
