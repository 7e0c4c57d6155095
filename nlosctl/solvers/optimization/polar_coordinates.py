"""A problem in the plane in polar coordinates about one of its sensors, where the valley of its range is straight.

A range that is much surer than the other measurements makes the likelihood a thin valley along its circle. Steps in x
and y can only creep there; steps along the circle and across it do not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation, Problem

__all__ = ["Pole", "minimize_about_pole"]

_PATIENCE = 20
"""Refused steps after which a descent is given up."""

_LEAST_SHARE = 0.01
"""Exact second derivatives are trusted if their determinant is at least this share of that without the curvature."""


@dataclass(frozen=True)
class Pole(RowBlock):
    """Poles (B,) of polar coordinates: the distance from the pole, and the arc length at ``radius_m``. Metres."""

    x: FloatArray
    y: FloatArray
    radius_m: FloatArray

    def polar(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the distance and the arc length of points (B,)."""
        dx, dy = x - self.x, y - self.y
        return np.hypot(dx, dy), np.arctan2(dy, dx) * self.radius_m

    def plane(self, distance_m: FloatArray, arc_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x and y of points (B,)."""
        cosine, sine = cosine_sine(arc_m / self.radius_m)
        return self.x + distance_m * cosine, self.y + distance_m * sine


@dataclass(frozen=True)
class _PolarProblem(RowBlock):
    """A problem in the plane as a function of distance and arc length (B,)."""

    inner: Problem
    pole: Pole

    def evaluate(self, distance_m: FloatArray, arc_m: FloatArray) -> Evaluation:
        """Return the evaluation by the chain rule; exact where that in the plane is, and positive definite here too."""
        pole = self.pole
        with ignoring_overflow():
            cosine, sine = cosine_sine(arc_m / pole.radius_m)
            at = self.inner.evaluate(pole.x + distance_m * cosine, pole.y + distance_m * sine)
            gradient_x, gradient_y = at.gradient
            out, turn = gradient_x * cosine + gradient_y * sine, gradient_y * cosine - gradient_x * sine
            stretch = distance_m / pole.radius_m
            xx, xy, yy = at.hessian
            out_x, out_y = xx * cosine + xy * sine, xy * cosine + yy * sine
            turn_x, turn_y = xy * cosine - xx * sine, yy * cosine - xy * sine
            matrix = SymmetricMatrix(
                out_x * cosine + out_y * sine,
                stretch * (out_y * cosine - out_x * sine),
                stretch * stretch * (turn_y * cosine - turn_x * sine),
            )
            gradient = (out, stretch * turn)
            if at.exact is None:
                return Evaluation(at.cost, gradient, matrix)
            curved = SymmetricMatrix(
                matrix.xx, matrix.xy + turn / pole.radius_m, matrix.yy - stretch * out / pole.radius_m
            )
            positive = at.exact & (curved.determinant > _LEAST_SHARE * matrix.determinant)
            return Evaluation(at.cost, gradient, curved.where(positive, matrix), positive)


def minimize_about_pole(problem: Problem, pole: Pole, x: FloatArray, y: FloatArray, *, max_iterations: int) -> Minimum:
    """Return the minima in the plane of problems from initial points (B,), as `minimize` does, by polar coordinates.

    The second derivatives are those by distance and arc length.
    """
    start = pole.polar(x, y)
    end = minimize(_PolarProblem(problem, pole), *start, max_iterations=max_iterations, patience=_PATIENCE)
    return end._replace(point=pole.plane(*end.point))
