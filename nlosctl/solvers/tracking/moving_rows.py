"""The rows of a snapshot whose source moves: position and one velocity, each row at its own time.

The unknowns of a snapshot are the position at the mean time of its rows, about the local origin, and the velocity times
the duration T of the snapshot, both in metres: row i measures at p + s_i w with the share s_i = (t_i - t) / T, and has
the derivatives [g, s_i g] of those by its own position.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, Point, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, max_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.optimization.problem import Evaluation
from nlosctl.solvers.tracking.path_rows import ComparableRows

__all__ = ["MovingRows", "split_state"]


def split_state(state: Point) -> tuple[Point, Point]:
    """Return the position and the movement of a state, half of its arrays each."""
    half = len(state) // 2
    return state[:half], state[half:]


@dataclass(frozen=True)
class MovingRows(RowBlock):
    """Rows (B, K) about local origins, whose sensors, or images of them, are at ``origin`` (D arrays (B, K)).

    ``share`` (B, K) are times of rows after the mean time, over the duration ``duration_s`` (B,), 1 where all rows are
    of one time. States are 2 D arrays (B,): the position, and the movement within the duration.
    """

    rows: ComparableRows
    origin: Point
    share: FloatArray
    duration_s: FloatArray

    @classmethod
    def of(cls, rows: ComparableRows, origin: Point, elapsed_s: FloatArray) -> MovingRows:
        """Return rows at times (B, K) after their mean."""
        duration = max_measurements(elapsed_s) + max_measurements(-elapsed_s)
        duration = np.where(duration > 0.0, duration, 1.0)
        return cls(rows, origin, np.asfortranarray(elapsed_s / duration[:, None]), duration)

    @property
    def count(self) -> int:
        """The number of rows of each snapshot, K."""
        return int(self.share.shape[1])

    @property
    def extent_m(self) -> FloatArray:
        """The diagonal (B,) of the box around the sensors."""
        sides = [max_measurements(part) + max_measurements(-part) for part in self.origin]
        return reduce(np.hypot, sides)

    def point(self, k: int, state: Point) -> Point:
        """Return the position (B,) of the source at the time of row ``k``."""
        position, movement = split_state(state)
        return tuple(part + self.share[:, k] * move for part, move in zip(position, movement, strict=True))

    def distance_m(self, state: Point) -> FloatArray:
        """Return the distance (B, K) of the source from each row's sensor at the time of the row."""
        position, movement = split_state(state)
        away = [
            part[:, None] + self.share * move[:, None] - own
            for part, move, own in zip(position, movement, self.origin, strict=True)
        ]
        return reduce(np.hypot, away)

    def evaluate(self, *state: FloatArray) -> Evaluation:
        """Return half the chi-square, its gradient and second derivatives, or Gauss-Newton's, at states."""
        shape, size = state[0].shape, len(state)
        cost, gradient = np.zeros(shape), tuple(np.zeros(shape) for _ in state)
        gauss, exact = (SymmetricMatrix.full(shape, 0.0, size) for _ in range(2))
        with ignoring_overflow():
            for k in range(self.count):
                row = self.rows.derivatives(k, *self.point(k, state))
                share = self.share[:, k]
                cost += row.half_chi_square
                for axis, slope in enumerate(row.gradient):
                    gradient[axis][...] += slope
                    gradient[len(row.gradient) + axis][...] += share * slope
                _add_moved(gauss, row.gauss, share)
                _add_moved(exact, row.hessian, share)
            return Evaluation.of_newton(cost, gradient, exact, gauss)

    def information(self, state: Point) -> SymmetricMatrix:
        """Return the Fisher information (B,) of states, in 1 / m^2."""
        total = SymmetricMatrix.full(state[0].shape, 0.0, len(state))
        with ignoring_overflow():
            for k in range(self.count):
                row = self.rows.derivatives(k, *self.point(k, state))
                _add_moved(total, row.gauss, self.share[:, k])
        return total

    def residuals(self, residuals: Any, state: Point) -> dict[str, FloatArray]:
        """Return measured minus predicted values (B, K) by name; ``residuals`` are those at one point of all rows."""
        columns: dict[str, FloatArray] = {}
        for k in range(self.count):
            for name, values in residuals(*self.point(k, state)).items():
                columns.setdefault(name, np.empty(self.share.shape, order="F"))[:, k] = values[:, k]
        return columns


def _add_moved(total: SymmetricMatrix, matrix: SymmetricMatrix, share: FloatArray) -> None:
    """Add a row's matrix (B,) by its own position to that of the state, in place."""
    size = matrix.dimension
    moved = [matrix, matrix * share, matrix * (share * share)]
    parts = iter(total.parts)
    for one in range(2 * size):
        for other in range(one + 1):
            part = next(parts)
            part += moved[(one >= size) + (other >= size)].entry(one % size, other % size)
