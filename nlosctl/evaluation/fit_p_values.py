"""P-values of fits by their chi-square."""

from __future__ import annotations

import numpy as np
from scipy.special import erfc, gammaincc

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.results import Estimates, has_covariance

__all__ = ["chi_square_p_value", "fit_p_values"]

_CLOSED_FORM_DEGREES = 40
_CERTAIN = 800.0
"""Half a chi-square at which every p-value of few degrees of freedom is below the smallest number."""


def fit_p_values(estimates: Estimates) -> FloatArray:
    """Return the p-value (E,) of each fit by its chi-square; NaN without spare scalars or without a covariance.

    A fix on the boundary has none: it is not the optimum that the degrees of freedom are those of. An infeasible one
    is the free optimum, whose residuals do not depend on where it is.
    """
    if estimates.chi_square is None or estimates.degrees_of_freedom is None:
        return np.full(estimates.status.shape, np.nan)
    p_value = chi_square_p_value(estimates.chi_square, estimates.degrees_of_freedom)
    return np.where(has_covariance(estimates.status), p_value, np.nan)


def chi_square_p_value(chi_square: FloatArray, degrees: IntArray) -> FloatArray:
    """Return the probability (E,) that a chi-square with ``degrees`` is at least so large; NaN for less than one.

    In closed form up to 40 degrees of freedom: exp(-z) times a sum of powers of z, half the chi-square, and
    erfc(sqrt(z)) for odd degrees (Abramowitz, Stegun, 26.4.4 and 26.4.5): ten times as fast as the incomplete gamma
    function.
    """
    p_value = np.full(chi_square.shape, np.nan)
    for count in np.flatnonzero(np.bincount(np.clip(degrees, 0, _CLOSED_FORM_DEGREES + 1))):
        mine = degrees == count if count <= _CLOSED_FORM_DEGREES else degrees > _CLOSED_FORM_DEGREES
        half = np.maximum(0.5 * chi_square[mine], 0.0)  # a fit by rounding may be better than perfect
        if count > _CLOSED_FORM_DEGREES:
            p_value[mine] = gammaincc(0.5 * degrees[mine], half)
        elif count > 0:
            p_value[mine] = _closed_form(int(count), np.minimum(half, _CERTAIN))
    return p_value


def _closed_form(degrees: int, half: FloatArray) -> FloatArray:
    root = np.sqrt(half)
    tail = erfc(root) if degrees % 2 else 0.0
    power = 2.0 * root / np.sqrt(np.pi) if degrees % 2 else np.ones(half.shape)
    total = np.zeros(half.shape)
    for term in range(degrees // 2):
        total += power
        power = power * (half / (term + (1.5 if degrees % 2 else 1.0)))
    return np.asarray(np.minimum(tail + np.exp(-half) * total, 1.0))
