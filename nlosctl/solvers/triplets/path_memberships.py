"""Whether a path is direct over a target at p or indirect: the densities of its triplet, and their pull on p.

A path is direct with probability 1 - ``prior_indirect``. Its triplet is then normal about what p predicts, with the
covariance S of its errors. A target of radius r scatters each path at a point of its own: with r^2 / 2 the variance of
that point in x and in y, and J the Jacobian of the triplet by p, the covariance grows to S + r^2 / 2 J J^T.

Else a path is indirect: a detour, longer than the direct path by an exponential law. One that meets its other
scatterers behind the target still departs towards the target, one that meets them before still arrives from it. In a
third of the detours each, DOD or DOA is normal about what p predicts; all other angles are uniform. A share ``clutter``
of the indirect paths is over something else, with uniform angles and any length.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import log_ndtr

from nlosctl.arrays import FloatArray
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.triplets.likelihood import TripletProblem, angle_residual

__all__ = ["PathDensity", "TargetModel", "log_unrelated", "path_density"]

_LOG_TURN = math.log(2.0 * math.pi)
_LOG_THIRD = -math.log(3.0)


@dataclass(frozen=True, kw_only=True)
class TargetModel:
    """Prior assumptions: shares of paths, and the largest number of targets."""

    prior_indirect: float
    clutter: float
    targets: int


@dataclass(frozen=True)
class _Residual:
    """A residual (N,) in standard deviations, its slopes by the target's x and y, and the log of its variance."""

    value: FloatArray
    slope_x: FloatArray
    slope_y: FloatArray
    log_variance: FloatArray

    @property
    def log_density(self) -> FloatArray:
        """Return the log of the normal density."""
        return -0.5 * (self.value * self.value + self.log_variance + _LOG_TURN)

    def scattered(self, scatter_m2: FloatArray) -> _Residual:
        """Return the residual of a target whose points of scattering have these variances in x and in y."""
        if not scatter_m2.any():
            return self
        growth = np.where(scatter_m2 > 0.0, 1.0 + scatter_m2 * (self.slope_x**2 + self.slope_y**2), 1.0)
        scale = 1.0 / np.sqrt(growth)
        log_variance = self.log_variance + np.log(growth)
        return _Residual(self.value * scale, self.slope_x * scale, self.slope_y * scale, log_variance)


@dataclass(frozen=True)
class PathDensity:
    """Log-densities (N,) of a path with their priors; chi-square of the direct path, gradient and information of half.

    ``towards`` holds the parts of the indirect density in which an angle points at the target, with its residual.
    """

    log_direct: FloatArray
    log_indirect: FloatArray
    chi_square: FloatArray
    gradient_x: FloatArray
    gradient_y: FloatArray
    information: SymmetricMatrix
    towards: tuple[tuple[FloatArray, _Residual], ...]

    def pull(self, log_total: FloatArray) -> tuple[FloatArray, FloatArray, SymmetricMatrix]:
        """Return the expected gradient and information of the path, given the log of its whole density (N,)."""
        share = np.exp(self.log_direct - log_total)
        gradient_x, gradient_y = share * self.gradient_x, share * self.gradient_y
        information = self.information * share
        for log_part, angle in self.towards:
            share = np.exp(log_part - log_total)
            gradient_x += share * angle.value * angle.slope_x
            gradient_y += share * angle.value * angle.slope_y
            information += SymmetricMatrix.outer(angle.slope_x, angle.slope_y, weight=share)
        return gradient_x, gradient_y, information

    def missing_information(self, log_total: FloatArray) -> SymmetricMatrix:
        """Return what the expected information of `pull` has too much: the membership of the path is unknown.

        That is the covariance of the gradient over the memberships.
        """
        mean_x, mean_y, _ = self.pull(log_total)
        share = np.exp(self.log_direct - log_total)
        missing = SymmetricMatrix.outer(self.gradient_x, self.gradient_y, weight=share)
        for log_part, angle in self.towards:
            weight = np.exp(log_part - log_total) * angle.value * angle.value
            missing += SymmetricMatrix.outer(angle.slope_x, angle.slope_y, weight=weight)
        missing += SymmetricMatrix.outer(mean_x, mean_y) * np.full(mean_x.shape, -1.0)
        return missing


def path_density(
    problem: TripletProblem, k: int, x: FloatArray, y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> PathDensity:
    """Return the densities of path k of every snapshot at targets (N,), (P, N); ``scale_m`` (N,) is the paths' size."""
    scatter = problem.scatter_m2[:, k]
    residuals = _residuals(problem, k, x, y)
    log_direct, chi_square, gradient_x, gradient_y, information = _direct(residuals, scatter)
    dod, doa, length = (residual.scattered(scatter) for residual in residuals)
    log_detour = _log_detour(length, scale_m)
    log_detour += math.log(model.prior_indirect) + math.log1p(-model.clutter) + _LOG_THIRD - _LOG_TURN
    towards = tuple((log_detour + angle.log_density, angle) for angle in (dod, doa))
    clutter = math.log(model.prior_indirect) + math.log(model.clutter) - 2.0 * _LOG_TURN
    neither = np.logaddexp(log_detour - _LOG_TURN, clutter - np.log(4.0 * scale_m))
    return PathDensity(
        math.log1p(-model.prior_indirect) + log_direct,
        np.logaddexp(np.logaddexp(towards[0][0], towards[1][0]), neither),
        chi_square,
        gradient_x,
        gradient_y,
        information,
        towards,
    )


def log_unrelated(problem: TripletProblem, scale_m: FloatArray) -> FloatArray:
    """Return the log-densities (B, K) of paths unrelated to any target: uniform angles, longer than their baselines."""
    base_x, base_y = problem.rx_x - problem.tx_x, problem.rx_y - problem.tx_y
    excess = np.maximum(problem.path_length_m - np.sqrt(base_x * base_x + base_y * base_y), 0.0)
    excess_scale = 0.5 * scale_m[:, None]
    return -2.0 * _LOG_TURN - excess / excess_scale - np.log(excess_scale)


def _residuals(problem: TripletProblem, k: int, x: FloatArray, y: FloatArray) -> tuple[_Residual, _Residual, _Residual]:
    """Return the residuals of DOD, DOA and path length of path k."""
    angles = []
    reach, sum_x, sum_y = (np.zeros(x.shape) for _ in range(3))
    nodes = (
        (problem.tx_x, problem.tx_y, problem.dod_cosine, problem.dod_sine, problem.inverse_dod_std),
        (problem.rx_x, problem.rx_y, problem.doa_cosine, problem.doa_sine, problem.inverse_doa_std),
    )
    for node_x, node_y, cosine, sine, inverse_stds in nodes:
        inverse_std = inverse_stds[:, k]
        dx, dy = x - node_x[:, k], y - node_y[:, k]
        distance = np.sqrt(dx * dx + dy * dy)
        inverse = 1.0 / distance
        ux, uy = dx * inverse, dy * inverse
        slope = inverse_std * inverse
        value = angle_residual(cosine[:, k], sine[:, k], dx, dy) * inverse_std
        angles.append(_Residual(value, uy * slope, -ux * slope, -2.0 * np.log(inverse_std)))
        reach, sum_x, sum_y = reach + distance, sum_x + ux, sum_y + uy
    inverse_std = problem.inverse_length_std[:, k]
    value = (reach - problem.path_length_m[:, k]) * inverse_std
    length = _Residual(value, sum_x * inverse_std, sum_y * inverse_std, -2.0 * np.log(inverse_std))
    return angles[0], angles[1], length


def _direct(
    residuals: tuple[_Residual, _Residual, _Residual], scatter_m2: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, SymmetricMatrix]:
    """Return log-density and chi-square of a direct path, and gradient and information of half the chi-square."""
    shape = residuals[0].value.shape
    chi_square, log_variance, gradient_x, gradient_y = (np.zeros(shape) for _ in range(4))
    information = SymmetricMatrix.full(shape, 0.0)
    for part in residuals:
        chi_square += part.value * part.value
        log_variance += part.log_variance
        gradient_x += part.value * part.slope_x
        gradient_y += part.value * part.slope_y
        information += SymmetricMatrix.outer(part.slope_x, part.slope_y)
    if scatter_m2.any():
        # With J the slopes and v the variance: (I + v J J^T)^-1 = I - v J (I + v J^T J)^-1 J^T (Woodbury).
        # The information is J^T (I + v J J^T)^-1 J = (I + v H)^-1 H = (H + v det(H) I) / det(I + v H) for H = J^T J.
        wide = scatter_m2 > 0.0
        grown = (information * scatter_m2).add_to_diagonal(np.ones(shape))
        determinant = grown.determinant
        pull_x, pull_y = grown.solve(gradient_x, gradient_y)
        absorbed = scatter_m2 * (gradient_x * pull_x + gradient_y * pull_y)
        less = information.add_to_diagonal(scatter_m2 * information.determinant) * (1.0 / determinant)
        chi_square = np.where(wide, chi_square - absorbed, chi_square)
        log_variance = np.where(wide, log_variance + np.log(determinant), log_variance)
        gradient_x, gradient_y = np.where(wide, pull_x, gradient_x), np.where(wide, pull_y, gradient_y)
        information = less.where(wide, information)
    return -0.5 * (chi_square + log_variance) - 1.5 * _LOG_TURN, chi_square, gradient_x, gradient_y, information


def _log_detour(length: _Residual, scale_m: FloatArray) -> FloatArray:
    """Return the log-density of a length that exceeds the direct path's by an exponential law, plus its error."""
    excess_scale = 0.5 * scale_m
    std = np.exp(0.5 * length.log_variance)
    ratio = std / excess_scale
    scaled = -length.value
    return 0.5 * ratio * ratio - scaled * ratio + log_ndtr(scaled - ratio) - np.log(excess_scale)
