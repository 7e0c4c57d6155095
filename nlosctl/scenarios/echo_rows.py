"""Rows of a simulated file of unlabelled echoes: the signal model (1) of Liang, Zeng, Li."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.contract.options import option
from nlosctl.scenarios.bearing_rows import sensor_names
from nlosctl.scenarios.spec import Columns

__all__ = ["EchoOptions", "echo_columns"]


@dataclass(frozen=True, kw_only=True)
class EchoOptions:
    """Parameters of all scenarios with unlabelled echoes."""

    targets: int = option(3, minimum=0, maximum=1000, meaning="targets in each snapshot")
    scatterers: int = option(3, minimum=0, maximum=1000, meaning="scatterers; each one echoes every target")
    range_std_m: float = option(
        1.0,
        unit="m",
        minimum=0.0,
        exclusive=True,
        meaning="standard deviation of every range (1 m is 0 dB in the paper)",
    )
    detection_probability: float = option(
        1.0, minimum=0.0, maximum=1.0, meaning="probability that a sensor detects the direct echo of a target"
    )
    false_echoes: float = option(
        0.0,
        minimum=0.0,
        maximum=1000.0,
        meaning="mean number of false echoes per sensor, uniform up to the longest true range; without targets, "
        "each has the range that a real echo of a target of its own would have",
    )
    nlos_range: Literal["sum", "half"] = option(
        "sum",
        meaning="range via a scatterer: sum: to the target, on to the scatterer and back, (1); half: half of that",
    )


def echo_columns(
    *,
    options: EchoOptions,
    generator: np.random.Generator,
    sensor_xy_m: FloatArray,
    draw_targets: Callable[[tuple[int, ...]], FloatArray],
    scatterer_xy_m: FloatArray,
) -> Columns:
    """Return the flat columns of B snapshots, the rows of each in random order; equation (1).

    Sensors (B, N, 2) and scatterers (B, L, 2) in metres; ``draw_targets`` returns targets (..., 2) for a shape. A
    direct range is one way; a range via a scatterer is |p - a| + |p - s| + |s - a|, or half of that.
    ``truth_target`` and the true position are NaN for a false echo.
    """
    snapshots, sensors, targets = *sensor_xy_m.shape[:2], options.targets
    target_xy_m = draw_targets((snapshots, targets))
    direct, detour = _ranges(sensor_xy_m, target_xy_m, scatterer_xy_m)
    if options.nlos_range == "half":
        detour *= 0.5
    false_count = generator.poisson(options.false_echoes, (snapshots, sensors))
    most_false = int(false_count.max(initial=0))
    if targets:
        span = np.maximum(direct.max(initial=0.0, axis=(1, 2)), detour.max(initial=0.0, axis=(1, 2, 3)))
        false = span[:, None, None] * generator.uniform(0.0, 1.0, (snapshots, sensors, most_false))
    else:
        unseen = draw_targets((snapshots, sensors * most_false)).reshape(snapshots * sensors, most_false, 2)
        false = _ranges_of_any_path(options, generator, sensor_xy_m, unseen, scatterer_xy_m)
    parts = [direct, detour.reshape(snapshots, sensors, -1), false]
    detected = [
        generator.random(direct.shape) < options.detection_probability,
        np.ones(parts[1].shape, dtype=bool),
        np.arange(most_false) < false_count[..., None],
    ]
    number = np.arange(targets, dtype=np.float64)
    labels = [number, np.repeat(number, scatterer_xy_m.shape[1]), np.full(most_false, np.nan)]
    ranges, is_echo = np.concatenate(parts, axis=2), np.concatenate(detected, axis=2)
    noisy = np.abs(ranges + options.range_std_m * generator.standard_normal(ranges.shape))
    los = np.arange(ranges.shape[2]) < targets
    return _shuffled(generator, sensor_xy_m, target_xy_m, noisy, is_echo, np.concatenate(labels), los, options)


def _ranges(sensor: FloatArray, target: FloatArray, scatterer: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return direct ranges (B, N, K) and ranges via scatterers (B, N, K, L)."""

    def distance(start: FloatArray, end: FloatArray) -> FloatArray:
        offset = start[:, :, None] - end[:, None]
        return np.hypot(offset[..., 0], offset[..., 1])

    direct = distance(sensor, target)
    detour = direct[..., None] + distance(target, scatterer)[:, None] + distance(sensor, scatterer)[:, :, None]
    return direct, detour


def _ranges_of_any_path(
    options: EchoOptions,
    generator: np.random.Generator,
    sensor_xy_m: FloatArray,
    target_xy_m: FloatArray,
    scatterer_xy_m: FloatArray,
) -> FloatArray:
    """Return ranges (B, N, F) from each sensor (B, N, 2) to targets (B N, F, 2) of its own, by one path drawn of all.

    No two sensors share a target: the ranges have the distribution of real echoes, and no common origin.
    """
    snapshots, sensors = sensor_xy_m.shape[:2]
    count = scatterer_xy_m.shape[1]
    direct, detour = _ranges(sensor_xy_m.reshape(-1, 1, 2), target_xy_m, np.repeat(scatterer_xy_m, sensors, axis=0))
    if options.nlos_range == "half":
        detour *= 0.5
    paths = np.concatenate([direct[..., None], detour], axis=-1)[:, 0]
    path = generator.integers(0, count + 1, paths.shape[:2])
    ranges: FloatArray = np.take_along_axis(paths, path[..., None], axis=-1).reshape(snapshots, sensors, -1)
    return ranges


def _shuffled(
    generator: np.random.Generator,
    sensor_xy_m: FloatArray,
    target_xy_m: FloatArray,
    ranges: FloatArray,
    is_echo: BoolArray,
    label: FloatArray,
    los: BoolArray,
    options: EchoOptions,
) -> Columns:
    """Return the columns of the ranges (B, N, M) where ``is_echo``, in random order within each snapshot."""
    snapshot, sensor, echo = np.nonzero(is_echo)
    order = np.lexsort((generator.random(snapshot.shape[0]), snapshot))
    snapshot, sensor, echo = snapshot[order], sensor[order], echo[order]
    target = label[echo]
    known = np.isfinite(target)
    truth = np.full((target.shape[0], 2), np.nan)
    truth[known] = target_xy_m[snapshot[known], target[known].astype(np.int64)]
    names = np.array(sensor_names(sensor_xy_m.shape[1]), dtype=object)
    return {
        "snapshot": snapshot.astype(np.int64),
        "sensor": names[sensor],
        "sensor_x_m": sensor_xy_m[snapshot, sensor, 0],
        "sensor_y_m": sensor_xy_m[snapshot, sensor, 1],
        "range_m": np.maximum(ranges[snapshot, sensor, echo], np.finfo(np.float64).tiny),
        "range_std_m": np.full(snapshot.shape, options.range_std_m),
        "truth_x_m": truth[:, 0],
        "truth_y_m": truth[:, 1],
        "truth_los": los[echo],
        "truth_target": target,
    }
