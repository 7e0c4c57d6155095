"""Several sources by bearings in plain Python: the rule of docs/several-sources.md, one snapshot, nothing vectorized.

Independent of the solvers: crossings, fits, gates, weights and the choice of disjoint sets are written again.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, islice, product

from scipy.stats import chi2

GATE, ROUNDS, MOST = 4.0, 8, 256


@dataclass(frozen=True)
class Row:
    """A bearing: sensor, its place in metres, direction and standard deviation in radians."""

    sensor: object
    x: float
    y: float
    bearing: float
    std: float

    def residual(self, x: float, y: float) -> float:
        """Return measured minus predicted bearing, wrapped."""
        error = self.bearing - math.atan2(y - self.y, x - self.x)
        return math.atan2(math.sin(error), math.cos(error))

    def gradient(self, x: float, y: float) -> tuple[float, float]:
        """Return the derivatives of the predicted bearing."""
        dx, dy = x - self.x, y - self.y
        return -dy / (dx * dx + dy * dy), dx / (dx * dx + dy * dy)

    def points_at(self, x: float, y: float) -> bool:
        """Return whether a point is in front."""
        return (x - self.x) * math.cos(self.bearing) + (y - self.y) * math.sin(self.bearing) > 0.0


@dataclass(frozen=True)
class Fit:
    """The maximum-likelihood position of some rows, chi-square and information (xx, xy, yy)."""

    x: float
    y: float
    chi_square: float
    information: tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Rule:
    """What the rule needs besides the rows: a field (xmin, xmax, ymin, ymax), and what is expected in which area."""

    field: tuple[float, float, float, float]
    area_m2: float
    detection: float = 0.9
    sources: float = 3.0
    least_range_m: float = 1.0

    def inside(self, x: float, y: float) -> bool:
        """Return whether a point is in the field or within 5 % of its side around it."""
        xmin, xmax, ymin, ymax = self.field
        margin = 0.05 * max(xmax - xmin, ymax - ymin)
        away = math.hypot(max(xmin - x, 0.0, x - xmax), max(ymin - y, 0.0, y - ymax))
        return away <= margin


def information(rows: Sequence[Row], x: float, y: float) -> tuple[float, float, float]:
    """Return the Fisher information at a point."""
    xx = xy = yy = 0.0
    for row in rows:
        gx, gy = row.gradient(x, y)
        weight = 1.0 / (row.std * row.std)
        xx, xy, yy = xx + weight * gx * gx, xy + weight * gx * gy, yy + weight * gy * gy
    return xx, xy, yy


def chi_square(rows: Sequence[Row], x: float, y: float) -> float:
    """Return the sum of squared residuals over their variances."""
    return sum((row.residual(x, y) / row.std) ** 2 for row in rows)


def fit(rows: Sequence[Row], x: float, y: float) -> Fit | None:
    """Return the fit by Gauss-Newton with halved steps, from a point; None where it does not settle."""
    cost = chi_square(rows, x, y)
    for _ in range(100):
        xx, xy, yy = information(rows, x, y)
        determinant = xx * yy - xy * xy
        if not determinant > 0.0:
            return None
        sx = sy = 0.0
        for row in rows:
            gx, gy = row.gradient(x, y)
            scaled = row.residual(x, y) / (row.std * row.std)
            sx, sy = sx + gx * scaled, sy + gy * scaled
        dx, dy = (yy * sx - xy * sy) / determinant, (xx * sy - xy * sx) / determinant
        if sx * dx + sy * dy < 1e-16:
            return Fit(x, y, cost, (xx, xy, yy))
        share = 1.0
        while (trial := chi_square(rows, x + share * dx, y + share * dy)) > cost and share > 1e-4:
            share *= 0.5
        if trial > cost:
            return Fit(x, y, cost, (xx, xy, yy)) if sx * dx + sy * dy < 1e-8 else None
        x, y, cost = x + share * dx, y + share * dy, trial
    return None


def distance(row: Row, place: Fit) -> float:
    """Return the residual of a row in units of sqrt(s^2 + g' C g), infinite behind it."""
    if not row.points_at(place.x, place.y):
        return math.inf
    xx, xy, yy = place.information
    gx, gy = row.gradient(place.x, place.y)
    spread = (yy * gx * gx - 2.0 * xy * gx * gy + xx * gy * gy) / (xx * yy - xy * xy)
    return abs(row.residual(place.x, place.y)) / math.sqrt(row.std * row.std + spread)


def weight(rows: Sequence[Row], place: Fit, sensors: int, clutter: float, rule: Rule) -> float:
    """Return the weight of a set against clutter, in nats."""
    xx, xy, yy = place.information
    seen = sum(math.log(rule.detection / clutter) - math.log(math.sqrt(2.0 * math.pi) * row.std) for row in rows)
    missed = (sensors - len(rows)) * math.log(1.0 - rule.detection)
    anywhere = math.log(rule.sources / rule.area_m2) + math.log(2.0 * math.pi) - 0.5 * math.log(xx * yy - xy * xy)
    return seen - 0.5 * place.chi_square + missed + anywhere


class Snapshot:
    """The rows of one snapshot, by sensor, and the sets that may be sources."""

    def __init__(self, rows: Sequence[Row], rule: Rule) -> None:
        self.rows, self.rule = list(rows), rule
        self.sensors: dict[object, list[int]] = {}
        for index, row in enumerate(rows):
            self.sensors.setdefault((row.sensor, row.x, row.y), []).append(index)
        self.clutter = max(len(self.rows) / max(len(self.sensors), 1), 1.0) / (2.0 * math.pi)

    def find(self) -> tuple[list[tuple[int, ...]], float]:
        """Return the best disjoint sets of row indices, and their total weight."""
        weights: dict[tuple[int, ...], float] = {}
        settled = {chosen: place for chosen, place in map(self.settle, self.seeds()) if chosen}
        for chosen, place in settled.items():
            for variant in self.variants(chosen, place):
                if variant not in weights:
                    weights[variant] = self.judge(variant, place)
        return best_disjoint({chosen: value for chosen, value in weights.items() if value > 0.0})

    def seeds(self) -> Iterator[tuple[tuple[int, int], Fit]]:
        """Yield the forward crossings of rays of different sensors in the field."""
        owner = {index: sensor for sensor, rows in self.sensors.items() for index in rows}
        for i, j in combinations(range(len(self.rows)), 2):
            if owner[i] != owner[j] and (point := cross(self.rows[i], self.rows[j])) and self.rule.inside(*point):
                pair = [self.rows[i], self.rows[j]]
                yield (i, j), Fit(*point, 0.0, information(pair, *point))

    def settle(self, seed: tuple[tuple[int, int], Fit]) -> tuple[tuple[int, ...], Fit]:
        """Return the set that a crossing settles at, empty if fewer than three sensors see it."""
        chosen, place = seed
        for _ in range(ROUNDS):
            nearest = [
                min(rows, key=lambda index: (distance(self.rows[index], place), index))
                for rows in self.sensors.values()
            ]
            taken = tuple(index for index in nearest if distance(self.rows[index], place) <= GATE)
            if taken == chosen:
                break
            moved = fit([self.rows[index] for index in taken], place.x, place.y) if len(taken) >= 3 else None
            if moved is None:
                return (), place
            chosen, place = taken, moved
        return (chosen if len(chosen) >= 3 else ()), place

    def variants(self, chosen: tuple[int, ...], place: Fit) -> Iterator[tuple[int, ...]]:
        """Yield the set with other rows inside the gate, and with up to two sensors less."""
        choices = []
        for rows in self.sensors.values():
            own = [index for index in rows if index in chosen]
            near = sorted((distance(self.rows[index], place), index) for index in rows if index not in chosen)
            choices.append([*own, *(index for away, index in near if away <= GATE)] or [-1])
        for some in islice(product(*choices), MOST):
            whole = tuple(index for index in some if index >= 0)
            for fewer in range(3):
                for left_out in combinations(range(len(whole)), fewer):
                    rest = tuple(index for at, index in enumerate(whole) if at not in left_out)
                    if len(rest) >= 3:
                        yield rest

    def judge(self, chosen: Sequence[int], place: Fit) -> float:
        """Return the weight of a set, minus infinity if it cannot be a source."""
        rows = [self.rows[index] for index in chosen]
        own = fit(rows, place.x, place.y)
        if own is None or own.chi_square > chi2.isf(1e-5, len(rows) - 2) or not self.rule.inside(own.x, own.y):
            return -math.inf
        near = any(math.hypot(row.x - own.x, row.y - own.y) < self.rule.least_range_m for row in rows)
        if near or not all(row.points_at(own.x, own.y) for row in rows):
            return -math.inf
        return weight(rows, own, len(self.sensors), self.clutter, self.rule)


def cross(one: Row, other: Row) -> tuple[float, float] | None:
    """Return where two rays cross, None if not in front of both."""
    c1, s1, c2, s2 = math.cos(one.bearing), math.sin(one.bearing), math.cos(other.bearing), math.sin(other.bearing)
    sine, dx, dy = c1 * s2 - s1 * c2, other.x - one.x, other.y - one.y
    if abs(sine) < 1e-6:
        return None
    along, across = (dx * s2 - dy * c2) / sine, (dx * s1 - dy * c1) / sine
    return (one.x + along * c1, one.y + along * s1) if along > 0.0 and across > 0.0 else None


def best_disjoint(weights: dict[tuple[int, ...], float]) -> tuple[list[tuple[int, ...]], float]:
    """Return the disjoint sets of largest total weight: branch and bound, each row worth its largest share of a set."""
    sets = sorted(weights, key=lambda chosen: -weights[chosen])
    best: tuple[list[tuple[int, ...]], float] = ([], 0.0)

    def bound(left: Sequence[tuple[int, ...]]) -> float:
        worth: dict[int, float] = {}
        for chosen in left:
            share = weights[chosen] / len(chosen)
            for index in chosen:
                worth[index] = max(worth.get(index, 0.0), share)
        return sum(worth.values())

    def search(left: list[tuple[int, ...]], taken: list[tuple[int, ...]], total: float) -> None:
        nonlocal best
        if total > best[1] + 1e-12:
            best = (taken, total)
        while left and total + bound(left) > best[1] + 1e-12:
            first, *left = left
            search([own for own in left if not set(own) & set(first)], [*taken, first], total + weights[first])

    search(sets, [], 0.0)
    return best
