"""The mean of the rows of a sensor in a window: one measurement with the weights 1 / std^2."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.io.measurements.row_checks import TICKS

__all__ = ["merged_columns"]

_CANCELLED = 1e-9
"""A sum of unit vectors this much shorter than their weights has no direction."""

_ANGLES = ("bearing_rad", "dod_rad", "doa_rad")
_LENGTHS = ("range_m", "path_length_m")
_PLACES = ("sensor_x_m", "sensor_y_m", "sensor_z_m", "tx_x_m", "tx_y_m", "rx_x_m", "rx_y_m")


def merged_columns(
    columns: Mapping[str, npt.NDArray[Any]], leader: IntArray, start: IntArray
) -> tuple[dict[str, npt.NDArray[Any]], BoolArray]:
    """Return the columns with the mean in each row that leads others, and the rows (N,) whose directions cancel.

    ``leader`` (N,) is the first row of those that are merged, ``start`` (N,) the start of each row's window in ticks.
    Weights are 1/std^2: lengths and times have their mean, directions that of the summed unit vectors, the std is
    (sum 1/std^2)^-1/2; the place of a moving sensor has the weights of its first measurement. ``time_offset`` is the
    time after the start.
    """
    merged = dict(columns)
    opposite = np.zeros(leader.shape[0], dtype=np.bool_)
    shared: FloatArray | None = None
    for name in (name for name in (*_ANGLES, *_LENGTHS) if name in columns):
        std_name = _std_name(name)
        weight = _weights(columns.get(std_name), columns[name])
        shared = weight if shared is None else shared
        if name in _ANGLES:
            merged[name], cancelled = _mean_direction(columns[name], weight, leader)
            opposite |= cancelled
        else:
            merged[name] = _mean(columns[name], weight, leader)
        if std_name in columns:
            merged[std_name] = _merged_std(columns[std_name], weight, leader)
    assert shared is not None  # noqa: S101 - every kind measures something
    for name in (name for name in _PLACES if name in columns):
        merged[name] = _mean(columns[name], shared, leader)
    merged["time_offset"] = _mean((columns[TICKS] - start).astype(np.float64), shared, leader)
    return merged, opposite


def _std_name(name: str) -> str:
    stem, _, unit = name.rpartition("_")
    return f"{stem}_std_{unit}"


def _weights(std: FloatArray | None, values: FloatArray) -> FloatArray:
    """Return 1/std^2 (N,), 0 without a value, 1 without a std."""
    if std is None:
        return np.where(np.isnan(values), 0.0, 1.0)
    return np.where(np.isnan(values), 0.0, np.where(np.isnan(std), 1.0, 1.0 / (std * std)))


def _sums(values: FloatArray, leader: IntArray) -> FloatArray:
    """Return the sum (N,) of the values that each row leads, one row after the other."""
    sums: FloatArray = np.bincount(leader, values, minlength=leader.shape[0]).astype(np.float64)
    return sums


def _several(leader: IntArray) -> BoolArray:
    """Return which rows (N,) lead others."""
    return np.asarray(np.bincount(leader, minlength=leader.shape[0]) > 1)


def _mean(values: FloatArray, weight: FloatArray, leader: IntArray) -> FloatArray:
    """Return the values with the mean where a row leads others; equal values keep their bits."""
    first = values[leader]
    first = np.where(np.isnan(first), _first_known(values, leader)[leader], first)
    step = np.where(weight > 0.0, values - first, 0.0)
    total = _sums(weight, leader)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = first + _sums(weight * step, leader) / total
    return np.where(_several(leader) & (total > 0.0), mean, values)


def _first_known(values: FloatArray, leader: IntArray) -> FloatArray:
    """Return for each leading row (N,) the first of its rows' values that is not NaN, else NaN."""
    known = np.flatnonzero(~np.isnan(values))[::-1]
    first = np.full(values.shape, np.nan)
    first[leader[known]] = values[known]
    return first


def _mean_direction(values: FloatArray, weight: FloatArray, leader: IntArray) -> tuple[FloatArray, BoolArray]:
    """Return the directions (N,) with that of the summed unit vectors where a row leads others, and which cancel."""
    with np.errstate(invalid="ignore"):
        cosine, sine = np.cos(values), np.sin(values)
    east = _sums(np.where(weight > 0.0, weight * cosine, 0.0), leader)
    north = _sums(np.where(weight > 0.0, weight * sine, 0.0), leader)
    several = _several(leader)
    cancelled = several & (np.hypot(east, north) <= _CANCELLED * _sums(weight, leader))
    return np.where(several, np.arctan2(north, east), values), cancelled[leader]


def _merged_std(std: FloatArray, weight: FloatArray, leader: IntArray) -> FloatArray:
    total = _sums(weight, leader)
    with np.errstate(divide="ignore"):
        merged = 1.0 / np.sqrt(total)
    return np.where(_several(leader) & (total > 0.0), merged, std)
