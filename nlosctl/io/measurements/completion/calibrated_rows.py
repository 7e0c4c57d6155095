"""Measurements without the offsets of their sensors, with their standard deviations scaled."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.batches import batch_class
from nlosctl.contract.calibration import Calibration
from nlosctl.io.measurements.completion.exact_numbers import REST
from nlosctl.io.measurements.completion.sensor_keys import sensor_keys

if TYPE_CHECKING:
    from nlosctl.io.measurements.reader import Chunk

__all__ = ["OFFSET_ENTRY", "STD_FACTOR", "calibrated_chunk", "calibrated_columns"]

OFFSET_ENTRY = "offset_entry"
"""The column with the index of each row's entry of the calibration, -1 without one."""

STD_FACTOR = "std_factor"
"""The column with the factor of each row's standard deviations, which flags have too."""

_LEAST_SHARE = 1e-3
"""A range that is not longer than its offset becomes this share of its standard deviation: ranges are positive."""


def calibrated_chunk(chunk: Chunk, calibration: Calibration) -> tuple[Chunk, list[tuple[str, ...]]]:
    """Return the chunk after a calibration, and the keys of its sensors that the calibration lacks."""
    codes, keys = sensor_keys(chunk, calibration.by)
    index = {entry.key: number for number, entry in enumerate(calibration.entries)}
    entries = np.array([index.get(key, -1) for key in keys], dtype=np.int64)
    lacking = [key for key, entry in zip(keys, entries.tolist(), strict=True) if entry < 0]
    offset = np.array([*(entry.offset for entry in calibration.entries), 0.0])[entries] * calibration.quantity.scale
    scale = np.array([*(entry.std_factor for entry in calibration.entries), 1.0])[entries]
    columns = calibrated_columns(chunk.columns, calibration.kind, offset[codes], scale[codes])
    return replace(chunk, columns={**columns, OFFSET_ENTRY: entries[codes], STD_FACTOR: scale[codes]}), lacking


def calibrated_columns(
    columns: Any, kind: str, offset: FloatArray, std_scale: FloatArray
) -> dict[str, npt.NDArray[Any]]:
    """Return the columns (N,) of a kind without the rows' offsets (N,), their stds times ``std_scale`` (N,)."""
    changed: dict[str, npt.NDArray[Any]] = dict(columns)
    for name in batch_class(kind).STDS:
        if name in changed:
            changed[name] = changed[name] * std_scale
    if kind == "bearings":
        changed["bearing_rad"] = changed["bearing_rad"] - offset
    elif kind == "ranges":
        shorter = changed["range_m"] - offset
        least = np.minimum(changed["range_m"], _LEAST_SHARE * changed["range_std_m"])
        changed["range_m"] = np.where(offset == 0.0, changed["range_m"], np.maximum(shorter, least))
    else:
        changed[REST] = changed[REST] - offset
    return changed
