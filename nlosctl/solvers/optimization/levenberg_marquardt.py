"""Levenberg-Marquardt for many small problems at once, each with the two unknowns x and y."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.solvers.optimization.array_tuples import pick_rows, take_rows_of
from nlosctl.solvers.optimization.problem import Evaluation, Problem

__all__ = ["Minimum", "minimize"]


_ROUNDING_DECREASE = 1e-8
"""A nearly full step shorter than 1e-4 standard deviations is taken whatever the cost says: its promised decrease may
be below the rounding of the cost."""

_ROUNDING_STEP = 1e-13
"""A step this small beside the coordinates is rounding: nothing is gained by another."""

_FORETOLD = 1e-9
"""A Newton step is the last when quadratic convergence foretells a next one shorter than this, in standard deviations:
two steps tell the rate."""

_NEARLY_FULL = 0.1
"""Up to this damping a step counts as a full one."""

_WORTH_DROPPING = 0.75
"""Settled rows are dropped when fewer than this share of the rows in the work are open: copying costs too."""


class Minimum(NamedTuple):
    """Where each problem (B,) ended, the cost and the second derivatives there, and whether it settled."""

    x: FloatArray
    y: FloatArray
    cost: FloatArray
    hessian: Symmetric2x2
    converged: BoolArray
    evaluations: IntArray

    def take(self, rows: IntArray) -> Minimum:
        """Return the ends of some problems."""
        return take_rows_of(self, rows)


class _State(NamedTuple):
    """The rows still in the work: their place in the block, point, damping, steps refused, evaluation, settled.

    ``last_length`` is that of the step before, if that was a full exact Newton step, else 0: it foretells nothing.
    """

    rows: IntArray
    x: FloatArray
    y: FloatArray
    damping: FloatArray
    refused: IntArray
    at: Evaluation
    settled: BoolArray
    last_length: FloatArray


class _Step(NamedTuple):
    """Where the damped steps (B,) lead, whether they move at all, and their length in standard deviations.

    The length is infinite unless it is that of a full step; ``decrease`` is twice what the quadratic model promises.
    """

    x: FloatArray
    y: FloatArray
    moves: BoolArray
    length: FloatArray
    decrease: FloatArray


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
    with ignoring_overflow():
        minimum = _unsettled(start_x, start_y)
        active, state = _begin(problem, start_x, start_y)
        for number in range(1, max_iterations + 1):
            step = _step(state)
            arrived = (step.length <= tolerance) | _settles_quadratically(state, step.length)
            stalled = state.refused >= patience
            if give_up is not None:
                stalled |= give_up(state.rows, state.x, state.y)
            if np.count_nonzero(arrived | stalled):
                arrived &= ~state.settled
                stalled &= ~(state.settled | arrived)
                _record(minimum, state, state.x, state.y, state.at.cost, number, stalled)
                lowered = state.at.cost - 0.5 * step.length * step.length
                _record(minimum, state, step.x, step.y, lowered, number, arrived)
                minimum.converged[state.rows[arrived]] = True
                state = state._replace(settled=state.settled | arrived | stalled)
                open_rows = np.flatnonzero(~state.settled)
                if not open_rows.size:
                    break
                if open_rows.size < _WORTH_DROPPING * state.rows.size:
                    active, state, step = (
                        active.take(open_rows),
                        take_rows_of(state, open_rows),
                        take_rows_of(step, open_rows),
                    )
            state = _try_step(active, state, step)
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


def _begin(problem: Problem, start_x: FloatArray, start_y: FloatArray) -> tuple[Problem, _State]:
    """Return the problems whose start is finite, and their state."""
    rows = np.flatnonzero(np.isfinite(start_x) & np.isfinite(start_y))
    active = problem if rows.shape[0] == start_x.shape[0] else problem.take(rows)
    x, y = start_x[rows], start_y[rows]
    state = _State(
        rows=rows,
        x=x,
        y=y,
        damping=np.zeros(rows.shape),
        refused=np.zeros(rows.shape, dtype=np.int64),
        at=active.evaluate(x, y),
        settled=np.zeros(rows.shape, dtype=bool),
        last_length=np.zeros(rows.shape),
    )
    return active, state


def _settles_quadratically(state: _State, length: FloatArray) -> BoolArray | bool:
    """Return which problems' steps, both this and the last exact Newton's, foretell that no other is needed."""
    if state.at.exact is None:
        return False
    foretold: BoolArray = length * length * length <= _FORETOLD * state.last_length * state.last_length
    return foretold & state.at.exact


def _record(
    minimum: Minimum,
    state: _State,
    x: FloatArray,
    y: FloatArray,
    cost: FloatArray,
    evaluations: int,
    which: BoolArray,
) -> None:
    if not np.count_nonzero(which):
        return
    rows = state.rows[which]
    minimum.x[rows], minimum.y[rows] = x[which], y[which]
    minimum.cost[rows], minimum.evaluations[rows] = cost[which], evaluations
    for recorded, part in zip(minimum.hessian, state.at.hessian, strict=True):
        recorded[rows] = part[which]


def _step(state: _State) -> _Step:
    at, matrix = state.at, state.at.hessian
    is_damped = np.count_nonzero(state.damping) > 0
    if is_damped:
        ridge = state.damping * matrix.trace
        matrix = Symmetric2x2(matrix.xx + ridge, matrix.xy, matrix.yy + ridge)
    up_x, up_y = matrix.solve(at.gradient_x, at.gradient_y)
    decrease = up_x * at.gradient_x + up_y * at.gradient_y
    length = np.sqrt(np.maximum(decrease, 0.0))
    step_m = np.abs(up_x) + np.abs(up_y)
    length[step_m <= _ROUNDING_STEP * (np.abs(state.x) + np.abs(state.y))] = 0.0
    usable = np.isfinite(length)
    if np.count_nonzero(usable) < usable.size:
        up_x, up_y, step_m = (np.where(usable, values, 0.0) for values in (up_x, up_y, step_m))
        length[~usable] = np.inf
    if is_damped:
        length[state.damping > _NEARLY_FULL] = np.inf
    return _Step(state.x - up_x, state.y - up_y, step_m > 0.0, length, decrease)


def _try_step(problem: Problem, state: _State, step: _Step) -> _State:
    trial = problem.evaluate(step.x, step.y)
    is_full = state.damping <= _NEARLY_FULL
    better = trial.cost <= state.at.cost
    better |= (step.decrease <= _ROUNDING_DECREASE) & is_full
    better &= step.moves
    newton = better & is_full if state.at.exact is None else better & is_full & state.at.exact
    eased = np.where(state.damping > 1e-3, state.damping * 0.1, 0.0)
    return _State(
        state.rows,
        np.where(better, step.x, state.x),
        np.where(better, step.y, state.y),
        np.where(better, eased, np.maximum(state.damping * 30.0, 1e-3)),
        state.refused + ~better,
        pick_rows(better, trial, state.at),
        state.settled,
        np.where(newton, step.length, 0.0),
    )
