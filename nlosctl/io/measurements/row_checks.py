"""Columns that say something only together, such as a prior's x, y and std: all of them or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError
from nlosctl.io.measurements.bad_rows import Fault
from nlosctl.io.measurements.column_mapping import ColumnPlan
from nlosctl.models.circle_rows import circle_table, misplaced_sensors

__all__ = ["half_filled_faults", "placement_faults", "require_together"]


def require_together(plan: ColumnPlan, file: str) -> None:
    """Raise DataError where a file has some, not all, of the columns that belong together."""
    for group in plan.table.together:
        there = [name for name in group if name in plan.found]
        if there and len(there) < len(group):
            absent = [name for name in group if name not in plan.found]
            raise DataError(
                f"{file}: column {plan.found[there[0]].name!r} says nothing without {_listed(absent)}; "
                f"give all of {', '.join(group)}, or drop {_listed(there)}"
            )


def half_filled_faults(plan: ColumnPlan, columns: Mapping[str, npt.NDArray[Any]]) -> list[Fault]:
    """Return the faults of rows that have some, not all, of the values that belong together.

    ``columns`` are the canonical columns (N,) of a record batch, NaN where a value is missing.
    """
    faults = []
    for group in plan.table.together:
        if all(name in plan.found for name in group):
            absent = np.array([np.isnan(columns[name]) for name in group])
            half = absent.any(axis=0) & ~absent.all(axis=0)
            for name, missing in zip(group, absent, strict=True):
                if (half & missing).any():
                    faults.append(_half_filled_fault(half & missing, plan.found[name].name, group))
    return faults


def _half_filled_fault(mask: BoolArray, column: str, group: Sequence[str]) -> Fault:
    told = f"empty (null), expected all of {', '.join(group)} or none"
    return Fault(mask=mask, column=column, describe=lambda _: told)


def _listed(names: Sequence[str]) -> str:
    return " and ".join(map(repr, names))


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
            faults.append(_placement_fault(name, place.shape[0], rows[wrong], distance[wrong], limit[wrong], expected))
    return faults


def _placement_fault(
    column: str,
    size: int,
    rows: IntArray,
    distance: FloatArray,
    limit: FloatArray,
    expected: str,
) -> Fault:
    mask = np.zeros(size, dtype=np.bool_)
    mask[rows] = True
    told = {int(row): (float(d), float(r)) for row, d, r in zip(rows, distance, limit, strict=True)}

    def describe(row: int) -> str:
        away, radius = told[row]
        return f"the sensor is {away:.10g} m from the centre of its circle, expected {expected}, {radius:.10g} m"

    return Fault(mask=mask, column=column, describe=describe)
