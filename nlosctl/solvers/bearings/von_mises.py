"""Maximum likelihood of bearings with von Mises errors (Lenth 1981, Technometrics 23, 149)."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import i0e, i1e

from nlosctl.arrays import FloatArray, IntArray, ignoring_invalid, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Estimates, Solution
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import RowBlock, max_measurements, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.fix_status import bearing_flags, judge_optima
from nlosctl.solvers.bearings.line_fits import LineFit
from nlosctl.solvers.optimization.levenberg_marquardt import Minimum, minimize
from nlosctl.solvers.optimization.problem import Evaluation
from nlosctl.solvers.optimization.unknown_std import StdFactors

__all__ = ["VonMisesProblem", "concentration", "fit_von_mises"]

_UNKNOWNS = 2

_RINGS, _DIRECTIONS = (0.6, 1.5), 8
"""Further initial points: rings about the mean of the origins, in units of the farthest one, and points on each."""

_DISTINCT = 0.1
"""Optima closer than this (standard deviations) are one."""

_CONCENTRATED = 0.001
"""Below this 1 - A the series of A in 1 / kappa is used: it has eight digits."""


@dataclass(frozen=True)
class VonMisesProblem(RowBlock):
    """The sum of w (1 - cos r) of the residuals r of rays (B, K), as a function of a point about the local origin."""

    origin_x: FloatArray
    origin_y: FloatArray
    cosine: FloatArray
    sine: FloatArray
    weight: FloatArray

    @classmethod
    def of_lines(cls, lines: SightLines) -> VonMisesProblem:
        """Return the problem of a block of rays, with weights 1 / std^2 scaled to mean 1."""
        weight = 1.0 / (lines.std_rad * lines.std_rad)
        weight *= (weight.shape[1] / sum_measurements(weight))[:, None]
        return cls(lines.origin_x, lines.origin_y, lines.cosine, lines.sine, weight)

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return cost, gradient and exact second derivatives, or the expected ones where those are not positive."""
        cost, down_x, down_y = (np.zeros(x.shape) for _ in range(3))
        gauss, exact = SymmetricMatrix.full(x.shape, 0.0), SymmetricMatrix.full(x.shape, 0.0)
        with ignoring_overflow():
            for k in range(self.weight.shape[1]):
                cosine, sine, weight = self.cosine[:, k], self.sine[:, k], self.weight[:, k]
                dx, dy = x - self.origin_x[:, k], y - self.origin_y[:, k]
                squared = dx * dx + dy * dy
                range_m = np.sqrt(squared)
                across, along = (sine * dx - cosine * dy) / range_m, (cosine * dx + sine * dy) / range_m
                half = np.sin(0.5 * np.arctan2(across, along))
                cost += 2.0 * weight * half * half
                turn_x, turn_y = -dy / squared, dx / squared
                down_x += weight * across * turn_x
                down_y += weight * across * turn_y
                gauss += SymmetricMatrix.outer(turn_x, turn_y, weight=weight)
                bend = weight * across / (squared * squared)
                exact += SymmetricMatrix.outer(turn_x, turn_y, weight=weight * along)
                exact += SymmetricMatrix(-2.0 * dx * dy * bend, (dx * dx - dy * dy) * bend, 2.0 * dx * dy * bend)
        return Evaluation.of_newton(cost, (-down_x, -down_y), exact, gauss)


def concentration(spread: FloatArray) -> FloatArray:
    """Return kappa (B,) with I1(kappa) / I0(kappa) = 1 - ``spread``; 0 for a spread of 1 and more, infinite for 0.

    By Newton steps, in 1 / kappa by the series 1 - A = u / 2 + u^2 / 8 + u^3 / 8 where kappa is large.
    """
    narrow = spread < _CONCENTRATED
    u = 2.0 * spread
    mean = np.clip(1.0 - spread, 0.0, 1.0 - 0.5 * _CONCENTRATED)
    kappa = mean * (2.0 - mean * mean) / (1.0 - mean * mean)
    with ignoring_overflow():
        for _ in range(12):
            u = u - (u * (0.5 + u * (0.125 + 0.125 * u)) - spread) / (0.5 + u * (0.25 + 0.375 * u))
            ratio = i1e(kappa) / i0e(kappa)
            slope = np.where(kappa > 0.0, 1.0 - ratio / kappa - ratio * ratio, 0.5)
            kappa = np.maximum(kappa - (ratio - mean) / slope, 0.0)
        return np.where(narrow, 1.0 / u, np.where(spread >= 1.0, 0.0, kappa))


def fit_von_mises(
    batch: BearingBatch,
    lines: SightLines,
    start: LineFit,
    normal: SymmetricMatrix,
    *,
    min_range_m: float,
    ambiguous_within: float,
    max_iterations: int,
) -> Solution:
    """Return Lenth's maximum-likelihood solution of rays that no circle reflects.

    Newton from the line fit ``start`` and from rings of points. The concentration kappa is that of the mean cosine
    C' = 1 - (1 - C) n / (n - 2), the covariance (kappa A(kappa) sum w g g')^-1 with the gradients g of the bearings:
    the expected form. The standard deviations are relative weights; their factor is
    kappa^-1/2 for weights of mean 1. The cost is the sum of w (1 - cos r).
    """
    problem = VonMisesProblem.of_lines(lines)
    best, rival = _two_best(problem, lines, start, max_iterations)
    count = lines.origin_x.shape[1]
    with ignoring_invalid():
        spread = best.cost / (count - _UNKNOWNS) if count > _UNKNOWNS else np.full(best.cost.shape, np.nan)
    kappa = concentration(spread)
    precision = sum_measurements(1.0 / (lines.std_rad * lines.std_rad)) / count
    with ignoring_overflow():
        chi_square = (count - _UNKNOWNS) * precision / kappa
    factors = StdFactors.of(chi_square, count - _UNKNOWNS)
    scaled = replace(lines, std_rad=factors.scaled(lines.std_rad))
    verdict = judge_optima(scaled, best.point, None, normal, min_range_m, best.converged, std="estimated")
    status = verdict.status
    with ignoring_invalid():
        apart = scaled.information(best.x, best.y).quadratic_form(rival.x - best.x, rival.y - best.y) > _DISTINCT**2
        close = kappa * (rival.cost - best.cost) <= ambiguous_within
    status[(status == Status.OK) & rival.converged & apart & close] = Status.AMBIGUOUS
    factors.mark(status)
    shrunk = np.where(factors.determined, 1.0 - spread, 1.0)
    estimates = Estimates.of(
        status,
        (best.x + lines.center_x, best.y + lines.center_y),
        verdict.covariance * (1.0 / shrunk),
        best.cost,
        batch.measurements,
        degrees_of_freedom=count - _UNKNOWNS,
        columns=factors.columns(status),
    )
    flags = bearing_flags(batch, lines, status, best.x, best.y) if batch.want_flags else None
    return Solution(estimates=estimates, flags=flags)


def _two_best(
    problem: VonMisesProblem, lines: SightLines, start: LineFit, max_iterations: int
) -> tuple[Minimum, Minimum]:
    """Return the best optimum (B,) that the initial points lead to, and the best apart from it (or the same again)."""
    away = np.hypot(lines.origin_x, lines.origin_y)
    radius = max_measurements(away)
    angles = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    ring_x = np.concatenate([[share * radius * np.cos(angle) for angle in angles] for share in _RINGS])
    ring_y = np.concatenate([[share * radius * np.sin(angle) for angle in angles] for share in _RINGS])
    x, y = np.concatenate([[start.x], ring_x]), np.concatenate([[start.y], ring_y])
    count, size = x.shape
    many = problem.take(np.tile(np.arange(size), count))
    end = minimize(many, x.ravel(), y.ravel(), max_iterations=max_iterations)
    shape = (count, size)
    cost = np.where(end.converged, end.cost, np.inf).reshape(shape)
    end_x, end_y = end.x.reshape(shape), end.y.reshape(shape)
    every = np.arange(size)
    first = np.argmin(cost, axis=0)
    at = first, every
    metric = end.hessian.map(lambda part: part.reshape(shape)[at])
    with ignoring_invalid():
        near = metric.quadratic_form(end_x - end_x[at], end_y - end_y[at]) <= np.maximum(cost[at], 1e-12) * _DISTINCT
    second = np.argmin(np.where(near, np.inf, cost), axis=0)
    return _taken(end, first * size + every), _taken(end, second * size + every)


def _taken(end: Minimum, index: IntArray) -> Minimum:
    return Minimum(
        tuple(part[index] for part in end.point),
        end.cost[index],
        end.hessian.take(index),
        end.converged[index],
        end.evaluations[index],
    )
