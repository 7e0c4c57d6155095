"""Reliability of stated probabilities: the observed frequency. Only `plot` shows it; `evaluate` has no such score."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.evaluation.error_statistics import share_std_error

__all__ = ["Reliability", "reliability"]


@dataclass(frozen=True)
class Reliability:
    """For each non-empty bin (M,): mean stated probability, share that came true with its standard error, rows."""

    stated: FloatArray
    share: FloatArray
    std_error: FloatArray
    count: IntArray


def reliability(probability: FloatArray, came_true: BoolArray, bins: int = 10) -> Reliability:
    """Return how often rows (N,) came true, by stated probability, in equal bins from 0 to 1 (Murphy, Winkler 1977).

    NaN are left out. The standard errors assume independent rows.
    """
    known = ~np.isnan(probability)
    stated, true = probability[known], came_true[known]
    index = np.minimum((stated * bins).astype(np.int64), bins - 1)
    count = np.bincount(index, minlength=bins)
    filled = count > 0
    share = np.bincount(index, true, bins)[filled] / count[filled]
    return Reliability(
        stated=np.bincount(index, stated, bins)[filled] / count[filled],
        share=share,
        std_error=np.array([share_std_error(p, n) for p, n in zip(share, count[filled], strict=True)]),
        count=count[filled],
    )
