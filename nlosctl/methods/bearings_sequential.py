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
from nlosctl.models.bearings import SightLines, sight_lines
from nlosctl.solvers.bearings.fix_status import judge_fixes, mark_crossings_behind, nearly_singular
from nlosctl.solvers.bearings.joint_range_bearing import count_scalars, range_columns
from nlosctl.solvers.bearings.line_fits import fit_focused, fit_least_squares
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.optimization.problem import RowDerivatives, least_chi_square
from nlosctl.solvers.sequential.orders import RangedLines, run_all_orders
from nlosctl.solvers.sequential.polar_updates import SourceState
from nlosctl.solvers.sequential.priors import PRIOR_NAMES, PriorOptions, prior_of
from nlosctl.solvers.sequential.second_round import second_round
from nlosctl.solvers.sequential.starting_pairs import starting_pairs

__all__ = ["METHOD", "SequentialOptions", "solve"]

_UNKNOWNS = 2


@dataclass(frozen=True, kw_only=True)
class SequentialOptions(PriorOptions):
    """Parameters of ``sequential``."""

    bootstraps: int = option(5, minimum=1, maximum=1000, meaning="runs from different pairs; the likeliest is kept")
    pairs: Literal["precise", "random"] = option(
        "precise", meaning="pairs to start from: those of least predicted covariance, or at random (as published)"
    )
    relinearize: bool = option(
        True, meaning="whether a second round through the rows relinearizes about the estimate (as published: false)"
    )
    use_ranges: bool = option(True, meaning="whether ranges are used where rows have them")
    range_noise: Literal["gaussian", "lognormal"] = option("gaussian", meaning="distribution of the range error")
    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    max_pairs: int = option(5000, minimum=1, meaning="most pairs of rows to choose the starting pairs from")


def solve(batch: BearingBatch, options: SequentialOptions) -> Solution:
    """Solve a batch by the sequential algorithm of Ananthasubramaniam and Madhow, Section III, (6)-(17).

    Starts from pairs of rays with the least predicted covariance, (15), (16) (or from a prior), combines the other
    rows in random order, each in its own polar frame, and keeps the likeliest of ``bootstraps`` runs. A second round
    then relinearizes all rows about its estimate. The cost is half the chi-square, (17) halved and negated. behind:
    every run started from a crossing behind a ray, or ended behind one.
    """
    lines = sight_lines(batch)
    measured_m, range_std_m = range_columns(batch, options.use_ranges) or (None, None)
    prior = prior_of(batch, lines.center, options)
    ranged = RangedLines(lines, measured_m, range_std_m, options.range_noise == "lognormal", prior)
    states, rows = _best_run(ranged, batch, options)
    if options.relinearize:
        states = second_round(ranged, states, np.stack(rows, axis=1))
    last = states[-1]
    cost = np.where(last.alive, ranged.half_chi_square(last.x, last.y), np.inf)[:, 0]
    status = _status(batch, ranged, last, options.min_range_m)
    x, y = last.x[:, 0], last.y[:, 0]
    position = (x + lines.center_x, y + lines.center_y)
    covariance = last.covariance.at(slice(None), 0)
    chi_square, degrees = _fit(ranged, x, y)
    return Solution(
        estimates=Estimates.of(
            status, position, covariance, cost, batch.measurements, chi_square=chi_square, degrees_of_freedom=degrees
        ),
        flags=Flags.of_fixes(status, lines.residuals(batch, x, y)) if batch.want_flags else None,
        trace=_trace(lines, states, rows, status) if batch.want_trace else None,
    )


def _fit(ranged: RangedLines, x: FloatArray, y: FloatArray) -> tuple[FloatArray, IntArray]:
    """Return the chi-square (B,) of all rows, and of the prior where there is one, with its degrees of freedom."""
    smallest = np.full(x.shape, np.finfo(np.float64).tiny)
    ranges = (ranged.measured_m, ranged.range_std_m)
    rows = DirectBearings.of(ranged.lines, smallest, *ranges, lognormal=ranged.lognormal)
    everything = np.ones(rows.weight.shape, dtype=bool)
    if ranged.prior is None:
        chi_square, scalars = least_chi_square(rows, (x, y), everything)
        return chi_square, scalars - _UNKNOWNS
    known = ranged.prior.known
    dx, dy = (np.where(known, part, 0.0) for part in (x - ranged.prior.x, y - ranged.prior.y))
    precision = ranged.prior.information()
    slope = (precision.xx * dx + precision.xy * dy, precision.xy * dx + precision.yy * dy)
    expected = RowDerivatives(0.5 * precision.quadratic_form(dx, dy), slope, precision, precision)
    chi_square, scalars = least_chi_square(rows, (x, y), everything, expected)
    return chi_square, scalars + np.where(known, _UNKNOWNS, 0) - _UNKNOWNS


def _best_run(
    ranged: RangedLines, batch: BearingBatch, options: SequentialOptions
) -> tuple[list[SourceState], list[IntArray]]:
    """Return the states (B, 1) of the likeliest run of each snapshot, and the rows (B,) in the order of their use."""
    if batch.measurements < 2:
        first = second = np.zeros((batch.size, 1), dtype=np.int64)
    else:
        first, second = starting_pairs(
            ranged, batch.seed, options.bootstraps, options.max_pairs, at_random=options.pairs == "random"
        )
    run = run_all_orders(ranged, batch.seed, first, second, want_steps=batch.want_trace)
    last = run.states[-1]
    misfit = ranged.misfit(last.x, last.y)
    return run.pick(np.argmin(np.where(last.alive & np.isfinite(misfit), misfit, np.inf), axis=1))


def _status(batch: BearingBatch, ranged: RangedLines, last: SourceState, min_range_m: float) -> StatusArray:
    lines = ranged.lines
    x, y = last.x[:, 0], last.y[:, 0]
    covariance = last.covariance.at(slice(None), 0)
    rays = lines.ray_residuals(x, y)
    allowed_m2 = None if ranged.prior is None else np.where(ranged.prior.known, np.inf, 0.0)
    status = judge_fixes(lines, (x, y), rays, covariance, min_range_m, allowed_m2=allowed_m2)
    first = fit_least_squares(lines)
    dead, free = ~last.alive[:, 0], ~ranged.from_prior
    status[dead] = Status.BEHIND
    if dead.any():
        crossing = fit_focused(lines, first)
        there = lines.ray_residuals(crossing.x, crossing.y)
        linear = judge_fixes(lines, crossing.point, there, crossing.normal.inverse(), min_range_m)
        status[dead & (linear == Status.DEGENERATE)] = Status.DEGENERATE
    ranged_rows = np.zeros(status.shape, dtype=bool)
    if ranged.measured_m is not None:
        ranged_rows |= np.isfinite(ranged.measured_m).any(axis=1)
    status[free & ~ranged_rows & nearly_singular(first.normal)] = Status.DEGENERATE
    mark_crossings_behind(status, lines, np.where(free, rays.chi_square, 0.0), answered_too=True)
    status[free & (count_scalars(batch, ranged.measured_m) < _UNKNOWNS)] = Status.TOO_FEW
    return status


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
    reads=frozenset({"range_m", "range_std_m", *PRIOR_NAMES}),
)
