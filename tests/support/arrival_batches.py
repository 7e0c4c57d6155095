"""Arrivals from arrays, made by equations of their own."""

from __future__ import annotations

from typing import Any

import numpy as np

from nlosctl.contract.batches import ArrivalBatch


def arrival_batch(
    sensors: Any,
    arrival_m: Any,
    std_m: Any = 0.1,
    z_m: Any = None,
    z_std_m: Any = None,
    origin_m: Any = 0.0,
    **more: Any,
) -> ArrivalBatch:
    """Return a batch of arrivals (B, K) at sensors (..., 2) or (..., 3); other arguments are broadcast."""
    arrivals = np.asfortranarray(arrival_m, dtype=float)
    shape = arrivals.shape
    sensor = np.asarray(sensors, dtype=float)
    dimension = sensor.shape[-1]
    sensor = np.broadcast_to(sensor, (*shape, dimension))
    fields: dict[str, Any] = {
        "seed": np.zeros(shape[0], dtype=np.uint64),
        "dimension": dimension,
        "sensor": np.asfortranarray(np.broadcast_to(np.arange(shape[1]), shape)),
        "sensor_xy_m": np.asfortranarray(sensor[..., :2]),
        "sensor_z_m": np.asfortranarray(sensor[..., 2]) if dimension == 3 else None,
        "arrival_m": arrivals,
        "arrival_std_m": np.asfortranarray(np.broadcast_to(np.asarray(std_m, dtype=float), shape)),
        "origin_m": np.broadcast_to(np.asarray(origin_m, dtype=float), shape[:1]).copy(),
    }
    if z_m is not None:
        fields["target_z_m"] = np.broadcast_to(np.asarray(z_m, dtype=float), shape[:1]).copy()
        fields["target_z_std_m"] = np.broadcast_to(np.asarray(z_std_m, dtype=float), shape[:1]).copy()
    return ArrivalBatch(**{**fields, **more})


def pair_batch(sensors: Any, references: Any, difference_m: Any, std_m: Any = 0.1, **more: Any) -> ArrivalBatch:
    """Return a batch of independent differences (B, K) of the arrivals at sensors and at references (..., D)."""
    differences = np.asarray(difference_m, dtype=float)
    reference = np.asarray(references, dtype=float)
    reference = np.broadcast_to(reference, (*differences.shape, reference.shape[-1]))
    more["reference_xy_m"] = np.asfortranarray(reference[..., :2])
    if reference.shape[-1] == 3:
        more["reference_z_m"] = np.asfortranarray(reference[..., 2])
    return arrival_batch(sensors, differences, std_m, **more)
