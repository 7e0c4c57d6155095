"""The likelihood of single paths in elliptic coordinates, where its valley is straight.

A path length is often far surer than the angles. The likelihood of a path is then a thin valley along its ellipse,
in which steps in x and y can only creep. With w the minor axis of the confocal ellipse through the target and v its
eccentric angle, x = sqrt(w^2 + d^2) cos(v) / 2 and y = w sin(v) / 2 in the baseline frame, the valley lies along v.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation
from nlosctl.solvers.triplets.likelihood import PathSums, TripletProblem

__all__ = ["HIGHEST_NATS", "PATIENCE", "minimize_paths", "path_covariance", "quadrature_nodes"]


PATIENCE = 20
"""Refused steps after which a descent is given up: then the likelihood has no smooth minimum near, as at the nodes."""

_NODES_ALONG, _NODES_ACROSS = 7, 5
"""Nodes of the quadrature along the ellipse, where the likelihood is wide and curved, and across it."""

HIGHEST_NATS = 30.0
"""Points likelier than the estimate by more than this count as if by this much."""


@dataclass(frozen=True)
class _EllipticProblem(RowBlock):
    """Paths (N, 1) in their baseline frames, as a function of w (metres) and v (radians)."""

    plane: TripletProblem
    baseline_m: FloatArray

    def evaluate(self, w: FloatArray, v: FloatArray) -> Evaluation:
        """Return the evaluation at w, v (N,): that in the plane, by the chain rule."""
        sums = PathSums(w.shape)
        with ignoring_overflow():
            cosine, sine = cosine_sine(v)
            length = np.sqrt(w * w + self.baseline_m * self.baseline_m)
            x, y = 0.5 * length * cosine, 0.5 * w * sine
            sums.add_path(self.plane, 0, x, y)
            x_w, x_v, y_w, y_v = 0.5 * w * cosine / length, -0.5 * length * sine, 0.5 * sine, 0.5 * w * cosine
            x_ww = 0.5 * cosine * (self.baseline_m / length) ** 2 / length
            gauss_newton = _pull_back(sums.gauss, x_w, x_v, y_w, y_v)
            bend = _pull_back(sums.bend, x_w, x_v, y_w, y_v)
            gradient_x, gradient_y = sums.gradient
            bend = SymmetricMatrix(
                bend.xx + gradient_x * x_ww,
                bend.xy - 0.5 * gradient_x * w * sine / length + 0.5 * gradient_y * cosine,
                bend.yy - gradient_x * x - gradient_y * y,
            )
            return Evaluation.of_newton(
                0.5 * sums.cost,
                (gradient_x * x_w + gradient_y * y_w, gradient_x * x_v + gradient_y * y_v),
                gauss_newton + bend,
                gauss_newton,
            )

    def to_plane(self, w: FloatArray, v: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return x, y (N,) in the baseline frame."""
        with ignoring_overflow():
            length = np.sqrt(w * w + self.baseline_m * self.baseline_m)
            cosine, sine = cosine_sine(v)
            return 0.5 * length * cosine, 0.5 * w * sine

    def information(self, w: FloatArray, v: FloatArray, in_plane: SymmetricMatrix) -> SymmetricMatrix:
        """Return the information (N,) of w and v, from that of x and y at the same points."""
        cosine, sine = cosine_sine(v)
        length = np.sqrt(w * w + self.baseline_m * self.baseline_m)
        return _pull_back(in_plane, 0.5 * w * cosine / length, -0.5 * length * sine, 0.5 * sine, 0.5 * w * cosine)

    def area(self, w: FloatArray, v: FloatArray) -> FloatArray:
        """Return the area in x and y of a unit of w and v (N,), up to a constant factor."""
        squared, sine = self.baseline_m * self.baseline_m, np.sin(v)
        area: FloatArray = (w * w + squared * sine * sine) / np.sqrt(w * w + squared)
        return area

    def from_plane(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return w >= 0 and v of points x, y (N,); NaN where they are."""
        half = 0.5 * self.baseline_m
        length = np.sqrt((x + half) ** 2 + y * y) + np.sqrt((x - half) ** 2 + y * y)
        w = np.sqrt(np.maximum((length - self.baseline_m) * (length + self.baseline_m), 0.0))
        cosine = np.clip(2.0 * x / np.where(length > 0.0, length, 1.0), -1.0, 1.0)
        return w, np.copysign(np.arccos(cosine), y)


def minimize_paths(
    plane: TripletProblem, baseline_m: FloatArray, start: tuple[FloatArray, ...], max_iterations: int
) -> Minimum:
    """Minimize the cost of single paths (N, 1) in their baseline frames from starts (N,); the result is in x, y."""
    problem = _EllipticProblem(plane, baseline_m)
    found = minimize(problem, *problem.from_plane(*start), max_iterations=max_iterations, patience=PATIENCE)
    x, y = problem.to_plane(found.x, found.y)
    there = plane.evaluate(x, y)
    return Minimum((x, y), there.cost, there.hessian, found.converged, found.evaluations)


def path_covariance(
    plane: TripletProblem,
    baseline_m: FloatArray,
    information: SymmetricMatrix,
    point: tuple[FloatArray, ...],
    cost: FloatArray,
) -> SymmetricMatrix:
    """Return the second moments (N,) about estimates x, y of the flat-prior posterior of single paths; square metres.

    ``information`` (N,) is that of x and y. Its inverse is tangent to the ellipse, which curves away from it by more
    than the standard deviation of the path length where the angles are inaccurate. So the moments are integrated
    in w and v, by Gauss-Hermite quadrature about the estimate. NaN where the information is singular.
    """
    problem = _EllipticProblem(plane, baseline_m)
    x, y = point
    w, v = problem.from_plane(x, y)
    with ignoring_overflow():
        linear = problem.information(w, v, information).inverse()
        along = np.sqrt(linear.yy)
        tilt = linear.xy / along
        across = np.sqrt(linear.xx - tilt * tilt)
        total = [np.zeros(x.shape) for _ in range(4)]
        for u_along, weight_along in zip(*quadrature_nodes(_NODES_ALONG), strict=True):
            for u_across, weight_across in zip(*quadrature_nodes(_NODES_ACROSS), strict=True):
                at_w, at_v = w + tilt * u_along + across * u_across, v + along * u_along
                at_x, at_y = problem.to_plane(at_w, at_v)
                nats = cost - plane.cost(at_x, at_y) + 0.5 * (u_along * u_along + u_across * u_across)
                mass = np.exp(np.minimum(nats, HIGHEST_NATS)) * problem.area(at_w, at_v)
                mass *= weight_along * weight_across
                dx, dy = at_x - x, at_y - y
                for sums, factor in zip(total, (np.ones_like(dx), dx * dx, dx * dy, dy * dy), strict=True):
                    sums += mass * factor
        return SymmetricMatrix(*(sums / total[0] for sums in total[1:]))


def quadrature_nodes(count: int) -> tuple[list[float], list[float]]:
    """Return the nodes and weights of Gauss-Hermite quadrature for the density exp(-u^2 / 2)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(count)
    return nodes.tolist(), weights.tolist()


def _pull_back(
    matrix: SymmetricMatrix, x_w: FloatArray, x_v: FloatArray, y_w: FloatArray, y_v: FloatArray
) -> SymmetricMatrix:
    """Return J^T matrix J for the Jacobian J of x, y by w, v."""
    left_w, right_w = matrix.xx * x_w + matrix.xy * y_w, matrix.xy * x_w + matrix.yy * y_w
    left_v, right_v = matrix.xx * x_v + matrix.xy * y_v, matrix.xy * x_v + matrix.yy * y_v
    return SymmetricMatrix(x_w * left_w + y_w * right_w, x_w * left_v + y_w * right_v, x_v * left_v + y_v * right_v)
