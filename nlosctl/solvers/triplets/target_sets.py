"""Hypotheses of the targets of a snapshot: sets of positions, refined on all paths and weighed by their likelihood."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.path_memberships import PathDensity, TargetModel, path_density

__all__ = ["TargetSets", "log_any", "log_volume", "refine_sets"]


_ITERATIONS = 15
_SETTLED_NATS = 1e-6
"""A step that should gain no more is the last."""
_WORTH_DROPPING = 0.7
"""Hypotheses that have settled are dropped when they are more than three in ten."""
_SAME = 9.0
"""Targets within three standard deviations of those of a better set are the same."""


@dataclass(frozen=True)
class TargetSets:
    """H sets of T targets of B snapshots of K paths, ``score`` (H, B) falling along the first axis.

    ``x``, ``y`` (T, H, B) are about the local origin, with their ``information``; ``log_direct`` and ``log_indirect``
    (T, H, B, K) are the densities of the paths. ``valid`` (H, B) is false for a set that repeats a better one.
    """

    x: FloatArray
    y: FloatArray
    information: SymmetricMatrix
    log_direct: FloatArray
    log_indirect: FloatArray
    score: FloatArray
    valid: BoolArray


def log_any(parts: FloatArray) -> FloatArray:
    """Return the logarithm of the sum of densities, given as logarithms, over the first axis."""
    total: FloatArray = parts[0]
    for part in parts[1:]:
        total = np.logaddexp(total, part)
    return total


def log_volume(information: SymmetricMatrix, scale_m: FloatArray) -> FloatArray:
    """Return the log of the volume of a peak as a share of the prior's: a normal one, as wide as the paths are long.

    Minus infinity where a hypothesis is on a station up to rounding.
    """
    ridge = 1.0 / (scale_m * scale_m)
    determinant = information.add_to_diagonal(ridge).determinant
    return np.where(determinant > 0.0, np.log(ridge) - 0.5 * np.log(determinant), -np.inf)


def refine_sets(
    problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> TargetSets:
    """Return sets (T, H, B) after Gauss-Newton steps on all paths, each path weighted by its memberships.

    The score is the log-likelihood, times the volumes of the peaks (Laplace's approximation); the prior of T targets
    gives each path to each with equal probability.
    """
    targets, count, size = x.shape
    copies = problem.take(np.tile(np.arange(size), count))
    scales = np.tile(scale_m, count)
    x, y = _refine(copies, x.reshape(targets, -1), y.reshape(targets, -1), model, scales)
    densities = [_densities(copies, k, x, y, model, scales) for k in range(problem.tx_x.shape[1])]
    score = np.zeros(scales.shape)
    for path in densities:
        score += _log_total(path)
    information = _observed_information(densities, scales)
    score -= len(densities) * math.log(targets)
    for target in range(targets):
        score += log_volume(information.at(target), scales)
    scores = np.where(np.isnan(score), -np.inf, score).reshape(count, size)
    order = np.argsort(-scores, axis=0, kind="stable")

    def sort(values: FloatArray) -> FloatArray:
        values = values.reshape(*values.shape[:-1], count, size)
        return np.take_along_axis(values, order if values.ndim == 2 else order[None], axis=-2)

    def by_path(name: str) -> FloatArray:
        return np.stack([sort(np.stack([getattr(part, name) for part in path])) for path in densities], axis=3)

    sets = TargetSets(
        sort(x),
        sort(y),
        information.map(sort),
        by_path("log_direct"),
        by_path("log_indirect"),
        np.take_along_axis(scores, order, axis=0),
        np.ones(scores.shape, dtype=bool),
    )
    return replace(sets, valid=_distinct(sets))


def _observed_information(densities: list[list[PathDensity]], scale_m: FloatArray) -> SymmetricMatrix:
    """Return the information (T, N): the expected less the missing one, or where that is not positive, the expected."""
    shape = (len(densities[0]), scale_m.shape[0])
    expected, missing = SymmetricMatrix.full(shape, 0.0), SymmetricMatrix.full(shape, 0.0)
    for path in densities:
        total = _log_total(path)
        for target, density in enumerate(path):
            expected.at(target).__iadd__(density.pull(total)[2])
            missing.at(target).__iadd__(density.missing_information(total))
    observed = expected + missing * np.full(shape, -1.0)
    positive = (observed.determinant > 0.0) & (observed.xx > 0.0)
    return observed.where(positive, expected)


def _densities(
    problem: TripletProblem, k: int, x: FloatArray, y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> list[PathDensity]:
    """Return the densities of path k for each target of the sets (T, N)."""
    return [path_density(problem, k, x[target], y[target], model, scale_m) for target in range(x.shape[0])]


def _log_total(path: list[PathDensity]) -> FloatArray:
    """Return the log-density of a path to be direct or indirect over any of the targets."""
    total = np.logaddexp(path[0].log_direct, path[0].log_indirect)
    for density in path[1:]:
        total = np.logaddexp(total, np.logaddexp(density.log_direct, density.log_indirect))
    return total


def _refine(
    problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest of the positions (T, N) that expectation-maximization passes until it settles."""
    best_x, best_y, best = x.copy(), y.copy(), np.full(scale_m.shape, -np.inf)
    rows = np.arange(scale_m.shape[0])
    moving: BoolArray = np.ones(rows.shape, dtype=bool)
    for _ in range(_ITERATIONS):
        likelihood, step_x, step_y, expected_gain = _step(problem, x, y, model, scale_m)
        better = moving & (likelihood > best[rows])
        chosen: IntArray = rows[better]
        best_x[:, chosen], best_y[:, chosen], best[chosen] = x[:, better], y[:, better], likelihood[better]
        usable = np.isfinite(step_x) & np.isfinite(step_y)
        x, y = np.where(usable, x + step_x, x), np.where(usable, y + step_y, y)
        # What has settled stays, so that no bit depends on when it is dropped.
        moving = moving & (expected_gain > _SETTLED_NATS)
        if not moving.any():
            break
        if np.count_nonzero(moving) < _WORTH_DROPPING * moving.shape[0]:
            kept = np.flatnonzero(moving)
            problem, x, y, scale_m = problem.take(kept), x[:, kept], y[:, kept], scale_m[kept]
            rows, moving = rows[kept], moving[kept]
    return best_x, best_y


def _step(
    problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the log-likelihood (N,) at positions (T, N), the steps from there, and the nats that they should gain."""
    likelihood, gradient_x, gradient_y = np.zeros(scale_m.shape), np.zeros(x.shape), np.zeros(x.shape)
    information = SymmetricMatrix.full(x.shape, 0.0).add_to_diagonal(1.0 / (scale_m * scale_m))
    for k in range(problem.tx_x.shape[1]):
        path = _densities(problem, k, x, y, model, scale_m)
        total = _log_total(path)
        likelihood += total
        for target, density in enumerate(path):
            pull_x, pull_y, pull_information = density.pull(total)
            gradient_x[target] += pull_x
            gradient_y[target] += pull_y
            information.at(target).__iadd__(pull_information)
    step_x, step_y = information.solve(-gradient_x, -gradient_y)
    gains = -0.5 * (gradient_x * step_x + gradient_y * step_y)
    expected_gain = gains[0]
    for gain in gains[1:]:
        expected_gain = np.maximum(expected_gain, gain)
    return likelihood, step_x, step_y, expected_gain


def _distinct(sets: TargetSets) -> BoolArray:
    """Return which sets (H, B) have distinct targets, and not those of a better set."""
    targets, count, size = sets.x.shape
    valid = np.ones((count, size), dtype=bool)

    def same(one: int, later: int, other: int, earlier: int) -> BoolArray:
        """Return whether a target of a set is within the error of a target of another (or the same)."""
        dx, dy = sets.x[one, later] - sets.x[other, earlier], sets.y[one, later] - sets.y[other, earlier]
        return ~(sets.information.at(other, earlier).quadratic_form(dx, dy) > _SAME)

    for later in range(count):
        for one in range(1, targets):
            for other in range(one):
                valid[later] &= ~same(one, later, other, later)
        for earlier in range(later):
            repeats = np.ones(size, dtype=bool)
            for one in range(targets):
                repeats &= np.logical_or.reduce([same(one, later, other, earlier) for other in range(targets)])
            valid[later] &= ~repeats
    return valid
