"""How far chance moves a figure: standard errors of an RMSE and of a share, of independent rows."""

from __future__ import annotations

import math

__all__ = ["rmse_std_error", "share_std_error"]


def rmse_std_error(count: int, mean_square: float, mean_fourth: float) -> float:
    """Return the standard error of a root mean square of ``count`` values, from the means of their squares and fourth
    powers.

    By the delta method: std of the squares / sqrt(count) / (2 RMS). NaN of fewer than two values.
    """
    if count < 2 or math.isnan(mean_square):
        return math.nan
    if mean_square == 0.0:
        return 0.0
    variance = max(mean_fourth - mean_square * mean_square, 0.0) / (count - 1)
    return 0.5 * math.sqrt(variance / mean_square)


def share_std_error(share: float, count: float) -> float:
    """Return the standard error of a share of ``count`` independent rows, that of a binomial law; NaN of none."""
    return math.sqrt(share * (1.0 - share) / count) if count > 0 else math.nan
