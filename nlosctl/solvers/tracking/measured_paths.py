"""Paths under the rows' own likelihoods: Gauss-Newton on the block-tridiagonal system of all tracks.

The cost is that of the motion plus the negative log-likelihood of the rows, each at its own time t_i: at the position
x_k + v_k (t_i - t_k) of its state, with the derivatives [g, (t_i - t_k) g]. Outliers are weighed by their probability
to be direct at the present path (Dempster, Laird, Rubin 1977); steps are accepted by the cost itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point
from nlosctl.solvers.tracking.block_tridiagonal import BlockTridiagonal
from nlosctl.solvers.tracking.fixes import Path, finished_path
from nlosctl.solvers.tracking.motion import Motion
from nlosctl.solvers.tracking.path_rows import FollowedRows, RowTerms
from nlosctl.solvers.tracking.states import state_sums

__all__ = ["FoundPaths", "MeasuredTracks", "Prior", "RowsAtStates", "StateTerms", "find_paths", "moved_terms"]

_SETTLED_NATS = 1e-9
"""A track has settled when a step gains less than this."""

_ROUNDING = 1e-12
_LEAST_DAMPING = 1e-3
_MOST_DAMPING = 1e8
_MOST_STEPS = 200


@dataclass(frozen=True)
class RowsAtStates:
    """A block of rows (B, K), the state (B,) and origin (B, D) of each snapshot, and the times (B, K) after the state.

    Positions of states are about the origins.
    """

    rows: FollowedRows
    state: IntArray
    origin_m: FloatArray
    delay_s: FloatArray

    def take(self, index: IntArray, state: IntArray, delay_s: FloatArray | None = None) -> RowsAtStates:
        """Return the snapshots ``index`` (C,), repeated or not, with other states (C,)."""
        delay_s = self.delay_s[index] if delay_s is None else delay_s
        return RowsAtStates(self.rows.take(index), state, self.origin_m[index], delay_s)

    def compare(self, states: FloatArray, tempering: float = 1.0) -> RowTerms:
        """Return the terms of the rows on the path of ``states`` (N, 2D)."""
        return self.rows.compare(lambda k: self.point(states, k), tempering)

    def point(self, states: FloatArray, k: int) -> Point:
        """Return the points (B,) of row ``k`` about the local origins of the rows."""
        dimension = self.origin_m.shape[1]
        own = states[self.state]
        return tuple(
            own[:, axis] + self.delay_s[:, k] * own[:, dimension + axis] + (self.origin_m[:, axis] - middle)
            for axis, middle in enumerate(self.rows.center)
        )


@dataclass(frozen=True)
class StateTerms:
    """What the rows add to each state: cost (N,), gradient (N, 2D), matrix (N, 2D, 2D)."""

    cost: FloatArray
    gradient: FloatArray
    matrix: FloatArray


@dataclass(frozen=True)
class Prior:
    """What is known of N states by other rows: information (N, 2D, 2D), and its gradient (N, 2D) at states (N, 2D)."""

    information: FloatArray
    gradient: FloatArray
    at: FloatArray

    def take(self, kept: BoolArray) -> Prior:
        """Return some of the states (N,)."""
        return Prior(self.information[kept], self.gradient[kept], self.at[kept])

    def add(self, total: StateTerms, states: FloatArray) -> None:
        """Add the cost, its gradient and matrix at states (N, 2D)."""
        away = states - self.at
        pull = np.einsum("nij,nj->ni", self.information, away)
        total.cost[...] += np.sum(away * (0.5 * pull + self.gradient), axis=1)
        total.gradient[...] += pull + self.gradient
        total.matrix[...] += self.information


@dataclass(frozen=True)
class MeasuredTracks:
    """The rows of all tracks, their motion, and what is known of states before, if anything is."""

    blocks: Sequence[RowsAtStates]
    motion: Motion
    dimension: int
    prior: Prior | None = None

    def only(self, tracks: BoolArray) -> MeasuredTracks:
        """Return some of the tracks (T,)."""
        kept = tracks[self.motion.track]
        if kept.all():
            return self
        number = np.cumsum(kept) - 1
        blocks = []
        for block in self.blocks:
            index = np.flatnonzero(kept[block.state])
            if index.size:
                blocks.append(block.take(index, number[block.state[index]]))
        return MeasuredTracks(blocks, self.motion.take(kept), self.dimension, self.prior and self.prior.take(kept))

    def terms(self, states: FloatArray, tempering: float = 1.0) -> StateTerms:
        """Return what all rows add at the path of ``states`` (N, 2D)."""
        size, whole = states.shape
        total = StateTerms(np.zeros(size), np.zeros((size, whole)), np.zeros((size, whole, whole)))
        for block in self.blocks:
            found = block.compare(states, tempering)
            gradient, matrix = moved_terms(found, block.delay_s, self.dimension)
            total.cost[...] += state_sums(found.cost, block.state, size)
            total.gradient[...] += state_sums(gradient, block.state, size)
            total.matrix[...] += state_sums(matrix, block.state, size)
        if self.prior is not None:
            self.prior.add(total, states)
        alone = self.motion.alone
        if alone.any():  # at rest: the velocity is held, not estimated
            total.gradient[alone, self.dimension :] = 0.0
            total.matrix[alone, self.dimension :, :] = total.matrix[alone, :, self.dimension :] = 0.0
            total.matrix[alone, self.dimension :, self.dimension :] = np.eye(self.dimension)
        return total

    def cost(self, states: FloatArray, terms: StateTerms) -> FloatArray:
        """Return the cost (T,) of each track."""
        per_state = terms.cost + self.motion.cost(states)
        tracks = self.motion.first.shape[0]
        return np.bincount(self.motion.track, weights=per_state, minlength=tracks).astype(np.float64)


def moved_terms(found: RowTerms, delay_s: FloatArray, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Return the gradients (B, 2D) and matrices (B, 2D, 2D) of snapshots by their states."""
    size = found.cost.shape[0]
    gradient, matrix = np.zeros((size, 2 * dimension)), np.zeros((size, 2 * dimension, 2 * dimension))
    shared = _Shared(np.zeros(size), np.zeros(size), np.zeros((size, 2 * dimension)))
    for k, row in enumerate(found.rows):
        weight, delay = found.weight[:, k], delay_s[:, k]
        slopes = [weight * part for part in row.gradient[:dimension]]
        gauss = list((row.gauss * weight).parts)
        if row.outlier is not None:
            slopes = [one + other for one, other in zip(slopes, row.outlier.gradient[:dimension], strict=True)]
            gauss = [one + other for one, other in zip(gauss, row.outlier.gauss, strict=True)]
        for axis, slope in enumerate(slopes):
            gradient[:, axis] += slope
            gradient[:, dimension + axis] += delay * slope
        entries = iter(gauss)
        for one in range(dimension):
            for other in range(one + 1):
                entry = next(entries)
                shifted = delay * entry
                matrix[:, one, other] += entry
                matrix[:, dimension + one, other] += shifted
                matrix[:, dimension + one, dimension + other] += delay * shifted
                if one != other:
                    matrix[:, dimension + other, one] += shifted
        if len(row.gradient) > dimension:
            further = 0.0 if row.outlier is None else row.outlier.gradient[-1]
            shared.add(weight * row.gradient[-1] + further, list(entries), delay)
    lower = np.tril_indices(2 * dimension, -1)
    matrix[:, lower[1], lower[0]] = matrix[:, lower[0], lower[1]]
    return shared.eliminated(gradient, matrix)


@dataclass(frozen=True)
class _Shared:
    """The unknown that the rows of a snapshot have in common: its slope and bend (B,), and its mixed ones (B, 2D)."""

    slope: FloatArray
    bend: FloatArray
    mixed: FloatArray

    def add(self, slope: FloatArray, entries: list[FloatArray], delay: FloatArray) -> None:
        """Add a row; ``entries`` are the mixed second derivatives by the position and, last, the unknown's own."""
        *mixed, bend = entries
        self.slope[...] += slope
        self.bend[...] += bend
        for axis, entry in enumerate(mixed):
            self.mixed[:, axis] += entry
            self.mixed[:, len(mixed) + axis] += delay * entry

    def eliminated(self, gradient: FloatArray, matrix: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return gradient and matrix at the best value of the unknown: Schur's complement."""
        if not self.bend.any():
            return gradient, matrix
        share = self.mixed / np.where(self.bend > 0.0, self.bend, np.inf)[:, None]
        return gradient - share * self.slope[:, None], matrix - share[:, :, None] * self.mixed[:, None, :]


@dataclass(frozen=True)
class FoundPaths:
    """Paths with their status: ``settled`` (T,) marks tracks whose search ended at a minimum."""

    path: Path
    settled: BoolArray


def find_paths(
    tracks: MeasuredTracks, states: FloatArray, tempering: float = 1.0, most: int = _MOST_STEPS
) -> FoundPaths:
    """Return the paths at the minimum near ``states`` (N, 2D), and their covariances, those of the direct rows.

    Tracks that have settled are left out of further steps.
    """
    count, states = tracks.motion.first.shape[0], states.copy()
    settled, damping, rest, part = np.zeros(count, dtype=bool), np.zeros(count), np.arange(count), tracks
    while rest.size and most > 0:
        mine = np.isin(tracks.motion.track, rest)
        found = _search(part, states[mine], damping[rest], tempering, most)
        states[mine], settled[rest], damping[rest] = found.states, found.settled, found.damping
        most -= found.steps
        part, rest = part.only(~found.settled), rest[~found.settled]
    motion, terms = tracks.motion, tracks.terms(states, tempering)
    diagonal, coupling = motion.blocks(tracks.dimension)
    factors = BlockTridiagonal(diagonal + terms.matrix, coupling, motion.within)
    return FoundPaths(finished_path(states, factors, terms.cost + motion.cost(states), terms.matrix, motion), settled)


@dataclass(frozen=True)
class _Searched:
    """The states (N, 2D) after some steps; which tracks (T,) have settled, and their damping (T,)."""

    states: FloatArray
    settled: BoolArray
    damping: FloatArray
    steps: int


def _search(tracks: MeasuredTracks, states: FloatArray, damping: FloatArray, tempering: float, most: int) -> _Searched:
    """Return the states after damped Gauss-Newton steps, until half of the tracks have settled."""
    motion, track = tracks.motion, tracks.motion.track
    diagonal, coupling = motion.blocks(tracks.dimension)
    terms = tracks.terms(states, tempering)
    cost = tracks.cost(states, terms)
    settled = np.zeros(cost.shape, dtype=bool)
    count = 0
    while count < most:
        count += 1
        damped = terms.matrix * (1.0 + damping[track])[:, None, None]
        factors = BlockTridiagonal(diagonal + damped, coupling, motion.within)
        gradient = motion.gradient(states) + terms.gradient
        step = factors.solve(gradient)
        step[settled[track] | factors.singular] = 0.0
        gain = 0.5 * np.bincount(track, np.sum(step * gradient, axis=1), minlength=cost.shape[0])
        settled |= gain <= _SETTLED_NATS + _ROUNDING * np.abs(cost)
        if 2 * np.count_nonzero(settled) >= settled.size:
            break
        trial = states - step
        trial_terms = tracks.terms(trial, tempering)
        trial_cost = tracks.cost(trial, trial_terms)
        better = ~settled & (trial_cost <= cost + _ROUNDING * np.abs(cost))
        worse = ~settled & ~better
        damping[better] = np.where(damping[better] > 10.0 * _LEAST_DAMPING, 0.1 * damping[better], 0.0)
        damping[worse] = np.maximum(10.0 * damping[worse], _LEAST_DAMPING)
        settled |= damping > _MOST_DAMPING
        moved = better[track]
        states = np.where(moved[:, None], trial, states)
        terms = StateTerms(
            np.where(moved, trial_terms.cost, terms.cost),
            np.where(moved[:, None], trial_terms.gradient, terms.gradient),
            np.where(moved[:, None, None], trial_terms.matrix, terms.matrix),
        )
        cost = np.where(better, trial_cost, cost)
    return _Searched(states, settled, damping, count)
