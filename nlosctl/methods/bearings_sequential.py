"""Sequential estimation: the state that one receiver would pass to the next."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, StatusArray
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Estimates, Flags, Solution, Trace, has_position
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines, sight_lines
from nlosctl.solvers.bearings.fix_status import judge_fixes, nearly_singular
from nlosctl.solvers.bearings.joint_range_bearing import range_columns
from nlosctl.solvers.bearings.line_fits import fit_least_squares
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.optimization.problem import RowDerivatives, least_chi_square
from nlosctl.solvers.sequential.orders import Prior, RangedLines, Run, run_all_orders
from nlosctl.solvers.sequential.polar_updates import SourceState
from nlosctl.solvers.sequential.starting_pairs import conditioned_pairs

__all__ = ["METHOD", "SequentialOptions", "solve"]

_UNKNOWNS = 2


@dataclass(frozen=True, kw_only=True)
class SequentialOptions:
    """Parameters of ``sequential``."""

    bootstraps: int = option(1, minimum=1, maximum=1000, meaning="runs from different pairs; the likeliest is kept")
    use_ranges: bool = option(True, meaning="whether ranges are used where rows have them")
    range_noise: Literal["gaussian", "lognormal"] = option("gaussian", meaning="distribution of the range error")
    prior_x_m: float | None = option(None, unit="m", meaning="prior x of the source, in place of a pair of rows")
    prior_y_m: float | None = option(None, unit="m", meaning="prior y of the source")
    prior_std_m: float | None = option(
        None, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of the prior in x and in y"
    )
    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    max_pairs: int = option(5000, minimum=1, meaning="pairs of rows to choose from; a random subset if there are more")


def solve(batch: BearingBatch, options: SequentialOptions) -> Solution:
    """Solve a batch by the sequential algorithm of Ananthasubramaniam and Madhow, Section III, (6)-(17).

    Starts from a pair of rays that cross well (or from a prior), combines the other rows in random order, each in its
    own polar frame, and keeps the likeliest of ``bootstraps`` runs. The cost is half the chi-square, (17) halved and
    negated. behind: every run started from a crossing behind a ray, or ended behind one.
    """
    lines = sight_lines(batch)
    prior = _prior(batch, lines, options)
    ranges = range_columns(batch, options.use_ranges)
    measured_m, range_std_m = ranges or (None, None)
    ranged = RangedLines(lines, measured_m, range_std_m, options.range_noise == "lognormal")
    if batch.measurements < 2:
        first = second = np.zeros((batch.size, 1), dtype=np.int64)
    else:
        first, second = conditioned_pairs(batch.seed, lines, options.bootstraps, options.max_pairs)
    run = run_all_orders(ranged, batch.seed, np.asfortranarray(first), np.asfortranarray(second), prior)
    last = run.states[-1]
    cost = np.where(last.alive, ranged.half_chi_square(last.x, last.y), np.inf)
    best = np.argmin(cost, axis=1)
    status = _status(batch, lines, run, best, prior, options.min_range_m)
    return _solution(batch, ranged, run, best, cost[np.arange(batch.size), best], status, prior)


def _prior(batch: BearingBatch, lines: SightLines, options: SequentialOptions) -> Prior | None:
    """Return the prior of each snapshot: that of the file, else that of the parameters."""
    given = (options.prior_x_m, options.prior_y_m, options.prior_std_m)
    if any(value is None for value in given) and any(value is not None for value in given):
        raise UsageError("a prior needs all of prior_x_m, prior_y_m and prior_std_m")
    x, y, std = (np.full(batch.size, np.nan if value is None else value) for value in given)
    if batch.prior_xy_m is not None and batch.prior_std_m is not None and batch.measurements:
        own = np.isfinite(batch.prior_xy_m[:, 0, 0]) & np.isfinite(batch.prior_xy_m[:, 0, 1])
        own &= np.isfinite(batch.prior_std_m[:, 0])
        x, y = np.where(own, batch.prior_xy_m[:, 0, 0], x), np.where(own, batch.prior_xy_m[:, 0, 1], y)
        std = np.where(own, batch.prior_std_m[:, 0], std)
    known = np.isfinite(std)
    if not known.any():
        return None
    return Prior(x - lines.center_x, y - lines.center_y, std, known)


def _status(
    batch: BearingBatch, lines: SightLines, run: Run, best: IntArray, prior: Prior | None, min_range_m: float
) -> StatusArray:
    (last,) = run.pick(best)[0][-1:]
    x, y = last.x[:, 0], last.y[:, 0]
    covariance = last.covariance.at(slice(None), 0)
    status = judge_fixes(lines, x, y, lines.ray_residuals(x, y), covariance, min_range_m)
    status[~last.alive[:, 0]] = Status.BEHIND
    free = np.ones(batch.size, dtype=bool) if prior is None else ~prior.known
    status[free & nearly_singular(fit_least_squares(lines).normal)] = Status.DEGENERATE
    if batch.measurements < 2:
        status[free] = Status.TOO_FEW
    return status


def _solution(
    batch: BearingBatch,
    ranged: RangedLines,
    run: Run,
    best: IntArray,
    cost: FloatArray,
    status: StatusArray,
    prior: Prior | None,
) -> Solution:
    lines = ranged.lines
    states, rows = run.pick(best)
    last = states[-1]
    x, y = last.x[:, 0], last.y[:, 0]
    position = (x + lines.center_x, y + lines.center_y)
    covariance = last.covariance.at(slice(None), 0)
    chi_square, degrees = _misfit(ranged, x, y, prior)
    return Solution(
        estimates=Estimates.of(
            status, position, covariance, cost, batch.measurements, chi_square=chi_square, degrees_of_freedom=degrees
        ),
        flags=Flags.of_fixes(status, lines.residuals(batch, x, y)) if batch.want_flags else None,
        trace=_trace(lines, states, rows, status) if batch.want_trace else None,
    )


def _misfit(ranged: RangedLines, x: FloatArray, y: FloatArray, prior: Prior | None) -> tuple[FloatArray, IntArray]:
    """Return the chi-square (B,) of all rows, and of the prior where there is one, with its degrees of freedom."""
    smallest = np.full(x.shape, np.finfo(np.float64).tiny)
    ranges = (ranged.measured_m, ranged.range_std_m)
    rows = DirectBearings.of(ranged.lines, smallest, *ranges, lognormal=ranged.lognormal)
    everything = np.ones(rows.weight.shape, dtype=bool)
    if prior is None:
        chi_square, scalars = least_chi_square(rows, x, y, everything)
        return chi_square, scalars - _UNKNOWNS
    weight = np.where(prior.known, 1.0 / (prior.std_m * prior.std_m), 0.0)
    dx, dy = (np.where(prior.known, part, 0.0) for part in (x - prior.x, y - prior.y))
    precision = SymmetricMatrix(weight, np.zeros(x.shape), weight)
    half = 0.5 * precision.quadratic_form(dx, dy)
    expected = RowDerivatives(half, (weight * dx, weight * dy), precision, precision)
    chi_square, scalars = least_chi_square(rows, x, y, everything, expected)
    return chi_square, scalars + np.where(prior.known, _UNKNOWNS, 0) - _UNKNOWNS


def _trace(lines: SightLines, states: list[SourceState], rows: list[IntArray], status: StatusArray) -> Trace:
    """Return the states (B, 1) of each step, of snapshots with a position."""
    written = np.stack([state.alive[:, 0] & has_position(status) for state in states], axis=1)
    row, step = np.nonzero(written)

    def written_of(parts: Iterable[FloatArray]) -> FloatArray:
        return np.concatenate([*parts], axis=1)[row, step]

    x, y = (written_of(getattr(state, name) for state in states) for name in ("x", "y"))
    covariances = zip(*(state.covariance for state in states), strict=True)
    return Trace(
        row=row.astype(np.int64),
        step=step.astype(np.int64) + 1,
        measurement=np.stack(rows, axis=1)[row, step],
        position_m=np.stack([x + lines.center_x[row], y + lines.center_y[row]], axis=1),
        covariance_m2=np.stack([written_of(parts) for parts in covariances], axis=1),
    )


METHOD = MethodSpec(
    name="sequential",
    kind="bearings",
    job="localize",
    summary="sequential updates, one sensor after the other, as receivers would pass them on; all rows trusted",
    reference="Ananthasubramaniam, Madhow, Section III, equations (6)-(17)",
    options=SequentialOptions,
    solve=solve,
    cost=HALF_CHI_SQUARE,
    minimum_measurements=1,
    flags=("residual_rad", "residual_m"),
    flags_needing={"residual_m": "range_m"},
    randomized=True,
    traces=True,
    exempt_from=frozenset({"order"}),
    reads=frozenset({"range_m", "range_std_m", "prior_x_m", "prior_y_m", "prior_std_m"}),
)
