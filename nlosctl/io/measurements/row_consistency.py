"""Checks of values against each other: groups of columns that belong together, and columns in another unit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import EARTH_PLACES
from nlosctl.io.measurements.column_mapping import ColumnPlan
from nlosctl.io.measurements.missing_columns import named_like_degrees
from nlosctl.io.measurements.row_checks import Fault, as_float64, got, is_null
from nlosctl.io.readers.base import RecordBatch

__all__ = ["half_filled_faults", "indefinite_faults", "missing_std_faults", "unit_remarks"]

_TURN = 2.0 * math.pi * (1.0 + 1e-6)
_MANY_ROWS = 20
_WIDEST_DEG = 1.0
_FAR = 20.0
_WIDEST_STD = 0.8
_NARROWEST_STD = 0.2


def half_filled_faults(group: Sequence[str], plan: ColumnPlan, columns: Mapping[str, npt.NDArray[Any]]) -> list[Fault]:
    """Return the faults of rows with values in some, not all, of a group's ``columns`` (N,), NaN where missing."""
    absent = np.array([np.isnan(columns[name]) for name in group])
    half = absent.any(axis=0) & ~absent.all(axis=0)
    describe = is_null(f"all of {', '.join(group)} or none")
    return [
        Fault(mask=half & missing, column=plan.mapped[name].name, describe=describe)
        for name, missing in zip(group, absent, strict=True)
        if (half & missing).any()
    ]


def indefinite_faults(entries: Sequence[str], plan: ColumnPlan, columns: Mapping[str, FloatArray]) -> list[Fault]:
    """Return the fault of rows whose covariance, columns xx, xy and yy (N,), is not positive definite."""
    xx, xy, yy = (columns[name] for name in entries)
    describe = got(xy, f"a covariance whose square is below {entries[0]} times {entries[2]}")
    with ignoring_overflow():
        indefinite = xy * xy >= xx * yy
    return [Fault(mask=indefinite, column=plan.mapped[entries[1]].name, describe=describe)] if indefinite.any() else []


def missing_std_faults(plan: ColumnPlan, columns: Mapping[str, npt.NDArray[Any]]) -> list[Fault]:
    """Return the faults of rows of bearings with a range whose std is empty: the range would not be used."""
    without = ~np.isnan(columns["range_m"]) & np.isnan(columns["range_std_m"])
    describe = is_null("the standard deviation of the row's range")
    return [Fault(mask=without, column=plan.mapped["range_std_m"].name, describe=describe)] if without.any() else []


def unit_remarks(
    batch: RecordBatch, plan: ColumnPlan, file_name_of: Mapping[str, str], scene: Scene, file: str
) -> list[str]:
    """Return remarks on the rows of a ``batch``: degrees read as metres, radians read as degrees, and the reverse.

    ``file_name_of`` are the file's own names of columns. Positions that the file lacks are those of the scene.
    """
    names = batch.table.schema.names
    own = {
        name: file_name_of[column.name]
        for name, column in plan.mapped.items()
        if file_name_of.get(column.name) in names and column.column.type == "number"
    }
    values = {name: as_float64(batch.table.column(given)) for name, given in own.items()}
    return [
        *_places_in_degrees(own, values, scene, file),
        *_angles_in_radians(plan, own, values, file),
        *_stds_in_other_units(plan, own, values, file),
    ]


def _places_in_degrees(own: Mapping[str, str], values: Mapping[str, FloatArray], scene: Scene, file: str) -> list[str]:
    remarks = []
    for owner in EARTH_PLACES:
        x, y = f"{owner}_x_m", f"{owner}_y_m"
        if x in own and y in own and _are_degrees([own[x], own[y]], values[x], values[y]):
            remarks.append(
                f"{file}: columns {own[x]!r} and {own[y]!r} are read as metres, but look like longitudes and "
                f"latitudes; if they are, read them by `columns` {owner}_lon_deg={own[x]} and `columns` "
                f"{owner}_lat_deg={own[y]}"
            )
        lat, lon = values.get(f"{owner}_lat_deg"), values.get(f"{owner}_lon_deg")
        if lat is not None and lon is not None and _are_radians(np.concatenate([2.0 * lat, lon]), 0.5 * _TURN):
            remarks.append(
                f"{file}: columns {own[f'{owner}_lat_deg']!r} and {own[f'{owner}_lon_deg']!r} are within pi / 2 and "
                "pi, and may be radians, expected degrees; convert them if they are"
            )
    positions = np.array([sensor.position for sensor in scene.sensors]).reshape(-1, 2).T
    if "sensor_x_m" not in own and "sensor_lat_deg" not in own and _are_degrees([], *positions):
        remarks.append(
            f"{file}: the positions of the scene's sensors are read as metres, but look like longitudes and latitudes; "
            "if they are, give them in columns sensor_lat_deg and sensor_lon_deg of the file"
        )
    return remarks


def _angles_in_radians(
    plan: ColumnPlan, own: Mapping[str, str], values: Mapping[str, FloatArray], file: str
) -> list[str]:
    remarks = []
    for name, given in own.items():
        column = plan.mapped[name]
        in_degrees = column.converted and column.column.unit == "rad" and "_std_" not in name
        if in_degrees and _are_radians(values[name], _TURN):
            certain = "are probably radians" if values[name].size >= _MANY_ROWS else "may be radians"
            remarks.append(
                f"{file}, column {given!r}: all {values[name].size} values are within 2 pi and {certain}, expected "
                f"degrees; if they are radians, read them by `columns` {name}={given}"
            )
    return remarks


def _stds_in_other_units(
    plan: ColumnPlan, own: Mapping[str, str], values: Mapping[str, FloatArray], file: str
) -> list[str]:
    """Return remarks on standard deviations of angles: whole numbers of degrees in radians, or too large."""
    remarks = []
    for name, given in own.items():
        column = plan.mapped[name]
        if column.column.unit != "rad" or "_std_" not in name:
            continue
        finite = values[name][np.isfinite(values[name])]
        if column.converted and _are_round_degrees(finite):
            remarks.append(
                f"{file}, column {given!r}: all values are whole or half degrees as radians, expected degrees; "
                f"if they are radians, read them by `columns` {name}={given}"
            )
        elif not column.converted and finite.size and finite.min() >= _WIDEST_STD:
            remarks.append(
                f"{file}, column {given!r}: all values are {finite.min():.3g} and more and may be degrees, expected "
                f"radians; if they are degrees, read them by `columns` {name.replace('_rad', '_deg')}={given}"
            )
    return remarks


def _are_degrees(names: Sequence[str], x: FloatArray, y: FloatArray) -> bool:
    """Return whether coordinates are degrees by their names, or since they are close together and far from (0, 0)."""
    finite = np.isfinite(x) & np.isfinite(y)
    x, y = x[finite], y[finite]
    if not x.size or np.abs(x).max() > 180.0 or np.abs(y).max() > 90.0:
        return False
    if named_like_degrees(names) is not None:
        return True
    span = max(float(np.ptp(x)), float(np.ptp(y)))
    fine = np.abs(x * 10.0 - np.round(x * 10.0)) > 1e-6
    fine |= np.abs(y * 10.0 - np.round(y * 10.0)) > 1e-6
    far = math.hypot(float(x.mean()), float(y.mean()))
    return 0.0 < span <= _WIDEST_DEG and far >= _FAR * span and far > 5.0 and bool(fine.mean() > 0.5)


def _are_radians(values: FloatArray, limit: float) -> bool:
    """Return whether angles are all within a limit in radians, and not whole numbers of degrees."""
    values = values[np.isfinite(values)]
    return values.size >= 2 and np.abs(values).max() <= limit and bool((values != np.round(values)).any())


def _are_round_degrees(std: FloatArray) -> bool:
    """Return whether small numbers with three decimals and more are, as radians, multiples of half a degree."""
    if not std.size or std.max() > _NARROWEST_STD or not std.min() > 0.0:
        return False
    halves = np.degrees(std) * 2.0
    whole = np.abs(halves - np.round(halves)) <= 0.01 * halves
    return bool((whole & (np.abs(std * 100.0 - np.round(std * 100.0)) > 1e-3)).all())
