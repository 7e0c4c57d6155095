"""Bearing errors of the models of Ananthasubramaniam and Madhow, Section II, and of a Cauchy model."""

from __future__ import annotations

from math import pi, sqrt
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["ErrorModel", "draw_errors"]

ErrorModel = Literal["gaussian", "laplace", "cauchy"]

_RIGHT_ANGLE = 0.5 * pi


def draw_errors(generator: np.random.Generator, model: ErrorModel, std_rad: FloatArray) -> FloatArray:
    """Return errors of the shape of ``std_rad``, truncated to a right angle on either side.

    gaussian: (1); laplace: (2), whose standard deviation is ``std_rad`` but for the truncation; cauchy: ``std_rad``
    is the half width at half maximum. Each is the inverse of its distribution function at a uniform number.
    """
    uniform = generator.uniform(-1.0, 1.0, std_rad.shape)
    if model == "laplace":
        scale = std_rad / sqrt(2.0)
        inside = -np.expm1(-_RIGHT_ANGLE / scale)  # (2) as corrected: 1 - exp(-pi / (sqrt(2) sigma))
        return np.asarray(-scale * np.sign(uniform) * np.log1p(-np.abs(uniform) * inside))
    if model == "cauchy":
        return np.asarray(std_rad * np.tan(uniform * np.arctan(_RIGHT_ANGLE / std_rad)))
    from scipy.special import erf, erfinv  # takes long to import

    return np.asarray(sqrt(2.0) * std_rad * erfinv(uniform * erf(_RIGHT_ANGLE / (sqrt(2.0) * std_rad))))
