"""What a mixture asks of the rows of measurements."""

from __future__ import annotations

from typing import Protocol

from nlosctl.arrays import FloatArray, IntArray, Point
from nlosctl.geometry.regions import Ball
from nlosctl.solvers.optimization.problem import RowDerivatives

__all__ = ["MixtureRows", "OutlierRows"]


class MixtureRows(Protocol):
    """Rows (B, K) of measurements whose model is compared with points about each snapshot's local origin.

    Points are given as D arrays.
    """

    @property
    def dimension(self) -> int:
        """The number of coordinates of a point, D."""
        ...

    def half_chi_square(self, k: int, *point: FloatArray) -> FloatArray:
        """Return half the chi-square of row ``k`` at points (B, P), within a per cent; infinite where impossible."""
        ...

    def derivatives(self, k: int, *point: FloatArray) -> RowDerivatives:
        """Return half the chi-square of row ``k`` at points (B,), exact, and its derivatives."""
        ...

    def scalars(self) -> IntArray:
        """Return the number of scalars (B, K) that each row measures."""
        ...

    def ridges(self, ball: Ball) -> FloatArray:
        """Return the density (B, K) of the points of `sample_ridge` where they are densest, 0 without points."""
        ...

    def on_ridge(self, k: int, ratio: FloatArray, *point: FloatArray) -> FloatArray:
        """Return the density (B, P) over that; ``ratio`` is exp(-half chi-square)."""
        ...

    def sample_ridge(self, ball: Ball, snapshot: IntArray, k: IntArray, normal: Point, uniform: Point) -> Point:
        """Return points (N,) in a ball from D independent numbers each, of row ``k``'s error and along it.

        ``normal`` are the same numbers as ``uniform``, as standard normal deviates: each row uses one of the two.
        """
        ...

    def take(self, rows: IntArray) -> MixtureRows:
        """Return the rows of some snapshots; a snapshot may be named several times."""
        ...


class OutlierRows(Protocol):
    """Rows (B, K) whose density as an outlier, u, depends on the point."""

    def scores(self, *point: FloatArray) -> tuple[list[FloatArray], FloatArray]:
        """Return ``half_chi_square`` of every row at points (B, P), and the negative logarithm of the product of u.

        The latter is apart from ``log_nlos``.
        """
        ...

    def take(self, rows: IntArray) -> OutlierRows:
        """Return the rows of some snapshots."""
        ...
