"""Levenberg-Marquardt for many small problems at once, each with the two unknowns x and y."""

from __future__ import annotations

from collections.abc import Callable
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

_ROUNDING_DECREASE = 1e-8
"""A nearly full step shorter than 1e-4 standard deviations is taken whatever the cost says: its promised decrease may
be below the rounding of the cost."""

_ROUNDING_STEP = 1e-13
"""A step this small beside the coordinates is rounding: nothing is gained by another."""

_FORETOLD = 1e-9
"""A Newton step is the last when quadratic convergence foretells a next one shorter than this, in standard deviations:
two steps tell the rate."""

_LEAST_SHARE = 0.1
"""Exact second derivatives are trusted when their determinant is at least this share of the stand-in's."""

_NEARLY_FULL = 0.1
"""Up to this damping a step counts as a full one."""

_WORTH_DROPPING = 0.75
"""Settled rows are dropped when fewer than this share of the rows in the work are open: copying costs too."""


@dataclass(frozen=True)
class Evaluation:
    """Cost, gradient and a positive matrix of second derivatives (B,) at one point each.

    ``exact`` (B,) tells where the matrix is that of the exact second derivatives, None that it is nowhere.
    """

    cost: FloatArray
    gradient_x: FloatArray
    gradient_y: FloatArray
    hessian: Symmetric2x2
    exact: BoolArray | None = None

    @classmethod
    def of_newton(
        cls,
        cost: FloatArray,
        gradient_x: FloatArray,
        gradient_y: FloatArray,
        exact: Symmetric2x2,
        stand_in: Symmetric2x2,
        least_share: float = _LEAST_SHARE,
    ) -> Evaluation:
        """Return the evaluation with the exact second derivatives, or a positive stand-in where those are not.

        That is Gauss-Newton's matrix, or the EM algorithm's. ``least_share`` is of the stand-in's determinant.
        """
        positive = (exact.xx > 0.0) & (exact.determinant > least_share * stand_in.determinant)
        if not positive.all():
            pairs = ((exact.xx, stand_in.xx), (exact.xy, stand_in.xy), (exact.yy, stand_in.yy))
            exact = Symmetric2x2(*(np.where(positive, one, other) for one, other in pairs))
        return cls(cost, gradient_x, gradient_y, exact, positive)


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
    """Where each problem (B,) ended, the cost and the second derivatives there, and whether it settled."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: Symmetric2x2
    converged: BoolArray
    evaluations: IntArray

    def take(self, rows: IntArray) -> Minimum:
        """Return the ends of some problems."""
        return Minimum(
            self.x[rows],
            self.y[rows],
            self.cost[rows],
            Symmetric2x2(self.hessian.xx[rows], self.hessian.xy[rows], self.hessian.yy[rows]),
            self.converged[rows],
            self.evaluations[rows],
        )


@dataclass
class _State:
    """The rows still in the work: their place in the block, point, damping, steps refused, evaluation, settled."""

    rows: IntArray
    x: FloatArray
    y: FloatArray
    damping: FloatArray
    refused: IntArray
    at: Evaluation
    settled: BoolArray
    last_length: FloatArray

    def keep(self, mask: BoolArray) -> _State:
        return _State(
            self.rows[mask],
            self.x[mask],
            self.y[mask],
            self.damping[mask],
            self.refused[mask],
            _choose(self.at, mask),
            self.settled[mask],
            self.last_length[mask],
        )


def minimize(
    problem: Problem,
    start_x: FloatArray,
    start_y: FloatArray,
    *,
    tolerance: float = 1e-8,
    max_iterations: int = 30,
    patience: int = 8,
    give_up: Callable[[IntArray, FloatArray, FloatArray], BoolArray] | None = None,
) -> Minimum:
    """Minimize all problems from their starts (B,); rows that have settled are dropped from the work.

    A row has settled when its next full step is shorter than ``tolerance`` standard deviations (the step in the
    metric of the second derivatives), or exact second derivatives foretell that the one after it would be; the
    matrix is that before the last step. Rows whose start is not finite (cost NaN), rows that find no way down and rows
    that have not settled after ``max_iterations`` steps are marked not converged and keep their last point. A row is
    given up after ``patience`` refused steps: the cost has a jump where it would go, as at a sensor; and where
    ``give_up(rows, x, y)`` says so of some problems at their points (N,).
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore", under="ignore"):
        minimum = _unsettled(start_x, start_y)
        rows = np.flatnonzero(np.isfinite(start_x) & np.isfinite(start_y))
        active = problem if rows.shape[0] == start_x.shape[0] else problem.take(rows)
        x, y = start_x[rows], start_y[rows]
        state = _State(
            rows,
            x,
            y,
            np.zeros(rows.shape),
            np.zeros(rows.shape, dtype=np.int64),
            active.evaluate(x, y),
            np.zeros(rows.shape, dtype=bool),
            np.full(rows.shape, np.inf),
        )
        for number in range(1, max_iterations + 1):
            step_x, step_y, length = _step(state)
            arrived = ((length <= tolerance) | _settles_quadratically(state, length)) & ~state.settled
            stalled = state.refused >= patience
            if give_up is not None:
                stalled |= give_up(state.rows, state.x, state.y)
            stalled &= ~(state.settled | arrived)
            if arrived.any() or stalled.any():
                if stalled.any():
                    _record(minimum, state, state.x, state.y, state.at.cost, number, stalled)
                lowered = state.at.cost - 0.5 * length * length
                _record(minimum, state, state.x + step_x, state.y + step_y, lowered, number, arrived)
                minimum.converged[state.rows[arrived]] = True
                state.settled |= arrived | stalled
                open_rows = ~state.settled
                if not open_rows.any():
                    break
                if np.count_nonzero(open_rows) < _WORTH_DROPPING * open_rows.shape[0]:
                    active, state = active.take(np.flatnonzero(open_rows)), state.keep(open_rows)
                    step_x, step_y, length = step_x[open_rows], step_y[open_rows], length[open_rows]
            state = _try_step(active, state, step_x, step_y, length)
        _record(minimum, state, state.x, state.y, state.at.cost, max_iterations + 1, ~state.settled)
        return minimum


def _unsettled(start_x: FloatArray, start_y: FloatArray) -> Minimum:
    nothing = [np.full(start_x.shape, np.nan) for _ in range(4)]
    return Minimum(
        x=start_x.copy(),
        y=start_y.copy(),
        cost=nothing[0],
        hessian=Symmetric2x2(*nothing[1:]),
        converged=np.zeros(start_x.shape, dtype=bool),
        evaluations=np.zeros(start_x.shape, dtype=np.int64),
    )


def _settles_quadratically(state: _State, length: FloatArray) -> BoolArray | bool:
    """Return which problems' steps, both this and the last exact Newton's, foretell that no other is needed."""
    if state.at.exact is None:
        return False
    foretold: BoolArray = length * length * length <= _FORETOLD * state.last_length * state.last_length
    return foretold & state.at.exact & np.isfinite(state.last_length)


def _record(
    minimum: Minimum,
    state: _State,
    x: FloatArray,
    y: FloatArray,
    cost: FloatArray,
    evaluations: int,
    which: BoolArray,
) -> None:
    rows, at = state.rows[which], state.at
    minimum.x[rows], minimum.y[rows] = x[which], y[which]
    minimum.cost[rows], minimum.evaluations[rows] = cost[which], evaluations
    minimum.hessian.xx[rows], minimum.hessian.xy[rows] = at.hessian.xx[which], at.hessian.xy[which]
    minimum.hessian.yy[rows] = at.hessian.yy[which]


def _step(state: _State) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the damped step, and its length in standard deviations (infinite unless it is a full step)."""
    hessian = state.at.hessian
    ridge = state.damping * hessian.trace
    damped = Symmetric2x2(hessian.xx + ridge, hessian.xy, hessian.yy + ridge)
    step_x, step_y = damped.solve(-state.at.gradient_x, -state.at.gradient_y)
    decrease = -(step_x * state.at.gradient_x + step_y * state.at.gradient_y)
    length = np.sqrt(np.maximum(decrease, 0.0))
    step_m, place_m = np.abs(step_x) + np.abs(step_y), np.abs(state.x) + np.abs(state.y)
    length[step_m <= _ROUNDING_STEP * place_m] = 0.0
    unusable = ~np.isfinite(length)
    step_x, step_y = np.where(unusable, 0.0, step_x), np.where(unusable, 0.0, step_y)
    return step_x, step_y, np.where(unusable | (state.damping > _NEARLY_FULL), np.inf, length)


def _try_step(problem: Problem, state: _State, step_x: FloatArray, step_y: FloatArray, length: FloatArray) -> _State:
    x, y = state.x + step_x, state.y + step_y
    trial = problem.evaluate(x, y)
    foreseen = -(step_x * state.at.gradient_x + step_y * state.at.gradient_y)
    short = (foreseen <= _ROUNDING_DECREASE) & (state.damping <= _NEARLY_FULL)
    better = ((trial.cost <= state.at.cost) | short) & ((step_x != 0.0) | (step_y != 0.0))
    newton = better if state.at.exact is None else better & state.at.exact
    eased = np.where(state.damping > 1e-3, state.damping * 0.1, 0.0)
    return _State(
        state.rows,
        np.where(better, x, state.x),
        np.where(better, y, state.y),
        np.where(better, eased, np.maximum(state.damping * 30.0, 1e-3)),
        state.refused + ~better,
        trial if better.all() else _merge(better, trial, state.at),
        state.settled,
        np.where(newton, length, np.inf),
    )


def _choose(at: Evaluation, mask: BoolArray) -> Evaluation:
    hessian = at.hessian
    return Evaluation(
        at.cost[mask],
        at.gradient_x[mask],
        at.gradient_y[mask],
        Symmetric2x2(hessian.xx[mask], hessian.xy[mask], hessian.yy[mask]),
        None if at.exact is None else at.exact[mask],
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
        None if one.exact is None or other.exact is None else np.where(first, one.exact, other.exact),
    )
