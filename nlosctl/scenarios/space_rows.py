"""Rows of simulated files in three dimensions: columns of azimuths and elevations, and of ranges."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import KINDS
from nlosctl.geometry.angles import wrap_angle
from nlosctl.models.space.paths import predict_directions
from nlosctl.scenarios.spec import Columns

__all__ = [
    "direction_columns",
    "in_table_order",
    "measured_heights",
    "sensor_coordinates",
    "spread_stds",
    "within_zenith",
]


def sensor_coordinates(scene: Scene) -> FloatArray:
    """Return x, y and z of the sensors of a scene, shape (K, 3)."""
    return np.array([(*sensor.position, sensor.z_m or 0.0) for sensor in scene.sensors])


def spread_stds(generator: np.random.Generator, std: float, shape: tuple[int, int]) -> FloatArray:
    """Return standard deviations from half to twice ``std``."""
    return std * generator.uniform(0.5, 2.0, shape)


def within_zenith(azimuth_rad: FloatArray, elevation_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return directions whose elevations are within +-90 degrees: one beyond is that of the opposite azimuth."""
    beyond = np.abs(elevation_rad) > 0.5 * np.pi
    turned = np.copysign(np.pi, elevation_rad) - elevation_rad
    return np.where(beyond, azimuth_rad + np.pi, azimuth_rad), np.where(beyond, turned, elevation_rad)


def direction_columns(
    *,
    scene: Scene,
    generator: np.random.Generator,
    source_m: FloatArray,
    reflector: IntArray,
    stds_rad: tuple[FloatArray, FloatArray],
    wrong: float = 0.0,
    without_elevation: float = 0.0,
    stated: bool = True,
    follows_path: BoolArray | bool = True,
) -> Columns:
    """Return the flat columns (B K,) of B snapshots with one row from each of the K sensors of a scene in space.

    ``source_m`` (B, 3) in metres; ``reflector`` (B, K) indexes ``scene.reflectors``, -1 for the direct path, and is a
    column if it is ``stated`` and the scene has reflectors. ``stds_rad`` are those of azimuths and elevations (B, K).
    Errors are Gaussian. ``wrong`` is the share of rows with an azimuth and an elevation anywhere, ``without_elevation``
    that of rows with an azimuth alone. ``truth_los`` is false for rows that are wrong or do not follow their path.
    """
    shape = reflector.shape
    sensor = np.broadcast_to(sensor_coordinates(scene), (*shape, 3))
    source = tuple(np.broadcast_to(source_m[:, None, axis], shape) for axis in range(3))
    azimuth, elevation = predict_directions(tuple(sensor[..., axis] for axis in range(3)), source, reflector, scene)
    noise = generator.standard_normal((2, *shape))
    azimuth, elevation = azimuth + noise[0] * stds_rad[0], elevation + noise[1] * stds_rad[1]
    azimuth, elevation = within_zenith(azimuth, elevation)
    right = generator.random(shape) >= wrong
    azimuth = np.where(right, azimuth, generator.uniform(-np.pi, np.pi, shape))
    elevation = np.where(right, elevation, generator.uniform(-0.5 * np.pi, 0.5 * np.pi, shape))
    missing = generator.random(shape) < without_elevation
    names = np.array([sensor.name for sensor in scene.sensors], dtype=object)
    paths = np.array([*scene.reflector_names, None], dtype=object)[reflector.ravel()]
    columns = {
        "snapshot": np.repeat(np.arange(shape[0], dtype=np.int64), shape[1]),
        "sensor": np.tile(names, shape[0]),
        "sensor_x_m": sensor[..., 0].ravel(),
        "sensor_y_m": sensor[..., 1].ravel(),
        "sensor_z_m": sensor[..., 2].ravel(),
        "bearing_rad": wrap_angle(azimuth).ravel(),
        "bearing_std_rad": stds_rad[0].ravel(),
        "elevation_rad": np.where(missing, np.nan, elevation).ravel(),
        "elevation_std_rad": np.where(missing, np.nan, stds_rad[1]).ravel(),
        **({"reflector": paths} if stated and scene.reflectors else {}),
        "truth_x_m": np.repeat(source_m[:, 0], shape[1]),
        "truth_y_m": np.repeat(source_m[:, 1], shape[1]),
        "truth_z_m": np.repeat(source_m[:, 2], shape[1]),
        "truth_los": (right & follows_path).ravel(),
    }
    return in_table_order("bearings", columns)


def measured_heights(generator: np.random.Generator, height_m: FloatArray, std_m: float, rows: int) -> Columns:
    """Return the columns of heights (B,) measured with a standard deviation, the same in all rows of a snapshot."""
    measured = height_m + std_m * generator.standard_normal(height_m.shape)
    return {"target_z_m": np.repeat(measured, rows), "target_z_std_m": np.full(rows * height_m.size, std_m)}


def in_table_order(kind: str, columns: Columns) -> Columns:
    """Return columns in the order of the table of their kind."""
    return {column.name: columns[column.name] for column in KINDS[kind].all_columns if column.name in columns}
