"""A measured height of the target: one more scalar beside the rows of a snapshot in space."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.blocks import RowBlock

__all__ = ["MeasuredHeight"]


@dataclass(frozen=True)
class MeasuredHeight(RowBlock):
    """Heights (B,) about the local origin in metres and their inverse standard deviations; both 0 where unmeasured.

    The residual is (z - Z) / S.
    """

    z_m: FloatArray
    inverse_std: FloatArray

    @classmethod
    def of(cls, z_m: FloatArray, std_m: FloatArray, center_z: FloatArray) -> Self:
        """Return the heights (B,) that are measured with a standard deviation; NaN in either stands for none."""
        known = np.isfinite(z_m) & np.isfinite(std_m)
        return cls(np.where(known, z_m - center_z, 0.0), np.where(known, 1.0 / np.where(known, std_m, 1.0), 0.0))

    @property
    def known(self) -> BoolArray:
        """Which snapshots (B,) have a measured height."""
        return self.inverse_std > 0.0

    def scaled_residual(self, z: FloatArray) -> FloatArray:
        """Return the height of points (B,) or (B, P) minus the measured one, over its standard deviation."""
        height, precision = (
            (self.z_m, self.inverse_std) if z.ndim == 1 else (self.z_m[:, None], self.inverse_std[:, None])
        )
        return (z - height) * precision
