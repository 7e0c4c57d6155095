"""The probability of each cell: the integral of the posterior over it, however narrow that is.

A square's mean density is taken from its centre, with the standard deviations of the rows widened by its extent
(`MethodSpec.cost_at`): so a ridge that is narrower than the square is not missed. Each square that has a share of the
probability is cut into quarters. Where their densities and their mean are much the same as that of the square, the sum
of the quarters is its mass; else they are cut in turn.

Where the rows agree nowhere (degrees read as radians, say), every square seems likelier than any point in it, and
millions would be cut. Beyond a limit such a snapshot has only the squares with the likeliest centres cut, size by size:
its cost is smooth over the region, and its posterior far narrower than a cell.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_division, ignoring_invalid

__all__ = ["CellCost", "cell_probabilities", "hpd_shares"]

CellCost = Callable[[IntArray, Point, float], FloatArray]
"""The negative log-posterior (N, P) of N snapshots, given by their indices, at points (N, P), or of cells there."""

_SAME_NATS = 0.03
_SMOOTH_NATS = 2.0
"""A square is smooth if its density and the mean of its quarters differ by at most the first, and the quarters among
themselves by at most the second."""

_NEGLECTED = 1e-3
"""Squares that are not cut have at most this probability together."""

_MOST_CUTS = 16
_MOST_ROUNDS = 100
_MOST_SQUARES = 1 << 15
_KEPT = 1 << 10
_MOST_OF_RIDGE = 1 << 14
"""A snapshot of more rounds, or of so many squares more than four a cell, has so many squares of each size cut, those
of a ridge up to that many."""

_SAME_SUM_NATS = 0.1
"""The quarters of a ridge have the sum of their squares to within this."""

_TOGETHER = 64
"""So many parts of a snapshot's cells are evaluated in a row of a batch."""


@dataclass
class _Leaves:
    """Squares of one size: their snapshots and cells (N,), centres, and logarithms of their masses."""

    snapshot: IntArray
    cell: IntArray
    x: FloatArray
    y: FloatArray
    log_mass: FloatArray

    def take(self, which: BoolArray) -> _Leaves:
        return _Leaves(*(part[which] for part in vars(self).values()))

    def __len__(self) -> int:
        return int(self.snapshot.shape[0])


def cell_probabilities(
    cost: CellCost, size: int, x: FloatArray, y: FloatArray, cell_m: float, share: FloatArray | None = None
) -> FloatArray:
    """Return the probabilities (B, P) of the cells about x, y (P,) for ``size`` snapshots; NaN if none is possible.

    ``share`` (P,) is the share of each cell that counts; None: all of it.
    """
    count = x.shape[0]
    points = tuple(np.broadcast_to(part, (size, count)) for part in (x, y))
    log_share = np.zeros(count)
    if share is not None:
        log_share = np.log(share, out=np.full(count, -np.inf), where=share > 0.0)
    whole = log_share - cost(np.arange(size), points, cell_m)
    snapshot, cell = np.nonzero(whole > -np.inf)
    first = _Leaves(snapshot, cell, x[cell], y[cell], whole[snapshot, cell])
    leaves = _settle(cost, first, size, count, cell_m, log_share)
    total = _log_sums(leaves, size)
    index = leaves.snapshot * count + leaves.cell
    mass = np.exp(leaves.log_mass - total[leaves.snapshot])
    probability = np.asarray(np.bincount(index, mass, minlength=size * count).reshape(size, count), dtype=np.float64)
    probability[~np.isfinite(total)] = np.nan
    return probability


def _settle(cost: CellCost, first: _Leaves, size: int, count: int, cell_m: float, log_share: FloatArray) -> _Leaves:
    """Return squares (of all sizes) whose masses sum to those of the ``count`` cells of ``size`` snapshots."""
    settled: list[_Leaves] = []
    total_settled = np.full(size, -np.inf)
    waiting: dict[int, _Leaves] = {0: first}
    squares, left = np.zeros(size, dtype=np.int64), np.zeros(size, dtype=np.bool_)
    for rounds in itertools.count():
        total = total_settled
        for leaves in waiting.values():
            total = np.logaddexp(total, _log_sums(leaves, size))
        least = total + np.log(_NEGLECTED / count)
        cut: list[tuple[int, _Leaves]] = []
        for cuts, leaves in waiting.items():
            heavy = leaves.log_mass > least[leaves.snapshot]
            if (heavy & ~left[leaves.snapshot]).any():
                cut.append((cuts, leaves.take(heavy & ~left[leaves.snapshot])))
                squares += np.bincount(cut[-1][1].snapshot, minlength=size)
                waiting[cuts] = leaves.take(~heavy)
        if not cut:
            break
        for cuts, leaves in sorted(cut, key=lambda part: part[0]):
            done, quarters = _cut(cost, leaves, cell_m * 0.5**cuts, cuts, log_share)
            settled.append(done)
            total_settled = np.logaddexp(total_settled, _log_sums(done, size))
            if len(quarters):
                known = waiting.get(cuts + 1)
                waiting[cuts + 1] = quarters if known is None else _joined([known, quarters])
        left |= (squares > _MOST_SQUARES + 4 * count) | (rounds >= _MOST_ROUNDS)
    leaves = _joined(settled + list(waiting.values()))
    if not left.any():
        return leaves
    narrow = _narrowed(cost, first.take(left[first.snapshot]), size, cell_m, log_share)
    return _joined([leaves.take(~left[leaves.snapshot]), *narrow])


def _narrowed(cost: CellCost, squares: _Leaves, size: int, cell_m: float, log_share: FloatArray) -> list[_Leaves]:
    """Return the squares about the likeliest points: of each size the few with the likeliest centres are cut.

    Quarters with the sum of their squares are those of a long and narrow ridge: they stay, and too many are not cut.
    """
    settled: list[_Leaves] = []
    for cuts in range(_MOST_CUTS):
        done, quarters = _cut(cost, squares, cell_m * 0.5**cuts, cuts, log_share)
        settled.append(done)
        if not len(quarters):
            break
        sums = np.logaddexp(_log_sums(done, size), _log_sums(quarters, size))
        with ignoring_invalid():
            ridge = np.abs(sums - _log_sums(squares, size)) <= _SAME_SUM_NATS
        long = ridge & (np.bincount(quarters.snapshot, minlength=size) > _MOST_OF_RIDGE)
        settled.append(quarters.take(long[quarters.snapshot]))
        centres = _log_masses(cost, quarters, 0.0, cuts + 1, log_share)
        kept = ridge[quarters.snapshot] | _largest(centres, quarters.snapshot, _KEPT)
        squares = quarters.take(kept & ~long[quarters.snapshot])
        if not len(squares):
            break
    return settled


def _largest(values: FloatArray, snapshot: IntArray, most: int) -> BoolArray:
    """Return which values (N,) are among the ``most`` largest of their snapshots (N,)."""
    order = np.lexsort((-values, snapshot))
    counts = np.bincount(snapshot)
    rank = np.empty(values.shape[0], dtype=np.int64)
    rank[order] = np.arange(values.shape[0]) - np.repeat(np.cumsum(counts) - counts, counts)
    return np.asarray(rank < most)


def _cut(cost: CellCost, leaves: _Leaves, side_m: float, cuts: int, log_share: FloatArray) -> tuple[_Leaves, _Leaves]:
    """Cut squares into quarters; return those that are smooth, with the masses of their quarters, and other quarters.

    Squares that are cut ``_MOST_CUTS`` times count as smooth.
    """
    quarter = 0.25 * side_m
    x = leaves.x[:, None] + quarter * np.array([-1.0, 1.0, -1.0, 1.0])
    y = leaves.y[:, None] + quarter * np.array([-1.0, -1.0, 1.0, 1.0])
    snapshot, cell = np.repeat(leaves.snapshot, 4), np.repeat(leaves.cell, 4)
    quarters = _Leaves(snapshot, cell, x.ravel(), y.ravel(), np.empty(x.size))
    quarters.log_mass = _log_masses(cost, quarters, 0.5 * side_m, cuts + 1, log_share)
    parts = quarters.log_mass.reshape(-1, 4)
    most, fewest = parts.max(axis=1), parts.min(axis=1)
    with ignoring_invalid():
        together = most + np.log(np.exp(parts - most[:, None]).sum(axis=1))
        smooth = (most - fewest <= _SMOOTH_NATS) & (np.abs(together - leaves.log_mass) <= _SAME_NATS)
    smooth |= (cuts + 1 >= _MOST_CUTS) | (most == -np.inf)
    done = leaves.take(smooth)
    done.log_mass = np.where(most == -np.inf, -np.inf, together)[smooth]
    return done, quarters.take(np.repeat(~smooth, 4))


def _log_masses(cost: CellCost, leaves: _Leaves, side_m: float, cuts: int, log_share: FloatArray) -> FloatArray:
    """Return the logarithms (N,) of the masses of squares.

    The squares, in order of their snapshots, are put into rows of equal length, the last of each snapshot repeated.
    """
    counts = np.bincount(leaves.snapshot)
    order = np.argsort(leaves.snapshot, kind="stable")
    rows_of = -(-counts // _TOGETHER)
    row_snapshot = np.repeat(np.arange(counts.shape[0]), rows_of)
    first_row = np.cumsum(rows_of) - rows_of
    within = (np.arange(row_snapshot.shape[0]) - first_row[row_snapshot])[:, None] * _TOGETHER + np.arange(_TOGETHER)
    first = (np.cumsum(counts) - counts)[row_snapshot]
    index = order[first[:, None] + np.minimum(within, counts[row_snapshot][:, None] - 1)]
    log_mass = np.empty(len(leaves))
    log_mass[index] = -cost(row_snapshot, (leaves.x[index], leaves.y[index]), side_m)
    return np.asarray(log_mass + log_share[leaves.cell] - cuts * np.log(4.0))


def _log_sums(leaves: _Leaves, size: int) -> FloatArray:
    """Return the logarithms (B,) of the summed masses of each snapshot, minus infinity without any."""
    top = np.full(size, -np.inf)
    np.maximum.at(top, leaves.snapshot, leaves.log_mass)
    known = np.where(np.isfinite(top), top, 0.0)
    sums = np.bincount(leaves.snapshot, np.exp(leaves.log_mass - known[leaves.snapshot]), minlength=size)
    with ignoring_division():
        return np.asarray(known + np.log(sums))


def _joined(parts: list[_Leaves]) -> _Leaves:
    return _Leaves(*(np.concatenate(arrays) for arrays in zip(*(vars(part).values() for part in parts), strict=True)))


def hpd_shares(probability: FloatArray) -> FloatArray:
    """Return the share of the smallest highest-density region that holds each cell (B, P), itself included.

    Of cells with equal probabilities the first ones are in the smaller regions. NaN for NaN.
    """
    order = np.argsort(-probability, axis=1, kind="stable")
    shares = np.empty_like(probability)
    summed = np.cumsum(np.take_along_axis(probability, order, axis=1), axis=1)
    np.put_along_axis(shares, order, np.minimum(summed, 1.0), axis=1)
    return shares
