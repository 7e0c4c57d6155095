"""Sensors at a height: slant ranges become ranges to targets in a plane."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy.typing as npt

from nlosctl.errors import UsageError

__all__ = ["heights_remark", "with_sensor_heights"]

_COLUMN = "sensor_z_m"
Columns = Mapping[str, npt.NDArray[Any]]


def with_sensor_heights(columns: Columns, target_z_m: float | None) -> Columns:
    """Return the flat columns (N,) with ``sensor_height_m``: each sensor's height over the targets' plane, metres.

    Without ``target_z_m`` they stay as they are: everything is taken as measured in the plane. Raises UsageError
    where a target height is given for measurements without ``sensor_z_m``.
    """
    if target_z_m is None:
        return columns
    if _COLUMN not in columns:
        raise UsageError(f"--target-z-m needs the column {_COLUMN!r}, the height of each sensor")
    return {**columns, "sensor_height_m": columns[_COLUMN] - target_z_m}


def heights_remark(names: Sequence[str], target_z_m: float | None) -> list[str]:
    """Return what to say of sensor heights that nobody asked to use."""
    if _COLUMN not in names or target_z_m is not None:
        return []
    return [f"the column {_COLUMN!r} is not used without --target-z-m: everything is taken as measured in one plane"]
