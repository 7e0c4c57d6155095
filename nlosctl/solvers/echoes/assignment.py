"""The heaviest set of candidates without a shared echo, by exact branch and bound."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["choose_disjoint"]


@dataclass
class _Search:
    """Candidates by falling weight, as bits: bit 0 is the heaviest.

    ``rivals[i]`` are the bits of those that share an echo with i (and i), ``groups`` for each sensor the bits of
    the candidates that take the same echo there, each in one group.
    """

    weight: list[float]
    rivals: list[int]
    groups: list[list[int]]
    nodes_left: int
    best_weight: float = 0.0
    best: int = 0

    def run(self, open_bits: int, chosen: int, weight: float) -> None:
        """Search all choices of open candidates that extend ``chosen``."""
        while open_bits:
            if self.nodes_left == 0 or weight + self.bound(open_bits) <= self.best_weight:
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


def choose_disjoint(echo: IntArray, weight: FloatArray, max_nodes: int) -> IntArray | None:
    """Return the indices of the candidates (C,) of largest total weight that share no echo, heaviest first.

    ``echo`` (C, N) is the echo of each sensor that a candidate takes, -1 for none; candidates whose weight is not
    positive are never chosen. None if the search is not complete after ``max_nodes`` nodes.
    """
    order = np.argsort(-weight, kind="stable")
    order = order[weight[order] > 0.0]
    if not order.size:
        return order
    echo, weight = echo[order], weight[order]
    shared = ((echo[:, None, :] == echo[None, :, :]) & (echo[:, None, :] >= 0)).any(axis=2)
    np.fill_diagonal(shared, True)
    rivals = [_bits(row) for row in shared]
    chosen = 0
    left = (1 << order.shape[0]) - 1
    nodes_left = max_nodes
    while left:
        cluster = _reach(left & -left, rivals)
        search = _Search(weight.tolist(), rivals, _groups(echo, cluster), nodes_left)
        search.run(cluster, 0, 0.0)
        nodes_left = search.nodes_left
        if nodes_left == 0:
            return None
        chosen |= search.best
        left &= ~cluster
    indices = [index for index in range(order.shape[0]) if chosen >> index & 1]
    return order[indices]


def _bits(members: BoolArray) -> int:
    return sum(1 << int(index) for index in np.flatnonzero(members))


def _reach(start: int, rivals: list[int]) -> int:
    """Return all candidates linked with ``start`` through shared echoes: they are chosen apart from the rest."""
    reached, fresh = start, start
    while fresh:
        index = (fresh & -fresh).bit_length() - 1
        fresh = (fresh | (rivals[index] & ~reached)) & ~(1 << index)
        reached |= rivals[index]
    return reached


def _groups(echo: IntArray, cluster: int) -> list[list[int]]:
    members = [index for index in range(echo.shape[0]) if cluster >> index & 1]
    groups = []
    for column in echo.T:
        by_echo: dict[int, int] = {}
        for index in members:
            key = int(column[index]) if column[index] >= 0 else -1 - index
            by_echo[key] = by_echo.get(key, 0) | (1 << index)
        groups.append(list(by_echo.values()))
    return groups
