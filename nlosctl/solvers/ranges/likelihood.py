"""Ranges as batched least-squares problems: of the ranges, and of their squares."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges import RangeCircles
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["RangeProblem", "SquaredRangeProblem"]


_LEAST_SHARE = 0.01
"""Newton's matrix is trusted when its determinant is at least this share of Gauss-Newton's."""


@dataclass(frozen=True)
class RangeProblem(RowBlock):
    """Half the chi-square of ranges (B, K) as a function of a point about the local origin; equation (8)."""

    sensor_x: FloatArray
    sensor_y: FloatArray
    range_m: FloatArray
    inverse_std: FloatArray
    height: FloatArray | None
    bent: RangeCircles | None = None

    @classmethod
    def of_circles(cls, circles: RangeCircles) -> RangeProblem:
        """Return the problem of a block of circles."""
        bent = None if circles.circles is None else circles
        return cls(circles.sensor_x, circles.sensor_y, circles.range_m, 1.0 / circles.std_m, circles.height, bent)

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient and Newton's matrix, or the Gauss-Newton matrix where that is not positive definite.

        The gradient of a range is the unit vector u from its sensor; Newton's matrix adds the residual times the
        bending of the range, (I - u u') / range. Without it a fit with large residuals, such as a mirror image,
        creeps. One measurement after the other, so that all temporaries stay in the near caches. Rows by a circle have
        the length, the gradient and the bending of their path; the cost is NaN where no path exists.
        """
        cost, gradient_x, gradient_y, xx, xy, yy, bend, bent_xx, bent_xy, bent_yy = (
            np.zeros(x.shape) for _ in range(10)
        )
        with ignoring_division():
            for k in range(self.sensor_x.shape[1]):
                inverse_std = self.inverse_std[:, k]
                dx, dy = x - self.sensor_x[:, k], y - self.sensor_y[:, k]
                distance = dx * dx + dy * dy
                if self.height is not None:
                    distance += self.height[:, k] * self.height[:, k]
                np.sqrt(distance, out=distance)
                scale = inverse_std / distance
                slope_x, slope_y = dx * scale, dy * scale
                radius = distance
                paths = None if self.bent is None else self.bent.bent_paths(k, x, y)
                if paths is not None:
                    at, radius = paths.snapshot, distance.copy()
                    distance[at], radius[at] = paths.path.length_m, paths.path.radius_m
                    slope_x[at], slope_y[at] = (
                        paths.path.along_x * inverse_std[at],
                        paths.path.along_y * inverse_std[at],
                    )
                    scale = inverse_std / radius
                residual = (distance - self.range_m[:, k]) * inverse_std
                share = residual / (inverse_std * radius)
                cost += residual * residual
                gradient_x += residual * slope_x
                gradient_y += residual * slope_y
                product_xx, product_xy, product_yy = slope_x * slope_x, slope_x * slope_y, slope_y * slope_y
                xx += product_xx
                xy += product_xy
                yy += product_yy
                bend += residual * scale
                bent_xx += share * product_xx
                bent_xy += share * product_xy
                bent_yy += share * product_yy
            simple = SymmetricMatrix(xx, xy, yy)
            newton = SymmetricMatrix(xx + bend - bent_xx, xy - bent_xy, yy + bend - bent_yy)
            return Evaluation.of_newton(0.5 * cost, (gradient_x, gradient_y), newton, simple, _LEAST_SHARE)


@dataclass(frozen=True)
class SquaredRangeProblem(RowBlock):
    """Half the weighted sum of squared differences of squared ranges (B, K); equation (9)."""

    sensor_x: FloatArray
    sensor_y: FloatArray
    squared_range: FloatArray
    inverse_scale: FloatArray

    @classmethod
    def of_circles(cls, circles: RangeCircles) -> SquaredRangeProblem:
        """Return the problem of a block of circles, with weights proportional to 1 / std^2.

        The differences are divided by 2 std times the snapshot's mean range, which makes them about as large as
        scaled residuals of ranges are.
        """
        mean_range = sum_measurements(circles.range_m) / circles.range_m.shape[1]
        scale = 2.0 * circles.std_m * mean_range[:, None]
        return cls(circles.sensor_x, circles.sensor_y, circles.squared_in_plane(), 1.0 / scale)

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient and Gauss-Newton matrix."""
        dx, dy = x[:, None] - self.sensor_x, y[:, None] - self.sensor_y
        residual = (dx * dx + dy * dy - self.squared_range) * self.inverse_scale
        dx *= 2.0 * self.inverse_scale
        dy *= 2.0 * self.inverse_scale
        return Evaluation(
            0.5 * sum_measurements(residual * residual),
            (sum_measurements(residual * dx), sum_measurements(residual * dy)),
            SymmetricMatrix.gram(dx, dy),
        )
