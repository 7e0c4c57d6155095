"""The likelihood of single paths in space in spheroidal coordinates, where its valley is straight.

With w the minor axis of the confocal spheroid through the target, d the baseline and n a unit vector, the target is
(sqrt(w^2 + d^2) n_x, w n_y, w n_z) / 2 in the frame of the baseline: elliptic coordinates turned about it. n is given
by two angles p and q from an initial direction, cos q (cos p n_0 + sin p n_1) + sin q n_2, singular only far from it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.angles import cosine_sine
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.directions import Vector, cross
from nlosctl.geometry.symmetric import SymmetricMatrix, dot
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation
from nlosctl.solvers.triplets.elliptic_coordinates import HIGHEST_NATS, PATIENCE, quadrature_nodes
from nlosctl.solvers.triplets.likelihood import TripletProblem

__all__ = ["minimize_space_paths", "space_path_covariance"]

_NODES = (5, 5, 3)
"""Nodes of the quadrature along p and q, where the likelihood is wide and curved, and along w."""


@dataclass(frozen=True)
class _SpheroidalProblem(RowBlock):
    """Paths (N, 1) in space, as a function of w (metres), p and q (radians).

    ``axes`` are those of the baseline's frame, ``directions`` n_0, n_1, n_2 in that frame: three vectors each.
    """

    space: TripletProblem
    baseline_m: FloatArray
    axes: tuple[Vector, Vector, Vector]
    directions: tuple[Vector, Vector, Vector]

    @classmethod
    def about(
        cls, space: TripletProblem, baseline_m: FloatArray, axes: tuple[Vector, Vector, Vector], point: Vector
    ) -> tuple[_SpheroidalProblem, FloatArray]:
        """Return the problem whose angles are 0 at points (three arrays (N,)), and their w."""
        along, y, z = (dot(axis, point) for axis in axes)
        aside, half = y * y + z * z, 0.5 * baseline_m
        length = np.sqrt((along + half) ** 2 + aside) + np.sqrt((along - half) ** 2 + aside)
        w = np.sqrt(np.maximum((length - baseline_m) * (length + baseline_m), 0.0))
        with ignoring_overflow():
            cosine = np.clip(2.0 * along / np.where(length > 0.0, length, 1.0), -1.0, 1.0)
            sine, radius = np.sqrt(1.0 - cosine * cosine), np.sqrt(aside)
            beside = np.where(radius > 0.0, y / radius, 1.0), np.where(radius > 0.0, z / radius, 0.0)
        first = (cosine, sine * beside[0], sine * beside[1])
        second = (-sine, cosine * beside[0], cosine * beside[1])
        third = (np.zeros_like(sine), -beside[1], beside[0])
        return cls(space, baseline_m, axes, (first, second, third)), w

    def point(self, w: FloatArray, p: FloatArray, q: FloatArray) -> Vector:
        """Return the targets (three arrays (N,)) in space."""
        with ignoring_overflow():
            return self._place(self._stretch(w)[0], self._unit(cosine_sine(p), cosine_sine(q)))

    def evaluate(self, w: FloatArray, p: FloatArray, q: FloatArray) -> Evaluation:
        """Return the evaluation at w, p, q (N,): that in space, by the chain rule."""
        with ignoring_overflow():
            columns, second = self._derivatives(w, p, q)
            sums = self.space.sums(*self.point(w, p, q))
            gauss_newton = _pull_back(sums.gauss, columns)
            bend = _pull_back(sums.bend, columns)
            for part, derivative in zip(bend, second, strict=True):
                part += dot(sums.gradient, derivative)
            gradient = tuple(dot(sums.gradient, column) for column in columns)
            return Evaluation.of_newton(0.5 * sums.cost, gradient, gauss_newton + bend, gauss_newton)

    def jacobian(self, w: FloatArray, p: FloatArray, q: FloatArray) -> tuple[Vector, Vector, Vector]:
        """Return the derivatives of the point by w, p and q."""
        turn, rise = cosine_sine(p), cosine_sine(q)
        stretch, by_w, _ = self._stretch(w)
        by_p, by_q = self._unit((-turn[1], turn[0]), (rise[0], 0.0 * q)), self._unit(turn, (-rise[1], rise[0]))
        return self._place(by_w, self._unit(turn, rise)), self._place(stretch, by_p), self._place(stretch, by_q)

    def _derivatives(self, w: FloatArray, p: FloatArray, q: FloatArray) -> tuple[tuple[Vector, ...], list[Vector]]:
        """Return the derivatives of the point by w, p and q, and the second ones: ww, pw, pp, qw, qp, qq."""
        turn, rise = cosine_sine(p), cosine_sine(q)
        stretch, by_w, by_ww = self._stretch(w)
        unit = self._unit(turn, rise)
        ahead, level = (-turn[1], turn[0]), (rise[0], 0.0 * q)
        by_p, by_q = self._unit(ahead, level), self._unit(turn, (-rise[1], rise[0]))
        by_pp = self._unit((-turn[0], -turn[1]), level)
        by_pq = self._unit(ahead, (-rise[1], 0.0 * q))
        down = tuple(-part for part in unit)
        second = ((by_ww, unit), (by_w, by_p), (stretch, by_pp), (by_w, by_q), (stretch, by_pq), (stretch, down))
        first = ((by_w, unit), (stretch, by_p), (stretch, by_q))
        return tuple(self._place(*pair) for pair in first), [self._place(*pair) for pair in second]

    def _unit(self, turn: tuple[FloatArray, FloatArray], rise: tuple[FloatArray, FloatArray]) -> Vector:
        """Return n by the cosines and sines of p and q, or their derivatives."""
        parts = zip(*self.directions, strict=True)
        return tuple(rise[0] * (turn[0] * one + turn[1] * two) + rise[1] * three for one, two, three in parts)

    def _stretch(self, w: FloatArray) -> tuple[tuple[FloatArray, FloatArray], ...]:
        """Return half the major and the minor axis by w, their first and their second derivatives."""
        length = np.sqrt(w * w + self.baseline_m * self.baseline_m)
        first = (0.5 * w / length, np.full_like(w, 0.5))
        return (0.5 * length, 0.5 * w), first, (0.5 * (self.baseline_m / length) ** 2 / length, np.zeros_like(w))

    def _place(self, stretch: tuple[FloatArray, FloatArray], unit: Vector) -> Vector:
        """Return a vector of the baseline's frame, stretched along and across it, in the axes of space."""
        along, y, z = stretch[0] * unit[0], stretch[1] * unit[1], stretch[1] * unit[2]
        return tuple(along * a + y * b + z * c for a, b, c in zip(*self.axes, strict=True))


def minimize_space_paths(
    space: TripletProblem,
    baseline_m: FloatArray,
    axes: tuple[Vector, Vector, Vector],
    start: Vector,
    max_iterations: int,
) -> Minimum:
    """Minimize the cost of single paths (N, 1) from starts (three arrays (N,)); the result is in space."""
    problem, w = _SpheroidalProblem.about(space, baseline_m, axes, start)
    zero = np.zeros_like(w)
    found = minimize(problem, w, zero, zero.copy(), max_iterations=max_iterations, patience=PATIENCE)
    point = problem.point(*found.point)
    there = space.evaluate(*point)
    return Minimum(point, there.cost, there.hessian, found.converged, found.evaluations)


def space_path_covariance(
    space: TripletProblem, baseline_m: FloatArray, axes: tuple[Vector, Vector, Vector], point: Vector, cost: FloatArray
) -> SymmetricMatrix:
    """Return the second moments (N,) about estimates of the flat-prior posterior of single paths; square metres.

    As `nlosctl.solvers.triplets.elliptic_coordinates.path_covariance`, for a path length surer than the angles. NaN
    where the information is singular.
    """
    problem, w = _SpheroidalProblem.about(space, baseline_m, axes, point)
    zero = np.zeros_like(w)
    with ignoring_overflow():
        by_w, by_p, by_q = problem.jacobian(w, zero, zero)
        # p, q, w: the last is the narrowest.
        linear = _pull_back(space.information(*point), (by_p, by_q, by_w)).inverse()
        factor = linear.cholesky()
        mass_sum, moments = zero.copy(), SymmetricMatrix.full(w.shape, 0.0, 3)
        nodes = [list(zip(*quadrature_nodes(count), strict=True)) for count in _NODES]
        for u_p, weight_p in nodes[0]:
            for u_q, weight_q in nodes[1]:
                for u_w, weight_w in nodes[2]:
                    p = factor[0][0] * u_p
                    q = factor[1][0] * u_p + factor[1][1] * u_q
                    at_w = w + factor[2][0] * u_p + factor[2][1] * u_q + factor[2][2] * u_w
                    at = problem.point(at_w, p, q)
                    nats = cost - space.cost(*at) + 0.5 * (u_p * u_p + u_q * u_q + u_w * u_w)
                    by_w, by_p, by_q = problem.jacobian(at_w, p, q)
                    mass = np.exp(np.minimum(nats, HIGHEST_NATS)) * np.abs(dot(by_w, cross(by_p, by_q)))
                    mass *= weight_p * weight_q * weight_w
                    mass_sum += mass
                    moments += SymmetricMatrix.outer(*(a - b for a, b in zip(at, point, strict=True)), weight=mass)
        return moments * (1.0 / mass_sum)


def _pull_back(matrix: SymmetricMatrix, columns: tuple[Vector, ...]) -> SymmetricMatrix:
    """Return J^T matrix J for Jacobians J, given by their columns."""
    images = [[dot([matrix.entry(i, k) for k in range(3)], column) for i in range(3)] for column in columns]
    return SymmetricMatrix(*(dot(columns[i], images[j]) for i in range(3) for j in range(i + 1)))
