"""An uncertain speed of the wave: a common scale error of arrivals, eliminated like a further unknown.

Arrivals t_i, times by the nominal speed, are (1 + e) times too short if the speed is (1 + e) times the nominal one:
(1 + e)(t_i - c) = |x - a_i|, with e of mean 0 and standard deviation g. With u the arrivals over their stds, less the
weighted mean that the offset takes off, the residuals r of e = 0 become r + e u. The likeliest e is linear in r, and
without it half the chi-square is r'(I + g^2 u u')^-1 r / 2: the errors have the covariance I + g^2 u u'. With
y = g^2 u'u

    e = -g^2 u'r / (1 + y)        (I + g^2 u u')^-1 = L L,    L = I - g^2 u u' / (sqrt(1 + y) (1 + sqrt(1 + y)))

so that L whitens residuals and their derivatives. As u is that of the measured arrivals, L is constant.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.blocks import RowBlock, sum_measurements

__all__ = ["UncertainSpeed"]


@dataclass(frozen=True)
class UncertainSpeed(RowBlock):
    """The std g (B,) of the scale error, its effect u (B, K) on residuals over their stds, and sqrt(1 + y) (B,)."""

    std: FloatArray
    effect: FloatArray
    root: FloatArray

    @classmethod
    def of(cls, std: FloatArray, effect: FloatArray) -> Self:
        """Return the error of a std (B,), which may be 0, with its effect (B, K)."""
        return cls(std, effect, np.sqrt(1.0 + std * std * sum_measurements(effect * effect)))

    def whitened(self, values: FloatArray) -> FloatArray:
        """Return L v for residuals or their derivatives v (B, K)."""
        share = self.std * self.std / (self.root * (1.0 + self.root))
        return np.asarray(values - (share * sum_measurements(self.effect * values))[:, None] * self.effect)

    def corrected(self, residual: FloatArray) -> FloatArray:
        """Return residuals (B, K) over their stds with the likeliest error, r + e u."""
        return residual + self.error(residual)[:, None] * self.effect

    def error(self, residual: FloatArray) -> FloatArray:
        """Return the likeliest error e (B,) for residuals (B, K) over their stds."""
        return np.asarray(-((self.std / self.root) ** 2) * sum_measurements(self.effect * residual))

    def eliminated(self, whitened: FloatArray) -> FloatArray:
        """Return by how much (B,) the likeliest e falls with residuals or derivatives v, given as L v (B, K)."""
        return np.asarray(self.std * self.std / self.root * sum_measurements(self.effect * whitened))

    def scaled_error(self, corrected: FloatArray) -> FloatArray:
        """Return the likeliest error over its std, e / g (B,), for `corrected` residuals (B, K)."""
        return np.asarray(-self.std * sum_measurements(self.effect * corrected))

    def gain(self, along: FloatArray) -> FloatArray:
        """Return the fall of the chi-square (B, P) by the likeliest error, for the products u'r (B, P)."""
        return np.asarray(((self.std / self.root)[:, None] * along) ** 2)
