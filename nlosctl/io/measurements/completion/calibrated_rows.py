"""Measurements without the offsets of their sensors, with their standard deviations scaled."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import batch_class
from nlosctl.contract.calibration import Calibration
from nlosctl.io.measurements.completion.array_deviations import deviated_rows, sector_of
from nlosctl.io.measurements.completion.exact_numbers import REST
from nlosctl.io.measurements.completion.geometry_stds import REFERENCE
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
    """Return the chunk after a calibration, and the keys of its sensors that the calibration lacks.

    Differences of arrivals lose the offset of their sensor and have that of their reference.
    """
    entry, lacking = _entries(chunk, calibration, "sensor")
    offsets = np.array([*(known.offset for known in calibration.entries), 0.0]) * calibration.quantity.scale
    scales = np.array([*(known.std_factor for known in calibration.entries), 1.0])
    if calibration.harmonics:
        return _without_deviations(chunk, calibration, entry, scales[entry]), lacking
    offset, added = offsets[entry], {OFFSET_ENTRY: entry, STD_FACTOR: scales[entry]}
    if "reference" in chunk.columns:
        of_reference, without = _entries(chunk, calibration, "reference")
        offset = offset - offsets[of_reference]
        lacking = list(dict.fromkeys([*lacking, *without]))
        added[REFERENCE.format(OFFSET_ENTRY)] = of_reference
        added["reference_std_m"] = chunk.columns["reference_std_m"] * scales[of_reference]
    columns = calibrated_columns(chunk.columns, calibration.kind, offset, scales[entry])
    return replace(chunk, columns={**columns, **added}), lacking


def _entries(chunk: Chunk, calibration: Calibration, of: str) -> tuple[IntArray, list[tuple[str, ...]]]:
    """Return the entry (N,) of each row's sensor or reference, -1 without one, and the keys that have none."""
    codes, keys = sensor_keys(chunk, calibration.by, of)
    index = {entry.key: number for number, entry in enumerate(calibration.entries)}
    entries = np.array([index.get(key, -1) for key in keys], dtype=np.int64)
    return entries[codes], [key for key, entry in zip(keys, entries.tolist(), strict=True) if entry < 0]


def _without_deviations(chunk: Chunk, calibration: Calibration, entry: IntArray, std_scale: FloatArray) -> Chunk:
    """Return the chunk without the deviations of its rows' entries (N,), each with the sector of its direction."""
    terms = np.array([*(known.terms for known in calibration.entries), (0.0,) * calibration.terms])
    columns, rows = deviated_rows(chunk.columns, terms[entry] * calibration.quantity.scale)
    for name in batch_class(calibration.kind).STDS:
        if name in columns:
            columns[name] = columns[name] * std_scale
    sectors = calibration.sectors
    sector = np.where(entry < 0, -1, entry * sectors + sector_of(rows.direction, sectors))
    factor = std_scale / (1.0 + rows.slope)
    return replace(chunk, columns={**columns, OFFSET_ENTRY: sector, STD_FACTOR: factor})


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
