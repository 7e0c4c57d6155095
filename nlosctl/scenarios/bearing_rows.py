"""Rows of a simulated bearings file: what every bearings scenario does once its geometry is drawn."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.models.bearings import predict_bearings
from nlosctl.scenarios.spec import Columns

__all__ = ["bearing_columns", "sensor_names"]


def sensor_names(count: int) -> tuple[str, ...]:
    """Return the names s1, s2, ... of ``count`` sensors."""
    return tuple(f"s{number}" for number in range(1, count + 1))


def bearing_columns(
    *,
    scene: Scene,
    generator: np.random.Generator,
    names: tuple[str, ...],
    sensor_xy_m: FloatArray,
    source_xy_m: FloatArray,
    bearing_std_rad: FloatArray,
    reflector: IntArray | None = None,
    outlier_fraction: float = 0.0,
) -> Columns:
    """Return the flat columns (B K,) of B snapshots with one row from each of K sensors.

    ``sensor_xy_m`` (B, K, 2) and ``source_xy_m`` (B, 2) in metres; ``bearing_std_rad`` (B, K); ``reflector``
    (B, K) places in ``scene.reflectors``, -1 for the direct path. Errors are Gaussian. That fraction of the rows
    is an outlier: its bearing is uniform over the circle and ``truth_los`` false. ``reflector`` is a column only
    where the scene has reflectors. The errors are drawn first and scaled then: worlds that differ in their
    standard deviations alone share their noise.
    """
    snapshots, sensors = bearing_std_rad.shape
    if reflector is None:
        reflector = np.full((snapshots, sensors), -1, dtype=np.int64)
    source = np.broadcast_to(source_xy_m[:, None, :], sensor_xy_m.shape)
    noise = generator.standard_normal((snapshots, sensors)) * bearing_std_rad
    bearing = predict_bearings(sensor_xy_m, reflector, scene, source) + noise
    follows_path = generator.random((snapshots, sensors)) >= outlier_fraction
    bearing = np.where(follows_path, bearing, generator.uniform(-np.pi, np.pi, (snapshots, sensors)))
    return {
        "snapshot": np.repeat(np.arange(snapshots, dtype=np.int64), sensors),
        "sensor": np.tile(np.array(names, dtype=object), snapshots),
        "sensor_x_m": sensor_xy_m[..., 0].ravel(),
        "sensor_y_m": sensor_xy_m[..., 1].ravel(),
        "bearing_rad": wrap_angle(bearing).ravel(),
        "bearing_std_rad": bearing_std_rad.ravel(),
        **_reflector_column(scene, reflector),
        "truth_x_m": np.repeat(source_xy_m[:, 0], sensors),
        "truth_y_m": np.repeat(source_xy_m[:, 1], sensors),
        "truth_los": follows_path.ravel(),
    }


def _reflector_column(scene: Scene, reflector: IntArray) -> Columns:
    if not scene.reflectors:
        return {}
    return {"reflector": np.array([*scene.reflector_names, None], dtype=object)[reflector.ravel()]}
