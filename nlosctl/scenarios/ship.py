"""A ship on legs between turns takes bearings to a target on a straight course, whose motion it is to find."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "ShipOptions", "generate", "scene"]


@dataclass(frozen=True, kw_only=True)
class ShipOptions:
    """Parameters of ``ship``."""

    bearings: int = option(61, minimum=2, meaning="bearings of a snapshot")
    duration_s: float = option(
        1200.0, unit="s", minimum=0.0, exclusive=True, meaning="time from the first bearing to the last"
    )
    turns: int = option(1, minimum=0, meaning="turns of the ship, to either side; 0: nothing is observable")
    turn_deg: float = option(90.0, unit="deg", minimum=0.0, maximum=180.0, meaning="angle of each turn")
    speed_m_s: float = option(5.0, unit="m/s", minimum=0.0, meaning="speed of the ship")
    target_speed_m_s: float = option(4.0, unit="m/s", minimum=0.0, meaning="speed of the target")
    nearest_m: float = option(
        4000.0, unit="m", minimum=0.0, exclusive=True, meaning="least distance of the target at half time"
    )
    farthest_m: float = option(
        5000.0, unit="m", minimum=0.0, exclusive=True, meaning="largest distance of the target at half time"
    )
    bearing_std_deg: float = option(
        0.5, unit="deg", minimum=0.0, exclusive=True, meaning="standard deviation of every bearing"
    )


def scene(options: ShipOptions) -> Scene:
    """Return the scene: no sensor stays where it is."""
    return Scene()


def generate(options: ShipOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots, each of another ship and target; courses, sides of turns and directions are uniform."""
    count, std = options.bearings, np.radians(options.bearing_std_deg)
    time = np.round(np.linspace(0.0, options.duration_s, count), 6)
    ship = _courses(options, generator, snapshots, time)
    towards, course = generator.uniform(-np.pi, np.pi, (2, snapshots))
    distance = generator.uniform(options.nearest_m, max(options.nearest_m, options.farthest_m), snapshots)
    middle = ship.mean(axis=1) + distance[:, None] * np.stack([np.cos(towards), np.sin(towards)], axis=1)
    velocity = options.target_speed_m_s * np.stack([np.cos(course), np.sin(course)], axis=1)
    target = middle[:, None] + (time - time.mean())[:, None] * velocity[:, None]
    away = target - ship
    bearing = np.arctan2(away[..., 1], away[..., 0]) + std * generator.standard_normal((snapshots, count))
    return {
        "snapshot": np.repeat(np.arange(snapshots, dtype=np.int64), count),
        "time_s": np.tile(time, snapshots),
        "sensor": np.full(snapshots * count, "ship", dtype=object),
        "sensor_x_m": ship[..., 0].ravel(),
        "sensor_y_m": ship[..., 1].ravel(),
        "bearing_rad": wrap_angle(bearing).ravel(),
        "bearing_std_rad": np.full(snapshots * count, std),
        "truth_x_m": target[..., 0].ravel(),
        "truth_y_m": target[..., 1].ravel(),
        "truth_los": np.ones(snapshots * count, dtype=bool),
        "truth_vx_m_s": np.repeat(velocity[:, 0], count),
        "truth_vy_m_s": np.repeat(velocity[:, 1], count),
    }


def _courses(options: ShipOptions, generator: np.random.Generator, snapshots: int, time: FloatArray) -> FloatArray:
    """Return the positions (S, K, 2) of ships at times (K,): legs of equal length, turns at once."""
    legs = options.turns + 1
    first = generator.uniform(-np.pi, np.pi, (snapshots, 1))
    sides = np.where(generator.random((snapshots, options.turns)) < 0.5, -1.0, 1.0)
    heading = first + np.radians(options.turn_deg) * np.cumsum(np.insert(sides, 0, 0.0, axis=1), axis=1)
    leg_s = options.duration_s / legs
    spent = np.clip(time[:, None] - leg_s * np.arange(legs), 0.0, leg_s)  # of each bearing's time on each leg
    way = np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return np.asarray(options.speed_m_s * np.einsum("kl,sld->skd", spent, way))


SCENARIO = ScenarioSpec(
    name="ship",
    kind="bearings",
    summary="a ship with turns takes bearings to a target that moves: motion=velocity finds position and velocity",
    reference="Nardone, Lindgren, Gong 1984",
    options=ShipOptions,
    scene=scene,
    generate=generate,
    further=("time_s", "truth_vx_m_s", "truth_vy_m_s"),
)
