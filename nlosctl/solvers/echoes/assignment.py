"""The heaviest set of candidates without a shared echo: components of conflicts, each searched exactly.

A small component is searched by branch and bound, a large one is an integer programme (set packing): one variable per
candidate, one constraint per echo. Memory grows with the number of candidates, not with its square.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.sparse import csr_array

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Choice", "choose_disjoint"]

_MOST_SEARCHED = 256
"""Candidates of a component up to which branch and bound is faster than the integer programme."""

_NODES_PER_PROGRAMME_NODE = 100
"""Nodes of branch and bound that take about as long as one of the integer programme, which solves a linear one."""


class Choice(NamedTuple):
    """Indices of the chosen candidates, heaviest first, and whether no other choice is proven to be heavier."""

    indices: IntArray
    proven: bool


@dataclass
class _Search:
    """Candidates by falling weight, as bits: bit 0 is the heaviest.

    ``rivals[i]`` are the bits of those that share an echo with i (and i), ``groups`` for each sensor the bits of
    the candidates that take the same echo there, each in one group. The search starts from ``best``.
    """

    weight: list[float]
    rivals: list[int]
    groups: list[list[int]]
    nodes_left: int
    best_weight: float
    best: int
    complete: bool = True

    def run(self, open_bits: int, chosen: int, weight: float) -> None:
        """Search all choices of open candidates that extend ``chosen``."""
        while open_bits:
            if weight + self.bound(open_bits) <= self.best_weight:
                return
            if self.nodes_left == 0:
                self.complete = False
                return
            self.nodes_left -= 1
            heaviest = (open_bits & -open_bits).bit_length() - 1
            taken, total = chosen | (1 << heaviest), weight + self.weight[heaviest]
            if total > self.best_weight:
                self.best_weight, self.best = total, taken
            self.run(open_bits & ~self.rivals[heaviest], taken, total)
            open_bits &= ~(1 << heaviest)

    def bound(self, open_bits: int) -> float:
        """Return the least, over the sensors, of the sum of the heaviest open candidate of each echo."""
        return min(
            sum(self.weight[(bits & -bits).bit_length() - 1] for group in groups if (bits := group & open_bits))
            for groups in self.groups
        )


def choose_disjoint(echo: IntArray, weight: FloatArray, max_nodes: int) -> Choice:
    """Return the candidates (C,) of largest total weight that share no echo.

    ``echo`` (C, N) is the echo of each sensor that a candidate takes, -1 for none; candidates whose weight is not
    positive are never chosen. A component whose search exceeds ``max_nodes`` nodes has the best choice found so far,
    at least the greedy one, and is not proven.
    """
    order = np.argsort(-weight, kind="stable")
    order = order[weight[order] > 0.0]
    if not order.size:
        return Choice(order, True)
    echo, weight = echo[order], weight[order]
    chosen, proven = [], True
    for members in _components(echo):
        solve = _search if members.shape[0] <= _MOST_SEARCHED else _programme
        choice = solve(echo[members], weight[members], max_nodes)
        chosen.append(members[choice.indices])
        proven &= choice.proven
    return Choice(order[np.sort(np.concatenate(chosen))], proven)


def _components(echo: IntArray) -> list[IntArray]:
    """Return the candidates (C, N) linked through shared echoes, each component in rising order."""
    candidate, sensor = np.nonzero(echo >= 0)
    column = sensor * (int(echo.max(initial=0)) + 1) + echo[candidate, sensor]
    label = np.arange(echo.shape[0])
    while True:
        least = np.full(int(column.max(initial=0)) + 1, echo.shape[0])
        np.minimum.at(least, column, label[candidate])
        lower = label.copy()
        np.minimum.at(lower, candidate, least[column])
        lower = lower[lower]
        if (lower == label).all():
            break
        label = lower
    order = np.argsort(label, kind="stable")
    parts: list[IntArray] = np.split(order, np.flatnonzero(np.diff(label[order])) + 1)
    return parts


def _incidence(echo: IntArray) -> Any:
    """Return which echoes (U,) of any sensor candidates (C,) take, as a sparse matrix."""
    most = int(echo.max(initial=0)) + 1
    candidate, sensor = np.nonzero(echo >= 0)
    column = sensor * most + echo[candidate, sensor]
    shape: Any = (echo.shape[0], echo.shape[1] * most)
    entries: Any = (np.ones(candidate.shape[0]), (candidate, column))
    return csr_array(entries, shape=shape)


def _search(echo: IntArray, weight: FloatArray, max_nodes: int) -> Choice:
    """Return the heaviest choice of a small component by branch and bound."""
    shared = ((echo[:, None, :] == echo[None, :, :]) & (echo[:, None, :] >= 0)).any(axis=2)
    np.fill_diagonal(shared, True)
    rivals = [_bits(row) for row in shared]
    greedy = _greedy(echo)
    first = sum(1 << int(index) for index in greedy)
    search = _Search(weight.tolist(), rivals, _groups(echo), max_nodes, sum(weight[greedy].tolist()), first)
    search.run((1 << weight.shape[0]) - 1, 0, 0.0)
    indices = [index for index in range(weight.shape[0]) if search.best >> index & 1]
    return Choice(np.array(indices, dtype=np.int64), search.complete)


def _programme(echo: IntArray, weight: FloatArray, max_nodes: int) -> Choice:
    """Return the heaviest choice of a large component by an integer programme."""
    from scipy.optimize import Bounds, LinearConstraint, milp

    limits: Any = {"node_limit": max(1, max_nodes // _NODES_PER_PROGRAMME_NODE), "mip_rel_gap": 0.0}
    once = LinearConstraint(_incidence(echo).T.tocsr(), ub=1.0)
    whole = np.ones(weight.shape[0], dtype=np.int64)
    result = milp(-weight, integrality=whole, bounds=Bounds(0.0, 1.0), constraints=once, options=limits)
    greedy = _greedy(echo)
    found = greedy if result.x is None else np.flatnonzero(result.x > 0.5)
    better = found if weight[found].sum() >= weight[greedy].sum() else greedy
    return Choice(better, result.status == 0)


def _greedy(echo: IntArray) -> IntArray:
    """Return the candidates (C, N), heaviest first, that share no echo with one taken before."""
    free = np.ones((echo.shape[1], int(echo.max(initial=0)) + 1), dtype=bool)
    sensors = np.arange(echo.shape[1])
    taken = []
    for index, row in enumerate(echo):
        seen = row >= 0
        if free[sensors[seen], row[seen]].all():
            free[sensors[seen], row[seen]] = False
            taken.append(index)
    return np.array(taken, dtype=np.int64)


def _bits(members: BoolArray) -> int:
    return sum(1 << int(index) for index in np.flatnonzero(members))


def _groups(echo: IntArray) -> list[list[int]]:
    groups = []
    for column in echo.T:
        by_echo: dict[int, int] = {}
        for index, taken in enumerate(column.tolist()):
            key = taken if taken >= 0 else -1 - index
            by_echo[key] = by_echo.get(key, 0) | (1 << index)
        groups.append(list(by_echo.values()))
    return groups
