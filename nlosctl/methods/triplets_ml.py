"""Maximum likelihood on triplets with Gaussian errors: path by path, or all paths of a snapshot together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point
from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Estimates, Flags, Solution, has_position
from nlosctl.models.triplets import PathRows, SpacePaths, paths_of, snapshot_centers
from nlosctl.solvers.optimization.point_costs import cost_point_by_point, spread_m
from nlosctl.solvers.triplets.cell_costs import cell_cost
from nlosctl.solvers.triplets.likelihood import TripletProblem
from nlosctl.solvers.triplets.target_fits import TargetFits, fit_paths, fit_snapshots
from nlosctl.solvers.triplets.target_status import curved_covariance, judge_targets, mark_ambiguous, path_estimates

__all__ = ["METHOD", "MaximumLikelihoodOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class MaximumLikelihoodOptions:
    """Parameters of ``ml``."""

    joint: bool = option(False, meaning="one target for all paths of a snapshot; else one for each path by itself")
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="another optimum this near makes an estimate ambiguous"
    )
    max_iterations: int = option(100, minimum=1, meaning="steps after which a fit counts as not converged")


def solve(batch: TripletBatch, options: MaximumLikelihoodOptions) -> Solution:
    """Solve a batch by maximum likelihood, Section VI-E of Shen, Molisch 2012, all rows trusted.

    Newton and Gauss-Newton steps from the three intersections and points between them. The covariance of a single path
    is the second moment of its posterior about the estimate, that of several the inverse Fisher information.
    """
    rows = paths_of(batch)
    fits = fit_paths(rows, max_iterations=options.max_iterations)
    if options.joint:
        return _solve_snapshots(batch, rows, fits, options)
    estimates = path_estimates(rows, fits, options.ambiguous_within)
    answered = estimates.n_used.reshape(rows.shape) > 0
    residuals = TripletProblem.of_paths(rows).residuals(*fits.point) if batch.want_flags else {}
    return _solution(estimates, answered, {name: rows.dense(part[:, 0]) for name, part in residuals.items()})


def _solve_snapshots(
    batch: TripletBatch, rows: PathRows | SpacePaths, single: TargetFits, options: MaximumLikelihoodOptions
) -> Solution:
    center = snapshot_centers(batch)
    proposed = rows.dense_from(center, *single.point)
    problem = TripletProblem.of_snapshots(batch, center)
    fits = fit_snapshots(problem, *proposed, max_iterations=options.max_iterations)
    covariance = problem.covariance(*fits.point)
    judged = judge_targets(problem, fits.point, covariance, fits.converged)
    if batch.measurements == 1:
        covariance = curved_covariance(rows, single)
    status = mark_ambiguous(fits, judged, options.ambiguous_within)
    position = tuple(map(np.add, fits.point, center))
    estimates = Estimates.of(
        status,
        position,
        covariance,
        fits.cost,
        batch.measurements,
        chi_square=2.0 * fits.cost,
        degrees_of_freedom=problem.degrees_of_freedom(np.ones(rows.shape, dtype=bool)),
    )
    answered = np.broadcast_to(has_position(status)[:, None], rows.shape)
    return _solution(estimates, answered, problem.residuals(*fits.point) if batch.want_flags else {})


def _cost_at(batch: TripletBatch, options: MaximumLikelihoodOptions, points: Point, cell_m: float) -> FloatArray:
    """Return half the chi-square (B, P) of all paths of a snapshot together, at points or of cells."""
    center = snapshot_centers(batch)
    problem = TripletProblem.of_snapshots(batch, center)
    return cost_point_by_point(problem, center, points, lambda part, at: cell_cost(part, at, spread_m(cell_m)))


def _solution(estimates: Estimates, answered: BoolArray, residuals: dict[str, FloatArray]) -> Solution:
    """Return the solution with the residuals, if there are any."""
    if not residuals:
        return Solution(estimates=estimates)
    columns = {name: np.where(answered, part, np.nan) for name, part in residuals.items()}
    return Solution(estimates=estimates, flags=Flags(used=answered.copy(), columns=columns))


METHOD = MethodSpec(
    name="ml",
    kind="triplets",
    job="localize",
    summary="maximum likelihood for Gaussian errors, path by path (joint=true: all paths of a snapshot together)",
    reference="Shen, Molisch 2012, Section VI-E",
    options=MaximumLikelihoodOptions,
    solve=solve,
    cost="half the chi-square of the residuals",
    minimum_measurements=1,
    cost_at=_cost_at,
    dimensions=(2, 3),
    flags=(
        "residual_dod_rad",
        "residual_doa_rad",
        "residual_m",
        "residual_dod_elevation_rad",
        "residual_doa_elevation_rad",
    ),
    flags_needing={f"residual_{node}_elevation_rad": f"{node}_elevation_rad" for node in ("dod", "doa")},
)
