"""Columns (N,) with standard deviations of the geometry of rows: those of the scene's sensors, and of the rows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nlosctl.io.measurements.row_checks import Fault, got

if TYPE_CHECKING:
    from nlosctl.io.measurements.column_mapping import ColumnPlan
    from nlosctl.io.measurements.scene_columns import SceneColumns

__all__ = [
    "CAUSE_SENSOR",
    "OFFSET_STD",
    "RANGE_OFFSET_STD",
    "REFERENCE",
    "SENSOR_STD",
    "add_geometry_stds",
    "offset_std_name",
]

SENSOR_STD = "sensor_std_m"
"""The std of each coordinate of a sensor's position."""

OFFSET_STD = "offset_std"
"""The std of what a sensor's measurements are too large by, radians of bearings and metres of ranges and arrivals."""

RANGE_OFFSET_STD = "range_offset_std_m"
"""The same of ranges beside bearings."""

CAUSE_SENSOR = "cause_sensor"
"""The code of the sensor that shares these errors: that of the one station for all its repeated readings."""

REFERENCE = "reference_{}"
"""The same columns of the references of differences."""

_OFFSETS = {"bearings": "heading_std_deg", "ranges": "range_offset_std_m", "arrivals": "arrival_offset_std_m"}


def offset_std_name(kind: str) -> str:
    """Return the key of the scene with the std of what a sensor's measurements of a kind are too large by."""
    return _OFFSETS[kind]


def add_geometry_stds(
    plan: ColumnPlan, scene: SceneColumns, columns: dict[str, npt.NDArray[Any]], faults: list[Fault]
) -> None:
    """Add the standard deviations (N,) of sensors, and the faults of rows with a negative one.

    That of a position is the row's, else the scene's.
    """
    given = columns.get(SENSOR_STD)
    if given is not None and (given < 0.0).any():
        mapped = plan.mapped[SENSOR_STD]
        describe = got(given / mapped.scale, "a standard deviation from 0")
        faults.append(Fault(mask=given < 0.0, column=mapped.name, describe=describe))
    kind = plan.table.name
    scale = np.pi / 180.0 if kind == "bearings" else 1.0
    for node, name in (("sensor", "{}"), ("reference", REFERENCE)):
        if node not in columns:
            continue
        sensor = columns[node]
        own = scene.stds_of(sensor, "position_std_m", columns)
        if node == "sensor" and given is not None:
            own = np.where(np.isnan(given), own, given)
        columns[name.format(SENSOR_STD)] = own
        columns[name.format(OFFSET_STD)] = scale * scene.stds_of(sensor, _OFFSETS[kind], columns)
    if kind == "bearings":
        columns[RANGE_OFFSET_STD] = scene.stds_of(columns["sensor"], "range_offset_std_m", columns)
    columns[CAUSE_SENSOR] = columns["sensor"]
