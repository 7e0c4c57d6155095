"""The causes of errors that the rows of a batch share, from the columns of its chunk, its scene and a calibration."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.calibration import Calibration
from nlosctl.io.measurements.completion.calibrated_rows import OFFSET_ENTRY
from nlosctl.io.measurements.completion.geometry_stds import (
    CAUSE_SENSOR,
    OFFSET_STD,
    RANGE_OFFSET_STD,
    REFERENCE,
    SENSOR_STD,
)
from nlosctl.models.shared_causes.causes import SensorCauses, SharedCauses, has_uncertain_reflectors

__all__ = ["Columns", "batch_causes"]

Columns = Mapping[str, npt.NDArray[Any]]


def batch_causes(columns: Columns, row: IntArray, batch: Any, calibration: Any = None) -> SharedCauses:
    """Return what is not exactly known in a batch of the rows (B, K) of a chunk's ``columns`` (N,).

    The offset of a sensor that the calibration has is known as the calibration states, whatever the scene does.
    """
    covariance = calibration.correlated() if isinstance(calibration, Calibration) else np.zeros((0, 0))
    sensor = batch.sensor[:, : row.shape[1]]
    if CAUSE_SENSOR in columns:
        shared = columns[CAUSE_SENSOR][row]
        sensor = np.where(np.isnan(shared), sensor, shared).astype(np.int64)
    sensors = _gathered(columns, row, sensor, "{}")
    reference = None
    if getattr(batch, "reference_xy_m", None) is not None:
        reference = _gathered(columns, row, columns["reference"][row], REFERENCE)
    elif batch.sensor.shape[1] > row.shape[1]:
        of_reference = _gathered(columns, row[:, :1], batch.sensor[:, row.shape[1] :], REFERENCE)
        parts = zip(vars(sensors).values(), vars(of_reference).values(), strict=True)
        sensors = SensorCauses(*(np.concatenate(pair, axis=1) for pair in parts))
    mirrors = has_uncertain_reflectors(batch.scene, getattr(batch, "reflector", None))
    return SharedCauses(sensors, covariance, reference, mirrors)


def _gathered(columns: Columns, row: IntArray, sensor: IntArray, name: str) -> SensorCauses:
    """Return what is not exactly known of the sensors (B, K), by the columns ``name`` is a pattern of."""

    def std(column: str) -> FloatArray:
        values = columns.get(name.format(column))
        return np.zeros(row.shape) if values is None else np.nan_to_num(values[row])

    entries = columns.get(name.format(OFFSET_ENTRY))
    entry = np.full(row.shape, -1, dtype=np.int64) if entries is None else entries[row]
    offset = np.where(entry < 0, std(OFFSET_STD), 0.0)
    return SensorCauses(sensor, std(SENSOR_STD), offset, std(RANGE_OFFSET_STD), entry)
