"""Worlds whose sensors and mirrors are not exactly known, and a slow solution of their rows, by own equations.

A world is a list of paths (sensor, mirror) with stated geometry; the true geometry of each snapshot differs from it by
errors of the stated standard deviations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.contract.scene import LineReflector, PlaneReflector, Scene, Sensor


@dataclass(frozen=True)
class World:
    """Sensors (S, D), paths (sensor, mirror; -1: direct), mirrors (point, normal), their stds, and that of rows."""

    kind: str
    sensors: np.ndarray
    paths: Sequence[tuple[int, int]]
    std: float
    mirrors: Sequence[tuple[np.ndarray, np.ndarray]] = ()
    position_std_m: float = 0.0
    offset_std: float = 0.0
    mirror_stds: Sequence[tuple[float, float]] = ()
    region: tuple[float, float] = (-300.0, 300.0)

    @property
    def dimension(self) -> int:
        """That of positions."""
        return int(self.sensors.shape[1])

    @property
    def turns(self) -> int:
        """Axes about which a mirror turns."""
        return self.dimension - 1

    def causes(self) -> np.ndarray:
        """Return the stds (C,) of all causes: positions, offsets of sensors, offsets and turns of mirrors."""
        stds = [np.full(self.sensors.size, self.position_std_m), np.full(len(self.sensors), self.offset_std)]
        stds += [np.array([offset, *[turn] * self.turns]) for offset, turn in self.mirror_stds]
        return np.concatenate(stds)

    def predict(self, source: np.ndarray, errors: np.ndarray) -> np.ndarray:
        """Return the scalars (M,) of all paths to a source (D,) with the geometry moved by errors (C,)."""
        place = self.sensors + errors[: self.sensors.size].reshape(self.sensors.shape)
        offset = errors[self.sensors.size :][: len(self.sensors)]
        of_mirrors = errors[self.sensors.size + len(self.sensors) :].reshape(len(self.mirrors), 1 + self.turns)
        values = []
        for sensor, mirror in self.paths:
            seen = source
            if mirror >= 0:
                point, normal = moved(*self.mirrors[mirror], of_mirrors[mirror])
                seen = source - 2.0 * ((source - point) @ normal) * normal
            away = seen - place[sensor]
            if self.kind == "bearings":
                values.append(np.arctan2(away[1], away[0]) + offset[sensor])
                if self.dimension == 3:
                    values.append(np.arctan2(away[2], np.hypot(away[0], away[1])))
            else:
                values.append(np.linalg.norm(away) + offset[sensor])
        return np.array(values)

    def scene(self) -> Scene:
        """Return the scene with the standard deviations."""
        names = {"bearings": "heading_std_deg", "ranges": "range_offset_std_m", "arrivals": "arrival_offset_std_m"}
        std = np.degrees(self.offset_std) if self.kind == "bearings" else self.offset_std
        sensors = tuple(
            Sensor(
                name=f"s{number}",
                position=tuple(place[:2].tolist()),
                z_m=float(place[2]) if len(place) == 3 else None,
                position_std_m=self.position_std_m or None,
                **{names[self.kind]: float(std) or None},
            )
            for number, place in enumerate(self.sensors)
        )
        return Scene(sensors=sensors, reflectors=tuple(self._reflectors()))

    def _reflectors(self) -> Any:
        for number, ((point, normal), (offset, turn)) in enumerate(zip(self.mirrors, self.mirror_stds, strict=True)):
            stds = {"offset_std_m": offset or None, "direction_std_deg": float(np.degrees(turn)) or None}
            place, across = tuple(point.tolist()), tuple(normal.tolist())
            if len(point) == 3:
                yield PlaneReflector(name=f"m{number}", point=place, normal=across, **stds)
            else:
                yield LineReflector(name=f"m{number}", point=place, direction=(across[1], -across[0]), **stds)


def moved(point: np.ndarray, normal: np.ndarray, errors: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mirror moved along its normal and turned about its point."""
    if len(point) == 2:
        angle = errors[1]
        turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ normal
        return point + errors[0] * normal, turned
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    turned = normal + errors[1] * first + errors[2] * np.cross(normal, first)
    return point + errors[0] * normal, turned / np.linalg.norm(turned)


def sample(world: World, snapshots: int, seed: int) -> tuple[dict[str, Any], np.ndarray, np.ndarray]:
    """Return a table of snapshots, each with a world of its own, the sources (B, D) and scalars (B, M)."""
    rng = np.random.default_rng(seed)
    sources = rng.uniform(*world.region, (snapshots, world.dimension))
    for point, normal in world.mirrors:
        side = np.sign((world.sensors[0] - point) @ normal)
        for number in range(snapshots):
            while np.sign((sources[number] - point) @ normal) != side:
                sources[number] = rng.uniform(*world.region, world.dimension)
    stds, noise = world.causes(), world.std * rng.normal(size=(snapshots, 400))
    values = np.array([world.predict(source, stds * rng.normal(size=stds.size)) for source in sources])
    values = values + noise[:, : values.shape[1]]
    if world.kind == "arrivals":
        values = values + rng.uniform(-1e4, 1e4, (snapshots, 1))
    return _table(world, sources, values), sources, values


def _table(world: World, sources: np.ndarray, values: np.ndarray) -> dict[str, Any]:
    count, size = len(world.paths), len(sources)
    sensor = np.array([sensor for sensor, _ in world.paths])
    mirror = [mirror for _, mirror in world.paths]
    table: dict[str, Any] = {
        "snapshot": np.repeat(np.arange(size), count),
        "sensor": np.tile([f"s{number}" for number in sensor], size),
    }
    places = world.sensors[sensor]
    for axis, letter in enumerate("xyz"[: world.dimension]):
        table[f"sensor_{letter}_m"] = np.tile(places[:, axis], size)
        table[f"truth_{letter}_m"] = np.repeat(sources[:, axis], count)
    if world.mirrors:
        names = ["" if number < 0 else f"m{number}" for number in mirror]
        table["reflector"] = [name or None for name in names * size]
    if world.kind != "arrivals":
        seen: dict[int, int] = {}
        paths = []
        for number in sensor.tolist():
            paths.append(seen.setdefault(number, 0))
            seen[number] += 1
        table["path"] = np.tile(paths, size)
    name, std = {
        "bearings": ("bearing_rad", "bearing_std_rad"),
        "ranges": ("range_m", "range_std_m"),
        "arrivals": ("arrival_m", "arrival_std_m"),
    }[world.kind]
    if world.kind == "bearings" and world.dimension == 3:
        table["elevation_rad"], table["elevation_std_rad"] = values[:, 1::2].ravel(), np.full(size * count, world.std)
        values = values[:, 0::2]
    table[name] = (np.arctan2(np.sin(values), np.cos(values)) if world.kind == "bearings" else values).ravel()
    table[std] = np.full(size * count, world.std)
    return table


def reference_fix(world: World, values: np.ndarray, start: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the point (D,) where A'R^-1 r = 0, (A'R^-1 A)^-1 and r'R^-1 r, by dense matrices."""
    stds, point = world.causes(), start.copy()
    for _ in range(15):
        here = point.copy()
        slopes = differences(lambda x: world.predict(x, np.zeros(stds.size)), point)
        effect = differences(lambda c, here=here: world.predict(here, c), np.zeros(stds.size)) * stds
        if world.kind == "arrivals":
            slopes = np.column_stack([slopes, np.ones(len(slopes))])
        whole = np.linalg.inv(world.std**2 * np.eye(len(values)) + effect @ effect.T)
        residual = values - world.predict(point, np.zeros(stds.size))
        if world.kind == "bearings":
            residual = np.arctan2(np.sin(residual), np.cos(residual))
        covariance = np.linalg.inv(slopes.T @ whole @ slopes)
        step = covariance @ slopes.T @ whole @ residual
        left = residual - slopes[:, world.dimension :] @ step[world.dimension :]
        point = point + step[: world.dimension]
        if np.abs(step[: world.dimension]).max() < 1e-6:
            break
    return point, covariance[: world.dimension, : world.dimension], float(left @ whole @ left)


def differences(function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, step: float = 1e-5) -> np.ndarray:
    """Return the Jacobian (M, N) of a function by central differences."""
    columns = []
    for index in range(at.size):
        by = np.zeros(at.size)
        by[index] = step
        columns.append((function(at + by) - function(at - by)) / (2.0 * step))
    return np.stack(columns, axis=1)


RING = 400.0 * np.stack([np.cos(np.arange(6) * np.pi / 3), np.sin(np.arange(6) * np.pi / 3)], axis=1)
_LEFT = (np.array([-600.0, 50.0]), np.array([0.995, 0.1]) / np.hypot(0.995, 0.1))
_UPPER = (np.array([0.0, 700.0]), np.array([0.05, -1.0]) / np.hypot(0.05, 1.0))
THREE = np.array([[-350.0, -250.0], [380.0, -200.0], [20.0, 400.0]])

WORLDS = {
    "places": World("bearings", RING[:5], [(n, -1) for n in range(5)], np.radians(1.0), position_std_m=10.0),
    "headings": World("bearings", THREE, [(n % 3, -1) for n in range(9)], np.radians(0.5), offset_std=np.radians(2.0)),
    "places and headings": World(
        "bearings",
        THREE,
        [(n % 3, -1) for n in range(12)],
        np.radians(0.5),
        position_std_m=10.0,
        offset_std=np.radians(1.0),
    ),
    "two mirrors": World(
        "bearings",
        THREE[:2],
        [(0, -1), (0, 0), (0, 1), (1, -1), (1, 0), (1, 1), (0, 0), (1, 1)],
        np.radians(0.5),
        mirrors=(_LEFT, _UPPER),
        mirror_stds=((15.0, np.radians(0.7)), (5.0, np.radians(0.3))),
    ),
    "ranges": World("ranges", RING[:4], [(n % 4, -1) for n in range(8)], 0.3, position_std_m=1.0, offset_std=0.7),
    "arrivals": World("arrivals", RING, [(n, -1) for n in range(6)], 0.3, position_std_m=1.0, offset_std=0.7),
    "ranges by a mirror": World(
        "ranges",
        THREE[:2],
        [(0, -1), (0, 0), (1, -1), (1, 0)],
        0.3,
        mirrors=(_UPPER,),
        mirror_stds=((3.0, np.radians(0.2)),),
    ),
}

SPACE = np.array([[-350.0, -250.0, 10.0], [380.0, -200.0, 40.0], [20.0, 400.0, 90.0]])
_CEILING = (np.array([0.0, 0.0, 600.0]), np.array([0.1, 0.2, -1.0]) / np.sqrt(1.05))
IN_SPACE = {
    "directions by a ceiling": World(
        "bearings",
        SPACE,
        [(0, -1), (0, 0), (1, -1), (1, 0), (2, 0)],
        0.01,
        mirrors=(_CEILING,),
        position_std_m=3.0,
        offset_std=0.02,
        mirror_stds=((4.0, 0.004),),
        region=(-200.0, 200.0),
    ),
    "arrivals in space": World(
        "arrivals",
        np.array(
            [
                [-350.0, -250.0, 10.0],
                [380.0, -200.0, 240.0],
                [20.0, 400.0, 90.0],
                [0.0, 0.0, 500.0],
                [-300.0, 200.0, 30.0],
                [250.0, 300.0, 150.0],
            ]
        ),
        [(number, -1) for number in range(6)],
        0.3,
        position_std_m=1.0,
        offset_std=0.7,
        region=(-200.0, 200.0),
    ),
    "ranges by a ceiling": World(
        "ranges",
        SPACE,
        [(0, -1), (0, 0), (1, -1), (1, 0), (2, 0)],
        0.3,
        mirrors=(_CEILING,),
        position_std_m=3.0,
        offset_std=0.5,
        mirror_stds=((4.0, 0.004),),
        region=(-200.0, 200.0),
    ),
}
