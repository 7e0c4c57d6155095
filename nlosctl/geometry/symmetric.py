"""Symmetric 2x2 matrices, held as three arrays xx, xy, yy: solved, inverted and decomposed in closed form."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow

__all__ = ["Symmetric2x2"]


class Symmetric2x2(NamedTuple):
    """A batch of symmetric 2x2 matrices; each of ``xx``, ``xy``, ``yy`` has the batch's shape."""

    xx: FloatArray
    xy: FloatArray
    yy: FloatArray

    @property
    def determinant(self) -> FloatArray:
        """The determinants."""
        return self.xx * self.yy - self.xy * self.xy

    @property
    def trace(self) -> FloatArray:
        """The traces."""
        return self.xx + self.yy

    def eigenvalues(self) -> tuple[FloatArray, FloatArray]:
        """Return the smaller and the larger eigenvalues, for matrices that are not negative.

        The smaller is found as determinant / larger, so that it keeps its digits in nearly singular matrices.
        """
        half_difference = 0.5 * (self.xx - self.yy)
        with ignoring_overflow():
            larger = 0.5 * self.trace + np.sqrt(half_difference * half_difference + self.xy * self.xy)
            smaller = np.where(larger > 0.0, self.determinant / larger, 0.0)
        return smaller, larger

    def solve(self, right_x: FloatArray, right_y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the solutions x, y; not finite where a matrix is singular."""
        with ignoring_overflow():
            scale = 1.0 / self.determinant
            x = (self.yy * right_x - self.xy * right_y) * scale
            y = (self.xx * right_y - self.xy * right_x) * scale
        return x, y

    def inverse(self) -> Symmetric2x2:
        """Return the inverses; not finite where a matrix is singular."""
        with ignoring_overflow():
            scale = 1.0 / self.determinant
            return Symmetric2x2(self.yy * scale, -self.xy * scale, self.xx * scale)

    def congruence(self, middle: Symmetric2x2) -> Symmetric2x2:
        """Return ``self @ middle @ self``, the sandwich of a covariance."""
        with ignoring_overflow():
            left_xx = self.xx * middle.xx + self.xy * middle.xy
            left_xy = self.xx * middle.xy + self.xy * middle.yy
            left_yx = self.xy * middle.xx + self.yy * middle.xy
            left_yy = self.xy * middle.xy + self.yy * middle.yy
            return Symmetric2x2(
                left_xx * self.xx + left_xy * self.xy,
                left_xx * self.xy + left_xy * self.yy,
                left_yx * self.xy + left_yy * self.yy,
            )
