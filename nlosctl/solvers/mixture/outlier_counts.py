"""Expected numbers of outliers and late ranges: their sums over a file give the share and the bias that fit it best.

With the numbers expected under the current values, the ratios of the sums are the next values of the EM algorithm
(Dempster, Laird and Rubin, 1977), whose fixed point is a maximum of the likelihood of the file. That likelihood is
marginal: the position is integrated over the search region, flat before the measurements, so that snapshots without
a consensus count as well.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.regions import Ball, Region
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.late_ranges import LateRanges
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.posterior import share_direct, sum_points, weighted_points
from nlosctl.solvers.mixture.spots import RowCandidates

__all__ = ["expected_counts", "next_alpha", "next_bias_mean_m"]

_POINTS = 256
"""Points of each posterior: with them the sums are within a per cent of the integral's."""

_PRIOR_ROWS = 4.0
_PRIOR_ALPHA = 0.25
"""So many further rows with the default share keep the share between 0 and 1, and near the default in short files."""

_FEWEST_LATE = 10.0
"""With fewer late rows the mean of their bias stays unknown."""

_LEAST_MEAN = 0.1
"""Least mean of a bias, in standard deviations: a shorter one can't be distinguished from none."""


def expected_counts(mixture: Mixture, modes: Modes, region: Region, candidates: RowCandidates) -> FloatArray:
    """Return the expected numbers (B, 2) of sensors without a direct row and of all sensors.

    For ranges with late outliers (B, 5): also of late rows, and the sums of their biases and standard deviations in
    metres. A snapshot whose posterior has no weight at any point counts as zeros.
    """
    late = mixture.rows if isinstance(mixture.rows, LateRanges) else None
    counts = np.zeros((mixture.obstructed.shape[0], 2 if late is None else 5))
    modes = _with_centers(mixture, modes, region)
    every = np.arange(counts.shape[0])
    for rows, part, weighted in weighted_points(mixture, modes, region, candidates, every, _POINTS):
        mass = sum_points(weighted.weight)
        weighed = mass > 0.0
        weight = weighted.weight / np.where(weighed, mass, 1.0)[:, None]
        counts[rows, 0] = counts[rows, 1] = np.where(weighed, part.groups, 0.0)
        point = [part + mode[rows, :1] for part, mode in zip(weighted.away, modes.point, strict=True)]
        for k, share in enumerate(share_direct(part, weighted.direct)):
            counts[rows, 0] -= sum_points(share, weight)
            if isinstance(part.rows, LateRanges):
                is_late, bias = part.rows.late_bias(k, *point)
                outlier = (1.0 - share) * is_late
                counts[rows, 2] += sum_points(outlier, weight)
                counts[rows, 3] += sum_points(outlier * bias, weight)
                counts[rows, 4] += sum_points(outlier, weight) * part.rows.circles.std_m[:, k]
    np.maximum(counts, 0.0, out=counts)
    return counts


def next_alpha(outliers: float, sensors: float) -> float:
    """Return the share of outliers by the sums of their expected numbers over a file."""
    return (outliers + _PRIOR_ROWS * _PRIOR_ALPHA) / (sensors + _PRIOR_ROWS)


def next_bias_mean_m(late: float, bias_m: float, std_m: float) -> float | None:
    """Return the mean bias of late rows in metres by the sums over a file; None with too few late rows."""
    return None if late < _FEWEST_LATE else max(bias_m, _LEAST_MEAN * std_m) / late


def _with_centers(mixture: Mixture, modes: Modes, region: Region) -> Modes:
    """Return the modes with the centre of the search region as a wide one in snapshots that have none."""
    rows = np.flatnonzero(~np.isfinite(modes.cost[:, 0]))
    if not rows.size:
        return modes
    center = Ball.about(region, rows).center
    *point, cost = (part.copy(order="F") for part in (*modes.point, modes.cost))
    for part, middle in zip(point, center, strict=True):
        part[rows, 0] = middle
    cost[rows, 0] = mixture.take(rows).score(*(part[:, None] for part in center))[:, 0]
    hessian = modes.hessian.map(lambda part: part.copy(order="F"))
    hessian.put((rows, 0), SymmetricMatrix.full(rows.shape, 0.0, mixture.dimension))
    return replace(modes, point=tuple(point), cost=cost, hessian=hessian)
