"""Rows of a simulated bearings file: error models, and the columns that follow from a scenario's geometry."""

from __future__ import annotations

from math import pi, sqrt
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.scenarios.spec import Columns

__all__ = ["ErrorModel", "bearing_columns", "bearing_errors", "sensor_names"]

ErrorModel = Literal["gaussian", "laplace", "cauchy"]

_RIGHT_ANGLE = 0.5 * pi


def sensor_names(count: int) -> tuple[str, ...]:
    """Return the names s1, s2, ... of ``count`` sensors."""
    return tuple(f"s{number}" for number in range(1, count + 1))


def bearing_errors(generator: np.random.Generator, model: ErrorModel, std_rad: FloatArray) -> FloatArray:
    """Return bearing errors of the shape of ``std_rad``, truncated to a right angle on either side.

    The models of Ananthasubramaniam and Madhow, Section II. gaussian: (1); laplace: (2), with standard deviation
    ``std_rad`` before truncation; cauchy (not in the paper): ``std_rad`` is the half width at half maximum. Sampled by
    inverting the distribution function.
    """
    uniform = generator.uniform(-1.0, 1.0, std_rad.shape)
    if model == "laplace":
        scale = std_rad / sqrt(2.0)
        inside = -np.expm1(-_RIGHT_ANGLE / scale)  # (2) as corrected: 1 - exp(-pi / (sqrt(2) sigma))
        return np.asarray(-scale * np.sign(uniform) * np.log1p(-np.abs(uniform) * inside))
    if model == "cauchy":
        return np.asarray(std_rad * np.tan(uniform * np.arctan(_RIGHT_ANGLE / std_rad)))
    from scipy.special import erf, erfinv  # slow to import

    return np.asarray(sqrt(2.0) * std_rad * erfinv(uniform * erf(_RIGHT_ANGLE / (sqrt(2.0) * std_rad))))


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

    ``sensor_xy_m`` (B, K, 2) and ``source_xy_m`` (B, 2) in metres; ``bearing_std_rad`` (B, K); ``reflector`` (B, K)
    indexes ``scene.reflectors``, -1 for the direct path. Errors are Gaussian. Outliers, ``outlier_fraction`` of the
    rows, have a bearing uniform over the circle and ``truth_los`` false. ``reflector`` is a column only if the scene
    has reflectors. Standard normal errors are drawn first, then scaled: worlds that differ only in their standard
    deviations share their noise.
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
