"""How the rows of a method enter the likelihood of a path: each row at a position of its own."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.blocks import RowBlock
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.path_groups import PathGroups
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = ["ComparableRows", "FollowedRows", "PathRows", "RowTerms", "mixed_terms", "trusted_terms"]


class ComparableRows(Protocol):
    """Rows (B, K) of measurements that are compared with points (B,)."""

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` and its derivatives."""
        ...

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) that each row measures."""
        ...


@dataclass(frozen=True)
class RowTerms:
    """The cost (B,) of a snapshot's rows in nats, the derivatives of each row, and its weight (B, K).

    The weight is the probability of the row to be direct; 1 where every row is trusted. Derivatives by a further
    unknown, the last, are there where the rows of a snapshot have one in common: its likeliest value is taken.
    ``residuals`` (B, K) are by the names of flags, None where `PathRows.residuals` has them.
    """

    cost: FloatArray
    rows: list[RowDerivatives]
    weight: FloatArray
    residuals: Mapping[str, FloatArray] | None = None


class FollowedRows(Protocol):
    """The rows (B, K) of B snapshots, as a path follows them: see `PathRows`."""

    @property
    def center(self) -> tuple[FloatArray, ...]:
        """The local origin, D arrays (B,)."""
        ...

    @property
    def count(self) -> int:
        """The number of rows of each snapshot, K."""
        ...

    @property
    def mixture(self) -> Mixture | None:
        """The mixture of direct rows and outliers, None where every row is trusted."""
        ...

    @property
    def order(self) -> IntArray | None:
        """The order of the rows (B, K), None: that of the file."""
        ...

    @property
    def residuals(self) -> Callable[..., Mapping[str, FloatArray]] | None:
        """Measured minus predicted values of all rows at one point each, None where the terms have them."""
        ...

    def in_order(self, values: FloatArray) -> FloatArray:
        """Return values (B, K) of the file's rows in the order of these."""
        ...

    def in_file_order(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return values (B, K) of these rows in the order of the file."""
        ...

    def compare(self, point_of: Callable[[int], Point], tempering: float = 1.0) -> RowTerms:
        """Return the terms of the rows, row ``k`` at the points ``point_of(k)`` (B,)."""
        ...

    def take(self, rows: IntArray) -> Self:
        """Return some snapshots, repeated or not."""
        ...


@dataclass(frozen=True)
class PathRows(RowBlock):
    """The rows (B, K) of B snapshots, those of a group together in the order ``order`` (None: of the file).

    Points are about the local origin ``center``, D arrays (B,). ``mixture`` is None where every row is trusted.
    ``residuals(batch_point)`` are measured minus predicted values by the names of flags, of all rows (B, K) at one
    point (B,) each.
    """

    rows: ComparableRows
    center: tuple[FloatArray, ...]
    scalars: IntArray
    mixture: Mixture | None
    order: IntArray | None
    residuals: Callable[..., Mapping[str, FloatArray]] | None = None

    @classmethod
    def trusted(cls, rows: ComparableRows, center: tuple[FloatArray, ...], residuals: Callable[..., Any]) -> PathRows:
        """Return rows that are all direct."""
        return cls(rows, center, rows.scalars(), None, None, residuals)

    @classmethod
    def mixed(
        cls, mixture: Mixture, center: tuple[FloatArray, ...], groups: PathGroups, residuals: Callable[..., Any]
    ) -> PathRows:
        """Return rows of a mixture of direct rows and outliers."""
        return cls(mixture.rows, center, mixture.rows.scalars(), mixture, groups.order, residuals)

    @property
    def count(self) -> int:
        """The number of rows of each snapshot, K."""
        return int(self.scalars.shape[1])

    def in_order(self, values: FloatArray) -> FloatArray:
        """Return values (B, K) of the file's rows in the order of these."""
        return values if self.order is None else np.asfortranarray(np.take_along_axis(values, self.order, axis=1))

    def in_file_order(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Return values (B, K) of these rows in the order of the file."""
        if self.order is None:
            return values
        restored = np.empty_like(values)
        np.put_along_axis(restored, self.order, values, axis=1)
        return restored

    def compare(self, point_of: Callable[[int], Point], tempering: float = 1.0) -> RowTerms:
        """Return the terms of the rows, row ``k`` at the points ``point_of(k)`` (B,).

        With ``tempering`` T all standard deviations are T times as large.
        """
        with ignoring_overflow():
            rows = [self.rows.derivatives(k, *point_of(k)) for k in range(self.count)]
            if self.mixture is None:
                return trusted_terms(rows, tempering)
            return mixed_terms(self.mixture, rows, self.scalars, tempering)


def trusted_terms(rows: list[RowDerivatives], tempering: float = 1.0) -> RowTerms:
    """Return the terms of rows that are all direct, with standard deviations ``tempering`` times as large."""
    rows = rows if tempering == 1.0 else [_tempered(row, tempering) for row in rows]
    cost: FloatArray = np.zeros_like(rows[0].half_chi_square)
    for row in rows:
        cost += row.half_chi_square
    return RowTerms(cost, rows, np.ones((cost.shape[0], len(rows)), order="F"))


def _tempered(row: RowDerivatives, tempering: float) -> RowDerivatives:
    """Return the derivatives with standard deviations ``tempering`` times as large."""
    gain = 1.0 / (tempering * tempering)
    scale = np.full(row.half_chi_square.shape, gain)
    return RowDerivatives(
        row.half_chi_square * gain,
        tuple(part * gain for part in row.gradient),
        row.gauss * scale,
        row.hessian * scale,
        row.outlier,
    )


def mixed_terms(
    mixture: Mixture, rows: list[RowDerivatives], scalars: npt.NDArray[Any], tempering: float = 1.0
) -> RowTerms:
    """Return the terms of a mixture: the groups' sums as in `Mixture.score`, and the probabilities of its rows.

    With ``tempering`` T the standard deviations of direct rows, with so many ``scalars`` (B, K), are T times as large.
    """
    log_direct = mixture.log_direct
    if tempering != 1.0:
        rows = [_tempered(row, tempering) for row in rows]
        log_direct = log_direct - scalars * np.log(tempering)
    direct = np.empty(log_direct.shape, order="F")
    for k, row in enumerate(rows):
        direct[:, k] = np.exp(log_direct[:, k] - row.half_chi_square)
    count, last = mixture.count, mixture.last
    evidence = np.empty_like(direct)
    group, cost = mixture.obstructed, -mixture.log_nlos
    for k in range(count):
        evidence[:, k] = group + direct[:, k]
        closes = np.ones(cost.shape, dtype=bool) if last is None else last[:, k]
        cost -= np.where(closes, np.log(evidence[:, k]), 0.0)
        group = np.where(closes, mixture.obstructed, evidence[:, k])
        outlier = rows[k].outlier
        if outlier is not None:
            cost += outlier.half_chi_square
    if last is not None:
        for k in range(count - 2, -1, -1):
            evidence[:, k] = np.where(last[:, k], evidence[:, k], evidence[:, k + 1])
    return RowTerms(cost, rows, direct / evidence)
