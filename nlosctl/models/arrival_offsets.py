"""The offset of arrivals at a fix: its value, its standard deviation, and its covariance with the position."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import ArrivalRows

__all__ = ["offset_columns"]


def offset_columns(
    rows: ArrivalRows, point: tuple[FloatArray, ...], covariance: SymmetricMatrix
) -> dict[str, FloatArray]:
    """Return the columns (B,) of the offset at points with a covariance: value, std, covariances with x, y, z.

    NaN for independent differences. The offset is the time of emission times the nominal speed.
    """
    at, dimension = rows.compare(*point), len(point)
    with ignoring_division():
        offset, pull = at.offset_m, at.pull
        variance = 1.0 / sum_measurements(1.0 / (rows.std_m * rows.std_m))
        if rows.speed is not None and not rows.of_pairs:
            error, mean_m = -rows.speed.eliminated(at.residual), rows.common(at.distance_m)
            offset = offset + mean_m * error / (1.0 + error)
            pull = tuple(
                part + mean_m * rows.speed.eliminated(slope) for part, slope in zip(pull, at.slopes, strict=True)
            )
            variance = variance + (mean_m * rows.speed.std / rows.speed.root) ** 2
        cross = [
            -sum((covariance.entry(i, j) * pull[j] for j in range(dimension)), np.zeros(offset.shape))
            for i in range(dimension)
        ]
        for part, mean in zip(cross, pull, strict=True):
            variance = variance - part * mean
    if rows.held_z_m is not None:
        cross.append(np.zeros(variance.shape))
    names = (f"cov_{axis}_offset_m2" for axis in "xyz")
    columns = {"offset_m": offset + rows.origin_m, "offset_std_m": np.sqrt(np.maximum(variance, 0.0))}
    columns |= dict(zip(names, cross, strict=False))
    return {name: np.full(part.shape, np.nan) for name, part in columns.items()} if rows.of_pairs else columns
