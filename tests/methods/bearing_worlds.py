"""Simulated bearings with their truth, for the tests of methods."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from batches import bearing_batch

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Estimates, Flags
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.contract.statuses import Status
from nlosctl.models.bearing_predictions import predict_bearings

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class World:
    """A batch of bearings and their sources (B, 2)."""

    batch: BearingBatch
    source_xy_m: FloatArray


def draw_world(
    snapshots: int,
    measurements: int,
    std_rad: Sequence[float] = (0.01, 0.01),
    *,
    seed: int = 1,
    scale_m: float = 1e3,
    offset_m: tuple[float, float] = (0.0, 0.0),
    noise: float = 1.0,
) -> World:
    """Draw a mixed world: half of the rows by one of two mirrors (one vertical), with the field on one side of both.

    The sensors form a ring about the field of the sources, so that no source is near one; ``std_rad`` is the span of
    the (log-uniform) stds, ``noise`` scales the errors.
    """
    generator = np.random.default_rng(seed)
    shape = (snapshots, measurements)
    scene = Scene(
        reflectors=(
            LineReflector(name="vertical", point=(offset_m[0] + 1.6 * scale_m, offset_m[1]), direction=(0.0, 3.0)),
            LineReflector(name="sloping", point=(offset_m[0], offset_m[1] + 2.0 * scale_m), direction=(-2.0, -1.0)),
        )
    )
    around = generator.uniform(-np.pi, np.pi, (snapshots, 1)) + 2.4 * np.arange(measurements)
    radius = scale_m * generator.uniform(0.8, 1.2, shape)
    sensor_xy = np.stack([radius * np.cos(around), radius * np.sin(around)], axis=-1) + np.array(offset_m)
    source = scale_m * generator.uniform(-0.4, 0.4, (snapshots, 2)) + np.array(offset_m)
    reflector = generator.choice([-1, -1, 0, 1], size=shape)
    std = np.exp(generator.uniform(np.log(std_rad[0]), np.log(std_rad[1]), shape))
    exact = predict_bearings(sensor_xy, reflector, scene, np.broadcast_to(source[:, None], sensor_xy.shape))
    bearing = exact + noise * std * generator.normal(size=shape)
    return World(batch=bearing_batch(sensor_xy, bearing, std, reflector, scene), source_xy_m=source)


def estimate(method: MethodSpec, batch: BearingBatch, **options: Any) -> Estimates:
    """Return the estimates of a method."""
    estimates: Estimates = method.solve(batch, method.options(**options)).estimates
    return estimates


def flags_of(method: MethodSpec, batch: BearingBatch) -> Flags:
    """Return the flags of a method."""
    flags = method.solve(batch, method.options()).flags
    assert flags is not None
    return flags


def words(estimates: Estimates) -> list[str]:
    """Return the status words."""
    return [Status(int(status)).word for status in estimates.status]


def squared_mahalanobis(estimates: Estimates, truth: FloatArray) -> FloatArray:
    """Return the squared error in the metric of the reported covariance (NEES); NaN without a covariance."""
    xx, xy, yy = estimates.covariance_m2.T
    dx, dy = (estimates.position_m - truth).T
    result: FloatArray = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    return result
