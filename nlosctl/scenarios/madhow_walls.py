"""Walls that block and reflect: the ray-traced examples of Ananthasubramaniam and Madhow, Figures 10 and 11."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.options import option
from nlosctl.contract.scene import Scene, SegmentReflector, Sensor
from nlosctl.errors import UsageError
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.lines import crosses_segment, reflect_in_segment
from nlosctl.scenarios.spec import Columns, ScenarioSpec

__all__ = ["SCENARIO", "MadhowWallsOptions", "WallPath", "generate", "scene", "trace_paths"]

Point = tuple[float, float]

_WORLDS = {
    "10": Scene(
        sensors=tuple(
            Sensor(name=f"R{number}", position=position)
            for number, position in enumerate([(0.0, 0.0), (500.0, 0.0), (500.0, 500.0), (0.0, 500.0)], 1)
        ),
        reflectors=(
            SegmentReflector(name="blocking", start=(164.0, 310.0), end=(235.0, 349.0)),
            SegmentReflector(name="reflecting", start=(450.0, 193.0), end=(600.0, 505.0)),
        ),
    ),
    "11": Scene(
        sensors=tuple(
            Sensor(name=f"R{number}", position=position)
            for number, position in enumerate([(0.0, 400.0), (170.0, 450.0), (330.0, 450.0), (500.0, 400.0)], 1)
        ),
        reflectors=(SegmentReflector(name="wall", start=(-400.0, 0.0), end=(900.0, 0.0)),),
    ),
}
"""Four receivers each; the positions are ours, the paper gives none."""

_SOURCES = {
    "10": {"A": (290.0, 270.0), "B": (420.0, 110.0), "C": (360.0, 80.0), "D": (350.0, 260.0)},
    "11": {"A": (250.0, 150.0)},
}


@dataclass(frozen=True, kw_only=True)
class MadhowWallsOptions:
    """Parameters of ``madhow-walls``."""

    figure: Literal["10", "11"] = option("10", meaning="10: one wall blocks, one reflects; 11: one reflects")
    source: Literal["A", "B", "C", "D"] = option("A", meaning="position of the source; Figure 11 has only A")
    band: Literal["narrow", "wide"] = option(
        "narrow", meaning="narrow: the power-weighted superposition of all paths; wide: a row for every path"
    )
    bearing_std_deg: float = option(
        0.5, unit="deg", minimum=0.0, maximum=90.0, exclusive=True, meaning="standard deviation of each path's bearing"
    )
    reflected_power: float = option(
        0.5,
        minimum=0.0,
        maximum=1.0,
        meaning="share of the power that a wall reflects; power falls with the squared path length",
    )

    def __post_init__(self) -> None:
        if self.source not in _SOURCES[self.figure]:
            raise UsageError(
                f"The 'source' parameter of madhow-walls must be A with figure={self.figure}. "
                f"Got {self.source!r} instead."
            )


def scene(options: MadhowWallsOptions) -> Scene:
    """Return the four receivers and the walls."""
    return _WORLDS[options.figure]


def generate(options: MadhowWallsOptions, generator: np.random.Generator, snapshots: int) -> Columns:
    """Sample snapshots of the source, which differ only in their errors. Receivers that no path reaches have no row.

    ``truth_los`` is true for rows of the direct path, unless a reflected one is superposed.
    """
    world = scene(options)
    source = _SOURCES[options.figure][options.source]
    walls = [wall for wall in world.reflectors if isinstance(wall, SegmentReflector)]
    std = np.radians(options.bearing_std_deg)
    rows: list[tuple[Sensor, int, FloatArray, bool]] = []
    for sensor in world.sensors:
        paths = trace_paths(source, sensor.position, walls)
        noisy = [path.bearing_rad + std * generator.standard_normal(snapshots) for path in paths]
        if options.band == "wide":
            rows += [(sensor, k, noisy[k], path.wall is None) for k, path in enumerate(paths)]
        elif paths:
            all_direct = all(path.wall is None for path in paths)
            rows.append((sensor, 0, _superposition(paths, noisy, options.reflected_power), all_direct))
    count = len(rows)

    def column(values: list[float]) -> FloatArray:
        return np.tile(np.array(values), snapshots)

    return {
        "snapshot": np.repeat(np.arange(snapshots, dtype=np.int64), count),
        "sensor": np.tile(np.array([row[0].name for row in rows], dtype=object), snapshots),
        "sensor_x_m": column([row[0].position[0] for row in rows]),
        "sensor_y_m": column([row[0].position[1] for row in rows]),
        "bearing_rad": wrap_angle(np.stack([row[2] for row in rows], axis=1).ravel()),
        "bearing_std_rad": np.full(snapshots * count, std),
        "path": np.tile(np.array([row[1] for row in rows], dtype=np.int64), snapshots),
        "truth_x_m": np.full(snapshots * count, source[0]),
        "truth_y_m": np.full(snapshots * count, source[1]),
        "truth_los": np.tile(np.array([row[3] for row in rows]), snapshots),
    }


def _superposition(paths: list[WallPath], bearing_rad: list[FloatArray], reflected_power: float) -> FloatArray:
    """Return the direction (B,) of the power-weighted sum of unit vectors along the paths."""
    x, y = np.zeros_like(bearing_rad[0]), np.zeros_like(bearing_rad[0])
    for path, bearing in zip(paths, bearing_rad, strict=True):
        power = (1.0 if path.wall is None else reflected_power) / path.length_m**2
        x += power * np.cos(bearing)
        y += power * np.sin(bearing)
    return np.arctan2(y, x)


@dataclass(frozen=True)
class WallPath:
    """A path that reaches a receiver: its bearing there, its length, and its reflecting wall (None: direct)."""

    bearing_rad: float
    length_m: float
    wall: str | None


def trace_paths(source: Point, receiver: Point, walls: Sequence[SegmentReflector]) -> list[WallPath]:
    """Return the unobstructed paths from source to receiver, shortest first: the direct one, and one via each wall."""
    paths = []
    if not any(_crosses(source, receiver, wall) for wall in walls):
        paths.append(_path(receiver, source, 0.0, None))
    for wall in walls:
        x, y = reflect_in_segment(*(np.array(part) for part in (*source, *receiver, *wall.start, *wall.end)))
        point = (float(x), float(y))
        others = [other for other in walls if other is not wall]
        blocked = any(_crosses(end, point, other) for other in others for end in (source, receiver))
        if np.isfinite(x) and not blocked:
            first_leg_m = float(np.hypot(point[0] - source[0], point[1] - source[1]))
            paths.append(_path(receiver, point, first_leg_m, wall.name))
    return sorted(paths, key=lambda path: path.length_m)


def _path(receiver: Point, last_point: Point, length_before_m: float, wall: str | None) -> WallPath:
    dx, dy = last_point[0] - receiver[0], last_point[1] - receiver[1]
    return WallPath(float(np.arctan2(dy, dx)), length_before_m + float(np.hypot(dx, dy)), wall)


def _crosses(start: Point, end: Point, wall: SegmentReflector) -> bool:
    return bool(crosses_segment(*(np.array(part) for part in (*start, *end, *wall.start, *wall.end))))


SCENARIO = ScenarioSpec(
    name="madhow-walls",
    kind="bearings",
    summary="four receivers, walls that block and reflect, a narrowband or a wideband source",
    reference="Ananthasubramaniam, Madhow, Section V-B, Figures 10 and 11 (positions ours)",
    options=MadhowWallsOptions,
    scene=scene,
    generate=generate,
)
