"""Sequential runs: every row of a snapshot combined, one after the other, in a random order."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ScalarT, SeedArray, ignoring_overflow
from nlosctl.contract.random_streams import random_keys
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.solvers.sequential.polar_updates import (
    SourceState,
    bootstrap_state,
    ranged_state,
    select_rays,
    update_bearings,
    update_ranges,
)

__all__ = ["Prior", "RangedLines", "Run", "run_all_orders"]


@dataclass(frozen=True)
class RangedLines:
    """Sight lines with the ranges of their rows (B, K), NaN in rows without one; None where no row has one."""

    lines: SightLines
    measured_m: FloatArray | None
    range_std_m: FloatArray | None
    lognormal: bool

    def half_chi_square(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square (B, M) of all rows at points (B, M) about the local origin; half of (17), negated.

        A lognormal range counts ((ln r / R) / s)^2 with s = std / r.
        """
        lines = self.lines
        total = np.zeros(x.shape)
        with ignoring_overflow():
            for k in range(lines.origin_x.shape[1]):
                cosine, sine = lines.cosine[:, k, None], lines.sine[:, k, None]
                dx, dy = x - lines.origin_x[:, k, None], y - lines.origin_y[:, k, None]
                scaled = np.arctan2(sine * dx - cosine * dy, cosine * dx + sine * dy) / lines.std_rad[:, k, None]
                total += scaled * scaled
                if self.measured_m is not None and self.range_std_m is not None:
                    measured, std = self.measured_m[:, k, None], self.range_std_m[:, k, None]
                    range_m = np.sqrt(dx * dx + dy * dy)
                    residual = measured * np.log(measured / range_m) if self.lognormal else measured - range_m
                    scaled = residual / std
                    total += np.where(np.isnan(measured), 0.0, scaled * scaled)
        return 0.5 * total


@dataclass(frozen=True)
class Prior:
    """Where the sources (B,) were expected, about the local origin, with one standard deviation in x and y; metres.

    ``known`` marks the snapshots that have a prior.
    """

    x: FloatArray
    y: FloatArray
    std_m: FloatArray
    known: BoolArray


@dataclass(frozen=True)
class Run:
    """A block of runs: the states (B, M) after each of K rows, and which row (B, M) was used in each step.

    The first state of a run that starts from a pair is not alive.
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


def run_all_orders(ranged: RangedLines, seed: SeedArray, first: IntArray, second: IntArray, prior: Prior | None) -> Run:
    """Return the runs that start from pairs ``first``, ``second`` (B, M), or from the prior where there is one.

    The rest of the rows (all, after a prior) follow in random order (Section III-B, steps 1 to 4). Where the first row
    of a pair has a range, it starts alone: its end is exact in its own polar frame, as a crossing is not.
    """
    from_prior = None if prior is None else np.broadcast_to(prior.known[:, None], first.shape)
    order = _orders(seed, first, second, ranged.lines.origin_x.shape[1], from_prior)
    start = _dead(first.shape)
    if prior is not None:
        start = _prior_state(prior, first.shape)
    states: list[SourceState] = []
    state = start
    for step, row in enumerate(order):
        rows = select_rays(ranged.lines, row, ranged.measured_m, ranged.range_std_m)
        updated = update_ranges(update_bearings(state, rows), rows, lognormal=ranged.lognormal)
        if step == 0:
            end = ranged_state(rows) or start
            state = end if from_prior is None else updated.where(from_prior, end)
            previous, alive = rows, state.alive
        elif step == 1:
            pair = bootstrap_state(previous, rows)
            pair = update_ranges(pair, rows, lognormal=ranged.lognormal)
            state = updated.where(alive, pair)
        else:
            state = updated
        states.append(state)
    return Run(states, order)


def _orders(
    seed: SeedArray, first: IntArray, second: IntArray, count: int, from_prior: BoolArray | None
) -> list[IntArray]:
    """Return the row (B, M) of each step: the pair, then the others at random; after a prior all at random."""
    runs = first.shape[1]
    keys = np.stack([random_keys(seed, count, 3 + run) >> np.uint64(2) for run in range(runs)], axis=1)
    keys += np.uint64(2)  # (B, M, K)
    if from_prior is None or not from_prior.all():
        paired = np.ones(first.shape, dtype=bool) if from_prior is None else ~from_prior
        for rank, index in enumerate((first, second)):
            old = np.take_along_axis(keys, index[..., None], axis=2)
            new = np.where(paired[..., None], np.uint64(rank), old)
            np.put_along_axis(keys, index[..., None], new, axis=2)
    order = np.argsort(keys, axis=2, kind="stable").astype(np.int64)
    return [np.asfortranarray(order[..., step]) for step in range(count)]


def _dead(shape: tuple[int, ...]) -> SourceState:
    nothing = np.full(shape, np.nan, order="F")
    return SourceState(nothing, nothing, SymmetricMatrix(nothing, nothing, nothing), np.zeros(shape, dtype=bool))


def _prior_state(prior: Prior, shape: tuple[int, ...]) -> SourceState:
    def spread(values: FloatArray) -> FloatArray:
        return np.asfortranarray(np.broadcast_to(values[:, None], shape))

    variance = spread(prior.std_m * prior.std_m)
    return SourceState(
        spread(prior.x),
        spread(prior.y),
        SymmetricMatrix(variance, np.zeros(shape, order="F"), variance),
        np.broadcast_to(prior.known[:, None], shape).copy(),
    )
