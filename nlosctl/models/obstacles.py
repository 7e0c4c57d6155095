"""Obstacles of the scene: from which points can a row be seen past opaque circles and walls?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene, SegmentReflector
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.circular_reflection import ReflectedPath
from nlosctl.geometry.lines import crosses_segment
from nlosctl.geometry.visibility import sees_directly
from nlosctl.models.circle_rows import CirclePaths
from nlosctl.models.mirror_rows import MirrorRows
from nlosctl.models.selected_rows import SelectedRows

__all__ = ["DirectRows", "WallRows", "hidden_by_walls", "locate_direct_rows", "locate_walls", "unseen_rows"]


@dataclass(frozen=True)
class DirectRows(SelectedRows):
    """N direct rows about the centre of one opaque circle; ``min_elevation_rad`` is -inf without a limit."""

    blocker_radius: FloatArray
    min_elevation_rad: FloatArray

    def outside(self, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return which rows (N,) can't see their point (B,) about the local origin: not in the region A3."""
        source_x, source_y = self.about_center(x, y)
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
        DirectRows(
            reflector.shape, snapshot, measurement, x - mx, y - my, fill(mx), fill(my), fill(radius), fill(least)
        )
        for (mx, my, radius), least in blockers.items()
        if snapshot.size
    )


@dataclass(frozen=True)
class WallRows(RowBlock):
    """The segment reflectors of a scene, ends x1, y1, x2, y2 (metres) by their index in it, and the rows' reflectors.

    ``reflector`` (B, K) is -1 for direct rows; ``center`` (B,) is the local origin of the points asked for.
    """

    ends_m: dict[int, tuple[float, float, float, float]]
    reflector: IntArray
    center_x: FloatArray
    center_y: FloatArray

    def unseen(self, origin_x: FloatArray, origin_y: FloatArray, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return to which rows (B, K), with unfolded origins, points (B,) about the local origins can't be visible.

        A row by a wall needs its way to meet the wall between its ends, a direct row must not meet any wall.
        """
        unseen = np.zeros(origin_x.shape, dtype=bool)
        for index, (x1, y1, x2, y2) in self.ends_m.items():
            corners = (x1 - self.center_x, y1 - self.center_y, x2 - self.center_x, y2 - self.center_y)
            with ignoring_overflow():
                meets = crosses_segment(
                    origin_x, origin_y, x[:, None], y[:, None], *(corner[:, None] for corner in corners)
                )
            unseen |= (self.reflector == index) & ~meets
            unseen |= (self.reflector < 0) & meets
        return unseen


def locate_walls(scene: Scene, reflector: IntArray, center_x: FloatArray, center_y: FloatArray) -> WallRows | None:
    """Return the walls of a scene for rows (B, K) about local origins (B,); None where it has none."""
    ends = {
        index: (*wall.start, *wall.end)
        for index, wall in enumerate(scene.reflectors)
        if isinstance(wall, SegmentReflector)
    }
    return WallRows(ends, reflector, center_x, center_y) if ends else None


def unseen_rows(
    origin_x: FloatArray,
    origin_y: FloatArray,
    mirrors: MirrorRows | None,
    direct: tuple[DirectRows, ...],
    circles: CirclePaths | None,
    walls: WallRows | None,
    x: FloatArray,
    y: FloatArray,
    paths: ReflectedPath | None = None,
) -> BoolArray:
    """Return to which rows (B, K), with unfolded origins, a point (B,) can't be visible by any part of the scene.

    All coordinates are about the local origins; ``paths`` are those of ``circles`` from the points, if known.
    """
    unseen = np.zeros(origin_x.shape, dtype=bool, order="F")
    if mirrors is not None:
        unseen |= mirrors.beyond(x, y)
    for rows in direct:
        rows.place_in(unseen, rows.pick_from(unseen) | rows.outside(x, y))
    if circles is not None:
        circles.place_in(unseen, circles.outside(x, y, circles.paths_from(x, y) if paths is None else paths))
    if walls is not None:
        unseen |= walls.unseen(origin_x, origin_y, x, y)
    return unseen


def hidden_by_walls(
    scene: Scene,
    sensor_x: FloatArray,
    sensor_y: FloatArray,
    x: FloatArray,
    y: FloatArray,
    center_x: FloatArray,
    center_y: FloatArray,
) -> BoolArray:
    """Return which points (B, P) no sensor (B, K) sees: the straight way to each crosses a wall.

    Walls are the scene's line and segment reflectors. Points and sensors are about the local origins ``center``
    (B,), metres.
    """
    hidden = np.ones(x.shape, dtype=bool)
    for k in range(sensor_x.shape[1]):
        blocked = np.zeros(x.shape, dtype=bool)
        for wall in scene.reflectors:
            ends = _ends(wall)
            if ends is None:
                continue
            (x1, y1), (x2, y2) = ends
            corners = (x1 - center_x, y1 - center_y, x2 - center_x, y2 - center_y)
            blocked |= crosses_segment(
                sensor_x[:, k, None],
                sensor_y[:, k, None],
                x,
                y,
                *(corner[:, None] for corner in corners),
                endless=isinstance(wall, LineReflector),
            )
        hidden &= blocked
    return hidden


def _ends(wall: object) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Return two points of a wall: the ends of a segment, or any two of a line; None for other reflectors."""
    if isinstance(wall, SegmentReflector):
        return wall.start, wall.end
    if isinstance(wall, LineReflector):
        return wall.point, (wall.point[0] + wall.direction[0], wall.point[1] + wall.direction[1])
    return None
