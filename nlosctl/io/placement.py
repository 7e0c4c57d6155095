"""Rows whose sensor can't be where it is: outside the circle that it sees by, or under the opaque one within."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.scene import Scene
from nlosctl.io.columns import ColumnPlan
from nlosctl.io.faults import Fault
from nlosctl.models.circle_rows import circle_table, misplaced_sensors

__all__ = ["placement_faults"]


def placement_faults(scene: Scene, plan: ColumnPlan, columns: Mapping[str, npt.NDArray[Any]]) -> list[Fault]:
    """Return the faults of rows by a circle whose sensor is not inside of it, or under its blocker.

    ``columns`` are the canonical columns (N,) of a record batch.
    """
    if not scene.has_circles or "reflector" not in columns:
        return []
    place = columns["reflector"]
    table = circle_table(scene)
    known = (place >= 0) & np.isfinite(columns["sensor_x_m"]) & np.isfinite(columns["sensor_y_m"])
    rows = np.flatnonzero(known)  # not those by a reflector that the scene lacks
    rows = rows[np.isfinite(table[0])[place[rows]]]
    center_x, center_y, radius, blocker, _ = (column[place[rows]] for column in table)
    distance = np.hypot(columns["sensor_x_m"][rows] - center_x, columns["sensor_y_m"][rows] - center_y)
    outside, under = misplaced_sensors(distance, radius, blocker)
    name = plan.found["sensor_x_m"].name if "sensor_x_m" in plan.found else "sensor_x_m"
    faults = []
    for wrong, limit, expected in (
        (outside, radius, "less than its radius"),
        (under, blocker, "at least the radius of its blocker"),
    ):
        if wrong.any():
            faults.append(_fault(name, place.shape[0], rows[wrong], distance[wrong], limit[wrong], expected))
    return faults


def _fault(
    column: str,
    size: int,
    rows: npt.NDArray[np.int64],
    distance: npt.NDArray[np.float64],
    limit: npt.NDArray[np.float64],
    expected: str,
) -> Fault:
    mask = np.zeros(size, dtype=np.bool_)
    mask[rows] = True
    told = {int(row): (float(d), float(r)) for row, d, r in zip(rows, distance, limit, strict=True)}

    def describe(row: int) -> str:
        away, radius = told[row]
        return f"the sensor is {away:.10g} m from the centre of its circle, expected {expected}, {radius:.10g} m"

    return Fault(mask=mask, column=column, describe=describe)
