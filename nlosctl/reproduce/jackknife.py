"""The standard error of any statistic of independent trials, by leaving out groups of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

__all__ = ["GROUPS", "jackknife_error"]

GROUPS = 40
"""How many groups the trials are dealt to; the error itself is then good to about a ninth."""


def jackknife_error(without: Sequence[float]) -> float:
    """Return the delete-a-group jackknife standard error from the statistic without each group in turn.

    Efron 1982, The Jackknife, the Bootstrap and Other Resampling Plans, equation (3.1), with groups in place of single
    observations. NaN where the statistic has no value without one of the groups.
    """
    values = np.asarray(without, dtype=np.float64)
    away = values - values[0]  # exactly 0 for what no group changes
    return float(np.sqrt((values.size - 1) * np.mean((away - away.mean()) ** 2)))
