"""Solutions with several estimates of a snapshot: judged one by one, ranked, and compared with each other."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, StatusArray, ignoring_invalid
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import Estimates, Solution, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import rows_in_order, rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.fix_status import bearing_flags, judge_optima
from nlosctl.solvers.bearings.multistart import Optima
from nlosctl.solvers.optimization.unknown_std import marginal_cost

__all__ = ["finish_alternatives"]


def finish_alternatives(
    batch: BearingBatch,
    optima: Optima,
    snapshot: IntArray,
    normal: SymmetricMatrix,
    *,
    min_range_m: float,
    ambiguous_within: float,
    constrained_status: StatusArray | None = None,
) -> Solution:
    """Return the solution of optima, one or more per ``snapshot`` (E,); ``normal`` (B,) is that of the lines.

    Optima without a position are left out unless a snapshot has no other. The first is ``ambiguous`` if the next is
    less than ``ambiguous_within`` nats worse, or another search stopped at a caustic within that; it is not converged
    if one stopped at a caustic more than that below it.
    """
    verdict = judge_optima(
        optima.lines,
        optima.point,
        None,
        normal.take(snapshot),
        min_range_m,
        optima.converged,
        constrained_status,
        std=batch.std,
    )
    status, covariance, cost = verdict.status, verdict.covariance, verdict.cost
    rows, alternative = _rank(snapshot, status, cost)
    status, cost, snapshot = status[rows], cost[rows], snapshot[rows]
    point, lines = rows_in_order((optima.point, optima.lines), rows, optima.converged.shape[0])
    degrees, nats, rival_nats = lines.scalars() - len(point), cost, optima.rival_cost[rows]
    if batch.std == "unknown":
        nats, rival_nats = marginal_cost(cost, degrees), marginal_cost(rival_nats, degrees)
    _compare(status, nats, alternative, rival_nats, ambiguous_within)
    if verdict.factors is not None:
        verdict.factors.take(rows).mark(status)
    estimates = Estimates.of(
        status,
        lines.absolute(*point),
        lines.whole_covariance(covariance.take(rows), *point),
        cost,
        batch.measurements,
        row=snapshot,
        alternative=alternative,
        chi_square=np.nan if batch.std == "unknown" else 2.0 * cost,
        degrees_of_freedom=degrees,
        columns={} if verdict.factors is None else verdict.factors.take(rows).columns(status),
    )
    flags = None
    if batch.want_flags:
        best = np.flatnonzero(alternative == 0)
        flags = bearing_flags(batch, lines.take(best), status[best], *rows_of(point, best))
    return Solution(estimates=estimates, flags=flags)


def _rank(snapshot: IntArray, status: StatusArray, cost: FloatArray) -> tuple[IntArray, IntArray]:
    """Return which optima to keep, by snapshot and best first, and their rank; those without a position come last."""
    answered = has_position(status)
    order = np.lexsort((np.where(answered, cost, np.inf), ~answered, snapshot))
    first = np.ones(order.shape, dtype=bool)
    first[1:] = snapshot[order][1:] != snapshot[order][:-1]
    kept = first | answered[order]
    order, first = order[kept], first[kept]
    index = np.arange(order.shape[0])
    return order, index - np.maximum.accumulate(np.where(first, index, 0))


def _compare(
    status: StatusArray, cost: FloatArray, alternative: IntArray, rival_cost: FloatArray, ambiguous_within: float
) -> None:
    """Write ambiguous and not converged into the status of the first optimum of each snapshot."""
    best = alternative == 0
    answered = best & has_position(status)
    runner_up = np.where(alternative[1:] == 1, cost[1:], np.inf)
    runner_up = np.minimum(np.append(runner_up, np.inf), rival_cost)
    with ignoring_invalid():
        close = runner_up - cost <= ambiguous_within
        beaten = rival_cost < cost - ambiguous_within
    status[answered & close & (status == Status.OK)] = Status.AMBIGUOUS
    status[answered & beaten] = Status.NOT_CONVERGED
