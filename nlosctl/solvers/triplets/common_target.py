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

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.contract.step_progress import note_step
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.path_memberships import TargetModel, log_unrelated, path_density
from nlosctl.solvers.triplets.target_posterior import CommonTargets, Posterior
from nlosctl.solvers.triplets.target_sets import TargetSets, log_any, log_volume, refine_sets

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
    problem: TripletProblem, proposed_x: FloatArray, proposed_y: FloatArray, model: TargetModel
) -> CommonTargets:
    """Return the posterior of snapshots (B, K) whose paths each propose a target (B, K) about the local origin."""
    scale = sum_measurements(problem.path_length_m) / problem.path_length_m.shape[1]
    # Targets on stations have densities that float64 does not hold.
    with ignoring_overflow():
        groups = _hypotheses(problem, proposed_x, proposed_y, model, scale)
        nothing = np.full(scale.shape, -np.inf)
        if problem.tx_x.shape[1] >= _FEWEST:
            nothing = _log_nothing(problem, proposed_x, proposed_y, model, scale)
        return Posterior.of(groups, nothing, model.targets).judged(problem, model, scale)


def _hypotheses(
    problem: TripletProblem, proposed_x: FloatArray, proposed_y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> list[TargetSets]:
    """Return the refined sets of one target, of two, and so on."""
    proposals = _likeliest(problem, proposed_x, proposed_y, model, scale_m)
    start_x, start_y = (part[:_HYPOTHESES] for part in proposals)
    if problem.tx_x.shape[1] > 1:
        crossings = _likeliest(problem, *_crossings(problem), model, scale_m)
        start_x = np.concatenate([start_x, crossings[0][:_CROSSINGS]])
        start_y = np.concatenate([start_y, crossings[1][:_CROSSINGS]])
    groups = [refine_sets(problem, start_x[None], start_y[None], model, scale_m)]
    if model.targets > 1:
        considered_x, considered_y = (part[:_CONSIDERED] for part in proposals)
        companions = _Companions.of(problem, considered_x, considered_y, model, scale_m)
        for _ in range(1, model.targets):
            groups.append(refine_sets(problem, *companions.extend(groups[-1]), model, scale_m))
    return groups


def _likeliest(
    problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return proposals (B, P) as (P, B), the likeliest first."""
    scores = np.zeros(x.T.shape)
    block = max(1, _SCORED // max(1, scale_m.shape[0]))
    for first in range(0, x.shape[1], block):
        some = slice(first, first + block)
        for k in range(problem.tx_x.shape[1]):
            density = path_density(problem, k, x.T[some], y.T[some], model, scale_m)
            scores[some] -= np.logaddexp(density.log_direct, density.log_indirect)
            note_step(first + block * k // problem.tx_x.shape[1], x.shape[1])
    order = np.argsort(np.where(np.isnan(scores), np.inf, scores), axis=0, kind="stable")
    return np.take_along_axis(x.T, order, axis=0), np.take_along_axis(y.T, order, axis=0)


def _crossings(problem: TripletProblem) -> tuple[FloatArray, FloatArray]:
    """Return where the departing ray of each path crosses the arriving rays of the next longer ones (B, P), or NaN."""
    rank = np.argsort(problem.path_length_m, axis=1, kind="stable")
    all_x: list[FloatArray] = []
    all_y: list[FloatArray] = []
    shifts = min(_SHIFTS, max(1, _MOST_CROSSINGS // rank.shape[1]), rank.shape[1] - 1)
    for shift in range(1, shifts + 1):
        cosine, sine, rx_x, rx_y = (
            np.roll(np.take_along_axis(values, rank, axis=1), -shift, axis=1)
            for values in (problem.doa_cosine, problem.doa_sine, problem.rx_x, problem.rx_y)
        )
        along_x, along_y, tx_x, tx_y = (
            np.take_along_axis(values, rank, axis=1)
            for values in (problem.dod_cosine, problem.dod_sine, problem.tx_x, problem.tx_y)
        )
        dx, dy = rx_x - tx_x, rx_y - tx_y
        inverse = 1.0 / (sine * along_x - cosine * along_y)
        along, back = (sine * dx - cosine * dy) * inverse, (along_y * dx - along_x * dy) * inverse
        along = np.where((along > 0.0) & (back > 0.0), along, np.nan)
        all_x.append(tx_x + along * along_x)
        all_y.append(tx_y + along * along_y)
    return np.concatenate(all_x, axis=1), np.concatenate(all_y, axis=1)


@dataclass(frozen=True)
class _Companions:
    """Further targets (P, B) to consider, with the log-densities (P, B, K) of all paths."""

    x: FloatArray
    y: FloatArray
    log_direct: FloatArray
    log_indirect: FloatArray

    @classmethod
    def of(
        cls, problem: TripletProblem, x: FloatArray, y: FloatArray, model: TargetModel, scale_m: FloatArray
    ) -> _Companions:
        """Return targets (P, B) with their densities."""
        direct, indirect = [], []
        for one_x, one_y in zip(x, y, strict=True):
            paths = [path_density(problem, k, one_x, one_y, model, scale_m) for k in range(problem.tx_x.shape[1])]
            direct.append(np.stack([path.log_direct for path in paths], axis=1))
            indirect.append(np.stack([path.log_indirect for path in paths], axis=1))
        return cls(x, y, np.stack(direct), np.stack(indirect))

    def extend(self, sets: TargetSets) -> tuple[FloatArray, FloatArray]:
        """Return sets (T + 1, H, B): the best sets, each with its likeliest companions."""
        # The sets that repeat a better one are last.
        order = np.argsort(~sets.valid, axis=0, kind="stable")[:_FIRSTS]
        rows = np.arange(order.shape[1])
        all_x: list[FloatArray] = []
        all_y: list[FloatArray] = []
        for rank in order:
            x, y = self._likeliest(log_any(sets.log_direct[:, rank, rows]), log_any(sets.log_indirect[:, rank, rows]))
            for extended, first, further in ((all_x, sets.x, x), (all_y, sets.y, y)):
                repeated = np.repeat(first[:, rank, rows][:, None], further.shape[0], axis=1)
                extended.append(np.concatenate([repeated, further[None]]))
        return np.concatenate(all_x, axis=1), np.concatenate(all_y, axis=1)

    def _likeliest(self, log_direct: FloatArray, log_indirect: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the likeliest companions (H, B) of targets that give the paths these log-densities (B, K)."""
        known = np.logaddexp(log_direct, log_indirect)
        scores = []
        for direct, indirect in zip(self.log_direct, self.log_indirect, strict=True):
            total = -sum_measurements(np.logaddexp(known, np.logaddexp(direct, indirect)))
            scores.append(np.where(np.isnan(total), np.inf, total))
        order = np.argsort(np.stack(scores), axis=0, kind="stable")[:_COMPANIONS]
        return np.take_along_axis(self.x, order, axis=0), np.take_along_axis(self.y, order, axis=0)


def _log_nothing(
    problem: TripletProblem, own_x: FloatArray, own_y: FloatArray, model: TargetModel, scale_m: FloatArray
) -> FloatArray:
    """Return the log-evidence (B,) that there is no target: each path is unrelated, or over a scatterer of its own.

    ``own_x``, ``own_y`` (B, K) are the scatterers that fit each path best.
    """
    unrelated = math.log(model.prior_indirect) + log_unrelated(problem, scale_m)
    total = np.zeros(scale_m.shape)
    for k in range(own_x.shape[1]):
        density = path_density(problem, k, own_x[:, k], own_y[:, k], model, scale_m)
        alone = density.log_direct + log_volume(density.information, scale_m)
        total += np.logaddexp(unrelated[:, k], np.where(np.isnan(alone), -np.inf, alone))
    return total
