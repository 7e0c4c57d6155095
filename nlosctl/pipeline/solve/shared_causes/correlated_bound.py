"""The information of rows that share errors: offsets, sensors and mirrors whose values are not exactly known."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.information import Information
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.models.shared_causes.causes import SharedCauses
from nlosctl.models.shared_causes.joint_rows import joint_rows
from nlosctl.models.sight import bearing_lines, has_geodesics
from nlosctl.solvers.optimization.correlated_rows import correlated_equations
from nlosctl.solvers.optimization.split_batches import take_snapshots

__all__ = ["information_with_causes"]

_MOST_NUMBERS = 1 << 22
"""So many entries of row covariances are in memory at a time."""


def information_with_causes(
    information: Information, kind: str, batch: Any, point: FloatArray, causes: SharedCauses, noise: str
) -> Information:
    """Return the information of snapshots about points (B, D) with the errors that their rows (B, K) share.

    Of rows that can see the point. Raises UsageError for errors that are not Gaussian, and for causes that have no
    model for azimuths of geodesics.
    """
    if not causes.any_error:
        return information
    if noise != "gaussian":
        raise UsageError(
            f"the bound of {noise} errors takes sensors and reflectors as exactly known; set `noise` to gaussian, or "
            "leave out the calibration and the standard deviations of the scene"
        )
    if kind == "bearings" and has_geodesics(batch):
        raise UsageError(
            "a bound with sensors that are not exactly known has no model for azimuths alone on the earth in three "
            "dimensions; set `dimensions` to 2"
        )
    with_ranges = kind == "bearings" and batch.range_m is not None and batch.range_std_m is not None
    seen = _seen(kind, batch, point)
    scalars = 4 * seen.shape[1] + 1
    size, parts = max(_MOST_NUMBERS // scalars**2, 1), []
    for start in range(0, batch.size, size):
        index = np.arange(start, min(start + size, batch.size))
        mine, own = take_snapshots(batch, index), causes.take(index)
        rows = joint_rows(kind, mine, own, point[index], with_ranges=with_ranges)
        parts.append(correlated_equations(rows.only(rows.of_rows(seen[index].astype(np.float64), 1.0) > 0.0))[0])
    matrix = np.concatenate(parts)
    entries = SymmetricMatrix(*(matrix[:, i, j] for i in range(matrix.shape[1]) for j in range(i + 1)))
    return dataclasses.replace(information, matrix=entries)


def _seen(kind: str, batch: Any, point: FloatArray) -> BoolArray:
    """Return which rows (B, K) can see points (B, D)."""
    if kind == "arrivals":
        return np.ones(batch.arrival_m.shape, dtype=bool)
    rows: Any = bearing_lines(batch) if kind == "bearings" else range_rows(batch)
    unknowns = getattr(rows, "unknowns", len(rows.center))
    local = [point[:, axis] - rows.center[axis] for axis in range(unknowns)]
    return np.asarray(~rows.unseen(*local))
