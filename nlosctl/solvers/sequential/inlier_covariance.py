"""The covariance of a fix from the rows of its set, at the fix itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.bearings.joint_range_bearing import RangedBearingProblem
from nlosctl.solvers.bearings.line_fits import inflate_near_sensors
from nlosctl.solvers.bearings.row_terms import DirectBearings

__all__ = ["inlier_covariance"]


def inlier_covariance(rows: DirectBearings, used: BoolArray, x: FloatArray, y: FloatArray) -> SymmetricMatrix:
    """Return the inverse information (N,) at points x, y (N,) of the rows marked by ``used`` (N, K).

    It is wider near a sensor (`inflate_near_sensors`). A row seen on a circle has the weight of its ray tube's width at
    the point. The covariance of the sequential updates, (10), is linearized where the set began.
    """
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
