"""Hypotheses of the targets of a snapshot: sets of positions, refined on all paths and weighed by their likelihood."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.symmetric import SymmetricMatrix, dot
from nlosctl.solvers.triplets.likelihood import Height, TripletProblem
from nlosctl.solvers.triplets.path_memberships import PathDensity, TargetModel, path_density

__all__ = ["Point", "TargetSets", "log_any", "log_volume", "refine_sets"]


Point = tuple[FloatArray, ...]
"""The coordinates of targets, as D arrays."""

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

    ``point`` (D arrays (T, H, B)) is about the local origin, with its ``information``; ``log_direct`` and
    ``log_indirect`` (T, H, B, K) are the densities of the paths. ``valid`` (H, B) is false for a set that repeats a
    better one.
    """

    point: Point
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


def log_volume(information: SymmetricMatrix, scale_m: FloatArray, height: Height | None = None) -> FloatArray:
    """Return the log of the volume of a peak as a share of the prior's: a normal one, as wide as the paths are long.

    Along z as wide as the error of a measured ``height``, which is part of the information. Minus infinity where a
    hypothesis is on a station up to rounding.
    """
    ridge = 1.0 / (scale_m * scale_m)
    determinant = information.add_to_diagonal(ridge).determinant
    prior = 0.5 * information.dimension * np.log(ridge)
    if height is not None:
        prior = prior + 0.5 * np.log1p(height.precision / ridge)
    return np.where(determinant > 0.0, prior - 0.5 * np.log(determinant), -np.inf)


def refine_sets(problem: TripletProblem, point: Point, model: TargetModel, scale_m: FloatArray) -> TargetSets:
    """Return sets (D arrays (T, H, B)) after Gauss-Newton steps on all paths, each path weighted by its memberships.

    The score is the log-likelihood, times the volumes of the peaks (Laplace's approximation); the prior of T targets
    gives each path to each with equal probability.
    """
    targets, count, size = point[0].shape
    copies = problem.take(np.tile(np.arange(size), count))
    scales = np.tile(scale_m, count)
    point = _refine(copies, tuple(part.reshape(targets, -1) for part in point), model, scales)
    densities = [_densities(copies, k, point, model, scales) for k in range(problem.paths)]
    score = np.zeros(scales.shape)
    for path in densities:
        score += _log_total(path)
    information = _observed_information(densities, scales, copies.height)
    score -= len(densities) * math.log(targets)
    for target in range(targets):
        score += log_volume(information.at(target), scales, copies.height)
        if copies.height is not None:
            score -= copies.height.cost(point[2][target])
    scores = np.where(np.isnan(score), -np.inf, score).reshape(count, size)
    order = np.argsort(-scores, axis=0, kind="stable")

    def sort(values: FloatArray) -> FloatArray:
        values = values.reshape(*values.shape[:-1], count, size)
        return np.take_along_axis(values, order if values.ndim == 2 else order[None], axis=-2)

    def by_path(name: str) -> FloatArray:
        return np.stack([sort(np.stack([getattr(part, name) for part in path])) for path in densities], axis=3)

    sets = TargetSets(
        tuple(map(sort, point)),
        information.map(sort),
        by_path("log_direct"),
        by_path("log_indirect"),
        np.take_along_axis(scores, order, axis=0),
        np.ones(scores.shape, dtype=bool),
    )
    return replace(sets, valid=_distinct(sets))


def _observed_information(
    densities: list[list[PathDensity]], scale_m: FloatArray, height: Height | None
) -> SymmetricMatrix:
    """Return the information (T, N): the expected less the missing one, or where that is not positive, the expected."""
    shape = (len(densities[0]), scale_m.shape[0])
    dimension = densities[0][0].information.dimension
    expected, missing = (SymmetricMatrix.full(shape, 0.0, dimension) for _ in range(2))
    for path in densities:
        total = _log_total(path)
        for target, density in enumerate(path):
            expected.at(target).__iadd__(density.pull(total)[1])
            missing.at(target).__iadd__(density.missing_information(total))
    if height is not None:
        height.add_information(expected)
    observed = expected + missing * np.full(shape, -1.0)
    positive = (observed.determinant > 0.0) & (observed.xx > 0.0)
    return observed.where(positive, expected)


def _densities(
    problem: TripletProblem, k: int, point: Point, model: TargetModel, scale_m: FloatArray
) -> list[PathDensity]:
    """Return the densities of path k for each target of the sets (D arrays (T, N))."""
    return [path_density(problem, k, one, model, scale_m) for one in zip(*point, strict=True)]


def _log_total(path: list[PathDensity]) -> FloatArray:
    """Return the log-density of a path to be direct or indirect over any of the targets."""
    total = np.logaddexp(path[0].log_direct, path[0].log_indirect)
    for density in path[1:]:
        total = np.logaddexp(total, np.logaddexp(density.log_direct, density.log_indirect))
    return total


def _refine(problem: TripletProblem, point: Point, model: TargetModel, scale_m: FloatArray) -> Point:
    """Return the likeliest of the positions (D arrays (T, N)) that expectation-maximization passes until it settles."""
    best_point, best = tuple(part.copy() for part in point), np.full(scale_m.shape, -np.inf)
    rows = np.arange(scale_m.shape[0])
    moving: BoolArray = np.ones(rows.shape, dtype=bool)
    for _ in range(_ITERATIONS):
        likelihood, step, expected_gain = _step(problem, point, model, scale_m)
        better = moving & (likelihood > best[rows])
        chosen: IntArray = rows[better]
        best[chosen] = likelihood[better]
        for mine, part in zip(best_point, point, strict=True):
            mine[:, chosen] = part[:, better]
        usable = np.logical_and.reduce([np.isfinite(part) for part in step])
        point = tuple(np.where(usable, part + change, part) for part, change in zip(point, step, strict=True))
        # What has settled stays, so that no bit depends on when it is dropped.
        moving = moving & (expected_gain > _SETTLED_NATS)
        if not moving.any():
            break
        if np.count_nonzero(moving) < _WORTH_DROPPING * moving.shape[0]:
            kept = np.flatnonzero(moving)
            problem, point, scale_m = problem.take(kept), tuple(part[:, kept] for part in point), scale_m[kept]
            rows, moving = rows[kept], moving[kept]
    return best_point


def _step(
    problem: TripletProblem, point: Point, model: TargetModel, scale_m: FloatArray
) -> tuple[FloatArray, Point, FloatArray]:
    """Return the log-likelihood (N,) at positions (T, N), the steps from there, and the nats that they should gain."""
    shape = point[0].shape
    likelihood, gradient = np.zeros(scale_m.shape), tuple(np.zeros(shape) for _ in point)
    information = SymmetricMatrix.full(shape, 0.0, len(point)).add_to_diagonal(1.0 / (scale_m * scale_m))
    for k in range(problem.paths):
        path = _densities(problem, k, point, model, scale_m)
        total = _log_total(path)
        likelihood += total
        for target, density in enumerate(path):
            pull, pull_information = density.pull(total)
            for mine, part in zip(gradient, pull, strict=True):
                mine[target] += part
            information.at(target).__iadd__(pull_information)
    if problem.height is not None:
        likelihood -= np.add.reduce(problem.height.cost(point[2]))
        problem.height.add_to(point[2], gradient, information)
    step = information.solve(*(-part for part in gradient))
    gains = -0.5 * dot(gradient, step)
    expected_gain = gains[0]
    for gain in gains[1:]:
        expected_gain = np.maximum(expected_gain, gain)
    return likelihood, step, expected_gain


def _distinct(sets: TargetSets) -> BoolArray:
    """Return which sets (H, B) have distinct targets, and not those of a better set."""
    targets, count, size = sets.point[0].shape
    valid = np.ones((count, size), dtype=bool)

    def same(one: int, later: int, other: int, earlier: int) -> BoolArray:
        """Return whether a target of a set is within the error of a target of another (or the same)."""
        apart = (part[one, later] - part[other, earlier] for part in sets.point)
        return ~(sets.information.at(other, earlier).quadratic_form(*apart) > _SAME)

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
