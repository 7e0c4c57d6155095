"""Sets of rows that may be of one source: crossings of rays, moved until they take the same rows as before.

A set takes at most one row of each sensor. A crossing takes from every sensor the row nearest to it, moves to the fit
of those, and again; then sets with other rows within the gate, and with one or two sensors less, are tried.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import chdtri, gammaincc, gammainccinv

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.errors import DataError
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.association.sensor_rows import SensorRows
from nlosctl.solvers.association.set_fits import SourceSets, fit_sets
from nlosctl.solvers.association.source_model import RowsAtPoints, SourceModel, set_weights
from nlosctl.solvers.bearings.row_crossings import cross_rows

__all__ = ["Gates", "find_sets"]

_ROUNDS = 8
_MAX_COMBINATIONS = 256
_NUMBERS = 1 << 20
"""So many terms of rows are in memory at a time."""

_MOST_NUMBERS = 1 << 26
"""More rows of crossings or of sets of one snapshot are an error: they would take minutes and gigabytes."""

_CLOSE = 4.0
"""A set is fitted if its chi-square, predicted from that of the set it comes from, is within so many limits."""

_PROMISING = -5.0
"""And if its predicted weight is at least this, in nats."""

_LARGEST_CODE = 1 << 62
_NOTHING = -1


@dataclass(frozen=True, kw_only=True)
class Gates:
    """What a set of rows must satisfy.

    ``min_sensors`` is the least number of sensors that see a source, ``gate_std`` how far, in standard deviations, a
    bearing may be from it, ``false_alarm`` the probability that the chi-square of a true source is rejected.
    """

    min_sensors: int
    gate_std: float
    false_alarm: float


def find_sets(table: SensorRows, model: SourceModel, gates: Gates) -> tuple[SourceSets, FloatArray]:
    """Return the sets of rows that may be of one source, each once, by snapshot, and their weights, all positive."""
    snapshot, point, pair = _crossings(table, model)
    _refuse_many(table, snapshot, np.full(snapshot.shape, table.batch.measurements))
    step = max(1, _NUMBERS // max(1, table.batch.measurements))
    starts = range(0, max(snapshot.shape[0], 1), step)
    parts = [
        _settle(table, model, gates, snapshot[at], tuple(axis[at] for axis in point), tuple(axis[at] for axis in pair))
        for at in (slice(start, start + step) for start in starts)
    ]
    snapshot, rows = (np.concatenate([part[index] for part in parts]) for index in (0, 1))
    point = tuple(np.concatenate(columns) for columns in zip(*(part[2] for part in parts), strict=True))
    snapshot, rows, first = _different(snapshot, rows)
    settled = fit_sets(table.batch, model.lines.center, snapshot, rows, tuple(part[first] for part in point))
    settled = settled.take(
        np.flatnonzero(settled.valid & (settled.chi_square <= _CLOSE * _limit(model, settled, gates)))
    )
    candidates = fit_sets(table.batch, model.lines.center, *_variants(table, model, gates, settled))
    with ignoring_overflow():
        kept = candidates.valid & (candidates.chi_square <= _limit(model, candidates, gates))
        kept &= model.contains(candidates.snapshot, *candidates.point)
    candidates = candidates.take(np.flatnonzero(kept))
    weight = _weights(table, model, candidates)
    positive = np.flatnonzero(weight > 0.0)
    return candidates.take(positive), weight[positive]


def _weights(table: SensorRows, model: SourceModel, sets: SourceSets) -> FloatArray:
    return set_weights(model, table.sensors, sets.snapshot, sets.rows, sets.chi_square, sets.information)


def _crossings(table: SensorRows, model: SourceModel) -> tuple[IntArray, Point, tuple[IntArray, IntArray]]:
    """Return where rays of different sensors cross in the region: snapshots (C,), points and the two rows."""
    first, second = np.triu_indices(table.batch.measurements, 1)
    crossings = cross_rows(model.lines, first, second)
    inside = model.region.edge_distance_m(*crossings.point) >= -model.margin_m[:, None]
    usable = crossings.valid & inside & (table.sensor[:, first] != table.sensor[:, second])
    snapshot, pair = np.nonzero(usable)
    return snapshot, tuple(part[snapshot, pair] for part in crossings.point), (first[pair], second[pair])


def _settle(
    table: SensorRows, model: SourceModel, gates: Gates, snapshot: IntArray, point: Point, pair: tuple[IntArray, ...]
) -> tuple[IntArray, IntArray, Point]:
    """Return the snapshots (C,), rows (C, N) and points of the sets that crossings of pairs of rows settle at."""
    done: list[tuple[IntArray, IntArray, Point]] = []
    rows = np.full((snapshot.shape[0], table.rows.shape[1]), _NOTHING, dtype=np.int64)
    own = np.stack(pair, axis=1)
    for _ in range(_ROUNDS):
        if not snapshot.size:
            break
        terms = model.terms(snapshot, point)
        _, _, information = _sums(model, terms, snapshot, point, own)
        distance = _distances(model, gates, snapshot, terms, information)
        before, rows = rows, _nearest(table, snapshot, distance)
        cost, gradient, information = _sums(model, terms, snapshot, point, rows)
        with ignoring_overflow():
            step = information.solve(*gradient)
            cost = cost - 0.5 * sum(part * slope for part, slope in zip(step, gradient, strict=True))
        point = tuple(part - move for part, move in zip(point, step, strict=True))
        seen = np.count_nonzero(rows >= 0, axis=1) >= gates.min_sensors
        alive = np.flatnonzero(seen & np.isfinite(cost) & np.logical_and.reduce([np.isfinite(part) for part in point]))
        order = alive[np.argsort(cost[alive], kind="stable")]
        _, _, first = _different(snapshot[order], rows[order])
        kept = order[first]
        stays = (rows[kept] == before[kept]).all(axis=1)
        done.append(_taken(kept[stays], snapshot, rows, point))
        snapshot, rows, point = _taken(kept[~stays], snapshot, rows, point)
        own = rows
    done.append((snapshot, rows, point))
    points = zip(*(part[2] for part in done), strict=True)
    joined = [np.concatenate([part[index] for part in done]) for index in (0, 1)]
    return joined[0], joined[1], tuple(np.concatenate(columns) for columns in points)


def _taken(index: IntArray, snapshot: IntArray, rows: IntArray, point: Point) -> tuple[IntArray, IntArray, Point]:
    return snapshot[index], rows[index], tuple(part[index] for part in point)


def _sums(
    model: SourceModel, terms: RowsAtPoints, snapshot: IntArray, point: Point, rows: IntArray
) -> tuple[FloatArray, Point, SymmetricMatrix]:
    """Return half the chi-square (C,) of some rows (C, n) and of a height, its derivatives and information."""
    half, slopes, gauss = model.height_terms(snapshot, point)
    taken, index = rows >= 0, np.maximum(rows, 0)

    def total(values: FloatArray) -> FloatArray:
        return sum_measurements(np.where(taken, np.take_along_axis(values, index, axis=1), 0.0))

    gradient = tuple(slope + total(part) for slope, part in zip(slopes, terms.gradient, strict=True))
    return half + total(terms.half), gradient, gauss + terms.gauss.map(total)


def _distances(
    model: SourceModel, gates: Gates, snapshot: IntArray, terms: RowsAtPoints, information: SymmetricMatrix
) -> FloatArray:
    """Return the squared distances (C, K) of rows from fixes in units of their gates: above 1 is outside.

    r' (S + G C G')^-1 r, with the residuals r of a row, their covariance S, their derivatives G and the covariance C of
    the fix, of the information J = C^-1: by Woodbury r' S^-1 r - v' (J + A)^-1 v, with A = G' S^-1 G, v = G' S^-1 r.
    """
    with ignoring_overflow():
        moved = (information.at(slice(None), None) + terms.gauss).solve(*terms.gradient)
        gain = sum(part * slope for part, slope in zip(moved, terms.gradient, strict=True))
        squared = 2.0 * terms.half - gain
    tail = gammaincc(0.5, 0.5 * gates.gate_std**2)
    gate = np.array([np.inf, gates.gate_std**2, chdtri(2, tail), chdtri(3, tail)])
    squared = squared / gate[model.scalars[snapshot]]
    return np.where(np.isfinite(squared), squared, np.inf)


def _nearest(table: SensorRows, snapshot: IntArray, distance: FloatArray) -> IntArray:
    """Return the nearest row (C, N) of each sensor within the gate, -1 without one, by the distances (C, K)."""
    rows, away = _by_sensor(table, snapshot, distance)
    nearest = np.argmin(away, axis=2)[..., None]
    chosen = np.take_along_axis(rows, nearest, axis=2)[..., 0]
    return np.where(np.take_along_axis(away, nearest, axis=2)[..., 0] <= 1.0, chosen, _NOTHING)


def _by_sensor(table: SensorRows, snapshot: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return the rows (C, N, M) of each sensor, and their values, infinite after the last."""
    rows = table.rows[snapshot]
    flat = np.maximum(rows, 0).reshape(rows.shape[0], rows.shape[1] * rows.shape[2])
    own = np.take_along_axis(values, flat, axis=1).reshape(rows.shape)
    return rows, np.where(rows >= 0, own, np.inf)


def _limit(model: SourceModel, sets: SourceSets, gates: Gates) -> FloatArray:
    """Return the largest chi-square (C,) of sets of true sources."""
    return _chi_square_limit(model, sets.snapshot, sets.rows, gates.false_alarm)


def _chi_square_limit(model: SourceModel, snapshot: IntArray, rows: IntArray, false_alarm: float) -> FloatArray:
    scalars = np.where(rows >= 0, model.scalars[snapshot[:, None], np.maximum(rows, 0)], 0).sum(axis=1)
    degrees = np.maximum(scalars + model.height_scalars()[snapshot] - model.unknowns, 1)
    limits = 2.0 * gammainccinv(0.5 * np.arange(1, int(degrees.max(initial=1)) + 1), false_alarm)
    return np.asarray(limits[degrees - 1])


def _variants(
    table: SensorRows, model: SourceModel, gates: Gates, sets: SourceSets
) -> tuple[IntArray, IntArray, Point]:
    """Return the settled sets and their variants that may be sources: snapshots, rows, and points to fit them from."""
    terms = model.terms(sets.snapshot, sets.point)
    distance = _distances(model, gates, sets.snapshot, terms, sets.information)
    source, rows = _combinations(table, sets, distance)
    sensors = np.count_nonzero(rows >= 0, axis=1)
    _refuse_many(table, sets.snapshot[source], (1 + sensors + sensors * (sensors - 1) // 2) * rows.shape[1])
    fewer, fewer_rows = _with_fewer_sensors(rows, gates.min_sensors)
    source, rows = np.concatenate([source, source[fewer]]), np.concatenate([rows, fewer_rows])
    enough = np.count_nonzero(rows >= 0, axis=1) >= gates.min_sensors
    source, rows = source[enough], rows[enough]
    snapshot, rows, first = _different(sets.snapshot[source], rows)
    source = source[first]
    point = tuple(part[source] for part in sets.point)
    own = RowsAtPoints(terms.half[source], tuple(part[source] for part in terms.gradient), terms.gauss.take(source))
    half, gradient, information = _sums(model, own, snapshot, point, rows)
    with ignoring_overflow():
        step = information.solve(*gradient)
        chi_square = 2.0 * half - sum(part * slope for part, slope in zip(step, gradient, strict=True))
        point = tuple(part - move for part, move in zip(point, step, strict=True))
        promising = chi_square <= _CLOSE * _chi_square_limit(model, snapshot, rows, gates.false_alarm)
        promising &= set_weights(model, table.sensors, snapshot, rows, chi_square, information) >= _PROMISING
    return _taken(np.flatnonzero(promising), snapshot, rows, point)


def _combinations(table: SensorRows, sets: SourceSets, distance: FloatArray) -> tuple[IntArray, IntArray]:
    """Return combinations (T, N) of the rows within the gates of each set, and the set each comes from.

    The set itself is the first; of more than ``_MAX_COMBINATIONS`` those that differ at the first sensors are kept.
    """
    rows, away = _by_sensor(table, sets.snapshot, distance)
    own = rows == sets.rows[..., None]
    own &= rows >= 0
    key = np.where(own, -1.0, np.where(away <= 1.0, away, np.inf))
    order = np.argsort(key, axis=2, kind="stable")
    ranked = np.where(
        np.isfinite(np.take_along_axis(key, order, axis=2)), np.take_along_axis(rows, order, axis=2), _NOTHING
    )
    count = np.maximum(np.count_nonzero(ranked >= 0, axis=2), 1)
    total = np.minimum(np.prod(count, axis=1, dtype=np.float64), _MAX_COMBINATIONS).astype(np.int64)
    _refuse_many(table, sets.snapshot, total * count.shape[1])
    source = np.repeat(np.arange(total.shape[0]), total)
    number = np.arange(source.shape[0]) - np.repeat(np.cumsum(total) - total, total)
    chosen = np.empty((source.shape[0], count.shape[1]), dtype=np.int64)
    for sensor in range(count.shape[1]):
        choices = count[source, sensor]
        chosen[:, sensor] = ranked[source, sensor, number % choices]
        number = number // choices
    return source, chosen


def _with_fewer_sensors(rows: IntArray, least: int) -> tuple[IntArray, IntArray]:
    """Return sets of rows (C, N) with one or two sensors less, and the set each comes from."""
    sensors = rows.shape[1]
    left_out = [np.isin(np.arange(sensors), some) for size in (1, 2) for some in combinations(range(sensors), size)]
    masks = np.array(left_out, dtype=bool).reshape(-1, sensors)
    step = max(1, _MOST_NUMBERS // max(1, masks.size))
    parts = [_masked(rows[start : start + step], masks, least) for start in range(0, max(rows.shape[0], 1), step)]
    source = [part + number * step for number, (part, _) in enumerate(parts)]
    return np.concatenate(source), np.concatenate([fewer for _, fewer in parts])


def _masked(rows: IntArray, masks: BoolArray, least: int) -> tuple[IntArray, IntArray]:
    """Return sets of rows (C, N) without each of the masks (M, N) of sensors they have, and the set each comes from."""
    seen = rows >= 0
    fewer = seen.sum(axis=1)[:, None] - masks.sum(axis=1)
    source, mask = np.nonzero(((seen[:, None] | ~masks).all(axis=2)) & (fewer >= least))
    return source, np.where(masks[mask], _NOTHING, rows[source])


def _refuse_many(table: SensorRows, snapshot: IntArray, numbers: IntArray) -> None:
    """Raise DataError if a snapshot has more ``numbers`` (C,) in all than are tried."""
    if np.bincount(snapshot, numbers).max(initial=0) > _MOST_NUMBERS:
        raise DataError(
            f"a snapshot of {table.batch.measurements} bearings of {table.rows.shape[1]} sensors has more sets of "
            "bearings that may be of one source than can be compared; the work grows with the cube of the sensors: "
            "give fewer rows a snapshot (a shorter window, the sensors of one area), or use localize for one source"
        )


def _different(snapshot: IntArray, rows: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Return the different snapshots and rows in sorted order, and the index of the first of each."""
    base, code, size = int(rows.max(initial=0)) + 2, snapshot, int(snapshot.max(initial=0)) + 1
    for own in rows.T:
        if size > _LARGEST_CODE // base:
            values, code = np.unique(code, return_inverse=True)
            size = values.shape[0]
        code, size = code * base + own + 1, size * base
    _, first = np.unique(code, return_index=True)
    return snapshot[first], rows[first], first
