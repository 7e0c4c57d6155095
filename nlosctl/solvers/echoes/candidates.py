"""Candidate targets: points and the echoes nearest to them, moved until the two agree.

A candidate takes at most one echo of each sensor. A seed takes the nearest echo of every sensor, moves to the
range least-squares fit of those, and again, until it takes the same echoes as before.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import islice, product

import numpy as np
from scipy.special import bdtr, gammainccinv

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_division, ignoring_invalid
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix, dot
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.ranges.likelihood import RangeProblem

__all__ = ["Candidates", "Gates", "find_candidates", "usual_sensors"]

_ROUNDS = 10
_STEPS_PER_ROUND = 2
_MAX_COMBINATIONS = 256
_COMBINATIONS_PER_CANDIDATE = 10
"""Combinations of echoes that are tried, at most, for each of the candidates that may be kept."""

_DOUBTFUL_STD = 2.0
"""An echo farther than this from its target, in standard deviations, may be clutter: the sensor may have missed it."""

_UNSEEN_SHARE = 0.01
_BLOCK = 1 << 14
"""Points and fits at a time, so that memory does not grow with their number."""
_NOTHING = -1


@dataclass(frozen=True, kw_only=True)
class Gates:
    """What a candidate must satisfy.

    ``min_sensors`` is the least number of sensors that see it, ``gate_std`` how far, in standard deviations, an
    echo may be from it, ``false_alarm`` the probability that the chi-square of a true one is rejected,
    ``least_evidence`` the evidence in nats below which it is dropped. At most ``most`` are kept.
    """

    min_sensors: int
    gate_std: float
    false_alarm: float
    least_evidence: float
    most: int


@dataclass(frozen=True)
class Candidates(RowBlock):
    """C candidates: points (D arrays (C,)) about the local origin, echoes (C, N) or -1, chi-square, information."""

    point: Point
    echo: IntArray
    chi_square: FloatArray
    information: SymmetricMatrix

    @classmethod
    def join(cls, parts: Sequence[Candidates]) -> Candidates:
        """Return the candidates of all parts."""
        point = tuple(np.concatenate(columns) for columns in zip(*(part.point for part in parts), strict=True))
        echo = np.concatenate([part.echo for part in parts])
        chi_square = np.concatenate([part.chi_square for part in parts])
        information = np.concatenate([part.information.stack() for part in parts])
        return cls(point, echo, chi_square, SymmetricMatrix(*information.T))


def usual_sensors(sensors: int, detection_probability: float, least: int = 3) -> int:
    """Return the largest number, at least three, of sensors that see all but a hundredth of the targets at once."""
    at_most = bdtr(np.arange(sensors), sensors, detection_probability)
    return max(least, int(np.count_nonzero(at_most <= _UNSEEN_SHARE)))


def find_candidates(
    echoes: Echoes, seeds: Point, gates: Gates, evidence: Callable[[Candidates], FloatArray]
) -> tuple[Candidates, bool]:
    """Return the candidates that seeds (D arrays (P,)) lead to and that pass the gates, each set of echoes once.

    Their ``evidence`` (C,) is at least ``gates.least_evidence``. False if there are more of them, or more combinations
    of their echoes, than ``gates.most``, and some were left out: those with the least evidence.
    """
    starts = [slice(start, start + _BLOCK) for start in range(0, max(seeds[0].shape[0], 1), _BLOCK)]
    parts = [_settle(echoes, tuple(axis[part] for axis in seeds), gates) for part in starts]
    echo = np.concatenate([settled for settled, _ in parts])
    point = tuple(np.concatenate(columns) for columns in zip(*(settled for _, settled in parts), strict=True))
    if len(parts) > 1:
        echo, point = _best_of_each(echoes, echo, point)
    candidates = _fit_in_blocks(echoes, point, echo, gates, slack=4.0)
    candidates, all_kept = _heaviest(candidates, evidence(candidates), gates.least_evidence, gates.most)
    more, point, all_combined = _combine(echoes, candidates, gates)
    candidates = _fit_in_blocks(echoes, point, more, gates, slack=1.0)
    candidates, all_heavy = _heaviest(candidates, evidence(candidates), gates.least_evidence, gates.most)
    return candidates, all_kept and all_combined and all_heavy


def _settle(echoes: Echoes, point: Point, gates: Gates) -> tuple[IntArray, Point]:
    """Return the different sets of echoes that points (D arrays (P,)) settle at, and their points."""
    echo = np.empty((0, echoes.sensors), dtype=np.int64)
    for _ in range(_ROUNDS):
        before = echo
        echo, point = _best_of_each(echoes, associate(echoes, point, gates), point)
        if echo.shape == before.shape and (echo == before).all():
            break
        for _ in range(_STEPS_PER_ROUND):
            point = _step(echoes, echo, point)
        finite = np.logical_and.reduce([np.isfinite(part) for part in point])
        point, echo = tuple(part[finite] for part in point), echo[finite]
    return echo, point


def _fit_in_blocks(echoes: Echoes, point: Point, echo: IntArray, gates: Gates, *, slack: float) -> Candidates:
    """Return the fits to echoes (C, N) from points (D arrays (C,)) that pass the gate."""
    parts = [
        _gate(echoes, fit_candidates(echoes, tuple(axis[part] for axis in point), echo[part]), gates, slack=slack)
        for start in range(0, max(echo.shape[0], 1), _BLOCK)
        for part in [slice(start, start + _BLOCK)]
    ]
    return parts[0] if len(parts) == 1 else Candidates.join(parts)


def _heaviest(candidates: Candidates, evidence: FloatArray, least: float, most: int) -> tuple[Candidates, bool]:
    """Return the candidates of at least that evidence, in order, at most ``most``; False if that left some out."""
    kept = np.flatnonzero(evidence >= least)
    if kept.shape[0] <= most:
        return candidates.take(kept), True
    best = np.argsort(-evidence[kept], kind="stable")[:most]
    return candidates.take(np.sort(kept[best])), False


def associate(echoes: Echoes, point: Point, gates: Gates) -> IntArray:
    """Return the nearest echo (P, N) of every sensor to points (D arrays (P,)).

    An echo beyond the gate is left out (-1), unless that would leave fewer than the least number of sensors: of
    those the nearest, in standard deviations, are kept.
    """
    chosen = np.empty((point[0].shape[0], echoes.sensors), dtype=np.int64)
    distance = np.empty(chosen.shape)
    for sensor in range(echoes.sensors):
        predicted = echoes.distance_m(sensor, *point)
        ranges = echoes.range_m[sensor]
        ranges = ranges[np.isfinite(ranges)]
        above = np.searchsorted(ranges, predicted)
        low, high = np.maximum(above - 1, 0), np.minimum(above, ranges.shape[0] - 1)
        nearer = np.abs(ranges[high] - predicted) < np.abs(ranges[low] - predicted)
        chosen[:, sensor] = np.where(nearer, high, low)
        index = chosen[:, sensor]
        distance[:, sensor] = np.abs(ranges[index] - predicted) / echoes.std_m[sensor, index]
    if gates.min_sensors < echoes.sensors:
        rank = np.empty_like(chosen)
        nearest_first = np.argsort(distance, axis=1, kind="stable")
        np.put_along_axis(rank, nearest_first, np.arange(echoes.sensors)[None, :], axis=1)
        chosen[(rank >= gates.min_sensors) & (distance > gates.gate_std)] = _NOTHING
    return chosen


def fit_candidates(echoes: Echoes, point: Point, echo: IntArray) -> Candidates:
    """Return the range least-squares fits (C,) to echoes (C, N), from points (D arrays (C,)), that settle."""
    problem = _problem(echoes, echo)
    minimum = minimize(problem, *point)
    settled = np.flatnonzero(minimum.converged)
    problem = problem.take(settled)
    point = tuple(part[settled] for part in minimum.point)
    away = [part[:, None] - own for part, own in zip(point, problem.sensor, strict=True)]
    squared = dot(away, away)
    if problem.height is not None:
        squared += problem.height * problem.height
    with ignoring_division():
        scale = problem.inverse_std / np.sqrt(squared)
        for part in away:
            part *= scale
    # Pairwise sums: a candidate is solved alone, so its bits depend on no block.
    information = SymmetricMatrix.outer(*away).map(lambda products: products.sum(axis=1))
    if problem.level is not None:
        information.diagonal[2][...] += problem.level.inverse_std**2
    candidates = Candidates(point, echo[settled], 2.0 * minimum.cost[settled], information)
    with ignoring_invalid():
        return candidates.take(np.flatnonzero(information.determinant > 0.0))


def _problem(echoes: Echoes, echo: IntArray) -> RangeProblem:
    """Return the fits of echoes (C, N); a sensor without one has weight zero."""
    sensor = np.broadcast_to(np.arange(echoes.sensors), echo.shape)
    seen = echo != _NOTHING
    index = np.where(seen, echo, 0)
    return RangeProblem(
        tuple(np.asfortranarray(np.broadcast_to(part, echo.shape)) for part in echoes.sensor),
        np.asfortranarray(echoes.range_m[sensor, index]),
        np.asfortranarray(np.where(seen, 1.0 / echoes.std_m[sensor, index], 0.0)),
        np.asfortranarray(np.broadcast_to(echoes.height, echo.shape)) if echoes.height.any() else None,
        level=None if echoes.level is None else echoes.level.take(np.zeros(echo.shape[0], dtype=np.int64)),
    )


def _step(echoes: Echoes, echo: IntArray, point: Point) -> Point:
    """Return points moved by one Gauss-Newton step."""
    at = _problem(echoes, echo).evaluate(*point)
    return tuple(map(np.add, point, at.hessian.solve(*(-slope for slope in at.gradient))))


def _combine(echoes: Echoes, candidates: Candidates, gates: Gates) -> tuple[IntArray, Point, bool]:
    """Return combinations of the echoes within the gate of each candidate, and the points to fit them from.

    A candidate's own echo is the first choice of a sensor; a sensor whose echo fits badly may also have none. A
    candidate has at most ``_MAX_COMBINATIONS`` of them, and fewer where there would be too many for ``gates.most``
    candidates in all (then the last value is False).
    """
    near = _choices(echoes, candidates, gates)
    count = near.sum(axis=2).prod(axis=1, dtype=np.float64)
    several = np.flatnonzero(count > 1)
    total = float(np.minimum(count, _MAX_COMBINATIONS).sum())
    budget = _COMBINATIONS_PER_CANDIDATE * gates.most
    most = _MAX_COMBINATIONS if total <= budget else max(1, (budget - count.shape[0]) // max(1, several.size))
    rows, source = [candidates.echo], [np.arange(count.shape[0])]
    for number in several:
        own = candidates.echo[number]
        choices = [
            [int(own[sensor]), *(int(index) - 1 for index in np.flatnonzero(flags) if index - 1 != own[sensor])]
            for sensor, flags in enumerate(near[number])
        ]
        combinations = np.array(list(islice(product(*choices), most)), dtype=np.int64)
        rows.append(combinations)
        source.append(np.full(combinations.shape[0], number))
    all_rows, origin = np.concatenate(rows), np.concatenate(source)
    enough = np.flatnonzero((all_rows != _NOTHING).sum(axis=1) >= gates.min_sensors)
    echo, first = _unique_rows(all_rows[enough])
    origin = origin[enough][first]
    return echo, tuple(part[origin] for part in candidates.point), total <= budget


def _choices(echoes: Echoes, candidates: Candidates, gates: Gates) -> BoolArray:
    """Return which echoes (C, N, 1 + M) of each sensor a candidate may take; the first stands for none."""
    predicted = echoes.distance_m(slice(None), *(part[:, None] for part in candidates.point))
    seen = candidates.echo != _NOTHING
    near = np.zeros((*predicted.shape, 1 + echoes.most), dtype=bool)
    for sensor in range(echoes.sensors):
        with ignoring_invalid():
            away = np.abs(echoes.range_m[sensor] - predicted[:, sensor, None]) / echoes.std_m[sensor]
            near[:, sensor, 1:] = away <= gates.gate_std
        own = np.where(seen[:, sensor], candidates.echo[:, sensor], 0)
        doubtful = np.take_along_axis(away, own[:, None], axis=1)[:, 0] > _DOUBTFUL_STD
        spare = seen.sum(axis=1) > gates.min_sensors
        near[:, sensor, 0] = ~seen[:, sensor] | (doubtful & spare)
    np.put_along_axis(near, candidates.echo[..., None] + 1, True, axis=2)
    return near


def _gate(echoes: Echoes, candidates: Candidates, gates: Gates, *, slack: float) -> Candidates:
    """Return the candidates whose chi-square is at most ``slack`` times its limit.

    Its degrees of freedom are the sensors, and a measured height, less D.
    """
    degrees = (candidates.echo != _NOTHING).sum(axis=1) + 1 - echoes.least_sensors
    limit = 2.0 * gammainccinv(0.5 * np.maximum(degrees, 1), gates.false_alarm)
    return candidates.take(np.flatnonzero(candidates.chi_square <= slack * limit))


def _best_of_each(echoes: Echoes, echo: IntArray, point: Point) -> tuple[IntArray, Point]:
    """Return the different sets of echoes, each with the point that it fits best: others may lead to a mirror image."""
    order = np.argsort(_problem(echoes, echo).evaluate(*point).cost, kind="stable")
    unique, first = _unique_rows(echo[order])
    return unique, tuple(part[order][first] for part in point)


def _unique_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the different rows in sorted order, and the index of the first of each."""
    unique, first = np.unique(rows, axis=0, return_index=True)
    return unique, first
