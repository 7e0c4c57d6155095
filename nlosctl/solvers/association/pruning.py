"""Sets of rows that cannot be in a better choice of disjoint sets than a known one: bounds by prices of rows.

With prices of the rows, at least 0, the profit of a set is its weight less the prices of its rows. A choice of disjoint
sets weighs at most the sum of all prices and of all positive profits, the Lagrangian bound; a choice with a set of
negative profit at most that bound less the loss. The prices are moved along the subgradient towards the least bound.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlosctl.arrays import FloatArray, IntArray

__all__ = ["Rivals", "rival_sets"]

_ROUNDS = 120
_EVERY = 4
"""After so many rounds a choice is made greedily by the present profits."""

_PATIENCE = 8
"""After so many rounds without a lower bound the steps are halved."""

_FEW = 6
"""The prices are good enough if no more sets than this are left besides those of the choice."""

_ROUNDING = 1e-10


class Rivals(NamedTuple):
    """A good choice of sets, the heaviest first, and the sets that a heavier choice may consist of."""

    chosen: IntArray
    rivals: IntArray


def rival_sets(rows: IntArray, weight: FloatArray) -> Rivals:
    """Return a choice of the sets of rows (C, N), -1 where a sensor has none, and those that may make a better one.

    Rows are numbered from 0, each that of one sensor; the weights (C,) are positive.
    """
    count = int(rows.max(initial=0)) + 1
    index = np.where(rows >= 0, rows, count)
    chosen = _greedy(rows, weight)
    best, price = float(weight[chosen].sum()), np.zeros(count + 1)
    for number in chosen:
        seen = rows[number][rows[number] >= 0]
        price[seen] = weight[number] / seen.shape[0]
    rivals, least, pace, since = np.arange(weight.shape[0]), np.inf, 1.0, 0
    for number in range(_ROUNDS):
        profit = weight - price[index].sum(axis=1)
        gains = profit > 0.0
        bound = float(price.sum() + profit[gains].sum())
        since += 1
        if bound < least:
            least, since = bound, 0
            rivals = np.flatnonzero(bound + np.minimum(profit, 0.0) > best + _ROUNDING * bound)
        if number % _EVERY == _EVERY - 1:
            other = _greedy(rows, profit)
            total = float(weight[other].sum())
            if total > best:
                chosen, best = other, total
                rivals = np.flatnonzero(bound + np.minimum(profit, 0.0) > best + _ROUNDING * bound)
        if rivals.size <= _FEW:
            break
        if since > _PATIENCE:
            pace, since = 0.5 * pace, 0
        slope = 1.0 - np.bincount(index[gains].ravel(), minlength=count + 1)
        slope[count] = 0.0
        slope[(price <= 0.0) & (slope > 0.0)] = 0.0
        norm = float(slope @ slope)
        if norm == 0.0:
            break
        price = np.maximum(price - pace * (bound - best) / norm * slope, 0.0)
    return Rivals(chosen[np.argsort(-weight[chosen], kind="stable")], rivals)


def _greedy(rows: IntArray, value: FloatArray) -> IntArray:
    """Return sets, those of the largest value first, that share no row with one taken before."""
    order = np.argsort(-value, kind="stable")
    left, taken = rows[order], []
    while order.size:
        taken.append(order[0])
        free = ~((left == left[0]) & (left >= 0)).any(axis=1)
        order, left = order[free], left[free]
    return np.array(taken, dtype=np.int64)
