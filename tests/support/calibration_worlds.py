"""Sessions of measurements by sensors with offsets, as tables, and dense fits of everything at once."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.optimize import least_squares

RING = 200.0 * np.stack([1.0 + np.cos(np.arange(6) * np.pi / 3), 1.0 + np.sin(np.arange(6) * np.pi / 3)], axis=1)
"""Six sensors on a circle, for bearings."""

HALL = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]])
"""Four anchors in the corners of a hall, for ranges."""

ROOM = np.array(
    [[0, 0, 1], [100, 0, 30], [100, 80, 4], [0, 80, 25], [50, -20, 12], [55, 100, 35], [-15, 40, 18]], dtype=float
)
"""Seven sensors at different heights around a room, for measurements in space."""

STDS = {"bearings": np.radians(1.0), "ranges": 0.1, "arrivals": 0.1}
NAMES = {
    "bearings": ("bearing_rad", "bearing_std_rad"),
    "ranges": ("range_m", "range_std_m"),
    "arrivals": ("arrival_m", "arrival_std_m"),
}
_AXES = "xyz"


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
    """Return a table of sources at random among the sensors (J, D), with the truth, and the offsets of the sensors.

    Offsets are three standard deviations by default. Outliers are uniform bearings, or ranges and arrivals too long by
    fifteen standard deviations on average. ``noise`` is a factor of the errors alone; ``first`` the first snapshot's
    number. Bearings in space have elevations.
    """
    rng = np.random.default_rng(seed)
    places = (RING if kind == "bearings" else HALL) if sensors is None else np.asarray(sensors)
    (count, dimension), std = places.shape, STDS[kind]
    given = rng.normal(size=count) * 3.0 * std if offsets is None else np.broadcast_to(offsets, count)
    sources = rng.uniform(places.min(axis=0), places.max(axis=0), (snapshots, dimension))
    away = sources[:, None] - places
    errors = given + noise * std * rng.normal(size=(snapshots, count))
    out = rng.random((snapshots, count)) < outliers
    true = _predicted(kind, away)
    if kind == "bearings":
        values = np.where(out, rng.uniform(-np.pi, np.pi, out.shape), true[0] + errors)
        values = np.arctan2(np.sin(values), np.cos(values))
    else:
        values = np.maximum(true[0] + errors + out * rng.exponential(15.0 * std, out.shape), 1e-3)
    name, std_name = NAMES[kind]
    table = {
        "snapshot": np.repeat(np.arange(first, first + snapshots), count),
        "sensor": np.tile([f"s{number}" for number in range(count)], snapshots),
        **{f"sensor_{axis}_m": np.tile(part, snapshots) for axis, part in zip(_AXES, places.T, strict=False)},
        name: values.ravel(),
        std_name: np.full(values.size, std),
        **{f"truth_{axis}_m": np.repeat(part, count) for axis, part in zip(_AXES, sources.T, strict=False)},
    }
    if kind == "arrivals":
        table[name] = (values + rng.uniform(0.0, 1e4, (snapshots, 1))).ravel()
    if len(true) > 1:
        table["elevation_rad"] = (true[1] + noise * std * rng.normal(size=values.shape)).ravel()
        table["elevation_std_rad"] = np.full(values.size, std)
    return table, given


def _predicted(kind: str, away: Any) -> tuple[np.ndarray, ...]:
    """Return the scalars, arrays (...,), that a sensor without an offset measures of vectors (..., D)."""
    level = np.hypot(away[..., 0], away[..., 1])
    if kind != "bearings":
        return (level if away.shape[-1] == 2 else np.hypot(level, away[..., 2]),)
    azimuth = np.arctan2(away[..., 1], away[..., 0])
    return (azimuth,) if away.shape[-1] == 2 else (azimuth, np.arctan2(away[..., 2], level))


def joint_fit(
    kind: str, table: dict[str, Any], scale: Any, start: Any, prior: float | None = None, height: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return offsets and covariance by dense least squares over all positions and offsets, with scaled stds.

    The unknowns are the offsets of the sensors, the positions, and of arrivals the offset of each snapshot; the
    covariance is the pseudo-inverse of their information after elimination. ``height`` are measured heights (S,) of the
    sources and their std.
    """
    count = len(scale)
    sensor = np.array([int(text[1:]) for text in table["sensor"]])
    snapshot = np.unique(table["snapshot"], return_inverse=True)[1]
    place, truth = (
        np.stack([table[f"{what}_{axis}_m"] for axis in _AXES if f"{what}_{axis}_m" in table], axis=1)
        for what in ("sensor", "truth")
    )
    first = np.unique(snapshot, return_index=True)[1]
    name, std_name = NAMES[kind]
    stds = [table[part] * scale[sensor] for part in (std_name, "elevation_std_rad") if part in table]
    own = [table[name][first] - _predicted(kind, truth[first] - place[first])[0]] if kind == "arrivals" else []
    unknowns = np.stack([*truth[first].T, *own], axis=1)

    def residuals(state: np.ndarray) -> np.ndarray:
        point = state[count:].reshape(unknowns.shape)[snapshot]
        predicted = _predicted(kind, point[:, : place.shape[1]] - place)
        errors = [table[name] - predicted[0] - state[sensor] - (point[:, -1] if own else 0.0)]
        errors += [table["elevation_rad"] - part for part in predicted[1:]]
        if kind == "bearings":
            errors = [np.nan_to_num(np.arctan2(np.sin(part), np.cos(part))) for part in errors]
        scaled = [part / std for part, std in zip(errors, stds, strict=True)]
        if height is not None:
            scaled.append((height[0] - state[count:].reshape(unknowns.shape)[:, 2]) / height[1])
        return np.concatenate([*scaled, [] if prior is None else state[:count] / prior])

    fit = least_squares(residuals, np.concatenate([start, unknowns.ravel()]), x_scale="jac", xtol=1e-14, ftol=1e-14)
    basis = np.linalg.qr(fit.jac[:, count:])[0]
    left = fit.jac[:, :count] - basis @ (basis.T @ fit.jac[:, :count])
    covariance = np.linalg.pinv(left.T @ left, rcond=1e-9, hermitian=True)
    return fit.x[:count], covariance


def rows(table: dict[str, Any], keep: Any) -> dict[str, Any]:
    """Return some rows of a table."""
    return {name: np.asarray(values)[keep] for name, values in table.items()}


def joined(*tables: dict[str, Any]) -> dict[str, Any]:
    """Return tables one after the other."""
    return {name: np.concatenate([np.asarray(table[name]) for table in tables]) for name in tables[0]}
