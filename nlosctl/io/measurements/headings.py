"""Directions relative to the heading of their sensor or array: the heading is added, and its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import ColumnPlan, MappedColumn
from nlosctl.io.measurements.completion.geometry_stds import OFFSET_STD
from nlosctl.io.measurements.row_checks import Fault, got

__all__ = ["add_headings", "require_headings"]


def require_headings(plan: ColumnPlan, scene: Scene, file: str) -> None:
    """Raise DataError if a relative direction has no heading, neither a column nor one in the scene."""
    for name in plan.relative:
        mapped = plan.mapped[name]
        heading = mapped.column.heading_names[0]
        if heading not in plan.mapped and all(sensor.heading_deg is None for sensor in scene.sensors):
            raise DataError(
                f"{file}, column {mapped.name!r}: is relative to a heading, but there is no column {heading!r} and "
                f"no heading_deg of a sensor in the scene; add one of them"
            )


def add_headings(
    columns: dict[str, npt.NDArray[Any]],
    plan: ColumnPlan,
    scene: Scene,
    nodes: Sequence[tuple[Sequence[str], IntArray]],
    faults: list[Fault],
) -> None:
    """Add the headings to the relative directions in ``columns``; ``nodes`` has the names (N,) of each one's nodes and
    their entries (N,) in the scene, -1 for none.

    A heading is that of the row, else that of the scene's sensor; a row without one is a fault. The variance of a
    row's heading adds to that of the direction; that of a heading in the scene is an error that all bearings of the
    sensor share, and adds to triplets alone. ``columns`` keeps the heading in radians, for other readings of the angle.
    """
    for name, (names, entries) in zip(plan.relative, nodes, strict=True):
        mapped = plan.mapped[name]
        heading_name, std_name = mapped.column.heading_names
        scene_deg = np.array([*(known.heading_deg for known in scene.sensors), None], dtype=np.float64)[entries]
        scene_std_deg = np.array([*(known.heading_std_deg for known in scene.sensors), None], dtype=np.float64)[entries]
        own_deg = columns.pop(heading_name, scene_deg)
        heading_deg = np.where(np.isnan(own_deg), scene_deg, own_deg)
        own_std_deg = columns.pop(std_name, np.full(scene_std_deg.shape, np.nan))
        std_deg = np.where(np.isnan(own_std_deg), scene_std_deg, own_std_deg)
        if OFFSET_STD in columns:
            columns[OFFSET_STD] = np.where(np.isnan(own_std_deg), columns[OFFSET_STD], 0.0)
            std_deg = np.nan_to_num(own_std_deg)
        faults += _faults(mapped, names, heading_deg, std_deg)
        heading_rad = np.radians(heading_deg)
        columns[name] = columns[name] - heading_rad
        columns[heading_name.replace("_deg", "_rad")] = heading_rad
        deviation = name.replace("_rad", "_std_rad")
        columns[deviation] = np.hypot(columns[deviation], np.radians(np.nan_to_num(std_deg)))


def _faults(mapped: MappedColumn, names: Sequence[str], heading_deg: FloatArray, std_deg: FloatArray) -> list[Fault]:
    heading_name, std_name = mapped.column.heading_names
    faults = []
    unknown = np.isnan(heading_deg)
    if unknown.any():
        faults.append(
            Fault(
                mask=unknown,
                column=mapped.name,
                describe=lambda index: (
                    f"the row has no {heading_name}, and the scene no heading of {names[index]!r}; give one of them"
                ),
            )
        )
    if (std_deg < 0.0).any():
        faults.append(Fault(mask=std_deg < 0.0, column=std_name, describe=got(std_deg, "a number from 0")))
    return faults
