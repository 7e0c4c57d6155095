"""Small worlds of bearings with outliers, drawn for the tests of the robust methods."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import CircleField
from nlosctl.scenarios.madhow_ring import MadhowRingOptions, generate

FloatArray = npt.NDArray[np.float64]


def ring_batch(seed: int, snapshots: int, **options: Any) -> tuple[FloatArray, BearingBatch, npt.NDArray[np.bool_]]:
    """Return true positions (B, 2), a batch in the field of the disc, and which rows (B, K) are direct."""
    chosen = MadhowRingOptions(**options)
    columns = generate(chosen, np.random.default_rng(seed), snapshots)

    def dense(name: str) -> npt.NDArray[Any]:
        return np.asfortranarray(columns[name].reshape(snapshots, -1))

    rows = chosen.sensors * chosen.paths
    sensor = np.tile(np.repeat(np.arange(chosen.sensors), chosen.paths), (snapshots, 1))
    ranges = {name: dense(name) for name in ("range_m", "range_std_m") if name in columns}
    batch = BearingBatch(
        seed=np.arange(snapshots, dtype=np.uint64),
        field=CircleField(x_m=0.0, y_m=0.0, radius_m=chosen.radius_m),
        sensor=np.asfortranarray(sensor),
        sensor_xy_m=np.asfortranarray(np.stack([dense("sensor_x_m"), dense("sensor_y_m")], axis=-1)),
        bearing_rad=dense("bearing_rad"),
        bearing_std_rad=dense("bearing_std_rad"),
        path=dense("path"),
        reflector=np.full((snapshots, rows), -1, order="F"),
        **ranges,
    )
    truth = np.stack([dense("truth_x_m")[:, 0], dense("truth_y_m")[:, 0]], axis=1)
    return truth, batch, dense("truth_los")


def without_flags(batch: BearingBatch) -> BearingBatch:
    """Return the batch, wanting no flags."""
    return dataclasses.replace(batch, want_flags=False)


def mixture_cost(batch: BearingBatch, xy: FloatArray, alpha: float, fov_rad: float = np.pi) -> FloatArray:
    """Return minus (23), or its wideband form, at points (B, 2): written straight from the equations, in a loop."""
    costs = np.empty(batch.size)
    for b in range(batch.size):
        cost = 0.0
        for sensor in np.unique(batch.sensor[b]):
            rows = np.flatnonzero(batch.sensor[b] == sensor)
            direct = 0.0
            for k in rows:
                dx, dy = xy[b] - batch.sensor_xy_m[b, k]
                error = (batch.bearing_rad[b, k] - np.arctan2(dy, dx) + np.pi) % (2.0 * np.pi) - np.pi
                std = batch.bearing_std_rad[b, k]
                density = np.exp(-0.5 * (error / std) ** 2) / (std * np.sqrt(2.0 * np.pi))
                direct += (1.0 - alpha) / len(rows) * density * (1.0 / fov_rad) ** (len(rows) - 1)
            cost -= np.log(direct + alpha * (1.0 / fov_rad) ** len(rows))
        costs[b] = cost
    return costs
