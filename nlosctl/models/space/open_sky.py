"""What rays have in common that no circle or sphere limits: a part of the interface `Sight`."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.blocks import RowBlock

__all__ = ["OpenSky"]


class OpenSky(RowBlock):
    """Rays without a horizon."""

    std: FloatArray

    @property
    @abstractmethod
    def rows(self) -> int:
        """The number of rows, K."""

    def inside_circles(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return the points: no row is seen by a circle."""
        return point

    def under_horizon(self) -> BoolArray:
        """Return which rows (B, K) have a direction from which no wave can come: none."""
        return np.zeros((self.std.shape[0], self.rows), dtype=bool)

    def all_under_horizon(self) -> BoolArray:
        """Return in which snapshots (B,) all directions are such: in none."""
        return np.zeros(self.std.shape[0], dtype=bool)
