"""Whether a path is direct over a target at p or indirect: the densities of its triplet, and their pull on p.

A path is direct with probability 1 - ``prior_indirect``. Its triplet is then normal about what p predicts, with the
covariance S of its errors. A target of radius r scatters each path at a point of its own: with r^2 / 2 the variance of
that point in x and in y, and J the Jacobian of the triplet by p, the covariance grows to S + r^2 / 2 J J^T.

Else a path is indirect: a detour, longer than the direct path by an exponential law. One that meets its other
scatterers behind the target still departs towards the target, one that meets them before still arrives from it. In a
third of the detours each, DOD or DOA is normal about what p predicts; all other angles are uniform. A share ``clutter``
of the indirect paths is over something else, with uniform angles and any length.

In space a direction is an azimuth and, where it is measured, an elevation, uniform over pi radians; the variance is
r^2 / 3. A quarter of the detours each has the DOD, the DOA, or both azimuths about what p predicts: the last ones are
over a floor or a ceiling.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import reduce

import numpy as np
from scipy.special import log_ndtr

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.symmetric import SymmetricMatrix, dot
from nlosctl.solvers.triplets.legs import Residual, leg_to, length_residual
from nlosctl.solvers.triplets.likelihood import LEAST_SCALARS, TripletProblem

__all__ = ["PathDensity", "TargetModel", "log_unrelated", "path_density"]

_LOG_TURN = math.log(2.0 * math.pi)
_LOG_HALF_TURN = math.log(math.pi)
_LOG_THIRD, _LOG_QUARTER = -math.log(3.0), -math.log(4.0)


@dataclass(frozen=True, kw_only=True)
class TargetModel:
    """Prior assumptions: shares of paths, and the largest number of targets."""

    prior_indirect: float
    clutter: float
    targets: int


@dataclass(frozen=True)
class _Residual:
    """A residual (N,) in standard deviations, its slopes by the target (D arrays), and the log of its variance.

    ``present`` (N,) is false where it is not measured, as an elevation may be; None: it is everywhere.
    """

    value: FloatArray
    slope: tuple[FloatArray, ...]
    log_variance: FloatArray
    present: BoolArray | None = None

    @classmethod
    def of(cls, residual: Residual) -> _Residual:
        """Return a residual of the model; without a standard deviation it is not measured."""
        present = residual.inverse_std > 0.0
        if present.all():
            return cls(residual.value, residual.slope, -2.0 * np.log(residual.inverse_std))
        log_variance = -2.0 * np.log(np.where(present, residual.inverse_std, 1.0))
        return cls(residual.value, residual.slope, log_variance, present)

    @property
    def log_density(self) -> FloatArray:
        """Return the log of the normal density, 0 where nothing is measured."""
        log_density = -0.5 * (self.value * self.value + self.log_variance + _LOG_TURN)
        return log_density if self.present is None else np.where(self.present, log_density, 0.0)

    def scattered(self, scatter_m2: FloatArray) -> _Residual:
        """Return the residual of a target whose points of scattering have these variances by each coordinate."""
        if not scatter_m2.any():
            return self
        growth = np.where(scatter_m2 > 0.0, 1.0 + scatter_m2 * dot(self.slope, self.slope), 1.0)
        scale = 1.0 / np.sqrt(growth)
        slope = tuple(part * scale for part in self.slope)
        return replace(self, value=self.value * scale, slope=slope, log_variance=self.log_variance + np.log(growth))


@dataclass(frozen=True)
class _Direction:
    """The measured direction of a node: its azimuth and, in space, its elevation."""

    angles: tuple[_Residual, ...]

    @property
    def log_density(self) -> FloatArray:
        """Return the log of the density of the direction, if it points at the target."""
        total = self.angles[0].log_density
        for angle in self.angles[1:]:
            total = total + angle.log_density
        return total

    @property
    def log_heights(self) -> FloatArray | float:
        """Return the log of the range of the measured elevations, pi radians; 0 in the plane."""
        total: FloatArray | float = 0.0
        for angle in self.angles[1:]:
            total = _LOG_HALF_TURN if angle.present is None else np.where(angle.present, _LOG_HALF_TURN, 0.0)
        return total

    def scattered(self, scatter_m2: FloatArray) -> _Direction:
        """Return the direction to a target that scatters at points around it; the two angles stay independent."""
        return _Direction(tuple(angle.scattered(scatter_m2) for angle in self.angles))


@dataclass(frozen=True)
class PathDensity:
    """Log-densities (N,) of a path with their priors; chi-square of the direct path, gradient and information of half.

    ``towards`` holds the parts of the indirect density in which a direction points at the target, with that direction.
    """

    log_direct: FloatArray
    log_indirect: FloatArray
    chi_square: FloatArray
    gradient: tuple[FloatArray, ...]
    information: SymmetricMatrix
    towards: tuple[tuple[FloatArray, _Direction], ...]

    def pull(self, log_total: FloatArray) -> tuple[tuple[FloatArray, ...], SymmetricMatrix]:
        """Return the expected gradient and information of the path, given the log of its whole density (N,)."""
        share = np.exp(self.log_direct - log_total)
        gradient = tuple(share * part for part in self.gradient)
        information = self.information * share
        for log_part, direction in self.towards:
            share = np.exp(log_part - log_total)
            for angle in direction.angles:
                for total, slope in zip(gradient, angle.slope, strict=True):
                    total += share * angle.value * slope
                information += SymmetricMatrix.outer(*angle.slope, weight=share)
        return gradient, information

    def missing_information(self, log_total: FloatArray) -> SymmetricMatrix:
        """Return what the expected information of `pull` has too much: the membership of the path is unknown.

        That is the covariance of the gradient over the memberships.
        """
        mean, _ = self.pull(log_total)
        share = np.exp(self.log_direct - log_total)
        missing = SymmetricMatrix.outer(*self.gradient, weight=share)
        for log_part, direction in self.towards:
            share = np.exp(log_part - log_total)
            azimuth = direction.angles[0]
            if len(direction.angles) == 1:
                missing += SymmetricMatrix.outer(*azimuth.slope, weight=share * azimuth.value * azimuth.value)
                continue
            gradients = ([angle.value * part for part in angle.slope] for angle in direction.angles)
            missing += SymmetricMatrix.outer(*map(np.add, *gradients), weight=share)
        missing += SymmetricMatrix.outer(*mean) * np.full(mean[0].shape, -1.0)
        return missing


def path_density(
    problem: TripletProblem, k: int, point: tuple[FloatArray, ...], model: TargetModel, scale_m: FloatArray
) -> PathDensity:
    """Return the densities of path k of every snapshot at targets (N,), (P, N); ``scale_m`` (N,) is the paths' size."""
    scatter = problem.scatter_m2[:, k]
    dod, doa, length = _residuals(problem, k, point)
    log_direct, chi_square, gradient, information = _direct((*dod.angles, *doa.angles, length), scatter)
    dod, doa, length = dod.scattered(scatter), doa.scattered(scatter), length.scattered(scatter)
    log_detour = _log_detour(length, scale_m)
    in_space = len(point) == 3
    kinds = _LOG_QUARTER if in_space else _LOG_THIRD
    log_detour += math.log(model.prior_indirect) + math.log1p(-model.clutter) + kinds - _LOG_TURN
    heights = dod.log_heights + doa.log_heights
    towards = [
        (log_detour + dod.log_density - doa.log_heights, dod),
        (log_detour + doa.log_density - dod.log_heights, doa),
    ]
    if in_space:
        level = _Direction((dod.angles[0], doa.angles[0]))
        towards.append((log_detour + _LOG_TURN + level.log_density - heights, level))
    clutter = math.log(model.prior_indirect) + math.log(model.clutter) - 2.0 * _LOG_TURN
    neither = np.logaddexp(log_detour - _LOG_TURN, clutter - np.log(4.0 * scale_m)) - heights
    return PathDensity(
        math.log1p(-model.prior_indirect) + log_direct,
        reduce(np.logaddexp, [part for part, _ in towards] + [neither]),
        chi_square,
        gradient,
        information,
        tuple(towards),
    )


def log_unrelated(problem: TripletProblem, scale_m: FloatArray) -> FloatArray:
    """Return the log-densities (B, K) of paths unrelated to any target: uniform angles, longer than their baselines."""
    baseline = [rx - tx for tx, rx in zip(problem.tx.position, problem.rx.position, strict=True)]
    excess = np.maximum(problem.path_length_m - np.sqrt(dot(baseline, baseline)), 0.0)
    excess_scale = 0.5 * scale_m[:, None]
    heights = (problem.scalars() - LEAST_SCALARS) * _LOG_HALF_TURN
    return -2.0 * _LOG_TURN - excess / excess_scale - np.log(excess_scale) - heights


def _residuals(
    problem: TripletProblem, k: int, point: tuple[FloatArray, ...]
) -> tuple[_Direction, _Direction, _Residual]:
    """Return the residuals of DOD, DOA and path length of path k."""
    legs = [leg_to(node, k, *point) for node in (problem.tx, problem.rx)]
    dod, doa = (
        _Direction(tuple(_Residual.of(angle) for angle in (leg.azimuth, leg.elevation) if angle is not None))
        for leg in legs
    )
    length = length_residual(legs, problem.path_length_m[:, k], problem.inverse_length_std[:, k])
    return dod, doa, _Residual.of(length)


def _direct(
    residuals: tuple[_Residual, ...], scatter_m2: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[FloatArray, ...], SymmetricMatrix]:
    """Return log-density and chi-square of a direct path, and gradient and information of half the chi-square."""
    shape, dimension = residuals[0].value.shape, len(residuals[0].slope)
    chi_square, log_variance = np.zeros(shape), np.zeros(shape)
    gradient = tuple(np.zeros(shape) for _ in range(dimension))
    information = SymmetricMatrix.full(shape, 0.0, dimension)
    scalars: FloatArray | float = 0.0
    for part in residuals:
        chi_square += part.value * part.value
        log_variance += part.log_variance
        for total, slope in zip(gradient, part.slope, strict=True):
            total += part.value * slope
        information += SymmetricMatrix.outer(*part.slope)
        scalars = scalars + (1.0 if part.present is None else np.where(part.present, 1.0, 0.0))
    if scatter_m2.any():
        # With J the slopes and v the variance: (I + v J J^T)^-1 = I - v J (I + v J^T J)^-1 J^T (Woodbury).
        wide = scatter_m2 > 0.0
        grown = (information * scatter_m2).add_to_diagonal(np.ones(shape))
        determinant = grown.determinant
        pull = grown.solve(*gradient)
        absorbed = scatter_m2 * dot(gradient, pull)
        chi_square = np.where(wide, chi_square - absorbed, chi_square)
        log_variance = np.where(wide, log_variance + np.log(determinant), log_variance)
        information = _scattered_information(information, scatter_m2, grown).where(wide, information)
        gradient = tuple(np.where(wide, less, part) for less, part in zip(pull, gradient, strict=True))
    return (-0.5 * (chi_square + log_variance) - 0.5 * scalars * _LOG_TURN, chi_square, gradient, information)


def _scattered_information(
    information: SymmetricMatrix, scatter_m2: FloatArray, grown: SymmetricMatrix
) -> SymmetricMatrix:
    """Return J^T (I + v J J^T)^-1 J = (I + v H)^-1 H for H = J^T J, v the variance, and I + v H.

    In the plane (H + v det(H) I) / det(I + v H), else H - v H (I + v H)^-1 H.
    """
    if information.dimension == 2:
        raised = information.add_to_diagonal(scatter_m2 * information.determinant)
        return raised * (1.0 / grown.determinant)
    return information + information.congruence(grown.inverse()) * -scatter_m2


def _log_detour(length: _Residual, scale_m: FloatArray) -> FloatArray:
    """Return the log-density of a length that exceeds the direct path's by an exponential law, plus its error."""
    excess_scale = 0.5 * scale_m
    std = np.exp(0.5 * length.log_variance)
    ratio = std / excess_scale
    scaled = -length.value
    return 0.5 * ratio * ratio - scaled * ratio + log_ndtr(scaled - ratio) - np.log(excess_scale)
