"""Standard deviations that are known up to a factor: the factor of each snapshot by its residuals.

With relative weights 1 / s_i^2, residuals r_i of the weighted fit, n scalars and p unknowns, f^2 = Q / (n - p),
Q = sum (r_i / s_i)^2, and the covariance is f^2 (J'J)^-1. In linear Gaussian theory the fit and Q are independent, so
that e' C^-1 e / p has the F distribution of p and n - p degrees of freedom.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray, ignoring_division
from nlosctl.contract.results import has_covariance
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import RowBlock

__all__ = ["HEIGHT_FAULT", "StdFactors", "marginal_cost"]

HEIGHT_FAULT = (
    "A measured height with a standard deviation needs stated standard deviations of the other measurements; state "
    "them, or set `target_z_std_m` to 0 for an exact height."
)
"""Why there is no factor beside a height of stated standard deviation: a single one would scale that too."""

_STAND_IN = 1e-3
"""The factor with which a fix is judged where its own is not determined: so small that the geometry decides."""


@dataclass(frozen=True)
class StdFactors(RowBlock):
    """Factors (B,) of the standard deviations with their degrees of freedom, and which of them are ``determined``.

    One that is not determined, without spare scalars or by residuals of exactly zero, is a small number.
    """

    factor: FloatArray
    degrees: IntArray
    determined: BoolArray

    @classmethod
    def of(cls, chi_square: FloatArray, degrees: IntArray | int) -> StdFactors:
        """Return the factors of fixes by the chi-square (B,) of their residuals over their relative std."""
        spare = np.broadcast_to(np.asarray(degrees, dtype=np.int64), chi_square.shape)
        with ignoring_division():
            factor = np.sqrt(chi_square / spare)
        determined = (spare > 0) & (factor > 0.0) & np.isfinite(factor)
        return cls(np.where(determined, factor, _STAND_IN), spare, determined)

    @property
    def squared(self) -> FloatArray:
        """The squared factors (B,)."""
        return self.factor * self.factor

    def scaled(self, std: FloatArray) -> FloatArray:
        """Return relative standard deviations (B, K) times their factor."""
        return std * self.factor[:, None]

    def mark(self, status: StatusArray) -> None:
        """Write into the status (B,) of fixes with a covariance that their factor is not determined."""
        status[has_covariance(status) & ~self.determined] = Status.STD_NOT_ESTIMABLE

    def columns(self, status: StatusArray) -> dict[str, FloatArray]:
        """Return the columns (B,) of the factors and their degrees of freedom, NaN where there is no covariance."""
        certain = has_covariance(status)
        return {
            "std_factor": np.where(certain, self.factor, np.nan),
            "std_dof": np.where(certain, self.degrees, np.nan),
        }


def marginal_cost(cost: FloatArray, degrees: IntArray | int) -> FloatArray:
    """Return the negative log-likelihoods (B,), up to a constant, of half chi-squares over relative std.

    The factor f, of prior density 1 / f, is integrated out: (n - p) / 2 times the logarithm of the chi-square.
    """
    with ignoring_division():
        return np.asarray(0.5 * np.asarray(degrees) * np.log(cost))
