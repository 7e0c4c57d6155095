"""What every bearings method does with its fix: is it an answer, what does it cost, what is left over?"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Estimates, Flags, Solution, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import rows_of, sum_measurements, sum_products
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import RayResiduals, Sight
from nlosctl.solvers.bearings.line_fits import (
    InflatedCovariance,
    fit_focused,
    fit_least_squares,
    inflate_near_sensors,
    with_independent_errors,
)
from nlosctl.solvers.optimization.unknown_std import StdFactors

Point = tuple[FloatArray, ...]
"""The coordinates of points about the local origins, as D arrays (B,)."""

__all__ = ["finish_bearings_fix", "judge_fixes", "judge_optima", "mark_crossings_behind"]

CONDITION_LIMIT = 1e6
"""Largest condition number of the lines' normals at which they still count as crossing."""

_RELATIVE_MINIMUM_RANGE = 1e-5

_ROUNDING = 1e-12
"""Relative size of what rounding leaves of a coordinate."""


_CLEARLY_BEHIND = 3.0
"""A crossing is clearly behind an origin from this many of its standard deviations on."""

_MEETING = 5.0
"""Lines meet at a point if none passes it at more than this many standard deviations."""

_DECISIVE = 20.0
"""A crossing behind the origins explains the bearings better if its chi-square is at least this much less."""


def nearly_singular(normal: SymmetricMatrix) -> BoolArray:
    """Return which normal matrices U^T U are of lines that are nearly parallel: cond(U) over the limit."""
    others = normal.dimension - 1
    with ignoring_overflow():  # the determinant is at most that of equal eigenvalues other than the smallest
        surely = normal.determinant * (others**others * CONDITION_LIMIT**2) > normal.trace**normal.dimension
    singular: BoolArray = ~surely
    rows = np.nonzero(singular)
    smaller, larger = normal.at(*rows).eigenvalues()
    singular[rows] = ~(smaller * CONDITION_LIMIT**2 > larger)
    return singular


def _least_range_m(lines: Sight, farthest_m: FloatArray) -> FloatArray:
    """Return the distance (B,) up to which a point is on an origin.

    Sensors at a single point have no size other than that of their coordinates.
    """
    rounding_m = _ROUNDING * sum(np.abs(part) for part in lines.center)
    return np.maximum(_RELATIVE_MINIMUM_RANGE * farthest_m, rounding_m)


def judge_fixes(
    lines: Sight,
    point: Point,
    rays: RayResiduals,
    covariance: SymmetricMatrix,
    minimum_range_m: float,
    paths: Any = None,
    *,
    allowed_m2: FloatArray | None = None,
) -> StatusArray:
    """Return the status (B,) of fixes at a point about the local origin, with their ray residuals and covariance.

    degenerate: not finite, a standard deviation beyond the distance to the farthest origin, a fix closer to an origin
    than ``minimum_range_m`` (or than 1e-5 of that distance), or at the zenith of a row; behind: behind a ray's origin;
    infeasible: outside the region that the scene allows (`SightLines.outside_scene`), or all bearings are below the
    horizon. ``allowed_m2`` (B,) is a larger variance that is no fault, such as that of a prior.
    """
    farthest = rays.farthest_m
    with ignoring_overflow():
        largest = farthest * farthest if allowed_m2 is None else np.maximum(farthest * farthest, allowed_m2)
        sure = (covariance.trace > 0.0) & (covariance.trace <= largest)
        uncertain = ~sure | nearly_singular(covariance)
        on_sensor = rays.nearest_m <= np.maximum(minimum_range_m, _least_range_m(lines, farthest))
    status = np.full(rays.behind.shape, Status.OK, dtype=np.uint8)
    status[lines.outside_scene(*point, paths=paths) | lines.all_under_horizon()] = Status.INFEASIBLE
    status[rays.behind] = Status.BEHIND
    status[uncertain | on_sensor] = Status.DEGENERATE
    if rays.at_zenith is not None:
        status[rays.at_zenith] = Status.DEGENERATE
    return status


@dataclass(frozen=True)
class Verdict:
    """Status, covariance and cost (half the chi-square) of fixes (B,), and the chi-square of the optimum near them.

    ``factors`` are those of unknown standard deviations, which have no chi-square of their own; None where stated.
    """

    status: StatusArray
    covariance: SymmetricMatrix
    cost: FloatArray
    least_chi_square: FloatArray
    factors: StdFactors | None = None


def finish_bearings_fix(
    batch: BearingBatch,
    lines: Sight,
    point: Point,
    covariance: SymmetricMatrix | None,
    normal: SymmetricMatrix,
    *,
    inflated: InflatedCovariance | None = None,
    min_range_m: float,
    converged: BoolArray | None = None,
    constrained_status: StatusArray | None = None,
    at_optimum: bool = False,
) -> Solution:
    """Return the solution of fixes, as D arrays (B,) about the local origin, that use every row.

    ``covariance`` (B,) is the inverse Fisher information by default; with another one, ``inflated`` computes it for
    fixes near a sensor. ``normal`` (B,) is the unweighted normal matrix of the lines, which shows whether they cross
    at all. Iterative methods pass ``converged`` (B,); constrained methods pass ``constrained_status`` (B,), which
    replaces ok and infeasible. The cost is half the chi-square. Methods whose fixes do not minimize it, other than to
    second order in the errors, leave ``at_optimum`` false: the test of the fit is then that after a Gauss-Newton step.
    """
    verdict = judge_optima(
        lines,
        point,
        covariance,
        normal,
        min_range_m,
        converged,
        constrained_status,
        inflated,
        at_optimum=at_optimum,
        std=batch.std,
    )
    estimates = Estimates.of(
        verdict.status,
        lines.absolute(*point),
        lines.whole_covariance(verdict.covariance, *point),
        verdict.cost,
        batch.measurements,
        chi_square=verdict.least_chi_square,
        degrees_of_freedom=lines.scalars() - len(point),
        columns={} if verdict.factors is None else verdict.factors.columns(verdict.status),
    )
    flags = bearing_flags(batch, lines, verdict.status, *point) if batch.want_flags else None
    return Solution(estimates=estimates, flags=flags)


def judge_optima(
    lines: Sight,
    point: Point,
    covariance: SymmetricMatrix | None,
    normal: SymmetricMatrix,
    min_range_m: float,
    converged: BoolArray | None = None,
    constrained_status: StatusArray | None = None,
    inflated: InflatedCovariance | None = None,
    *,
    at_optimum: bool = True,
    std: str = "stated",
) -> Verdict:
    """Return status, covariance, cost and chi-square of fixes; arguments as in `finish_bearings_fix`.

    ``std`` as in `Batch`: with estimated ones the covariance is that of (1) in docs/unknown-std.md, as it stands.
    """
    paths, scalars = lines.paths_from(*point), lines.scalars()
    rays, factors = lines.ray_residuals(*point, paths=paths), None
    cost = 0.5 * rays.chi_square
    if std == "unknown":
        gain = 0.0 if at_optimum else _gauss_newton_gain(lines, point, paths)
        factors = StdFactors.of(rays.chi_square - gain, scalars - len(point))
        lines = lines.with_std(factors.scaled(lines.std))
        paths = lines.paths_from(*point)
        zenith = None if rays.at_zenith is None else lines.ray_residuals(*point, paths=paths).at_zenith
        rays = replace(rays, chi_square=rays.chi_square / factors.squared, at_zenith=zenith)
        if covariance is not None and inflated is not None:
            covariance = covariance * factors.squared
    searched = covariance is None or inflated is None
    if covariance is None or inflated is None:
        covariance = lines.information(*point, paths=paths).inverse()
        inflated = _inflated_information(lines, point)
    if std == "stated":
        covariance = inflate_near_sensors(covariance, rays.nearest_m, inflated)
    status = judge_fixes(lines, point, rays, covariance, min_range_m, paths)
    if converged is not None:
        open_rows = np.flatnonzero(~converged & has_position(status))
        if open_rows.size:
            on_sensor = _likelier_on_sensor(lines.take(open_rows), rows_of(point, open_rows))
            status[open_rows] = np.where(on_sensor, Status.DEGENERATE, Status.NOT_CONVERGED)
    if constrained_status is not None:
        status = np.where((status == Status.OK) | (status == Status.INFEASIBLE), constrained_status, status)
    status[nearly_singular(normal)] = Status.DEGENERATE
    if searched:
        mark_crossings_behind(status, lines, rays.chi_square)
    status[np.less(scalars, len(point))] = Status.TOO_FEW
    if factors is not None:
        factors.mark(status)
        return Verdict(status, covariance, cost, np.full(status.shape, np.nan), factors)
    gain = 0.0 if at_optimum else _gauss_newton_gain(lines, point, paths)
    return Verdict(status, covariance, cost, rays.chi_square - gain)


def _gauss_newton_gain(lines: Sight, point: Point, paths: Any) -> FloatArray:
    """Return by how much a Gauss-Newton step from points (B,) lowers the chi-square of the linearized residuals."""
    with ignoring_overflow():
        slopes = lines.slopes(*point, paths=paths)
        scaled = lines.residual(*point, paths=paths) / lines.std
        gradient = tuple(sum_products(slope, scaled) for slope in slopes)
        step = SymmetricMatrix.gram(*slopes).solve(*gradient)
        gain = sum(part * slope for part, slope in zip(step, gradient, strict=True))
    return np.asarray(gain)


def mark_crossings_behind(
    status: StatusArray, lines: Sight, chi_square: FloatArray, *, answered_too: bool = False
) -> None:
    """Write behind into the status (B,) of snapshots without an answer whose lines meet behind the sensors instead.

    A likelihood without a maximum in front of the rays ends at a sensor or far away: degenerate, or not converged.
    ``answered_too`` for methods that may end at a fix that fits badly; ``chi_square`` (B,) is that of the fix.
    """
    answered = has_position(status)
    suspect = (status == Status.DEGENERATE) | (status == Status.NOT_CONVERGED)
    rows = np.flatnonzero(suspect | answered if answered_too else suspect)
    if rows.size:
        status[rows[_crosses_behind(lines.take(rows), chi_square[rows], answered[rows])]] = Status.BEHIND


def _crosses_behind(lines: Sight, chi_square: FloatArray, answered: BoolArray) -> BoolArray:
    """Return in which snapshots (B,) the lines meet behind the sensors, as with bearings of the opposite sense.

    The lines, without their directions, then meet at a well-determined point behind a ray's origin, which explains
    them far better than the best point in front, whose ``chi_square`` (B,) is given (NaN if it is unknown). Where that
    point is not ``answered``, it is enough that the crossing is clearly behind the origin.
    """
    first = fit_least_squares(lines)
    lines = with_independent_errors(lines, first)
    fit = fit_focused(lines, first)
    crossing = lines.crossing(*fit.point)
    covariance = fit.normal.inverse()
    with ignoring_overflow():
        farthest_m = crossing.farthest_m
        meeting = (covariance.trace > 0.0) & (covariance.trace <= farthest_m * farthest_m)
        meeting &= (crossing.missed.max(axis=1) <= _MEETING) & (crossing.nearest_m > _least_range_m(lines, farthest_m))
        along_m = crossing.along_m
        clearly = ~answered & (along_m < -_CLEARLY_BEHIND * np.sqrt(covariance.eigenvalues()[1]))
        decisively = ~(sum_measurements(crossing.missed * crossing.missed) + _DECISIVE > chi_square)
        behind: BoolArray = (along_m < 0.0) & meeting & (clearly | decisively) & ~nearly_singular(first.normal)
    return behind


def _likelier_on_sensor(lines: Sight, point: Point) -> BoolArray:
    """Return whether points (B,) are less likely than those on their nearest origins, where there is no smooth optimum.

    On an origin means as close as a fix would be degenerate, in the direction of its ray.
    """
    there = lines.beside_nearest_origin(*point, share=_RELATIVE_MINIMUM_RANGE)
    likelier: BoolArray = lines.ray_residuals(*there).chi_square < lines.ray_residuals(*point).chi_square
    return likelier


def _inflated_information(lines: Sight, point: Point) -> InflatedCovariance:
    def inflated(rows: IntArray, extra_m2: FloatArray) -> SymmetricMatrix:
        return lines.take(rows).information(*rows_of(point, rows), extra_m2=extra_m2).inverse()

    return inflated


def bearing_flags(batch: BearingBatch, lines: Sight, status: StatusArray, *point: FloatArray) -> Flags:
    """Return the flags of fixes (B,): ``used``, residuals, and ``under_horizon`` where the scene has horizons."""
    with ignoring_overflow():
        flags = Flags.of_fixes(status, lines.residuals(batch, *point))
    if not batch.scene.has_horizons(batch.dimension):
        return flags
    return replace(flags, columns={**flags.columns, "under_horizon": lines.under_horizon()})
