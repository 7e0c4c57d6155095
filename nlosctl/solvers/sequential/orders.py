"""Sequential runs: every row of a snapshot combined, one after the other, in a random order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ScalarT, SeedArray, ignoring_overflow
from nlosctl.contract.random_streams import random_keys
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.bearings.row_terms import squared_tube_ratio
from nlosctl.solvers.sequential.polar_updates import (
    SelectedRays,
    SourceState,
    bootstrap_state,
    ranged_state,
    select_rays,
    update_bearings,
    update_ranges,
)
from nlosctl.solvers.sequential.priors import Prior

__all__ = ["Prior", "RangedLines", "Run", "pair_state", "run_all_orders"]


@dataclass(frozen=True)
class RangedLines(RowBlock):
    """Sight lines with the ranges of their rows (B, K), NaN in rows without one; None where no row has one.

    ``prior`` is None if no snapshot has one.
    """

    lines: SightLines
    measured_m: FloatArray | None
    range_std_m: FloatArray | None
    lognormal: bool
    prior: Prior | None = None

    @property
    def from_prior(self) -> BoolArray:
        """Which snapshots (B,) start from a prior, not from a pair of rows."""
        size = self.lines.center_x.shape
        return np.zeros(size, dtype=bool) if self.prior is None else self.prior.known

    def select(self, row: IntArray) -> SelectedRays:
        """Return the rows of indices ``row`` (B, M) in each snapshot."""
        return select_rays(self.lines, row, self.measured_m, self.range_std_m)

    def half_chi_square(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square (B, M) of all rows at points (B, M) about the local origin; half of (17), negated.

        A lognormal range counts ((ln r / R) / s)^2 with s = std / r; a circle focuses a row's ray tube.
        """
        lines = self.lines
        total = np.zeros(x.shape)
        with ignoring_overflow():
            for k in range(lines.origin_x.shape[1]):
                cosine, sine = lines.cosine[:, k, None], lines.sine[:, k, None]
                dx, dy = x - lines.origin_x[:, k, None], y - lines.origin_y[:, k, None]
                scaled = np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy) / lines.std_rad[:, k, None]
                if lines.focusing is not None:
                    scaled *= np.sqrt(squared_tube_ratio(lines.focusing, k, np.sqrt(dx * dx + dy * dy)))
                total += scaled * scaled
                if self.measured_m is not None and self.range_std_m is not None:
                    measured, std = self.measured_m[:, k, None], self.range_std_m[:, k, None]
                    range_m = np.sqrt(dx * dx + dy * dy)
                    residual = measured * np.log(measured / range_m) if self.lognormal else measured - range_m
                    scaled = residual / std
                    total += np.where(np.isnan(measured), 0.0, scaled * scaled)
        return 0.5 * total

    def misfit(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square (B, M) of all rows and of the prior at points (B, M)."""
        total = self.half_chi_square(x, y)
        return total if self.prior is None else total + self.prior.half_chi_square(x, y)


@dataclass(frozen=True)
class Run:
    """A block of runs: the last states (B, M), and which row (B, M) was used in each of the K steps.

    ``states`` are those after each step if the steps are wanted, else only the last one. The first state of a run
    that starts from a pair is not alive.
    """

    states: list[SourceState]
    rows: list[IntArray]

    def pick(self, best: IntArray) -> tuple[list[SourceState], list[IntArray]]:
        """Return the states (B, 1) and rows (B,) of one run of each snapshot."""
        index = best[:, None]

        def take(array: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
            return np.take_along_axis(array, index, axis=1)

        states = [
            SourceState(take(state.x), take(state.y), state.covariance.map(take), take(state.alive))
            for state in self.states
        ]
        return states, [take(row)[:, 0] for row in self.rows]


def pair_state(first: SelectedRays, second: SelectedRays, *, lognormal: bool) -> SourceState:
    """Return the states from pairs of rows (B, M): bootstrap, then ranges.

    Where the first row of a pair has a range, it starts alone: its end is exact in its own polar frame, as a crossing
    is not.
    """
    pair = update_ranges(bootstrap_state(first, second), second, lognormal=lognormal)
    end = ranged_state(first)
    if end is None:
        return pair
    return update_ranges(update_bearings(end, second), second, lognormal=lognormal).where(end.alive, pair)


def run_all_orders(
    ranged: RangedLines, seed: SeedArray, first: IntArray, second: IntArray, *, want_steps: bool = True
) -> Run:
    """Return the runs that start from pairs ``first``, ``second`` (B, M), or from the prior where there is one.

    The rest of the rows (all, after a prior) follow in random order (Section III-B, steps 1 to 4).
    """
    from_prior = np.broadcast_to(ranged.from_prior[:, None], first.shape)
    order = _orders(seed, first, second, ranged.lines.origin_x.shape[1], from_prior)
    state = _dead(first.shape) if ranged.prior is None else _prior_state(ranged.prior, first.shape)
    states: list[SourceState] = []
    for step, row in enumerate(order):
        rows = ranged.select(row)
        updated = update_ranges(update_bearings(state, rows), rows, lognormal=ranged.lognormal)
        if step == 0:
            state = updated.where(from_prior, ranged_state(rows) or state)
            previous = rows
        elif step == 1 and not from_prior.all():
            state = updated.where(from_prior, pair_state(previous, rows, lognormal=ranged.lognormal))
        else:
            state = updated
        if want_steps:
            states.append(state)
    return Run(states if want_steps else [state], order)


def _orders(seed: SeedArray, first: IntArray, second: IntArray, count: int, from_prior: BoolArray) -> list[IntArray]:
    """Return the row (B, M) of each step: the pair, then the others at random; after a prior all at random."""
    runs = first.shape[1]
    keys = np.stack([random_keys(seed, count, 3 + run) >> np.uint64(2) for run in range(runs)], axis=1)
    keys += np.uint64(2)  # (B, M, K)
    for rank, index in enumerate((first, second)):
        old = np.take_along_axis(keys, index[..., None], axis=2)
        new = np.where(from_prior[..., None], old, np.uint64(rank))
        np.put_along_axis(keys, index[..., None], new, axis=2)
    order = np.argsort(keys, axis=2, kind="stable").astype(np.int64)
    return [np.asfortranarray(order[..., step]) for step in range(count)]


def _dead(shape: tuple[int, ...]) -> SourceState:
    nothing = np.full(shape, np.nan, order="F")
    return SourceState(nothing, nothing, SymmetricMatrix(nothing, nothing, nothing), np.zeros(shape, dtype=bool))


def _prior_state(prior: Prior, shape: tuple[int, ...]) -> SourceState:
    def spread(values: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
        return np.asfortranarray(np.broadcast_to(values[:, None], shape))

    return SourceState(spread(prior.x), spread(prior.y), prior.covariance.map(spread), spread(prior.known))
