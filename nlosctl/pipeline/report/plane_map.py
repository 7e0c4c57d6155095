"""The map of the page: its box, its sensors, each once, and the reflectors of the scenes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.scene import CircleReflector, LineReflector, Reflector, Scene, SegmentReflector
from nlosctl.pipeline.report.numbers import decimals_of, rounded

__all__ = ["PlaneMap"]

_FAR_QUANTILES = (0.005, 0.995)
_MANY = 200
_MARGIN = 0.04


@dataclass
class PlaneMap:
    """Everything that has a place on the map, in metres; coordinates of the page are relative to ``origin_m`` (2,).

    First include all points, then `settle` the box, then ask for coordinates.
    """

    low_m: FloatArray = field(default_factory=lambda: np.full(2, np.inf))
    high_m: FloatArray = field(default_factory=lambda: np.full(2, -np.inf))
    origin_m: FloatArray = field(default_factory=lambda: np.zeros(2))
    _names: list[str] = field(default_factory=list)
    _places: list[tuple[float, float]] = field(default_factory=list)
    _index: dict[tuple[str, float, float], int] = field(default_factory=dict)
    _at: dict[tuple[float, float], int] = field(default_factory=dict)

    def include(self, points_m: FloatArray) -> None:
        """Widen the box to points (N, 2), without the farthest of many; those that are not finite are ignored."""
        points = points_m[np.isfinite(points_m).all(axis=1)]
        if not points.size:
            return
        ends = np.quantile(points, _FAR_QUANTILES, axis=0) if len(points) > _MANY else points
        self.low_m = np.minimum(self.low_m, ends.min(axis=0))
        self.high_m = np.maximum(self.high_m, ends.max(axis=0))

    def add_scene(self, scene: Scene) -> None:
        """Add the sensors of a scene."""
        for sensor in scene.sensors:
            self._sensor(sensor.name, float(sensor.position[0]), float(sensor.position[1]))
        self.include(np.array([sensor.position[:2] for sensor in scene.sensors], dtype=np.float64).reshape(-1, 2))

    def add_sensors(self, names: Sequence[str], code: IntArray, position_m: FloatArray) -> IntArray:
        """Add the sensors of rows, ``names[code]`` at positions (N, 2); return the index (N,) of each row's sensor."""
        keys = np.column_stack([code.astype(np.float64), position_m])
        each, inverse = np.unique(keys, axis=0, return_inverse=True)
        index = [self._sensor(names[int(number)], x, y) for number, x, y in each.tolist()]
        self.include(each[:, 1:])
        return np.array(index, dtype=np.int64)[inverse.ravel()]

    def sensors_at(self, position_m: FloatArray) -> IntArray:
        """Return the index (N,) of the sensor at each of the positions (N, 2) of sensors added before."""
        return np.array([self._at[x, y] for x, y in position_m.tolist()], dtype=np.int64)

    def _sensor(self, name: str, x: float, y: float) -> int:
        index = self._index.setdefault((name, x, y), len(self._names))
        if index == len(self._names):
            self._names.append(name)
            self._places.append((x, y))
            self._at.setdefault((x, y), index)
        return index

    def settle(self) -> None:
        """Fix the box, with a margin, and the origin in its middle."""
        if not np.isfinite(self.low_m).all():
            self.low_m, self.high_m = np.full(2, -1.0), np.full(2, 1.0)
        self.origin_m = np.round(0.5 * (self.low_m + self.high_m))
        margin = _MARGIN * self.span_m
        self.low_m, self.high_m = self.low_m - margin, self.high_m + margin

    @property
    def span_m(self) -> float:
        """The longer side of the box; 1 for a box without extent."""
        span = float(np.max(self.high_m - self.low_m))
        return span if np.isfinite(span) and span > 0.0 else 1.0

    @property
    def decimals(self) -> int:
        """The decimals of what is only drawn: a ten-thousandth of the box."""
        return decimals_of(self.span_m, 5)

    def coordinates(self, values_m: FloatArray, axis: int, decimals: int | None = None) -> list[Any]:
        """Return x or y (N,) relative to the origin, rounded for the picture, or to ``decimals``."""
        return rounded(values_m - self.origin_m[axis], self.decimals if decimals is None else decimals)

    def content(self, scenes: Sequence[Scene]) -> dict[str, Any]:
        """Return the box, the sensors and the reflectors as plain values."""
        places = np.array(self._places, dtype=np.float64).reshape(-1, 2)
        fine = min(self.decimals + 2, 9)
        names = {name: number for number, name in enumerate(dict.fromkeys(self._names))}
        mirrors = {mirror: None for scene in scenes for mirror in scene.reflectors}
        return {
            "origin": self.origin_m.tolist(),
            "low": rounded(self.low_m - self.origin_m, self.decimals),
            "high": rounded(self.high_m - self.origin_m, self.decimals),
            "sensors": {
                "names": list(names),
                "name": [names[name] for name in self._names],
                "x": self.coordinates(places[:, 0], 0, fine),
                "y": self.coordinates(places[:, 1], 1, fine),
            },
            "reflectors": [shape for mirror in mirrors for shape in self._shapes(mirror, fine)],
        }

    def _shapes(self, mirror: Reflector, decimals: int) -> list[dict[str, Any]]:
        """Return a reflector as lines and circles; planes and spheres have no outline in the plan."""
        if isinstance(mirror, CircleReflector):
            x, y = (rounded(np.array([mirror.center[axis]]) - self.origin_m[axis], decimals)[0] for axis in (0, 1))
            radii = [("mirror", mirror.radius)]
            radii += [] if mirror.blocker_radius is None else [("opaque", mirror.blocker_radius)]
            return [{"name": mirror.name, "kind": kind, "x": x, "y": y, "radius": radius} for kind, radius in radii]
        if isinstance(mirror, SegmentReflector):
            ends = np.array([mirror.start, mirror.end])
        elif isinstance(mirror, LineReflector):
            along = np.array(mirror.direction) / np.hypot(*mirror.direction)
            middle = np.array(mirror.point) + along * ((self.origin_m - mirror.point) @ along)
            reach = 2.0 * self.span_m + float(np.hypot(*(middle - self.origin_m)))
            ends = middle + np.outer([-reach, reach], along)
        else:
            return []
        points = [rounded(point - self.origin_m, decimals) for point in ends]
        return [{"name": mirror.name, "kind": "mirror", "points": points}]
