"""Which paths of a snapshot belong to common targets: hypotheses of these, weighed by their likelihood.

Every path proposes a target, and so does the crossing of the departing ray of one with the arriving ray of another:
two detours meet there if one leaves towards the target and the other comes from it. The likeliest proposals are refined
on all paths by expectation-maximization, and weighed by their likelihood times the volume of the peak.
A further target is sought given those of the best sets so far: all proposals are scored as the companion of each, and
the likeliest sets are refined together. So the second target need not be a good answer by itself.

Hypotheses are averaged, not selected: one wrong choice would flag every direct path. One of them is that there is no
target: each path is then unrelated to the others, or over a scatterer of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.contract.step_progress import note_step
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.solvers.triplets.legs import cross_rays
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.path_memberships import TargetModel, log_unrelated, path_density
from nlosctl.solvers.triplets.target_posterior import CommonTargets, Posterior
from nlosctl.solvers.triplets.target_sets import Point, TargetSets, log_any, log_volume, refine_sets

__all__ = ["CommonTargets", "TargetModel", "weigh_targets"]


_HYPOTHESES = 12
"""So many of a snapshot's proposals are refined, the likeliest."""
_CROSSINGS = 4
"""So many crossings of rays of two paths are refined, the likeliest."""
_SHIFTS = 4
"""The departing ray of each path crosses the arriving rays of so many others."""
_MOST_CROSSINGS = 240
"""With more crossings, of fewer others, but of one at least."""
_FIRSTS = 4
"""So many sets, the likeliest, are each extended by a further target."""
_CONSIDERED = 48
"""So many of the proposals are considered as further targets, the likeliest."""
_COMPANIONS = 4
"""So many further targets of each of them are refined, the likeliest."""
_SCORED = 4096
"""Number of proposals scored at once: temporaries stay in cache."""
_FEWEST = 4
"""Fewer paths cannot distinguish a target from scatterers of their own: their target is taken for granted."""


def weigh_targets(
    problem: TripletProblem, proposed: Point, model: TargetModel, own: Point | None = None
) -> CommonTargets:
    """Return the posterior of snapshots whose paths each propose a target (D arrays (B, K)) about the local origin.

    ``own`` are the scatterers that fit each path best, if they are others: a measured height is that of targets alone.
    """
    scale = sum_measurements(problem.path_length_m) / problem.paths
    # Targets on stations have densities that float64 does not hold.
    with ignoring_overflow():
        groups = _hypotheses(problem, proposed, model, scale)
        nothing = np.full(scale.shape, -np.inf)
        if problem.paths >= _FEWEST:
            nothing = _log_nothing(problem, own or proposed, model, scale)
        return Posterior.of(groups, nothing, model.targets).judged(problem, model, scale)


def _hypotheses(problem: TripletProblem, proposed: Point, model: TargetModel, scale_m: FloatArray) -> list[TargetSets]:
    """Return the refined sets of one target, of two, and so on."""
    proposals = _likeliest(problem, proposed, model, scale_m)
    start = tuple(part[:_HYPOTHESES] for part in proposals)
    if problem.paths > 1:
        crossings = _likeliest(problem, _crossings(problem), model, scale_m)
        start = tuple(np.concatenate([part, more[:_CROSSINGS]]) for part, more in zip(start, crossings, strict=True))
    groups = [refine_sets(problem, tuple(part[None] for part in start), model, scale_m)]
    if model.targets > 1:
        considered = tuple(part[:_CONSIDERED] for part in proposals)
        companions = _Companions.of(problem, considered, model, scale_m)
        for _ in range(1, model.targets):
            groups.append(refine_sets(problem, companions.extend(groups[-1]), model, scale_m))
    return groups


def _likeliest(problem: TripletProblem, point: Point, model: TargetModel, scale_m: FloatArray) -> Point:
    """Return proposals (B, P) as (P, B), the likeliest first."""
    point = tuple(part.T for part in point)
    count = point[0].shape[0]
    scores = np.zeros(point[0].shape)
    block = max(1, _SCORED // max(1, scale_m.shape[0]))
    for first in range(0, count, block):
        some = slice(first, first + block)
        for k in range(problem.paths):
            density = path_density(problem, k, tuple(part[some] for part in point), model, scale_m)
            scores[some] -= np.logaddexp(density.log_direct, density.log_indirect)
            note_step(first + block * k // problem.paths, count)
    if problem.height is not None:
        scores += problem.height.cost(point[2])
    order = np.argsort(np.where(np.isnan(scores), np.inf, scores), axis=0, kind="stable")
    return tuple(np.take_along_axis(part, order, axis=0) for part in point)


def _crossings(problem: TripletProblem) -> Point:
    """Return where the departing ray of each path crosses the arriving rays of the next longer ones (B, P), or NaN."""
    rank = np.argsort(problem.path_length_m, axis=1, kind="stable")
    found: list[Point] = []
    shifts = min(_SHIFTS, max(1, _MOST_CROSSINGS // rank.shape[1]), rank.shape[1] - 1)
    departing = problem.tx.map(lambda values: np.take_along_axis(values, rank, axis=1))
    for shift in range(1, shifts + 1):
        later = np.roll(rank, -shift, axis=1)
        found.append(cross_rays(departing, problem.rx.map(partial(np.take_along_axis, indices=later, axis=1))))
    return tuple(np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))


@dataclass(frozen=True)
class _Companions:
    """Further targets (D arrays (P, B)) to consider, with the log-densities (P, B, K) of all paths.

    ``cost`` (P, B) is that of their heights, where those are measured.
    """

    point: Point
    log_direct: FloatArray
    log_indirect: FloatArray
    cost: FloatArray

    @classmethod
    def of(cls, problem: TripletProblem, point: Point, model: TargetModel, scale_m: FloatArray) -> _Companions:
        """Return targets (P, B) with their densities."""
        direct, indirect = [], []
        for one in zip(*point, strict=True):
            paths = [path_density(problem, k, one, model, scale_m) for k in range(problem.paths)]
            direct.append(np.stack([path.log_direct for path in paths], axis=1))
            indirect.append(np.stack([path.log_indirect for path in paths], axis=1))
        cost = np.zeros(point[0].shape) if problem.height is None else problem.height.cost(point[2])
        return cls(point, np.stack(direct), np.stack(indirect), cost)

    def extend(self, sets: TargetSets) -> Point:
        """Return sets (T + 1, H, B): the best sets, each with its likeliest companions."""
        # The sets that repeat a better one are last.
        order = np.argsort(~sets.valid, axis=0, kind="stable")[:_FIRSTS]
        rows = np.arange(order.shape[1])
        found: list[Point] = []
        for rank in order:
            companion = self._likeliest(
                log_any(sets.log_direct[:, rank, rows]), log_any(sets.log_indirect[:, rank, rows])
            )
            extended = []
            for first, further in zip(sets.point, companion, strict=True):
                repeated = np.repeat(first[:, rank, rows][:, None], further.shape[0], axis=1)
                extended.append(np.concatenate([repeated, further[None]]))
            found.append(tuple(extended))
        return tuple(np.concatenate(parts, axis=1) for parts in zip(*found, strict=True))

    def _likeliest(self, log_direct: FloatArray, log_indirect: FloatArray) -> Point:
        """Return the likeliest companions (H, B) of targets that give the paths these log-densities (B, K)."""
        known = np.logaddexp(log_direct, log_indirect)
        scores = []
        for direct, indirect, cost in zip(self.log_direct, self.log_indirect, self.cost, strict=True):
            total = cost - sum_measurements(np.logaddexp(known, np.logaddexp(direct, indirect)))
            scores.append(np.where(np.isnan(total), np.inf, total))
        order = np.argsort(np.stack(scores), axis=0, kind="stable")[:_COMPANIONS]
        return tuple(np.take_along_axis(part, order, axis=0) for part in self.point)


def _log_nothing(problem: TripletProblem, own: Point, model: TargetModel, scale_m: FloatArray) -> FloatArray:
    """Return the log-evidence (B,) that there is no target: each path is unrelated, or over a scatterer of its own.

    ``own`` (D arrays (B, K)) are the scatterers that fit each path best.
    """
    unrelated = math.log(model.prior_indirect) + log_unrelated(problem, scale_m)
    total = np.zeros(scale_m.shape)
    for k in range(problem.paths):
        density = path_density(problem, k, tuple(part[:, k] for part in own), model, scale_m)
        alone = density.log_direct + log_volume(density.information, scale_m)
        total += np.logaddexp(unrelated[:, k], np.where(np.isnan(alone), -np.inf, alone))
    return total
