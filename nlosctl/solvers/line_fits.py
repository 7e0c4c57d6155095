"""Linear fits of a point to lines: least squares and Stansfield (Song, Willett, Zhou 2013, Sections 2.2, 2.3)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.models.bearings import SightLines

__all__ = ["LineFit", "fit_least_squares", "fit_stansfield"]

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class LineFit:
    """Points (B,) about the local origin, and the normal matrix that they solve."""

    x: FloatArray
    y: FloatArray
    normal: Symmetric2x2


def fit_least_squares(lines: SightLines) -> LineFit:
    """Return the point with the least sum of squared distances to the lines, equations (18), (19).

    x and y are not finite where the lines are exactly parallel.
    """
    return _solve(lines.sine, -lines.cosine, lines)


def fit_stansfield(lines: SightLines, first: LineFit) -> LineFit:
    """Return Stansfield's fix: lines weighted by 1 / (std range)^2, the ranges taken at ``first``; equation (15).

    x and y are not finite where ``first`` is not.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = 1.0 / (lines.std_rad * lines.range_m(first.x, first.y))
        return _solve(weight * lines.sine, -weight * lines.cosine, lines)


def _solve(normal_x: FloatArray, normal_y: FloatArray, lines: SightLines) -> LineFit:
    offset = normal_x * lines.origin_x + normal_y * lines.origin_y
    normal = Symmetric2x2(
        sum_measurements(normal_x * normal_x),
        sum_measurements(normal_x * normal_y),
        sum_measurements(normal_y * normal_y),
    )
    x, y = normal.solve(sum_measurements(normal_x * offset), sum_measurements(normal_y * offset))
    return LineFit(x, y, normal)
