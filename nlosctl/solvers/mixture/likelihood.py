"""The mixture likelihood: each row follows its model or is an outlier; of a group of rows at most one follows it.

With one row to a group this is equation (23) of Ananthasubramaniam and Madhow; with several, the direct one is
summed out: ``sum_l w_l p_l prod_{m != l} u_m + w_0 prod u_m``, w_0 the probability that none is direct.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.blocks import gather_rows
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.solvers.optimization.problem import Evaluation, RowDerivatives

__all__ = [
    "Mixture",
    "MixtureRows",
]


_FACTORS = 8
"""So many factors of the likelihood are multiplied before a logarithm is taken: no over- or underflow."""


class MixtureRows(Protocol):
    """Rows (B, K) of measurements whose model is compared with points about each snapshot's local origin."""

    def misfit(self, k: int, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P), within a per cent; infinite where impossible."""
        ...

    def derivatives(self, k: int, x: FloatArray, y: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,), exact, and its derivatives."""
        ...

    def take(self, rows: IntArray) -> MixtureRows:
        """Return the rows of some snapshots; a snapshot may be named several times."""
        ...


@dataclass(frozen=True)
class Mixture:
    """The mixtures of B snapshots; rows are in an order in which groups are together.

    ``log_direct`` (B, K) is the logarithm of w_l p_l / u_l where the misfit is nought, minus infinity for a row that
    can't be direct; ``obstructed`` (B,) is w_0; ``last`` (B, K) marks the last row of each group, None where every
    row is alone; ``log_nlos`` (B,) is the sum of log u; ``least_cost`` (B,) is the cost if every misfit were nought.
    """

    rows: MixtureRows
    log_direct: FloatArray
    obstructed: FloatArray
    last: BoolArray | None
    log_nlos: FloatArray
    least_cost: FloatArray

    @classmethod
    def of(
        cls,
        rows: MixtureRows,
        log_direct: FloatArray,
        obstructed: FloatArray,
        last: BoolArray | None,
        log_nlos: FloatArray,
    ) -> Mixture:
        """Return the mixtures, their least cost worked out."""
        total = log_nlos.copy()
        group = obstructed
        for k in range(log_direct.shape[1]):
            evidence = np.exp(log_direct[:, k]) + group
            closes = True if last is None else last[:, k]
            total += np.where(closes, np.log(evidence), 0.0)
            group = np.where(closes, obstructed, evidence)
        return cls(rows, log_direct, obstructed, last, log_nlos, -total)

    @property
    def count(self) -> int:
        """The number of rows, K."""
        return int(self.log_direct.shape[1])

    def take(self, rows: IntArray) -> Mixture:
        """Return the mixtures of some snapshots; a snapshot may be named several times."""
        return Mixture(
            self.rows.take(rows),
            gather_rows(self.log_direct, rows),
            self.obstructed[rows],
            None if self.last is None else gather_rows(self.last, rows),
            self.log_nlos[rows],
            self.least_cost[rows],
        )

    def take_rows(self, rows: IntArray) -> Mixture:
        """Return the mixtures of some snapshots, in rising order, each named once: all of them are this itself."""
        return self if rows.shape[0] == self.obstructed.shape[0] else self.take(rows)

    def score(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cost (B, P) of points (B, P): the negative log-likelihood in nats, within a few per cent."""
        logarithm = np.zeros_like(x)
        product = np.ones_like(x)
        obstructed = self.obstructed[:, None]
        group = obstructed
        for k in range(self.count):
            direct = self.rows.misfit(k, x, y)
            np.subtract(self.log_direct[:, k, None], direct, out=direct)
            np.exp(direct, out=direct)
            direct += group
            if self.last is None:
                product *= direct
            else:
                closes = self.last[:, k, None]
                product *= np.where(closes, direct, 1.0)
                group = np.where(closes, obstructed, direct)
            if k % _FACTORS == _FACTORS - 1 or k == self.count - 1:
                logarithm += np.log(product)
                product[...] = 1.0
        np.negative(logarithm, out=logarithm)
        logarithm -= self.log_nlos[:, None]
        return logarithm

    def evaluate(self, x: FloatArray, y: FloatArray) -> Evaluation:
        """Return the cost above ``least_cost``, its gradient and second derivatives at points (B,).

        Where the exact second derivatives are not positive definite, the EM algorithm's matrix stands in for them.
        """
        total = _Totals.zero(x.shape[0])
        group = _Group.empty(x.shape[0], self.obstructed)
        with ignoring_overflow():
            for k in range(self.count):
                row = self.rows.derivatives(k, x, y)
                direct = np.exp(self.log_direct[:, k] - row.misfit)
                if self.last is None:
                    total.add_single(direct, direct + self.obstructed, row)
                else:
                    group.add(direct, row)
                    total.add_group(group, self.last[:, k])
                    group.clear(self.last[:, k], self.obstructed)
        exact = Symmetric2x2(total.exact[0], total.exact[1], total.exact[2])
        gauss = Symmetric2x2(total.gauss[0], total.gauss[1], total.gauss[2])
        cost = -total.logarithm - self.log_nlos - self.least_cost
        return Evaluation.of_newton(cost, total.gradient[0], total.gradient[1], exact, gauss)

    def responsibilities(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, Symmetric2x2]:
        """Return each row's probability (B, K) to be direct at points (B,), and the information they carry.

        The information (B,) is the sum of the rows' Gauss-Newton matrices, each times its probability.
        """
        count = self.count
        direct = np.empty((x.shape[0], count), order="F")
        rows: list[RowDerivatives] = []
        with ignoring_overflow():
            for k in range(count):
                rows.append(self.rows.derivatives(k, x, y))
                np.exp(self.log_direct[:, k] - rows[k].misfit, out=direct[:, k])
            evidence = self._evidence(direct)
            direct /= evidence
            xx, xy, yy = np.zeros(x.shape), np.zeros(x.shape), np.zeros(x.shape)
            for k, row in enumerate(rows):
                xx += direct[:, k] * row.gauss.xx
                xy += direct[:, k] * row.gauss.xy
                yy += direct[:, k] * row.gauss.yy
        return direct, Symmetric2x2(xx, xy, yy)

    def _evidence(self, direct: FloatArray) -> FloatArray:
        """Return for each row (B, K) the sum over its group, w_0 included."""
        evidence = np.empty_like(direct)
        group = self.obstructed
        for k in range(self.count):
            evidence[:, k] = group + direct[:, k]
            group = self.obstructed if self.last is None else np.where(self.last[:, k], self.obstructed, evidence[:, k])
        if self.last is not None:
            for k in range(self.count - 2, -1, -1):
                evidence[:, k] = np.where(self.last[:, k], evidence[:, k], evidence[:, k + 1])
        return evidence


@dataclass
class _Totals:
    """What the groups have added so far."""

    logarithm: FloatArray
    gradient: list[FloatArray]
    exact: list[FloatArray]
    gauss: list[FloatArray]

    @classmethod
    def zero(cls, size: int) -> _Totals:
        return cls(np.zeros(size), *([np.zeros(size) for _ in range(number)] for number in (2, 3, 3)))

    def add_single(self, direct: FloatArray, evidence: FloatArray, row: RowDerivatives) -> None:
        """Add a group of one row, ``evidence`` = direct + w_0."""
        share = direct / evidence
        self.logarithm += np.log(evidence)
        moved_x, moved_y = share * row.gradient_x, share * row.gradient_y
        self.gradient[0] += moved_x
        self.gradient[1] += moved_y
        moved_x *= 1.0 - share
        moved_y *= 1.0 - share
        self.exact[0] += share * row.hessian.xx - moved_x * row.gradient_x
        self.exact[1] += share * row.hessian.xy - moved_x * row.gradient_y
        self.exact[2] += share * row.hessian.yy - moved_y * row.gradient_y
        self.gauss[0] += share * row.gauss.xx
        self.gauss[1] += share * row.gauss.xy
        self.gauss[2] += share * row.gauss.yy

    def add_group(self, group: _Group, closes: BoolArray) -> None:
        """Add a group that is complete where ``closes`` (B,)."""
        scale = np.where(closes, 1.0 / group.evidence, 0.0)
        self.logarithm += np.where(closes, np.log(group.evidence), 0.0)
        x, y = group.gradient[0] * scale, group.gradient[1] * scale
        self.gradient[0] += x
        self.gradient[1] += y
        self.exact[0] += group.curvature[0] * scale + x * x
        self.exact[1] += group.curvature[1] * scale + x * y
        self.exact[2] += group.curvature[2] * scale + y * y
        for part in range(3):
            self.gauss[part] += group.gauss[part] * scale


@dataclass
class _Group:
    """The sums over the rows of the group that is open in each snapshot."""

    evidence: FloatArray
    gradient: list[FloatArray]
    curvature: list[FloatArray]
    gauss: list[FloatArray]

    @classmethod
    def empty(cls, size: int, obstructed: FloatArray) -> _Group:
        return cls(obstructed.copy(), *([np.zeros(size) for _ in range(number)] for number in (2, 3, 3)))

    def add(self, direct: FloatArray, row: RowDerivatives) -> None:
        self.evidence += direct
        moved_x, moved_y = direct * row.gradient_x, direct * row.gradient_y
        self.gradient[0] += moved_x
        self.gradient[1] += moved_y
        self.curvature[0] += direct * row.hessian.xx - moved_x * row.gradient_x
        self.curvature[1] += direct * row.hessian.xy - moved_x * row.gradient_y
        self.curvature[2] += direct * row.hessian.yy - moved_y * row.gradient_y
        self.gauss[0] += direct * row.gauss.xx
        self.gauss[1] += direct * row.gauss.xy
        self.gauss[2] += direct * row.gauss.yy

    def clear(self, closes: BoolArray, obstructed: FloatArray) -> None:
        self.evidence = np.where(closes, obstructed, self.evidence)
        for sums in (self.gradient, self.curvature, self.gauss):
            for total in sums:
                total[closes] = 0.0
