"""Maximum likelihood within what the scene allows, by an augmented Lagrangian around Levenberg-Marquardt."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray, ignoring_invalid
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.scene_margins import scene_margins
from nlosctl.solvers.bearings.circle_likelihood import BearingLikelihood, bearing_problem
from nlosctl.solvers.bearings.multistart import Ends
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.optimization.problem import Evaluation

__all__ = ["ConstrainedFix", "hold_within_scene", "minimize_within_scene"]


_ROUNDS = 12
_STIFFNESS = 30.0
"""Penalty of leaving the scene by one scale length (a standard deviation of the free estimate), in nats times two."""

_HARDENING = 4.0
"""By how much the penalty grows with each round: edges that are nearly parallel share their multipliers slowly."""

_ACTIVE = 1e-6
"""A constraint holds the estimate when moving it by a scale length would gain more than this (nats)."""


@dataclass(frozen=True)
class ConstrainedFix:
    """Constrained estimates (B,) about the local origins.

    ``found`` is false where no point within the scene was reached; ``on_edge`` is true where a constraint holds the
    estimate.
    """

    x: FloatArray
    y: FloatArray
    found: BoolArray
    on_edge: BoolArray


def hold_within_scene(ends: Ends, max_iterations: int) -> tuple[Ends, StatusArray]:
    """Return the ends, those outside of what the scene allows replaced by constrained ones, and their status (E,).

    ok, or boundary on an edge; no_candidate where no point within the scene was reached: the end stays where it was.
    Within the scene but with all bearings under the horizon: infeasible still.
    """
    outside = np.flatnonzero(ends.lines.outside_scene(ends.x, ends.y) & np.isfinite(ends.x) & np.isfinite(ends.y))
    status: StatusArray = np.where(ends.lines.all_under_horizon(), Status.INFEASIBLE, Status.OK).astype(np.uint8)
    if not outside.size:
        return ends, status
    x, y, converged = ends.x.copy(), ends.y.copy(), ends.converged.copy()
    lines = ends.lines.take(outside)
    with ignoring_invalid():
        scale = np.sqrt(lines.information(x[outside], y[outside]).inverse().trace)
    fix = minimize_within_scene(lines, x[outside], y[outside], scale, max_iterations)
    held = np.where(fix.found, np.where(fix.on_edge, Status.BOUNDARY, Status.OK), Status.NO_CANDIDATE)
    status[outside] = held
    x[outside], y[outside] = np.where(fix.found, fix.x, x[outside]), np.where(fix.found, fix.y, y[outside])
    converged[outside] |= fix.found
    return replace(ends, x=x, y=y, converged=converged), status


def minimize_within_scene(
    lines: SightLines, start_x: FloatArray, start_y: FloatArray, scale_m: FloatArray, max_iterations: int
) -> ConstrainedFix:
    """Return the least half chi-square (B,) among points that the scene allows, from a start each.

    ``scale_m`` (B,) is the size of a standard deviation of the position. Minimizes half the chi-square plus
    (mu / 2) sum max(0, lambda / mu - g)^2 over the margins g >= 0 of the scene, and raises the multipliers lambda.
    """
    x, y = lines.inside_circles(start_x, start_y)
    likelihood = bearing_problem(lines)
    stiffness = _STIFFNESS / (scale_m * scale_m)
    owners = tuple(margin.snapshot for margin in scene_margins(lines, x, y))
    multipliers = [np.zeros(owner.shape) for owner in owners]
    for _ in range(_ROUNDS):
        problem = _Penalized(likelihood, lines, stiffness, owners, tuple(multipliers))
        minimum = minimize(problem, x, y, max_iterations=max_iterations)
        x, y = minimum.x, minimum.y
        multipliers = [
            np.fmax(0.0, multiplier - stiffness[margin.snapshot] * margin.value_m)
            for multiplier, margin in zip(multipliers, scene_margins(lines, x, y), strict=True)
        ]
        stiffness = _HARDENING * stiffness
    on_edge = np.zeros(x.shape, dtype=bool)
    for multiplier, margin in zip(multipliers, scene_margins(lines, x, y), strict=True):
        on_edge[margin.snapshot[multiplier * scale_m[margin.snapshot] > _ACTIVE]] = True
    return ConstrainedFix(x, y, np.isfinite(x) & minimum.converged & ~lines.outside_scene(x, y), on_edge)


@dataclass(frozen=True)
class _Penalized:
    """The likelihood with the penalties of the scene's margins; ``owners`` are the snapshots of each kind of them."""

    likelihood: BearingLikelihood
    lines: SightLines
    stiffness: FloatArray
    owners: tuple[IntArray, ...]
    multipliers: tuple[FloatArray, ...]

    def take(self, rows: IntArray) -> _Penalized:
        place = np.full(self.stiffness.shape, -1, dtype=np.int64)
        place[rows] = np.arange(rows.shape[0])
        moved = [place[owner] for owner in self.owners]
        return _Penalized(
            self.likelihood.take(rows),
            self.lines.take(rows),
            self.stiffness[rows],
            tuple(owner[owner >= 0] for owner in moved),
            tuple(multiplier[owner >= 0] for multiplier, owner in zip(self.multipliers, moved, strict=True)),
        )

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        at = self.likelihood.evaluate(x, y)
        cost, (gradient_x, gradient_y), hessian = at.cost, at.gradient, at.hessian
        for snapshot, shortfall, slope_x, slope_y, stiffness in self._shortfalls(x, y):

            def total(values: FloatArray, snapshot: IntArray = snapshot) -> FloatArray:
                return np.asarray(np.bincount(snapshot, weights=values, minlength=x.shape[0]), dtype=np.float64)

            cost = cost + total(0.5 * stiffness * shortfall * shortfall)
            gradient_x = gradient_x - total(stiffness * shortfall * slope_x)
            gradient_y = gradient_y - total(stiffness * shortfall * slope_y)
            hessian = hessian + SymmetricMatrix.outer(slope_x, slope_y, weight=stiffness).map(total)
        return Evaluation(cost, (gradient_x, gradient_y), hessian)

    def _shortfalls(
        self, x: FloatArray, y: FloatArray
    ) -> Iterator[tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray]]:
        """Yield the margins that are short of lambda / mu: snapshot, by how much, the margin's gradient, mu."""
        for multiplier, margin in zip(self.multipliers, scene_margins(self.lines, x, y), strict=True):
            stiffness = self.stiffness[margin.snapshot]
            shortfall = multiplier / stiffness - margin.value_m
            short = np.flatnonzero(shortfall > 0.0)
            yield (
                margin.snapshot[short],
                shortfall[short],
                margin.slope_x[short],
                margin.slope_y[short],
                stiffness[short],
            )
