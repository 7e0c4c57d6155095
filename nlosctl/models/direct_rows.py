"""Bearings that came directly in a scene with an opaque circle: can the sensor see the point at all?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.geometry.visibility import sees_directly
from nlosctl.models.placed_rows import PlacedRows

__all__ = ["DirectRows", "locate_direct_rows"]


@dataclass(frozen=True)
class DirectRows(PlacedRows):
    """N direct rows about the centre of one opaque circle; ``min_elevation_rad`` is -inf where none is demanded."""

    blocker_radius: FloatArray
    min_elevation_rad: FloatArray

    def outside(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which rows (N,) can't see their point (B,) about the local origin: not in the region A3."""
        source_x, source_y = self.about_circle(x, y)
        limits = (self.blocker_radius, self.min_elevation_rad)
        return ~sees_directly(self.sensor_x, self.sensor_y, source_x, source_y, *limits)


def locate_direct_rows(
    scene: Scene, reflector: IntArray, sensor_x: FloatArray, sensor_y: FloatArray
) -> tuple[DirectRows, ...]:
    """Return the direct rows of a block (B, K), once about each opaque circle of the scene (centres in its frame).

    Layers about the same opaque circle count once, with the least of their elevations.
    """
    blockers: dict[tuple[float, float, float], float] = {}
    for circle in scene.reflectors:
        if isinstance(circle, CircleReflector) and circle.blocker_radius is not None:
            least = -np.inf if circle.min_elevation_deg is None else np.radians(circle.min_elevation_deg)
            key = (*circle.center, circle.blocker_radius)
            blockers[key] = min(blockers.get(key, np.inf), least)
    if not blockers:
        return ()
    measurement, snapshot = np.nonzero((reflector < 0).T)
    x, y = sensor_x[snapshot, measurement], sensor_y[snapshot, measurement]

    def fill(value: float) -> FloatArray:
        return np.full(x.shape, value)

    return tuple(
        DirectRows(snapshot, measurement, x - mx, y - my, fill(mx), fill(my), fill(radius), fill(least))
        for (mx, my, radius), least in blockers.items()
        if snapshot.size
    )
