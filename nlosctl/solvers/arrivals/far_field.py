"""Sources so far away that arrival times hardly differ from those of a plane wave: their distance is not determined."""

from __future__ import annotations

from dataclasses import replace
from functools import reduce
from itertools import product

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.blocks import rows_of, sum_measurements, sum_products
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows
from nlosctl.solvers.arrivals.closed_forms import far_away
from nlosctl.solvers.arrivals.likelihood import AT_INFINITY, PLAUSIBLE_NATS, ArrivalProblem
from nlosctl.solvers.ranges.paired_estimates import RangeOptimum

__all__ = ["are_plane_waves", "distance_is_open", "without_open_distance"]

_STEPS = 5

_RIDGE = 1e-9
"""Added to a normal matrix in units of its trace: sensors in a plane have no slope across it."""

_LEAST_NATS = 12.5
"""A plane wave must be so much worse: the inverse distance is then five standard deviations from zero."""


def without_open_distance(rows: ArrivalRows, optimum: RangeOptimum) -> RangeOptimum:
    """Return the optimum with a covariance that is not finite where its distance is open."""
    nothing = SymmetricMatrix.full(optimum.cost.shape, np.inf, len(optimum.point))
    return replace(optimum, covariance=nothing.where(distance_is_open(rows, *optimum.point), optimum.covariance))


def distance_is_open(rows: ArrivalRows, *point: FloatArray) -> BoolArray:
    """Return for which fixes (B,), D arrays about the local origins, a plane wave explains the arrivals nearly as well.

    The inverse distance is what is nearly Gaussian; that of such a fix is within five standard deviations of zero, and
    the covariance of its position is not the size of its error. The plane wave is a point at `AT_INFINITY` array sizes
    in the direction of the fix, or of a coarse set if one is likelier, turned by Newton steps across it.
    """
    is_open: BoolArray = np.logical_and.reduce([np.isfinite(part) for part in point])
    for judge in (_may_be_open, _is_open):
        some = np.flatnonzero(is_open)
        if some.size:
            is_open[some] = judge(rows.take(some), *rows_of(point, some))
    return is_open


def _may_be_open(rows: ArrivalRows, *point: FloatArray) -> BoolArray:
    """Return for which fixes (B,) that is not ruled out by how well arrivals that rise linearly may fit.

    Those of a point that is `AT_INFINITY` array sizes R away do so up to a^2 / 2R of a sensor a from the local origin.
    """
    inverse_std, count = 1.0 / rows.std_m, rows.std_m.shape[1]
    columns = [rows.arrival_m, *map(rows.measured, rows.sensor)]
    arrival, *sensor = (inverse_std * (part - rows.common(part)[:, None]) for part in columns)
    if rows.speed is not None:
        arrival, *sensor = map(rows.speed.whitened, (arrival, *sensor))
    bend = reduce(np.add, [part * part for part in rows.sensor])
    if rows.height is not None:
        bend += rows.height * rows.height
    bend = inverse_std * (bend[:, :count] + bend[:, count:] if rows.of_pairs else bend)
    with ignoring_overflow():
        normal = SymmetricMatrix.gram(*sensor)
        pull = [sum_products(part, arrival) for part in sensor]
        explained = _dot(tuple(pull), normal.add_to_diagonal(_RIDGE * normal.trace).solve(*pull))
        least = np.sqrt(np.maximum(sum_products(arrival, arrival) - explained, 0.0))
        least -= np.sqrt(sum_products(bend, bend)) / (AT_INFINITY * rows.size_m())
        least = np.maximum(least, 0.0)
        fix = rows.half_chi_squares(*(part[:, None] for part in point))[:, 0]
        surely_closed: BoolArray = 0.5 * least * least - fix > _LEAST_NATS
    return ~surely_closed


def _is_open(rows: ArrivalRows, *point: FloatArray) -> BoolArray:
    problem, far_m = ArrivalProblem.of_rows(rows), AT_INFINITY * rows.size_m()
    with ignoring_overflow():
        wave = _wave_cost(problem, far_m, _likeliest(rows, far_m, _normalized(point)))
        fix = problem.evaluate(*point).cost
    with ignoring_invalid():
        return np.asarray(wave - fix <= _LEAST_NATS)


def are_plane_waves(rows: ArrivalRows) -> BoolArray:
    """Return in which snapshots (B,), of more rows than unknowns, a plane wave explains all arrivals."""
    size = rows.size_m()
    weight = 1.0 / (rows.std_m * rows.std_m)
    weight = weight / sum_measurements(weight)[:, None]
    with ignoring_overflow():
        unit = _normalized(far_away([part / size[:, None] for part in rows.sensor], rows.arrival_m, weight))
        wave = _wave_cost(ArrivalProblem.of_rows(rows), AT_INFINITY * size, unit)
    with ignoring_invalid():
        plausible: BoolArray = wave <= PLAUSIBLE_NATS + 2.0 * rows.degrees_of_freedom
    return plausible & (rows.degrees_of_freedom > 0)


def _wave_cost(problem: ArrivalProblem, far_m: FloatArray, unit: tuple[FloatArray, ...]) -> FloatArray:
    """Return the cost (B,) of points at a distance, turned from the direction of unit vectors by Newton steps."""
    for _ in range(_STEPS):
        at = problem.evaluate(*(part * far_m for part in unit))
        across = _across(unit)
        steps = []
        for tangent in across:
            curve = at.hessian.quadratic_form(*tangent)
            steps.append(np.where(curve > 0.0, -_dot(tangent, at.gradient) / (curve * far_m), 0.0))
        turned = tuple(
            part + sum(step * tangent[axis] for step, tangent in zip(steps, across, strict=True))
            for axis, part in enumerate(unit)
        )
        unit = _normalized(turned)
    return problem.evaluate(*(part * far_m for part in unit)).cost


def _likeliest(rows: ArrivalRows, far_m: FloatArray, unit: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    """Return the likeliest of unit vectors and of those whose coordinates are equal in size or zero."""
    signs = np.array([signs for signs in product((-1.0, 0.0, 1.0), repeat=len(unit)) if any(signs)])
    coarse = (signs / np.linalg.norm(signs, axis=1)[:, None]).T
    tried = [np.column_stack([own, np.tile(part, (own.size, 1))]) for own, part in zip(unit, coarse, strict=True)]
    cost = rows.half_chi_squares(*(part * far_m[:, None] for part in tried))
    best = np.argmin(np.where(np.isnan(cost), np.inf, cost), axis=1)
    return tuple(part[np.arange(best.size), best] for part in tried)


def _normalized(vector: tuple[FloatArray, ...]) -> tuple[FloatArray, ...]:
    length = np.sqrt(_dot(vector, vector))
    return tuple(part / length for part in vector)


def _dot(one: tuple[FloatArray, ...], other: tuple[FloatArray, ...]) -> FloatArray:
    return np.asarray(sum(a * b for a, b in zip(one, other, strict=True)))


def _across(unit: tuple[FloatArray, ...]) -> list[tuple[FloatArray, ...]]:
    """Return D - 1 unit vectors across unit vectors: in space along the horizontal and up."""
    if len(unit) == 2:
        return [(-unit[1], unit[0])]
    x, y, z = unit
    level = np.hypot(x, y)
    zero = np.zeros(x.shape)
    steep = level < 1e-9
    cosine, sine = np.where(steep, 1.0, x / level), np.where(steep, 0.0, y / level)
    return [(-sine, cosine, zero), (-z * cosine, -z * sine, level)]
