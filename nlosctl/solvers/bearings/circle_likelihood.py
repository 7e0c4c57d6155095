"""The likelihood of bearings, some of them seen on circles, as a batched least-squares problem."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import gather_rows, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.circle_rows import CircleRows
from nlosctl.models.sight import Sight
from nlosctl.models.space.sphere_lines import SphereLines
from nlosctl.solvers.bearings.likelihood import BearingProblem
from nlosctl.solvers.optimization.problem import Evaluation, ExpandedRows, LeastSquaresProblem

__all__ = ["BearingLikelihood", "MixedBearingProblem", "bearing_problem"]


@dataclass(frozen=True)
class MixedBearingProblem:
    """Half the chi-square of bearings (B, K), direct, by lines and by circles, as a function of a local point.

    Where a circle has no blocker, each row takes the path that fits best at the point. The cost is NaN where no path
    leads to the point, or (seen from the blocker) it lies beyond a focus: the likelihood ends at the caustic, and a
    step across it is refused. ``straight`` are the rays of all rows, None where all are by circles; ``circles`` the
    circle rows; ``plain_rows`` the snapshots without any, and ``plain`` their problem: solved as it would be alone.
    """

    straight: BearingProblem | None
    circles: CircleRows
    inverse_std: FloatArray
    plain_rows: IntArray
    plain: BearingProblem | None

    @classmethod
    def of_lines(cls, lines: SightLines, circles: CircleRows) -> MixedBearingProblem:
        """Return the problem of a block of sight lines and its circle rows."""
        inverse_std = 1.0 / lines.std_rad
        if circles.snapshot.shape[0] == inverse_std.size:
            return cls(None, circles, inverse_std, np.zeros(0, dtype=np.int64), None)
        has_circles = np.zeros(lines.center_x.shape, dtype=bool)
        has_circles[circles.snapshot] = True
        plain_rows = np.flatnonzero(~has_circles)
        straight = BearingProblem.of_lines(lines)
        return cls(straight, circles, inverse_std, plain_rows, straight.take(plain_rows) if plain_rows.size else None)

    def take(self, rows: IntArray) -> MixedBearingProblem:
        """Return the problems of some rows, which rise."""
        shape = self.inverse_std.shape
        if rows.shape[0] == shape[0]:
            return self
        index = np.full(shape[0], -1, dtype=np.int64)
        index[rows] = np.arange(rows.shape[0])
        kept = np.flatnonzero(index[self.plain_rows] >= 0)
        return MixedBearingProblem(
            None if self.straight is None else self.straight.take(rows),
            self.circles.take(rows),
            gather_rows(self.inverse_std, rows),
            index[self.plain_rows[kept]],
            None if self.plain is None or not kept.size else self.plain.take(kept),
        )

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient and Gauss-Newton matrix, with the closed-form gradient of reflected bearings.

        Of snapshots without a circle row the exact second derivatives, as `BearingProblem` has them.
        """
        residual, slope_x, slope_y = self._linearize(x, y)
        with ignoring_overflow():
            at = Evaluation(
                0.5 * sum_measurements(residual * residual),
                (sum_measurements(residual * slope_x), sum_measurements(residual * slope_y)),
                SymmetricMatrix.gram(slope_x, slope_y),
                np.zeros(x.shape, dtype=bool),
            )
        if self.plain is not None:
            rows = self.plain_rows
            plain = self.plain.evaluate(x[rows], y[rows])
            at.cost[rows] = plain.cost
            for block, values in zip(at.gradient, plain.gradient, strict=True):
                block[rows] = values
            at.hessian.put(rows, plain.hessian)
            if at.exact is not None and plain.exact is not None:
                at.exact[rows] = plain.exact
        return at

    def _linearize(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the scaled residuals (B, K) and their derivatives by x and y."""
        bent = _linearize_circles(self.circles, x, y)
        if self.straight is None:
            residual, slope_x, slope_y = (self.circles.whole_block(values, x.shape[0]) for values in bent)
            return residual * self.inverse_std, slope_x * self.inverse_std, slope_y * self.inverse_std
        residual, slope_x, slope_y = _linearize_straight(self.straight, x, y)
        inverse_std = self.circles.pick_from(self.inverse_std)
        for block, values in zip((residual, slope_x, slope_y), bent, strict=True):
            self.circles.place_in(block, values * inverse_std)
        return residual, slope_x, slope_y


def _linearize_straight(
    rays: BearingProblem, x: FloatArray, y: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the scaled residuals (B, K) and derivatives of direct and line rows, (23); circle rows are undefined."""
    dx, dy = x[:, None] - rays.origin_x, y[:, None] - rays.origin_y
    with ignoring_overflow():
        residual = np.arctan2(rays.sine * dx - rays.cosine * dy, rays.cosine * dx + rays.sine * dy)
        weight = rays.inverse_std / (dx * dx + dy * dy)
        return residual * rays.inverse_std, dy * weight, -dx * weight


BearingLikelihood = BearingProblem | MixedBearingProblem | LeastSquaresProblem
"""The likelihood of a block of bearings."""


def bearing_problem(lines: Sight) -> BearingLikelihood:
    """Return the likelihood of a block of rays: in the plane the plain one where no row is seen on a circle."""
    if isinstance(lines, SphereLines):
        return LeastSquaresProblem(replace(lines, refuses=True))
    if not isinstance(lines, SightLines):
        return LeastSquaresProblem(cast(ExpandedRows, lines))
    if lines.circles is None:
        return BearingProblem.of_lines(lines)
    return MixedBearingProblem.of_lines(lines, lines.circles)


def _linearize_circles(circles: CircleRows, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    path = circles.paths_from(x, y)
    gradient_x, gradient_y = path.bearing_gradient()
    beyond_focus = ~(path.tube_width_m > 0.0) & ~circles.takes_any_path
    return np.where(beyond_focus, np.nan, circles.residual_rad(path)), -gradient_x, -gradient_y
