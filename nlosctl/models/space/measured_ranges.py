"""Ranges beside directions in space, compared with vectors from their origins."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.directions import length
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.space.measured_angles import Vector

__all__ = ["compare_range"]


def compare_range(
    vector: Vector, measured_m: FloatArray, std: FloatArray, *, is_lognormal: bool
) -> tuple[FloatArray, Vector, SymmetricMatrix]:
    """Return measured minus predicted range (B,) over its std, its derivatives and second derivatives.

    All are 0 where ``measured_m`` is NaN. With ``is_lognormal`` residual and std are those of the logarithm.
    """
    distance, known = length(vector), np.isfinite(measured_m)
    unit = (vector[0] / distance, vector[1] / distance, vector[2] / distance)
    inverse = np.where(known, 1.0 / std, 0.0)
    residual = np.log(measured_m / distance) if is_lognormal else measured_m - distance
    slope = -inverse / distance if is_lognormal else -inverse
    twice = 2.0 if is_lognormal else 1.0
    bend = SymmetricMatrix.outer(*unit, weight=-twice * slope / distance).add_to_diagonal(slope / distance)
    return np.where(known, residual * inverse, 0.0), (unit[0] * slope, unit[1] * slope, unit[2] * slope), bend
