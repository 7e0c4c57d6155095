"""Candidate targets: points and the echoes nearest to them, moved until the two agree.

A candidate takes at most one echo of each sensor. A seed takes the nearest echo of every sensor, moves to the
range least-squares fit of those, and again, until it takes the same echoes as before.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import islice, product

import numpy as np
from scipy.special import gammainccinv

from nlosctl.arrays import FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.ranges.likelihood import RangeProblem

__all__ = ["Candidates", "Gates", "clutter_density", "find_candidates", "target_weights"]

_ROUNDS = 10
_STEPS_PER_ROUND = 2
_MAX_COMBINATIONS = 256
_NOTHING = -1


@dataclass(frozen=True, kw_only=True)
class Gates:
    """What a candidate must satisfy.

    ``min_sensors`` is the least number of sensors that see it, ``gate_std`` how far, in standard deviations, an
    echo may be from it, ``false_alarm`` the probability that the chi-square of a true one is rejected.
    """

    min_sensors: int
    gate_std: float
    false_alarm: float


@dataclass(frozen=True)
class Candidates(RowBlock):
    """C candidates: points (C,) in metres about the local origin, echoes (C, N) or -1, chi-square, information."""

    x: FloatArray
    y: FloatArray
    echo: IntArray
    chi_square: FloatArray
    information: SymmetricMatrix


def find_candidates(echoes: Echoes, seed_x: FloatArray, seed_y: FloatArray, gates: Gates) -> Candidates:
    """Return all candidates that seeds (P,) lead to and that pass the gates, each set of echoes once."""
    x, y, echo = seed_x, seed_y, np.empty((0, echoes.sensors), dtype=np.int64)
    for _ in range(_ROUNDS):
        before = echo
        echo, x, y = _best_of_each(echoes, associate(echoes, x, y, gates), x, y)
        if echo.shape == before.shape and (echo == before).all():
            break
        for _ in range(_STEPS_PER_ROUND):
            x, y = _step(echoes, echo, x, y)
        finite = np.isfinite(x) & np.isfinite(y)
        x, y, echo = x[finite], y[finite], echo[finite]
    candidates = _gate(fit_candidates(echoes, x, y, echo), gates, slack=4.0)
    more, x, y = _combine(echoes, candidates, gates)
    return _gate(fit_candidates(echoes, x, y, more), gates, slack=1.0)


def associate(echoes: Echoes, x: FloatArray, y: FloatArray, gates: Gates) -> IntArray:
    """Return the nearest echo (P, N) of every sensor to points (P,).

    An echo beyond the gate is left out (-1), unless that would leave fewer than the least number of sensors: of
    those the nearest, in standard deviations, are kept.
    """
    chosen = np.empty((x.shape[0], echoes.sensors), dtype=np.int64)
    distance = np.empty(chosen.shape)
    for sensor in range(echoes.sensors):
        predicted = np.hypot(np.hypot(x - echoes.sensor_x[sensor], y - echoes.sensor_y[sensor]), echoes.height[sensor])
        ranges = echoes.range_m[sensor]
        ranges = ranges[np.isfinite(ranges)]
        above = np.searchsorted(ranges, predicted)
        low, high = np.maximum(above - 1, 0), np.minimum(above, ranges.shape[0] - 1)
        nearer = np.abs(ranges[high] - predicted) < np.abs(ranges[low] - predicted)
        chosen[:, sensor] = np.where(nearer, high, low)
        index = chosen[:, sensor]
        distance[:, sensor] = np.abs(ranges[index] - predicted) / echoes.std_m[sensor, index]
    if gates.min_sensors < echoes.sensors:
        rank = np.argsort(np.argsort(distance, axis=1, kind="stable"), axis=1)
        chosen[(rank >= gates.min_sensors) & (distance > gates.gate_std)] = _NOTHING
    return chosen


def fit_candidates(echoes: Echoes, x: FloatArray, y: FloatArray, echo: IntArray) -> Candidates:
    """Return the range least-squares fits (C,) to echoes (C, N), from points (C,), that settle."""
    problem = _problem(echoes, echo)
    minimum = minimize(problem, x, y)
    settled = np.flatnonzero(minimum.converged)
    problem = problem.take(settled)
    x, y = minimum.x[settled], minimum.y[settled]
    dx, dy = x[:, None] - problem.sensor_x, y[:, None] - problem.sensor_y
    squared = dx * dx + dy * dy
    if problem.height is not None:
        squared += problem.height * problem.height
    with ignoring_division():
        scale = problem.inverse_std / np.sqrt(squared)
        dx *= scale
        dy *= scale
    # Pairwise sums: a candidate is solved alone, so its bits depend on no block.
    information = SymmetricMatrix.outer(dx, dy).map(lambda products: products.sum(axis=1))
    candidates = Candidates(x, y, echo[settled], 2.0 * minimum.cost[settled], information)
    with ignoring_invalid():
        return candidates.take(np.flatnonzero(information.determinant > 0.0))


def _problem(echoes: Echoes, echo: IntArray) -> RangeProblem:
    """Return the fits of echoes (C, N); a sensor without one has weight zero."""
    sensor = np.broadcast_to(np.arange(echoes.sensors), echo.shape)
    seen = echo != _NOTHING
    index = np.where(seen, echo, 0)
    return RangeProblem(
        np.asfortranarray(np.broadcast_to(echoes.sensor_x, echo.shape)),
        np.asfortranarray(np.broadcast_to(echoes.sensor_y, echo.shape)),
        np.asfortranarray(echoes.range_m[sensor, index]),
        np.asfortranarray(np.where(seen, 1.0 / echoes.std_m[sensor, index], 0.0)),
        np.asfortranarray(np.broadcast_to(echoes.height, echo.shape)) if echoes.height.any() else None,
    )


def _step(echoes: Echoes, echo: IntArray, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points moved by one Gauss-Newton step."""
    at = _problem(echoes, echo).evaluate(x, y)
    step_x, step_y = at.hessian.solve(*(-slope for slope in at.gradient))
    return x + step_x, y + step_y


def _combine(echoes: Echoes, candidates: Candidates, gates: Gates) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return all combinations of the echoes within the gate of each candidate, and the points to fit them from."""
    rows: list[tuple[int, ...]] = []
    source: list[int] = []
    for number in range(candidates.x.shape[0]):
        choices = [_choices(echoes, candidates, number, sensor, gates) for sensor in range(echoes.sensors)]
        combinations = list(islice(product(*choices), _MAX_COMBINATIONS))
        rows += combinations
        source += [number] * len(combinations)
    if not rows:
        return candidates.echo, candidates.x, candidates.y
    echo, first = _unique_rows(np.array(rows, dtype=np.int64))
    origin = np.array(source)[first]
    return echo, candidates.x[origin], candidates.y[origin]


def _choices(echoes: Echoes, candidates: Candidates, number: int, sensor: int, gates: Gates) -> list[int]:
    """Return the candidate's own echo of a sensor, then the others within its gate."""
    predicted = np.hypot(
        np.hypot(candidates.x[number] - echoes.sensor_x[sensor], candidates.y[number] - echoes.sensor_y[sensor]),
        echoes.height[sensor],
    )
    own = int(candidates.echo[number, sensor])
    with ignoring_invalid():
        near = np.flatnonzero(np.abs(echoes.range_m[sensor] - predicted) <= gates.gate_std * echoes.std_m[sensor])
    return [own, *(int(index) for index in near if index != own)]


def _gate(candidates: Candidates, gates: Gates, *, slack: float) -> Candidates:
    """Return the candidates whose chi-square is at most ``slack`` times its limit; its degrees are sensors - 2."""
    degrees = (candidates.echo != _NOTHING).sum(axis=1) - 2
    limit = 2.0 * gammainccinv(0.5 * np.maximum(degrees, 1), gates.false_alarm)
    return candidates.take(np.flatnonzero(candidates.chi_square <= slack * limit))


def _best_of_each(
    echoes: Echoes, echo: IntArray, x: FloatArray, y: FloatArray
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the different sets of echoes, each with the point that it fits best: others may lead to a mirror image."""
    order = np.argsort(_problem(echoes, echo).evaluate(x, y).cost, kind="stable")
    unique, first = _unique_rows(echo[order])
    return unique, x[order][first], y[order][first]


def _unique_rows(rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return the different rows in sorted order, and the index of the first of each."""
    unique, first = np.unique(rows, axis=0, return_index=True)
    return unique, first


def clutter_density(echoes: Echoes, bandwidth_m: float) -> FloatArray:
    """Return the density (N, M) of echoes per metre and sensor at each echo: all ranges pooled, a Gaussian kernel.

    The kernel is reflected at zero, since ranges are positive. NaN where there is no echo.
    """
    pooled = echoes.range_m[np.isfinite(echoes.range_m)]
    here = echoes.range_m[..., None]
    kernel = np.exp(-0.5 * ((here - pooled) / bandwidth_m) ** 2) + np.exp(-0.5 * ((here + pooled) / bandwidth_m) ** 2)
    density: FloatArray = kernel.sum(axis=-1) / (np.sqrt(2.0 * np.pi) * bandwidth_m * echoes.sensors)
    return density


def target_weights(
    echoes: Echoes,
    candidates: Candidates,
    *,
    density: FloatArray,
    area_m2: float,
    detection_probability: float,
    reward: float,
) -> FloatArray:
    """Return the log of the likelihood ratio (C,) of a target against clutter, in nats.

    sum of -ln(density sqrt(2 pi) std) over the echoes taken, less half the chi-square, plus ln(2 pi / (sqrt det
    F area)) for a position that could be anywhere in the area, plus ``reward``; and for each sensor the log of the
    probability with which it sees a target, or doesn't.
    """
    seen = candidates.echo >= 0
    index = np.where(seen, candidates.echo, 0)
    sensor = np.broadcast_to(np.arange(echoes.sensors), index.shape)
    surprise = -np.log(density[sensor, index] * np.sqrt(2.0 * np.pi) * echoes.std_m[sensor, index])
    detected = np.where(seen, surprise + np.log(detection_probability), np.log1p(-detection_probability))
    volume = np.log(2.0 * np.pi / area_m2) - 0.5 * np.log(candidates.information.determinant)
    weights: FloatArray = detected.sum(axis=1) - 0.5 * candidates.chi_square + volume + reward
    return weights
