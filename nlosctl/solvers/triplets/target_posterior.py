"""The posterior over sets of targets of a snapshot: which paths are direct, and whether there is a target at all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.symmetric import SymmetricMatrix, dot
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.path_memberships import TargetModel, path_density
from nlosctl.solvers.triplets.target_sets import TargetSets, log_any

__all__ = ["CommonTargets", "Posterior"]


_EVIDENCE_NATS = 4.0
"""A set of targets must be ahead of all that has no direct path by so much."""
_LEAST_FIT = 1e-3
"""A target whose direct paths fit with a smaller p-value is not one."""


@dataclass(frozen=True)
class CommonTargets:
    """The posterior of the targets of B snapshots of K paths; at most T targets.

    ``direct`` (B, K) is the probability that a path is direct, over all hypotheses. Of the best set of targets:
    ``point`` (D arrays (T, B)) about the local origin, its ``information``, NaN where the set has fewer; which paths
    ``supported`` (T, B, K) each, and the ``chi_square`` (T, B) that these leave; ``unfounded`` (T, B) targets fit them
    badly, or explain the snapshot hardly better than no direct path at all; ``cost`` (B,) is the set's negative
    log-evidence, ``lead`` (B,) by how many nats it is ahead of the next.
    """

    direct: FloatArray
    point: tuple[FloatArray, ...]
    information: SymmetricMatrix
    supported: BoolArray
    chi_square: FloatArray
    unfounded: BoolArray
    cost: FloatArray
    lead: FloatArray


@dataclass
class Posterior:
    """The posterior over sets of targets, as in `CommonTargets`.

    ``top`` and ``second`` (B,) are the log-evidence of the two best sets, ``rival`` is the best of no direct
    path, minus infinity where a target is taken for granted.
    """

    direct: FloatArray
    point: tuple[FloatArray, ...]
    information: SymmetricMatrix
    supported: BoolArray
    top: FloatArray
    second: FloatArray
    rival: FloatArray

    @classmethod
    def of(cls, groups: list[TargetSets], nothing: FloatArray, targets: int) -> Posterior:
        """Return the posterior over all sets of 1 to T targets, and nothing at all (log-evidence, (B,))."""
        _, _, size, paths = groups[0].log_direct.shape
        shape, dimension = (targets, size), len(groups[0].point)
        empty = tuple(np.full(shape, np.nan) for _ in range(dimension))
        unknown, none = SymmetricMatrix.full(shape, np.nan, dimension), np.zeros((*shape, paths), dtype=bool)
        lowest = np.full(size, -np.inf)
        found = cls(np.zeros((size, paths)), empty, unknown, none, lowest, lowest.copy(), nothing)
        highest, total = nothing, np.where(np.isfinite(nothing), 1.0, 0.0)
        for sets in groups:
            for rank in range(sets.score.shape[0]):
                score = np.where(sets.valid[rank], sets.score[rank], -np.inf)
                new_highest = np.maximum(highest, score)
                old, new = (
                    np.where(np.isfinite(value), np.exp(value - new_highest), 0.0) for value in (highest, score)
                )
                total = total * old + new
                found.direct = found.direct * old[:, None] + _direct_share(sets, rank) * new[:, None]
                highest = new_highest
                found._consider(sets, rank, score)
        found.direct = np.asfortranarray(np.where(total[:, None] > 0.0, found.direct / total[:, None], 0.0))
        return found

    def _consider(self, sets: TargetSets, rank: int, score: FloatArray) -> None:
        """Take over a set where it is the best so far."""
        supported = sets.log_direct[:, rank] > sets.log_indirect[:, rank]
        without = np.isfinite(self.rival) & ~supported.any(axis=(0, 2))
        self.rival = np.where(without, np.maximum(self.rival, score), self.rival)
        rows = score > self.top
        self.second = np.where(rows, self.top, np.maximum(self.second, score))
        self.top = np.maximum(self.top, score)
        if not rows.any():
            return
        count = supported.shape[0]
        self.supported[:, rows] = False
        self.supported[:count, rows] = supported[:, rows]
        mine, theirs = (*self.point, *self.information), (*sets.point, *sets.information)
        for part, values in zip(mine, theirs, strict=True):
            part[:, rows] = np.nan
            part[:count, rows] = values[:, rank, rows]

    def judged(self, problem: TripletProblem, model: TargetModel, scale_m: FloatArray) -> CommonTargets:
        """Return the posterior with the targets that are not founded on the paths."""
        weak = self.top - self.rival < _EVIDENCE_NATS
        chi_square = np.stack(
            [
                _best_chi_square(problem, tuple(point), supported, model, scale_m)
                for *point, supported in zip(*self.point, self.supported, strict=True)
            ]
        )
        spare = np.maximum(problem.degrees_of_freedom(self.supported), 1)
        unfounded = weak | (chdtrc(spare, chi_square) < _LEAST_FIT)
        lead = np.where(np.isfinite(self.top), self.top - self.second, 0.0)
        return CommonTargets(
            self.direct, self.point, self.information, self.supported, chi_square, unfounded, -self.top, lead
        )


def _best_chi_square(
    problem: TripletProblem,
    point: tuple[FloatArray, ...],
    supported: BoolArray,
    model: TargetModel,
    scale_m: FloatArray,
) -> FloatArray:
    """Return the chi-square (B,) that the direct paths leave at the position that fits them alone best.

    That is a Gauss-Newton step from points (B,), where detours count too. The radius of the target is accounted for,
    and so is a measured height.
    """
    shape = point[0].shape
    total, gradient = np.zeros(shape), tuple(np.zeros(shape) for _ in point)
    information, none = (SymmetricMatrix.full(shape, 0.0, len(point)) for _ in range(2))
    for k in range(problem.paths):
        density, direct = path_density(problem, k, point, model, scale_m), supported[:, k]
        total += np.where(direct, density.chi_square, 0.0)
        for mine, part in zip(gradient, density.gradient, strict=True):
            mine += np.where(direct, part, 0.0)
        information += density.information.where(direct, none)
    if problem.height is not None:
        total += 2.0 * problem.height.cost(point[2])
        problem.height.add_to(point[2], gradient, information)
    gain = dot(gradient, information.solve(*gradient))
    return np.where(gain > 0.0, np.maximum(total - gain, 0.0), total)


def _direct_share(sets: TargetSets, rank: int) -> FloatArray:
    """Return each path's probability (B, K) to be direct to one of a set of targets."""
    direct, indirect = log_any(sets.log_direct[:, rank]), log_any(sets.log_indirect[:, rank])
    share = np.exp(direct - np.logaddexp(direct, indirect))
    return np.where(np.isnan(share), 0.0, share)
