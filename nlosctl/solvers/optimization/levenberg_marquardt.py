"""Levenberg-Marquardt for many small problems at once, over a state of D unknowns (x and y in the plane)."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import reduce
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.optimization.problem import Evaluation, Problem

__all__ = ["Minimum", "minimize"]

Point = tuple[FloatArray, ...]
"""The coordinates of points, as D arrays (B,)."""

_ROUNDING_DECREASE = 1e-8
"""A nearly full step shorter than 1e-4 standard deviations is accepted at any cost: the decrease that it
promises may be below the rounding of the cost."""

_ROUNDING_STEP = 1e-13
"""A step this small relative to the coordinates is rounding: another would gain nothing."""

_CUBIC_RATE = 1e-9
"""A Newton step of length L after one of length M is the last if L^3 <= this times M^2: at the quadratic rate L / M^2
the next step would be shorter than this, in standard deviations."""

_NEARLY_FULL = 0.1
"""Up to this damping a step counts as a full one."""

_WORTH_DROPPING = 0.75
"""Settled rows are dropped when fewer than this share of the active rows are open, since copying costs time too."""


class Minimum(NamedTuple):
    """Where each problem (B,) ended, the cost and the second derivatives there, and whether it settled."""

    point: Point
    cost: FloatArray
    hessian: SymmetricMatrix
    converged: BoolArray
    evaluations: IntArray

    @property
    def x(self) -> FloatArray:
        """The first coordinate."""
        return self.point[0]

    @property
    def y(self) -> FloatArray:
        """The second coordinate."""
        return self.point[1]


class _State(NamedTuple):
    """The active rows: their index in the block, point, damping, refused steps, evaluation, whether settled.

    ``last_length`` is the length of the previous step if that was a full exact Newton step, else 0.
    """

    rows: IntArray
    point: Point
    damping: FloatArray
    refused: IntArray
    at: Evaluation
    settled: BoolArray
    last_length: FloatArray


class _Step(NamedTuple):
    """Where the damped steps (B,) lead, whether they move at all, and their length in standard deviations.

    The length is infinite unless it is that of a full step; ``decrease`` is twice what the quadratic model promises.
    """

    point: Point
    moves: BoolArray
    length: FloatArray
    decrease: FloatArray


def minimize(
    problem: Problem,
    *start: FloatArray,
    tolerance: float = 1e-8,
    max_iterations: int = 30,
    patience: int = 8,
    give_up: Callable[..., BoolArray] | None = None,
) -> Minimum:
    """Minimize all problems from their initial points, given as D arrays (B,); settled rows are dropped on the way.

    A row has settled when its next full step is shorter than ``tolerance`` standard deviations (the step in the
    metric of the second derivatives), or when exact second derivatives predict that the step after it would be; the
    matrix is that before the last step. Rows whose initial point is not finite (cost NaN), rows that find no way
    down and rows that have not settled after ``max_iterations`` steps are marked not converged and keep their last
    point. A row is given up after ``patience`` refused steps, which means that the cost jumps where the step leads,
    as at a sensor; and where ``give_up(rows, at, *point)`` returns true for the problems ``rows`` (N,), evaluated
    ``at`` their points.
    """
    with ignoring_overflow():
        minimum = _unsettled(start)
        active, state = _begin(problem, start)
        for number in range(1, max_iterations + 1):
            step = _step(state)
            arrived = (step.length <= tolerance) | _settles_quadratically(state, step.length)
            stalled = state.refused >= patience
            if give_up is not None:
                stalled |= give_up(state.rows, state.at, *state.point)
            if np.count_nonzero(arrived | stalled):
                arrived &= ~state.settled
                stalled &= ~(state.settled | arrived)
                _record(minimum, state, state.point, state.at.cost, number, stalled)
                lowered = state.at.cost - 0.5 * step.length * step.length
                _record(minimum, state, step.point, lowered, number, arrived)
                minimum.converged[state.rows[arrived]] = True
                state = state._replace(settled=state.settled | arrived | stalled)
                open_rows = np.flatnonzero(~state.settled)
                if not open_rows.size:
                    break
                if open_rows.size < _WORTH_DROPPING * state.rows.size:
                    active, state, step = active.take(open_rows), rows_of(state, open_rows), rows_of(step, open_rows)
            state = _try_step(active, state, step)
        _record(minimum, state, state.point, state.at.cost, max_iterations + 1, ~state.settled)
        return minimum


def _unsettled(start: Point) -> Minimum:
    shape = start[0].shape
    return Minimum(
        point=tuple(part.copy() for part in start),
        cost=np.full(shape, np.nan),
        hessian=SymmetricMatrix.full(shape, np.nan, len(start)),
        converged=np.zeros(shape, dtype=bool),
        evaluations=np.zeros(shape, dtype=np.int64),
    )


def _begin(problem: Problem, start: Point) -> tuple[Problem, _State]:
    """Return the problems whose initial point is finite, and their state."""
    rows = np.flatnonzero(np.logical_and.reduce([np.isfinite(part) for part in start]))
    active = problem if rows.shape[0] == start[0].shape[0] else problem.take(rows)
    point = rows_of(start, rows)
    state = _State(
        rows=rows,
        point=point,
        damping=np.zeros(rows.shape),
        refused=np.zeros(rows.shape, dtype=np.int64),
        at=active.evaluate(*point),
        settled=np.zeros(rows.shape, dtype=bool),
        last_length=np.zeros(rows.shape),
    )
    return active, state


def _settles_quadratically(state: _State, length: FloatArray) -> BoolArray | bool:
    """Return where the last two steps were exact Newton steps whose rate predicts a negligible next step."""
    if state.at.exact is None:
        return False
    predicted: BoolArray = length * length * length <= _CUBIC_RATE * state.last_length * state.last_length
    return predicted & state.at.exact


def _record(
    minimum: Minimum, state: _State, point: Point, cost: FloatArray, evaluations: int, which: BoolArray
) -> None:
    if not np.count_nonzero(which):
        return
    rows = state.rows[which]
    for recorded, part in zip(minimum.point, point, strict=True):
        recorded[rows] = part[which]
    minimum.cost[rows], minimum.evaluations[rows] = cost[which], evaluations
    minimum.hessian.put(rows, state.at.hessian.at(which))


def _step(state: _State) -> _Step:
    at, matrix = state.at, state.at.hessian
    is_damped = np.count_nonzero(state.damping) > 0
    if is_damped:
        matrix = matrix.add_to_diagonal(state.damping * matrix.trace)
    up = matrix.solve(*at.gradient)
    decrease = _sum(part * slope for part, slope in zip(up, at.gradient, strict=True))
    length = np.sqrt(np.maximum(decrease, 0.0))
    step_m = _sum(map(np.abs, up))
    length[step_m <= _ROUNDING_STEP * _sum(map(np.abs, state.point))] = 0.0
    usable = np.isfinite(length)
    if np.count_nonzero(usable) < usable.size:
        up = tuple(np.where(usable, part, 0.0) for part in up)
        step_m = np.where(usable, step_m, 0.0)
        length[~usable] = np.inf
    if is_damped:
        length[state.damping > _NEARLY_FULL] = np.inf
    point = tuple(part - rise for part, rise in zip(state.point, up, strict=True))
    return _Step(point, step_m > 0.0, length, decrease)


def _sum(terms: Iterable[FloatArray]) -> FloatArray:
    """Return the sum of the terms, added one by one in order."""
    return reduce(np.add, terms)


def _try_step(problem: Problem, state: _State, step: _Step) -> _State:
    trial = problem.evaluate(*step.point)
    is_full = state.damping <= _NEARLY_FULL
    better = trial.cost <= state.at.cost
    better |= (step.decrease <= _ROUNDING_DECREASE) & is_full
    better &= step.moves
    newton = better & is_full if state.at.exact is None else better & is_full & state.at.exact
    eased = np.where(state.damping > 1e-3, state.damping * 0.1, 0.0)
    return _State(
        state.rows,
        tuple(np.where(better, new, old) for new, old in zip(step.point, state.point, strict=True)),
        np.where(better, eased, np.maximum(state.damping * 30.0, 1e-3)),
        state.refused + ~better,
        trial.where(better, state.at),
        state.settled,
        np.where(newton, step.length, 0.0),
    )
