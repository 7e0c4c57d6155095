"""Residuals, derivatives and information of rays whose scalars are compared one after the other."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.space.open_sky import OpenSky

__all__ = ["ScalarRows"]


class ScalarRows(OpenSky):
    """Rays of K rows, each an azimuth and perhaps an elevation, and further scalars: a part of `Sight`."""

    @abstractmethod
    def linearized(
        self, *point: FloatArray, extra_m2: FloatArray | None = None, paths: Any = None
    ) -> Iterator[tuple[FloatArray, tuple[FloatArray, ...]]]:
        """Yield residual over std (B,) and derivatives of azimuth and elevation, row by row, then of other scalars."""

    def residual(self, *point: FloatArray, paths: Any = None) -> FloatArray:
        """Return measured minus predicted scalars (B, M); 0 in rows without an elevation."""
        return self._gathered([residual for residual, _ in self.linearized(*point, paths=paths)]) * self.std

    def slopes(
        self, *point: FloatArray, paths: Any = None, extra_m2: FloatArray | None = None
    ) -> tuple[FloatArray, ...]:
        """Return the derivatives (B, M) of the residuals over their stds; with ``extra_m2`` as in `linearized`."""
        every = [slopes for _, slopes in self.linearized(*point, extra_m2=extra_m2, paths=paths)]
        return tuple(self._gathered(parts) for parts in zip(*every, strict=True))

    def _gathered(self, parts: Sequence[FloatArray]) -> FloatArray:
        """Return the scalars (B,) in the order of `linearized` as a block (B, M) in the order of `std`."""
        angles = 2 * self.rows
        return np.stack([*parts[:angles:2], *parts[1:angles:2], *parts[angles:]]).T

    def information(self, *point: FloatArray, paths: Any = None, extra_m2: FloatArray | None = None) -> SymmetricMatrix:
        """Return the Fisher information (B,) of points; ``extra_m2`` as in `linearized`."""
        total = SymmetricMatrix.full(point[0].shape, 0.0, len(point))
        with ignoring_overflow():
            for _, slopes in self.linearized(*point, extra_m2=extra_m2, paths=paths):
                total += SymmetricMatrix.outer(*slopes)
        return total
