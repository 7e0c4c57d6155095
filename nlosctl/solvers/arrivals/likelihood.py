"""Arrival times as batched least-squares problems: of the times, and of squared range differences."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock, sum_measurements, sum_products
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["AT_INFINITY", "PLAUSIBLE_NATS", "ArrivalProblem", "SquaredDifferenceProblem"]

_LEAST_SHARE = 0.01
"""Newton's matrix is trusted when its determinant is at least this share of Gauss-Newton's."""

PLAUSIBLE_NATS = 10.0
"""Half a chi-square of at most this plus two per degree of freedom is that of a good fit."""

AT_INFINITY = 1e3
"""A descent that ends this many array sizes away is on its way to a plane wave."""

_FARTHEST = 1e6
"""Points this many array sizes away are never tried: there the arrivals vanish in the rounding of the distances."""


@dataclass(frozen=True)
class ArrivalProblem(RowBlock):
    """Half the chi-square of arrivals as a function of a point about the local origin, the offset eliminated."""

    rows: ArrivalRows
    reach_m: FloatArray

    @classmethod
    def of_rows(cls, rows: ArrivalRows) -> ArrivalProblem:
        """Return the problem of a block of arrivals."""
        return cls(rows, _FARTHEST * rows.size_m())

    def evaluate(self, *point: FloatArray) -> Evaluation:
        """Return cost, gradient and Newton's matrix, or the Gauss-Newton matrix where that is not positive definite.

        Newton's matrix is J'J minus the sum of r_i / s_i (I - u u') / distance, see `ArrivalRows.bending`. Infinite
        beyond the reach.
        """
        rows = self.rows
        with ignoring_overflow():
            at = rows.compare(*point)
            simple = SymmetricMatrix.gram(*at.slopes)
            bend = rows.bending(at)
            newton = simple + SymmetricMatrix.gram(*at.along, weight=bend)
            newton = newton.add_to_diagonal(-sum_measurements(bend))
            cost = 0.5 * sum_products(at.residual, at.residual)
            gradient = tuple(sum_products(slope, at.residual) for slope in at.slopes)
            if rows.level is not None:
                precision, scaled = rows.level.inverse_std, rows.level.scaled_residual(point[-1])
                cost += 0.5 * scaled * scaled
                gradient[-1][:] += scaled * precision
                for matrix in (simple, newton):
                    matrix.diagonal[-1][:] += precision * precision
            away = np.sqrt(sum(part * part for part in point))
            cost = np.where(away > self.reach_m, np.inf, cost)
        return Evaluation.of_newton(cost, gradient, newton, simple, _LEAST_SHARE)


@dataclass(frozen=True)
class SquaredDifferenceProblem(RowBlock):
    """Half the sum of squares of rows (B, M) of B y - g over y = (x - a, |x - a|), a the reference (B,) sensor.

    Beck, Stoica, Li 2008. ``coefficients`` are D + 1 arrays (B, M); ``height`` (B,) is the reference's over a plane.
    """

    coefficients: tuple[FloatArray, ...]
    right: FloatArray
    reference: tuple[FloatArray, ...]
    height: FloatArray
    reach_m: FloatArray

    def evaluate(self, *point: FloatArray) -> Evaluation:
        """Return cost, gradient and Newton's matrix, or the Gauss-Newton matrix where that is not positive definite."""
        with ignoring_overflow():
            residual, slopes, along, distance = self._rows(point)
            cost = 0.5 * sum_measurements(residual * residual)
            gradient = tuple(sum_measurements(slope * residual) for slope in slopes)
            simple = SymmetricMatrix.gram(*slopes)
            bend = sum_measurements(residual * self.coefficients[-1]) / distance
            newton = (simple - SymmetricMatrix.outer(*along, weight=bend)).add_to_diagonal(bend)
            away = np.sqrt(sum(part * part for part in point))
            cost = np.where(away > self.reach_m, np.inf, cost)
        return Evaluation.of_newton(cost, gradient, newton, simple, _LEAST_SHARE)

    def slopes(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return the D derivatives (B, M) of the rows at points (B,)."""
        with ignoring_overflow():
            return self._rows(point)[1]

    def half_squares(self, *point: FloatArray) -> FloatArray:
        """Return the cost (B,) at points (B,)."""
        with ignoring_overflow():
            residual = self._rows(point)[0]
        return 0.5 * sum_measurements(residual * residual)

    def _rows(
        self, point: tuple[FloatArray, ...]
    ) -> tuple[FloatArray, tuple[FloatArray, ...], tuple[FloatArray, ...], FloatArray]:
        away = [part - own for part, own in zip(point, self.reference, strict=True)]
        distance = np.sqrt(sum(part * part for part in away) + self.height * self.height)
        along = tuple(part / distance for part in away)
        last = self.coefficients[-1]
        residual = last * distance[:, None] - self.right
        for part, coefficient in zip(away, self.coefficients, strict=False):
            residual = residual + coefficient * part[:, None]
        slopes = tuple(
            coefficient + last * part[:, None] for part, coefficient in zip(along, self.coefficients, strict=False)
        )
        return residual, slopes, along, distance
