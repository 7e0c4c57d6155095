"""The mixture likelihood: each row follows its model or is an outlier; of a group of rows at most one follows it.

With one row to a group this is equation (23) of Ananthasubramaniam and Madhow; with several, the direct one is
summed out: ``sum_l w_l p_l prod_{m != l} u_m + w_0 prod u_m``, w_0 the probability that none is direct.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.contract.step_progress import note_step
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import TargetHeight
from nlosctl.solvers.mixture.mixture_rows import MixtureRows, OutlierRows
from nlosctl.solvers.optimization.problem import Evaluation, RowDerivatives

__all__ = ["FACTORS", "Mixture", "MixtureRows", "OutlierRows"]


FACTORS = 8
"""Number of factors of the likelihood multiplied before a logarithm is taken, without overflow or underflow."""


@dataclass(frozen=True)
class Mixture(RowBlock):
    """The mixtures of B snapshots; rows are in an order in which groups are together.

    ``log_direct`` (B, K) is the logarithm of w_l p_l / u_l at zero chi-square, minus infinity for a row that can't be
    direct; ``obstructed`` (B,) is w_0; ``last`` (B, K) marks the last row of each group, None if every row is alone;
    ``log_nlos`` (B,) is the sum of log u; ``least_cost`` (B,) is the cost if every row had zero chi-square.
    ``height`` is a measured height of the source, always right.
    ``outliers`` is None where u is the same everywhere; else ``rows`` give the negative logarithm of p / u as their
    chi-square.
    """

    rows: MixtureRows
    log_direct: FloatArray
    obstructed: FloatArray
    last: BoolArray | None
    log_nlos: FloatArray
    least_cost: FloatArray
    outliers: OutlierRows | None = None
    height: TargetHeight | None = None

    @classmethod
    def of(
        cls,
        rows: MixtureRows,
        log_direct: FloatArray,
        obstructed: FloatArray,
        last: BoolArray | None,
        log_nlos: FloatArray,
        outliers: OutlierRows | None = None,
        height: TargetHeight | None = None,
    ) -> Mixture:
        """Return the mixtures with their least cost computed."""
        total = log_nlos.copy()
        group = obstructed
        for k in range(log_direct.shape[1]):
            evidence = np.exp(log_direct[:, k]) + group
            closes = True if last is None else last[:, k]
            total += np.where(closes, np.log(evidence), 0.0)
            group = np.where(closes, obstructed, evidence)
        return cls(rows, log_direct, obstructed, last, log_nlos, -total, outliers, height)

    @property
    def dimension(self) -> int:
        """The number of coordinates of a point, D."""
        return self.rows.dimension

    @property
    def count(self) -> int:
        """The number of rows, K."""
        return int(self.log_direct.shape[1])

    def take_rows(self, rows: IntArray) -> Mixture:
        """Return the mixtures of some snapshots, in rising order, each named once: all of them are this itself."""
        return self if rows.shape[0] == self.obstructed.shape[0] else self.take(rows)

    @property
    def groups(self) -> IntArray | int:
        """The number of groups, of each snapshot where it differs."""
        return self.count if self.last is None else np.count_nonzero(self.last, axis=1)

    def score(self, *point: FloatArray, terms: list[FloatArray] | None = None) -> FloatArray:
        """Return the cost (B, P) of points (B, P): the negative log-likelihood in nats, within a few per cent.

        The terms of the rows, w_l p_l / u_l (B, P), are appended to ``terms``.
        """
        logarithm = np.zeros_like(point[0])
        product = np.ones_like(point[0])
        obstructed = self.obstructed[:, None]
        group = obstructed
        ratios = None if self.outliers is None else self.outliers.scores(*point)
        for k in range(self.count):
            note_step(k, self.count)
            direct = self.rows.half_chi_square(k, *point) if ratios is None else ratios[0][k]
            np.subtract(self.log_direct[:, k, None], direct, out=direct)
            np.exp(direct, out=direct)
            if terms is not None:
                terms.append(direct.copy())
            direct += group
            if self.last is None:
                product *= direct
            else:
                closes = self.last[:, k, None]
                product *= np.where(closes, direct, 1.0)
                group = np.where(closes, obstructed, direct)
            if k % FACTORS == FACTORS - 1 or k == self.count - 1:
                logarithm += np.log(product)
                product[...] = 1.0
        np.negative(logarithm, out=logarithm)
        logarithm -= self.log_nlos[:, None]
        if ratios is not None:
            logarithm += ratios[1]
        if self.height is not None:
            scaled = self.height.scaled_residual(*point[:3])
            logarithm += 0.5 * scaled * scaled
        return logarithm

    def evaluate(self, *point: FloatArray) -> Evaluation:
        """Return the cost above ``least_cost``, its gradient and second derivatives at points (B,).

        Where the exact second derivatives are not positive definite, the EM algorithm's matrix replaces them.
        """
        total = _Totals.zero(*point)
        group = _Group.empty(self.obstructed, *point)
        with ignoring_overflow():
            for k in range(self.count):
                row = self.rows.derivatives(k, *point)
                direct = np.exp(self.log_direct[:, k] - row.half_chi_square)
                if self.last is None:
                    total.add_single(direct, direct + self.obstructed, row)
                else:
                    group.add(direct, row)
                    total.add_group(group, self.last[:, k])
                    group.clear(self.last[:, k], self.obstructed)
                if row.outlier is not None:
                    total.add_factor(row.outlier)
            if self.height is not None:
                total.add_factor(self.height_terms(*point))
        cost = -total.logarithm - self.log_nlos - self.least_cost
        return Evaluation.of_newton(cost, total.gradient, total.exact, total.gauss)

    def derivatives(self, *point: FloatArray) -> list[RowDerivatives]:
        """Return half the chi-square of each row at points (B,), and its derivatives."""
        with ignoring_overflow():
            return [self.rows.derivatives(k, *point) for k in range(self.count)]

    def responsibilities(
        self, *point: FloatArray, rows: list[RowDerivatives] | None = None
    ) -> tuple[FloatArray, SymmetricMatrix]:
        """Return each row's probability (B, K) to be direct at points (B,), and the information they carry.

        The information (B,) is the sum of the rows' Gauss-Newton matrices, each times its probability, and of those
        of outliers. ``rows`` are the `derivatives` at the points, if already computed.
        """
        count = self.count
        direct = np.empty((point[0].shape[0], count), order="F")
        rows = self.derivatives(*point) if rows is None else rows
        with ignoring_overflow():
            for k in range(count):
                np.exp(self.log_direct[:, k] - rows[k].half_chi_square, out=direct[:, k])
            evidence = self._evidence(direct)
            direct /= evidence
            information = SymmetricMatrix.full(point[0].shape, 0.0, len(point))
            for k, row in enumerate(rows):
                information.add_scaled(row.gauss, direct[:, k])
                if row.outlier is not None:
                    information += row.outlier.gauss
            if self.height is not None:
                information += self.height_terms(*point).gauss
        return direct, information

    def height_terms(self, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of the measured height at points (B,) in space, and its derivatives."""
        assert self.height is not None  # noqa: S101 - asked for where a height is measured
        scaled, slopes = self.height.scaled_residual(*point[:3]), self.height.scaled_slopes(*point[:3])
        slopes = (*slopes, *(np.zeros(scaled.shape) for _ in point[3:]))
        gauss = SymmetricMatrix.outer(*slopes)
        return RowDerivatives(0.5 * scaled * scaled, tuple(scaled * slope for slope in slopes), gauss, gauss)

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
    """Sums over the groups so far."""

    logarithm: FloatArray
    gradient: tuple[FloatArray, ...]
    exact: SymmetricMatrix
    gauss: SymmetricMatrix

    @classmethod
    def zero(cls, *point: FloatArray) -> _Totals:
        size, dimension = point[0].shape[0], len(point)
        gradient = tuple(np.zeros(size) for _ in point)
        exact, gauss = (SymmetricMatrix.full(size, 0.0, dimension) for _ in range(2))
        return cls(np.zeros(size), gradient, exact, gauss)

    def add_single(self, direct: FloatArray, evidence: FloatArray, row: RowDerivatives) -> None:
        """Add a group of one row, ``evidence`` = direct + w_0."""
        share = direct / evidence
        self.logarithm += np.log(evidence)
        moved = [share * slope for slope in row.gradient]
        for total, part in zip(self.gradient, moved, strict=True):
            total += part
        for part in moved:
            part *= 1.0 - share
        _add_curvature(self.exact, share, moved, row)
        self.gauss.add_scaled(row.gauss, share)

    def add_factor(self, outlier: RowDerivatives) -> None:
        """Add a factor of every term of a group: the density of a row as an outlier, that of a measured height."""
        self.logarithm -= outlier.half_chi_square
        for total, part in zip(self.gradient, outlier.gradient, strict=True):
            total += part
        self.exact += outlier.hessian
        self.gauss += outlier.gauss

    def add_group(self, group: _Group, closes: BoolArray) -> None:
        """Add a group that is complete where ``closes`` (B,)."""
        scale = np.where(closes, 1.0 / group.evidence, 0.0)
        self.logarithm += np.where(closes, np.log(group.evidence), 0.0)
        moved = [part * scale for part in group.gradient]
        for total, part in zip(self.gradient, moved, strict=True):
            total += part
        self.exact += group.curvature * scale + SymmetricMatrix.outer(*moved)
        self.gauss.add_scaled(group.gauss, scale)


@dataclass
class _Group:
    """The sums over the rows of the group that is open in each snapshot."""

    evidence: FloatArray
    gradient: tuple[FloatArray, ...]
    curvature: SymmetricMatrix
    gauss: SymmetricMatrix

    @classmethod
    def empty(cls, obstructed: FloatArray, *point: FloatArray) -> _Group:
        sums = _Totals.zero(*point)
        return cls(obstructed.copy(), sums.gradient, sums.exact, sums.gauss)

    def add(self, direct: FloatArray, row: RowDerivatives) -> None:
        self.evidence += direct
        moved = [direct * slope for slope in row.gradient]
        for total, part in zip(self.gradient, moved, strict=True):
            total += part
        _add_curvature(self.curvature, direct, moved, row)
        self.gauss.add_scaled(row.gauss, direct)

    def clear(self, closes: BoolArray, obstructed: FloatArray) -> None:
        self.evidence = np.where(closes, obstructed, self.evidence)
        for sums in (self.gradient, self.curvature, self.gauss):
            for total in sums:
                total[closes] = 0.0


def _add_curvature(total: SymmetricMatrix, share: FloatArray, moved: list[FloatArray], row: RowDerivatives) -> None:
    """Add ``share`` times the second derivatives of a row, minus ``moved`` times its gradient, to the total."""
    entries = zip(total, row.hessian, strict=True)
    for i, slope in enumerate(row.gradient):
        for left in moved[: i + 1]:
            entry, second = next(entries)
            entry += share * second - left * slope
