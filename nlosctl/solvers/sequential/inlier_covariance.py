"""The covariance of a fix from the rows of its set, at the fix itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_division
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.space.geodesic_lines import GeodesicLines
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.bearings.geodesic_row_terms import DirectGeodesics
from nlosctl.solvers.bearings.joint_range_bearing import RangedBearingProblem
from nlosctl.solvers.bearings.line_fits import inflate_near_sensors
from nlosctl.solvers.bearings.row_terms import DirectBearings
from nlosctl.solvers.bearings.space_row_terms import DirectDirections

__all__ = ["inlier_covariance"]

_Rows = DirectBearings | DirectDirections | DirectGeodesics


def inlier_covariance(rows: _Rows, used: BoolArray, *point: FloatArray) -> SymmetricMatrix:
    """Return the inverse information (N,) at points (N,) of the rows marked by ``used`` (N, K).

    It is wider near a sensor (`inflate_near_sensors`). A row seen on a circle has the weight of its ray tube's width at
    the point. The covariance of the sequential updates, (10), is linearized where the set began.
    """
    if not isinstance(rows, DirectBearings):
        return _in_space(rows.lines, used, point)
    x, y = point
    range_m = rows.lines.range_m(x, y)
    nearest = np.where(used, range_m, np.inf)
    if rows.lines.circles is not None:  # their origins are images, not sensors
        rows.lines.circles.place_in(nearest, np.full(rows.lines.circles.snapshot.shape, np.inf))
    is_sensor = np.isfinite(nearest)

    def covariance(which: IntArray, extra_m2: FloatArray) -> SymmetricMatrix:
        squared = range_m[which] * range_m[which]
        with ignoring_division():
            wider = np.where(is_sensor[which], squared / (squared + extra_m2[:, None]), 1.0)
        part = rows.take(which)
        precision = None if part.precision is None else np.where(used[which], part.precision, 0.0)
        part = replace(part, weight=np.where(used[which], part.weight * wider, 0.0), precision=precision)
        return RangedBearingProblem(part).information(x[which], y[which]).inverse()

    every = np.arange(x.shape[0])
    return inflate_near_sensors(covariance(every, np.zeros(x.shape)), nearest.min(axis=1), covariance)


def _in_space(lines: SpaceLines | GeodesicLines, used: BoolArray, point: Point) -> SymmetricMatrix:
    kinds = lines.of_rows // lines.rows
    std = np.where(np.concatenate([used] * kinds, axis=1), lines.std[:, : lines.of_rows], np.inf)
    masked = lines.with_std(std)

    def covariance(which: IntArray, extra_m2: FloatArray) -> SymmetricMatrix:
        return masked.take(which).information(*rows_of(point, which), extra_m2=extra_m2).inverse()

    nearest_m = np.where(used, lines.range_m(*point), np.inf).min(axis=1)
    return inflate_near_sensors(masked.information(*point).inverse(), nearest_m, covariance)
