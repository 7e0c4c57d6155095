"""Sessions of measurements by sensors with offsets, as tables."""

from __future__ import annotations

from typing import Any

import numpy as np

RING = 200.0 * np.stack([1.0 + np.cos(np.arange(6) * np.pi / 3), 1.0 + np.sin(np.arange(6) * np.pi / 3)], axis=1)
"""Six sensors on a circle, for bearings."""

HALL = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]])
"""Four anchors in the corners of a hall, for ranges."""

STDS = {"bearings": np.radians(1.0), "ranges": 0.1}
NAMES = {"bearings": ("bearing_rad", "bearing_std_rad"), "ranges": ("range_m", "range_std_m")}


def session(
    kind: str,
    snapshots: int,
    *,
    seed: int,
    offsets: Any = None,
    outliers: float = 0.0,
    sensors: Any = None,
    noise: float = 1.0,
    first: int = 0,
) -> tuple[dict[str, Any], np.ndarray]:
    """Return a table of sources at random among the sensors, with the truth, and the offsets of the sensors.

    Offsets are three standard deviations by default. Outliers are uniform bearings, or ranges too long by fifteen
    standard deviations on average. ``noise`` is a factor of the errors alone; ``first`` the first snapshot's number.
    """
    rng = np.random.default_rng(seed)
    places = (RING if kind == "bearings" else HALL) if sensors is None else np.asarray(sensors)
    count, std = len(places), STDS[kind]
    given = rng.normal(size=count) * 3.0 * std if offsets is None else np.broadcast_to(offsets, count)
    sources = rng.uniform(places.min(axis=0), places.max(axis=0), (snapshots, 2))
    dx, dy = np.moveaxis(sources[:, None] - places, -1, 0)
    errors = given + noise * std * rng.normal(size=(snapshots, count))
    out = rng.random((snapshots, count)) < outliers
    if kind == "bearings":
        values = np.where(out, rng.uniform(-np.pi, np.pi, out.shape), np.arctan2(dy, dx) + errors)
        values = np.arctan2(np.sin(values), np.cos(values))
    else:
        values = np.maximum(np.hypot(dx, dy) + errors + out * rng.exponential(15.0 * std, out.shape), 1e-3)
    name, std_name = NAMES[kind]
    table = {
        "snapshot": np.repeat(np.arange(first, first + snapshots), count),
        "sensor": np.tile([f"s{number}" for number in range(count)], snapshots),
        "sensor_x_m": np.tile(places[:, 0], snapshots),
        "sensor_y_m": np.tile(places[:, 1], snapshots),
        name: values.ravel(),
        std_name: np.full(values.size, std),
        "truth_x_m": np.repeat(sources[:, 0], count),
        "truth_y_m": np.repeat(sources[:, 1], count),
    }
    return table, given


def rows(table: dict[str, Any], keep: Any) -> dict[str, Any]:
    """Return some rows of a table."""
    return {name: np.asarray(values)[keep] for name, values in table.items()}


def joined(*tables: dict[str, Any]) -> dict[str, Any]:
    """Return tables one after the other."""
    return {name: np.concatenate([np.asarray(table[name]) for table in tables]) for name in tables[0]}
