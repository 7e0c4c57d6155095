"""Maximum likelihood of arrival times: the offset of their common clock eliminated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.tables.arrivals import OFFSET
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.arrivals import arrival_rows
from nlosctl.solvers.arrivals.closed_forms import initial_estimates
from nlosctl.solvers.arrivals.far_field import without_open_distance
from nlosctl.solvers.arrivals.likelihood import AT_INFINITY, PLAUSIBLE_NATS, ArrivalProblem
from nlosctl.solvers.arrivals.pair_estimates import pair_estimates
from nlosctl.solvers.optimization.point_costs import cost_at_points, spread_m
from nlosctl.solvers.optimization.two_optima import find_best_two, nearer_first
from nlosctl.solvers.ranges.optima import estimate_factors, finish_range_fix, with_covariances
from nlosctl.solvers.tracking.arrival_rows import trusted_arrivals

__all__ = ["METHOD", "ArrivalOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class ArrivalOptions:
    """Parameters of ``ml``."""

    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="a second optimum whose cost is at most this much higher is as good"
    )
    max_iterations: int = option(100, minimum=1, meaning="steps after which a snapshot counts as not converged")


def solve(batch: ArrivalBatch, options: ArrivalOptions) -> Solution:
    """Solve a batch by the likelihood of the arrivals, (1) of `nlosctl.models.arrivals`, in the plane or in space.

    Levenberg-Marquardt from the closed forms of `initial_estimates`. That is the likelihood of all differences to any
    reference with their full covariance. Independent differences of pairs have no offset, and their initial estimates
    are those of `pair_estimates`. The covariance is the inverse Fisher information at the estimate. A source whose
    arrivals a plane wave explains nearly as well is degenerate.
    """
    rows = arrival_rows(batch)
    points = pair_estimates(rows) if rows.of_pairs else initial_estimates(rows)
    plausible = None
    if batch.std == "stated":
        plausible = PLAUSIBLE_NATS + 2.0 * rows.degrees_of_freedom.astype(np.float64)
    ends = nearer_first(
        *find_best_two(
            ArrivalProblem.of_rows(rows), rows, points, options.max_iterations, plausible, AT_INFINITY * rows.size_m()
        )
    )
    factors = None
    if batch.std == "unknown":
        factors = estimate_factors(rows, *ends, options.ambiguous_within)
        rows = replace(rows, std_m=factors.scaled(rows.std_m))
    one, other = (without_open_distance(rows, end) for end in with_covariances(rows, *ends, factors))
    return finish_range_fix(
        batch,
        rows,
        one,
        other,
        min_range_m=options.min_range_m,
        ambiguous_within=options.ambiguous_within,
        factors=factors,
    )


def _cost_at(batch: ArrivalBatch, options: ArrivalOptions, points: Point, cell_m: float) -> FloatArray:
    """Return half the chi-square (B, P) at points, or of cells, whose extent widens the standard deviations.

    The offset is integrated out, its prior flat.
    """
    std_m = np.hypot(batch.arrival_std_m, spread_m(cell_m))
    rows = arrival_rows(replace(batch, arrival_std_m=std_m))
    cost = cost_at_points(rows, rows.center, points, lambda part, at: part.half_chi_squares(*at))
    blur = sum_measurements(np.log(std_m))
    if not rows.of_pairs:
        blur = blur + 0.5 * np.log(sum_measurements(std_m**-2.0))
    return np.asarray(cost + blur[:, None])


OFFSETS = tuple(column.name for column in OFFSET)
"""The columns of the offset."""

METHOD = MethodSpec(
    name="ml",
    kind="arrivals",
    job="localize",
    summary="maximum likelihood of arrival times, all rows trusted",
    reference="Chan, Ho 1994, Section II, as the model; maximum likelihood",
    options=ArrivalOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=2,
    cost_at=_cost_at,
    flags=("residual_m",),
    estimate_columns=OFFSETS,
    reads=frozenset({"reference", "speed_std"}),
    scales_std=True,
    dimensions=(2, 3),
    path_rows=lambda batch, options: trusted_arrivals(batch),
)
