"""Do probabilities come true? The share of the cases in which they do, against what was said."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.evaluation.monte_carlo import share_std_error

__all__ = ["Reliability", "reliability"]


@dataclass(frozen=True)
class Reliability:
    """Of the rows of each bin (M,) that has any: mean stated probability, share that came true, its standard error."""

    stated: FloatArray
    share: FloatArray
    std_error: FloatArray
    count: IntArray


def reliability(probability: FloatArray, came_true: BoolArray, bins: int = 10) -> Reliability:
    """Return how often rows (N,) came true, by the probability that was stated, in equal bins from 0 to 1.

    NaN are left out (Murphy, Winkler 1977). The standard errors are those of independent rows.
    """
    known = ~np.isnan(probability)
    stated, true = probability[known], came_true[known]
    place = np.minimum((stated * bins).astype(np.int64), bins - 1)
    count = np.bincount(place, minlength=bins)
    filled = count > 0
    share = np.bincount(place, true, bins)[filled] / count[filled]
    return Reliability(
        stated=np.bincount(place, stated, bins)[filled] / count[filled],
        share=share,
        std_error=np.array([share_std_error(p, n) for p, n in zip(share, count[filled], strict=True)]),
        count=count[filled],
    )
