"""Angles: radians, counter-clockwise from +x."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["wrap_angle"]

FloatArray = npt.NDArray[np.float64]


def wrap_angle(angle_rad: FloatArray) -> FloatArray:
    """Return the angles wrapped to (-pi, pi], same shape; NaN stays NaN.

    Angles already in that interval keep their bits.
    """
    turns = np.ceil((angle_rad - np.pi) / (2.0 * np.pi))
    wrapped = np.minimum(angle_rad - turns * (2.0 * np.pi), np.pi)
    return np.where(np.abs(angle_rad) < np.pi, angle_rad, wrapped)
