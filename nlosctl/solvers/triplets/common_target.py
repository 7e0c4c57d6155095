"""Which paths of a snapshot belong to a common target: hypotheses of it, weighed by their likelihood.

The model of a snapshot with the target at p: every path is direct with probability 1 - ``prior_indirect``, its triplet
then normal about what p predicts; or it is indirect, its angles then uniform and its length in excess of the direct
path's by an exponential law: no detour is shorter than the direct path. The paths over one wall agree on a mirror
image, but the shorter true paths contradict it. A ``clutter`` share of the indirect paths may have any length (they
are over something else).

Every path proposes a target. Each proposal is refined on all paths by expectation-maximization, and weighed by its
likelihood times the volume of its peak (Laplace's approximation, flat prior about the size of the paths). Hypotheses
are averaged, not selected: one wrong choice would flag every direct path.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.special import log_ndtr

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.triplets.likelihood import PathSums, TripletProblem

__all__ = ["CommonTargets", "TargetModel", "weigh_targets"]


_ITERATIONS = 15
_HYPOTHESES = 12
"""So many of a snapshot's proposals are refined, the likeliest."""
_OF_SEVERAL = 8
"""So many hypotheses are combined to sets of several targets, the likeliest."""
_SAME = 9.0
"""Hypotheses within three standard deviations of a better one are the same."""


@dataclass(frozen=True, kw_only=True)
class TargetModel:
    """Prior assumptions: shares of paths, and the largest number of targets."""

    prior_indirect: float
    clutter: float
    targets: int


@dataclass(frozen=True)
class CommonTargets:
    """The posterior of the targets of B snapshots of K paths; at most T targets.

    ``direct`` (B, K) is the probability that a path is direct, over all hypotheses. Of the best set of targets:
    ``x``, ``y`` (T, B) about the local origin, their ``information``, NaN where the set has fewer, and which paths
    ``supported`` (T, B, K) each; ``cost`` (B,) is its negative log-evidence, ``lead`` (B,) by how many nats it is
    ahead of the next.
    """

    direct: FloatArray
    x: FloatArray
    y: FloatArray
    information: SymmetricMatrix
    supported: BoolArray
    cost: FloatArray
    lead: FloatArray


@dataclass(frozen=True)
class _Hypotheses:
    """H hypotheses of B snapshots, every array (H, B) or (H, B, K); ``score`` falls with the first axis."""

    x: FloatArray
    y: FloatArray
    log_direct: FloatArray
    log_indirect: FloatArray
    information: SymmetricMatrix
    volume: FloatArray
    score: FloatArray


def weigh_targets(
    problem: TripletProblem, proposed_x: FloatArray, proposed_y: FloatArray, model: TargetModel
) -> CommonTargets:
    """Return the posterior of snapshots (B, K) whose paths each propose a target (B, K) about the local origin."""
    scale = sum_measurements(problem.path_length_m) / problem.path_length_m.shape[1]
    starts = np.argsort(_first_scores(problem, proposed_x, proposed_y, model, scale), axis=0, kind="stable")
    x = np.take_along_axis(np.ascontiguousarray(proposed_x.T), starts[:_HYPOTHESES], axis=0)
    y = np.take_along_axis(np.ascontiguousarray(proposed_y.T), starts[:_HYPOTHESES], axis=0)
    copies = problem.take(np.tile(np.arange(scale.shape[0]), x.shape[0]))
    x, y = _refine(copies, x, y, model, scale)
    return _combine(_distinct(_score(copies, x, y, model, scale)), model)


def _first_scores(
    problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale: FloatArray
) -> FloatArray:
    """Return minus the log-likelihood of every path's own proposal (K, B)."""
    scores = []
    for k in range(x.shape[1]):
        memberships = _memberships(problem, x[:, k], y[:, k], model, scale)
        total = np.zeros(scale.shape)
        for log_direct, log_indirect, _ in memberships:
            total -= np.logaddexp(log_direct, log_indirect)
        scores.append(np.where(np.isnan(total), np.inf, total))
    return np.stack(scores)


def _memberships(
    problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale: FloatArray
) -> Iterator[tuple[FloatArray, FloatArray, PathSums]]:
    """Yield for every path the log-densities, direct and indirect, with their priors, and its own sums."""
    direct = math.log1p(-model.prior_indirect) - 1.5 * math.log(2.0 * math.pi)
    indirect = math.log(model.prior_indirect) - 2.0 * math.log(2.0 * math.pi)
    excess_scale = 0.5 * scale
    clutter = math.log(model.clutter) - np.log(4.0 * scale)
    for k in range(problem.tx_x.shape[1]):
        sums = PathSums(x.shape)
        with ignoring_overflow():
            excess = problem.path_length_m[:, k] - sums.add_path(problem, k, x, y)
            inverse = problem.inverse_length_std[:, k]
            log_stds = np.log(problem.inverse_dod_std[:, k] * problem.inverse_doa_std[:, k] * inverse)
            ratio = 1.0 / (inverse * excess_scale)
            longer = 0.5 * ratio * ratio - excess / excess_scale + log_ndtr(excess * inverse - ratio)
            longer += math.log1p(-model.clutter) - np.log(excess_scale)
            yield direct + log_stds - 0.5 * sums.cost, indirect + np.logaddexp(longer, clutter), sums


def _refine(
    problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return hypotheses (H, B) after Gauss-Newton steps on all paths, each weighted by its membership."""
    shape = x.shape
    scales = np.tile(scale, shape[0])
    x, y = x.reshape(-1), y.reshape(-1)
    best_x, best_y, best = x, y, np.full(x.shape, -np.inf)
    for _ in range(_ITERATIONS):
        likelihood, gradient_x, gradient_y = (np.zeros(x.shape) for _ in range(3))
        ridge = 1.0 / (scales * scales)
        information = SymmetricMatrix.full(x.shape, 0.0).add_to_diagonal(ridge)
        for log_direct, log_indirect, sums in _memberships(problem, x, y, model, scales):
            total = np.logaddexp(log_direct, log_indirect)
            likelihood += total
            share = np.exp(log_direct - total)
            gradient_x += share * sums.gradient_x
            gradient_y += share * sums.gradient_y
            information.add_scaled(sums.gauss, share)
        better = likelihood > best
        best_x, best_y, best = np.where(better, x, best_x), np.where(better, y, best_y), np.fmax(best, likelihood)
        step_x, step_y = information.solve(-gradient_x, -gradient_y)
        usable = np.isfinite(step_x) & np.isfinite(step_y)
        x, y = np.where(usable, x + step_x, x), np.where(usable, y + step_y, y)
    return best_x.reshape(shape), best_y.reshape(shape)


def _score(problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale: FloatArray) -> _Hypotheses:
    """Return the hypotheses with their densities and score, the best first."""
    shape = x.shape
    scales = np.tile(scale, shape[0])
    direct, indirect = [], []
    likelihood, information = np.zeros(scales.shape), SymmetricMatrix.full(scales.shape, 0.0)
    for log_direct, log_indirect, sums in _memberships(problem, x.reshape(-1), y.reshape(-1), model, scales):
        total = np.logaddexp(log_direct, log_indirect)
        share = np.exp(log_direct - total)
        likelihood += total
        information.add_scaled(sums.gauss, share)
        direct.append(log_direct.reshape(shape))
        indirect.append(log_indirect.reshape(shape))
    # The volume of the peak as a share of the prior's: a normal one, as wide as the paths are long. None where a
    # hypothesis is on a station up to rounding.
    ridge = 1.0 / (scales * scales)
    with ignoring_overflow():
        determinant = information.add_to_diagonal(ridge).determinant
        volume = np.where(determinant > 0.0, np.log(ridge) - 0.5 * np.log(determinant), -np.inf)
    score = (likelihood + volume).reshape(shape)
    score = np.where(np.isnan(score), -np.inf, score)
    order = np.argsort(-score, axis=0, kind="stable")

    def sort(values: FloatArray) -> FloatArray:
        return np.take_along_axis(values.reshape(shape), order, axis=0)

    return _Hypotheses(
        sort(x),
        sort(y),
        np.stack([sort(values) for values in direct], axis=2),
        np.stack([sort(values) for values in indirect], axis=2),
        information.map(sort),
        sort(volume),
        sort(score),
    )


def _distinct(hypotheses: _Hypotheses) -> _Hypotheses:
    """Return the hypotheses with those that repeat a better one ruled out (volume minus infinity)."""
    volume = hypotheses.volume.copy()
    information = hypotheses.information
    for later in range(1, volume.shape[0]):
        for earlier in range(later):
            dx = hypotheses.x[later] - hypotheses.x[earlier]
            dy = hypotheses.y[later] - hypotheses.y[earlier]
            with ignoring_overflow():
                apart = information.at(earlier).quadratic_form(dx, dy)
            volume[later, ~(apart > _SAME)] = -np.inf
    return replace(hypotheses, volume=volume)


def _combine(hypotheses: _Hypotheses, model: TargetModel) -> CommonTargets:
    """Return the posterior over all sets of 1 to T targets."""
    count, size, paths = hypotheses.log_direct.shape
    direct, total = np.zeros((size, paths)), np.zeros(size)
    top, second = np.full(size, -np.inf), np.full(size, -np.inf)
    members = np.full((model.targets, size), -1, dtype=np.int64)
    for targets in range(1, model.targets + 1):
        for chosen in combinations(range(count if targets == 1 else min(count, _OF_SEVERAL)), targets):
            score, share = _weigh_set(hypotheses, chosen)
            ahead = score > top
            second = np.where(ahead, top, np.maximum(second, score))
            highest = np.maximum(top, score)
            with ignoring_invalid():
                old, new = (np.where(np.isfinite(value), np.exp(value - highest), 0.0) for value in (top, score))
            total = total * old + new
            direct = direct * old[:, None] + share * new[:, None]
            top = highest
            for index in range(model.targets):
                members[index, ahead] = chosen[index] if index < targets else -1
    with ignoring_division():
        direct = np.asfortranarray(np.where(total[:, None] > 0.0, direct / total[:, None], 0.0))
        lead = np.where(np.isfinite(top), top - second, 0.0)
    return _best_set(hypotheses, members, direct, -top, lead)


def _weigh_set(hypotheses: _Hypotheses, chosen: tuple[int, ...]) -> tuple[FloatArray, FloatArray]:
    """Return log-evidence (B,) of a set of targets, and each path's probability (B, K) to be direct to one of it."""
    direct, indirect = hypotheses.log_direct[chosen[0]], hypotheses.log_indirect[chosen[0]]
    for index in chosen[1:]:
        direct = np.logaddexp(direct, hypotheses.log_direct[index])
        indirect = np.logaddexp(indirect, hypotheses.log_indirect[index])
    path = np.logaddexp(direct, indirect)
    score = sum_measurements(path) - direct.shape[1] * math.log(len(chosen))
    for index in chosen:
        score = score + hypotheses.volume[index]
    share = np.exp(direct - path)
    return np.where(np.isnan(score), -np.inf, score), np.where(np.isnan(share), 0.0, share)


def _best_set(
    hypotheses: _Hypotheses, members: IntArray, direct: FloatArray, cost: FloatArray, lead: FloatArray
) -> CommonTargets:
    present = members >= 0

    def pick(values: FloatArray) -> FloatArray:
        return np.where(present, np.take_along_axis(values, np.maximum(members, 0), axis=0), np.nan)

    supported = hypotheses.log_direct > hypotheses.log_indirect
    chosen = np.take_along_axis(supported, np.maximum(members, 0)[:, :, None], axis=0) & present[:, :, None]
    return CommonTargets(
        direct, pick(hypotheses.x), pick(hypotheses.y), hypotheses.information.map(pick), chosen, cost, lead
    )
