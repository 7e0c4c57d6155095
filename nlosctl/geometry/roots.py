"""Roots of many functions of one variable at once, each within its bracket."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_overflow

__all__ = ["bracketed_roots"]


_MAX_ITERATIONS = 100


def bracketed_roots(
    function: Callable[[FloatArray], tuple[FloatArray, FloatArray]],
    low: FloatArray,
    high: FloatArray,
    guess: FloatArray,
    *,
    tolerance: float = 1e-12,
) -> FloatArray:
    """Return the roots (N,) of ``function``, which is negative just above ``low`` and positive just below ``high``.

    ``function`` gives value and slope (N,) at points (N,). Newton's step, or half the bracket where that would leave
    it or shrinks too slowly. A root no longer changes once a step is at most ``tolerance``, so its bits do not
    depend on its neighbours. NaN where the function is NaN.
    """
    low, high, root = low.copy(), high.copy(), guess.copy()
    last_step = high - low
    settled = np.isnan(root)
    for _ in range(_MAX_ITERATIONS):
        value, slope = function(root)
        negative = value < 0.0
        np.copyto(low, root, where=negative)
        np.copyto(high, root, where=~negative)
        with ignoring_overflow():
            newton = root - value / slope
            poor = ~((newton >= low) & (newton <= high)) | (2.0 * np.abs(newton - root) > np.abs(last_step))
        proposed = np.where(poor, 0.5 * (low + high), newton)
        last_step = proposed - root
        root = np.where(settled, root, np.where(np.isnan(value), np.nan, proposed))
        settled |= (np.abs(last_step) <= tolerance) | np.isnan(value)
        if settled.all():
            break
    return root
