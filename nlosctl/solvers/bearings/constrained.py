"""Maximum likelihood within what the scene allows, by an augmented Lagrangian around Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray, ignoring_invalid
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.scene_margins import scene_margins
from nlosctl.models.sight import Sight
from nlosctl.solvers.bearings.circle_likelihood import BearingLikelihood, bearing_problem
from nlosctl.solvers.bearings.multistart import Optima
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["ConstrainedFix", "constrain_to_scene", "minimize_within_scene"]


_ROUNDS = 12
_STIFFNESS = 30.0
"""Penalty of leaving the scene by one scale length (a standard deviation of the free estimate), in nats times two."""

_HARDENING = 4.0
"""Growth of the penalty per round: edges that are nearly parallel share their multipliers slowly."""

_ACTIVE = 1e-6
"""A constraint is active if moving the estimate by a scale length would gain more than this (nats)."""


@dataclass(frozen=True)
class ConstrainedFix:
    """Constrained estimates (B,) about the local origins.

    ``reached`` is false where no point within the scene was reached; ``at_boundary`` is true where a constraint is
    active.
    """

    point: tuple[FloatArray, ...]
    reached: BoolArray
    at_boundary: BoolArray


def constrain_to_scene(optima: Optima, max_iterations: int) -> tuple[Optima, StatusArray]:
    """Return the optima, those outside the scene's limits replaced by constrained ones, and their status (E,).

    ok, or boundary on an edge; no_candidate if no point within the scene was reached (the optimum is unchanged).
    Optima within the scene remain infeasible if all bearings are below the horizon.
    """
    finite = np.logical_and.reduce([np.isfinite(part) for part in optima.point])
    outside = np.flatnonzero(optima.lines.outside_scene(*optima.point) & finite)
    status: StatusArray = np.where(optima.lines.all_under_horizon(), Status.INFEASIBLE, Status.OK).astype(np.uint8)
    if not outside.size:
        return optima, status
    point, converged = tuple(part.copy() for part in optima.point), optima.converged.copy()
    lines, start = optima.lines.take(outside), rows_of(point, outside)
    with ignoring_invalid():
        scale = np.sqrt(lines.information(*start).inverse().trace)
    fix = minimize_within_scene(lines, start, scale, max_iterations)
    constrained_status = np.where(
        fix.reached, np.where(fix.at_boundary, Status.BOUNDARY, Status.OK), Status.NO_CANDIDATE
    )
    status[outside] = constrained_status
    for part, within in zip(point, fix.point, strict=True):
        part[outside] = np.where(fix.reached, within, part[outside])
    converged[outside] |= fix.reached
    return replace(optima, point=point, converged=converged), status


def minimize_within_scene(
    lines: Sight, start: tuple[FloatArray, ...], scale_m: FloatArray, max_iterations: int
) -> ConstrainedFix:
    """Return the least half chi-square (B,) among points that the scene allows, from a start each.

    ``scale_m`` (B,) is the size of a standard deviation of the position. Minimizes half the chi-square plus
    (mu / 2) sum max(0, lambda / mu - g)^2 over the margins g >= 0 of the scene, and raises the multipliers lambda.
    """
    point = lines.inside_circles(*start)
    likelihood = bearing_problem(lines)
    stiffness = _STIFFNESS / (scale_m * scale_m)
    owners = tuple(margin.snapshot for margin in scene_margins(lines, *point))
    multipliers = [np.zeros(owner.shape) for owner in owners]
    for _ in range(_ROUNDS):
        problem = _Penalized(likelihood, lines, stiffness, owners, tuple(multipliers))
        minimum = minimize(problem, *point, max_iterations=max_iterations)
        point = minimum.point
        multipliers = [
            np.fmax(0.0, multiplier - stiffness[margin.snapshot] * margin.value_m)
            for multiplier, margin in zip(multipliers, scene_margins(lines, *point), strict=True)
        ]
        stiffness = _HARDENING * stiffness
    at_boundary = np.zeros(scale_m.shape, dtype=bool)
    for multiplier, margin in zip(multipliers, scene_margins(lines, *point), strict=True):
        at_boundary[margin.snapshot[multiplier * scale_m[margin.snapshot] > _ACTIVE]] = True
    reached = np.isfinite(point[0]) & minimum.converged & ~lines.outside_scene(*point)
    return ConstrainedFix(point, reached, at_boundary)


@dataclass(frozen=True)
class _Penalized:
    """The likelihood with the penalties of the scene's margins; ``owners`` are the snapshots of each kind of them."""

    likelihood: BearingLikelihood
    lines: Sight
    stiffness: FloatArray
    owners: tuple[IntArray, ...]
    multipliers: tuple[FloatArray, ...]

    def take(self, rows: IntArray) -> _Penalized:
        index = np.full(self.stiffness.shape, -1, dtype=np.int64)
        index[rows] = np.arange(rows.shape[0])
        moved = [index[owner] for owner in self.owners]
        return _Penalized(
            self.likelihood.take(rows),
            self.lines.take(rows),
            self.stiffness[rows],
            tuple(owner[owner >= 0] for owner in moved),
            tuple(multiplier[owner >= 0] for multiplier, owner in zip(self.multipliers, moved, strict=True)),
        )

    def evaluate(self, *point: FloatArray) -> Evaluation:
        at = self.likelihood.evaluate(*point)
        cost, gradient, hessian = at.cost, at.gradient, at.hessian
        for snapshot, shortfall, slopes, stiffness in self._shortfalls(*point):

            def total(values: FloatArray, snapshot: IntArray = snapshot) -> FloatArray:
                return np.asarray(np.bincount(snapshot, weights=values, minlength=at.cost.shape[0]), dtype=np.float64)

            cost = cost + total(0.5 * stiffness * shortfall * shortfall)
            pull = stiffness * shortfall
            gradient = tuple(part - total(pull * slope) for part, slope in zip(gradient, slopes, strict=True))
            hessian = hessian + SymmetricMatrix.outer(*slopes, weight=stiffness).map(total)
        return Evaluation(cost, gradient, hessian)

    def _shortfalls(
        self, *point: FloatArray
    ) -> Iterator[tuple[IntArray, FloatArray, tuple[FloatArray, ...], FloatArray]]:
        """Yield the margins that are short of lambda / mu: snapshot, by how much, the margin's gradient, mu."""
        for multiplier, margin in zip(self.multipliers, scene_margins(self.lines, *point), strict=True):
            stiffness = self.stiffness[margin.snapshot]
            shortfall = multiplier / stiffness - margin.value_m
            short = np.flatnonzero(shortfall > 0.0)
            slopes = tuple(slope[short] for slope in margin.slopes)
            yield margin.snapshot[short], shortfall[short], slopes, stiffness[short]
