"""Ranges as batched least-squares problems: of the ranges, and of their squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import MeasuredHeight
from nlosctl.models.ranges.circles import RangeCircles
from nlosctl.models.ranges.spheres import RangeRows
from nlosctl.solvers.optimization.problem import Evaluation
from nlosctl.solvers.ranges.squared_ranges import HeightPenalty, SquaredRangeFit, fit_squared_ranges

__all__ = ["RangeProblem", "SquaredRangeProblem", "fit_squares", "mean_range_m"]


_LEAST_SHARE = 0.01
"""Newton's matrix is trusted when its determinant is at least this share of Gauss-Newton's."""


_TRIANGLE = tuple((i, j) for i in range(3) for j in range(i + 1))
"""The entries of a `SymmetricMatrix` in the order of its parts."""


@dataclass(frozen=True)
class RangeProblem(RowBlock):
    """Half the chi-square of ranges (B, K) as a function of a point about the local origin; equation (8).

    ``sensor`` has D arrays (B, K). ``height`` is that of slant ranges to a plane, ``level`` a measured height in space.
    """

    sensor: tuple[FloatArray, ...]
    range_m: FloatArray
    inverse_std: FloatArray
    height: FloatArray | None = None
    bent: RangeCircles | None = None
    level: MeasuredHeight | None = None

    @classmethod
    def of_rows(cls, rows: RangeRows) -> RangeProblem:
        """Return the problem of a block of ranges."""
        bent = rows if isinstance(rows, RangeCircles) and rows.circles is not None else None
        return cls(rows.sensor, rows.range_m, 1.0 / rows.std_m, rows.height, bent, rows.level)

    def evaluate(self, *point: FloatArray) -> Evaluation:
        """Return cost, gradient and Newton's matrix, or the Gauss-Newton matrix where that is not positive definite.

        The gradient of a range is the unit vector u from its sensor; Newton's matrix adds the residual times the
        bending of the range, (I - u u') / range. Without it a fit with large residuals, such as a mirror image,
        creeps. One measurement after the other, so that all temporaries stay in the near caches. Rows by a circle have
        the length, the gradient and the bending of their path; the cost is NaN where no path exists.
        """
        shape = point[0].shape
        cost, bend = np.zeros(shape), np.zeros(shape)
        gradient = tuple(np.zeros(shape) for _ in point)
        simple, bent = (SymmetricMatrix.full(shape, 0.0, len(point)) for _ in range(2))
        entries = list(zip(simple.parts, bent.parts, _TRIANGLE, strict=False))
        with ignoring_division():
            for k in range(self.range_m.shape[1]):
                inverse_std = self.inverse_std[:, k]
                slopes = [part - own[:, k] for part, own in zip(point, self.sensor, strict=True)]
                distance = slopes[0] * slopes[0]
                for part in slopes[1:]:
                    distance += part * part
                if self.height is not None:
                    distance += self.height[:, k] * self.height[:, k]
                np.sqrt(distance, out=distance)
                scale = inverse_std / distance
                for slope in slopes:
                    slope *= scale
                radius = distance
                paths = None if self.bent is None else self.bent.bent_paths(k, *point)
                if paths is not None:
                    at, radius = paths.snapshot, distance.copy()
                    distance[at], radius[at] = paths.path.length_m, paths.path.radius_m
                    for slope, along in zip(slopes, paths.path.along, strict=True):
                        slope[at] = along * inverse_std[at]
                    scale = inverse_std / radius
                residual = (distance - self.range_m[:, k]) * inverse_std
                share = residual / (inverse_std * radius)
                cost += residual * residual
                bend += residual * scale
                for total, total_bent, (i, j) in entries:
                    product = slopes[i] * slopes[j]
                    total += product
                    product *= share
                    total_bent += product
                for total, slope in zip(gradient, slopes, strict=True):
                    slope *= residual
                    total += slope
            newton = simple.add_to_diagonal(bend) - bent
            if self.level is not None:
                precision, residual = self.level.inverse_std, self.level.scaled_residual(point[-1])
                cost += residual * residual
                gradient[-1][:] += residual * precision
                for matrix in (simple, newton):
                    matrix.diagonal[-1][:] += precision * precision
            return Evaluation.of_newton(0.5 * cost, gradient, newton, simple, _LEAST_SHARE)


@dataclass(frozen=True)
class SquaredRangeProblem(RowBlock):
    """Half the weighted sum of squared differences of squared ranges (B, K); equation (9). ``sensor`` as above."""

    sensor: tuple[FloatArray, ...]
    squared_range: FloatArray
    inverse_scale: FloatArray
    level: MeasuredHeight | None = None

    @classmethod
    def of_rows(cls, rows: RangeRows) -> SquaredRangeProblem:
        """Return the problem of a block of ranges, with weights proportional to 1 / std^2.

        The differences are divided by 2 std times the snapshot's mean range, which makes them about as large as
        scaled residuals of ranges are.
        """
        scale = 2.0 * rows.std_m * mean_range_m(rows)[:, None]
        return cls(rows.sensor, rows.squared_in_plane(), 1.0 / scale, rows.level)

    def evaluate(self, *point: FloatArray) -> Evaluation:
        """Return cost, gradient and Gauss-Newton matrix; in space Newton's, where that is positive definite.

        In space Gauss-Newton's is singular for sensors in a plane and a point in it.
        """
        away = [part[:, None] - own for part, own in zip(point, self.sensor, strict=True)]
        squared = away[0] * away[0]
        for part in away[1:]:
            squared += part * part
        residual = (squared - self.squared_range) * self.inverse_scale
        bend = 2.0 * sum_measurements(residual * self.inverse_scale) if len(point) > 2 else None
        for part in away:
            part *= 2.0 * self.inverse_scale
        cost = 0.5 * sum_measurements(residual * residual)
        gradient = tuple(sum_measurements(residual * part) for part in away)
        matrix = SymmetricMatrix.gram(*away)
        if self.level is not None:
            precision, scaled = self.level.inverse_std, self.level.scaled_residual(point[-1])
            cost += 0.5 * scaled * scaled
            gradient[-1][:] += scaled * precision
            matrix.diagonal[-1][:] += precision * precision
        if bend is None:
            return Evaluation(cost, gradient, matrix)
        return Evaluation.of_newton(cost, gradient, matrix.add_to_diagonal(bend), matrix, _LEAST_SHARE)


def mean_range_m(rows: RangeRows) -> FloatArray:
    """Return the mean range (B,) of the snapshots."""
    return np.asarray(sum_measurements(rows.range_m) / rows.range_m.shape[1])


def fit_squares(rows: RangeRows) -> SquaredRangeFit:
    """Return the exact minimum of `SquaredRangeProblem`, by `fit_squared_ranges`."""
    penalty = None
    if rows.level is not None:
        scale = 2.0 * mean_range_m(rows) * rows.level.inverse_std
        penalty = HeightPenalty(rows.level.z_m, scale * scale)
    return fit_squared_ranges(rows.sensor, rows.squared_in_plane(), 1.0 / (rows.std_m * rows.std_m), penalty)
