"""Walks of nearly constant velocity among anchors that range to them, each row at a time of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, Sensor
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "WalkOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class WalkOptions:
    """Parameters of ``walk``."""

    states: int = option(60, minimum=2, maximum=1024, meaning="snapshots of a walk; the next one is another walk")
    interval_s: float = option(1.0, unit="s", minimum=0.0, exclusive=True, meaning="time between snapshots")
    spread: float = option(
        0.8, minimum=0.0, maximum=1.0, meaning="share of the interval over which the rows of a snapshot are spread"
    )
    acceleration_psd: float = option(
        0.05, unit="m2/s3", minimum=0.0, exclusive=True, meaning="power spectral density of the white acceleration"
    )
    speed_m_s: float = option(
        1.0, unit="m/s", minimum=0.0, meaning="standard deviation of the first velocity, per axis"
    )
    width_m: float = option(
        100.0, unit="m", minimum=0.0, exclusive=True, meaning="width of the area, an anchor a corner"
    )
    height_m: float = option(80.0, unit="m", minimum=0.0, exclusive=True, meaning="height of the area")
    range_std_m: float = option(1.0, unit="m", minimum=0.0, exclusive=True, meaning="standard deviation of every range")
    missing: float = option(0.1, minimum=0.0, maximum=0.9, meaning="share of the rows that are missing")
    outlier_fraction: float = option(0.0, minimum=0.0, maximum=1.0, meaning="share of the rows that are too long")
    late_m: float = option(20.0, unit="m", minimum=0.0, exclusive=True, meaning="outliers are too long by up to this")


def scene(options: WalkOptions) -> Scene:
    """Return the scene: an anchor at each corner of the area."""
    w, h = options.width_m, options.height_m
    corners = ((0.0, 0.0), (w, 0.0), (w, h), (0.0, h))
    return Scene(sensors=tuple(Sensor(name=f"a{number}", position=place) for number, place in enumerate(corners)))


def generate(options: WalkOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots of walks from the middle of the area, under `nlosctl.solvers.tracking.motion`, equation (1)."""
    anchors = np.array([sensor.position for sensor in scene(options).sensors])
    walk, path = _walks(options, generator, snapshots)
    delay = options.spread * options.interval_s * (np.arange(len(anchors)) / len(anchors) - 0.5)
    second = np.arange(snapshots) % options.states * options.interval_s
    place = path[:, None, :2] + delay[:, None] * path[:, None, 2:]
    exact = np.hypot(*(place - anchors).transpose(2, 0, 1))
    follows_path = generator.random(exact.shape) >= options.outlier_fraction
    late = np.where(follows_path, 0.0, generator.uniform(0.0, options.late_m, exact.shape))
    measured = np.abs(exact + late + options.range_std_m * generator.standard_normal(exact.shape))
    kept = generator.random(exact.shape) >= options.missing
    kept[:, 0] |= ~kept.any(axis=1)
    row, anchor = np.nonzero(kept)
    return {
        "snapshot": row.astype(np.int64),
        "time_s": np.round(second[row] + delay[anchor] + options.interval_s, 6),
        "walk": walk[row],
        "sensor": np.array([f"a{number}" for number in range(len(anchors))], dtype=object)[anchor],
        "sensor_x_m": anchors[anchor, 0],
        "sensor_y_m": anchors[anchor, 1],
        "range_m": measured[kept],
        "range_std_m": np.full(row.size, options.range_std_m),
        "truth_x_m": place[kept][:, 0],
        "truth_y_m": place[kept][:, 1],
        "truth_los": follows_path[kept],
    }


def _walks(options: WalkOptions, generator: np.random.Generator, snapshots: int) -> tuple[IntArray, FloatArray]:
    """Return the name of each snapshot's walk (S,), a random number, and its position and velocity (S, 4)."""
    h, q = options.interval_s, options.acceleration_psd
    root = np.linalg.cholesky(q * np.array([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]]))
    walks = -(-snapshots // options.states)
    noise = generator.standard_normal((walks, options.states, 2, 2)) @ root.T
    state = np.zeros((walks, 2, 2))
    state[:, :, 0] = 0.5 * np.array([options.width_m, options.height_m])
    state[:, :, 1] = options.speed_m_s * generator.standard_normal((walks, 2))
    path = np.empty((walks, options.states, 4))
    for k in range(options.states):
        path[:, k, :2], path[:, k, 2:] = state[:, :, 0], state[:, :, 1]
        state = np.stack([state[:, :, 0] + h * state[:, :, 1], state[:, :, 1]], axis=2) + noise[:, k]
    names = generator.integers(0, 10**9, walks)
    return np.repeat(names, options.states)[:snapshots], path.reshape(-1, 4)[:snapshots]


SCENARIO = ScenarioSpec(
    name="walk",
    kind="ranges",
    summary="walks of nearly constant velocity among four anchors, ranges one after the other, some too long",
    reference="generic",
    options=WalkOptions,
    scene=scene,
    generate=generate,
    further=("time_s", "walk"),
)
