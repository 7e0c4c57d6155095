"""The paths of a world of finite walls: the direct one where no wall is in the way, and one by each wall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlosctl.contract.scene import SegmentReflector
from nlosctl.geometry.segments import crosses_segment, reflect_in_segment

__all__ = ["WallPath", "trace_paths"]

Point = tuple[float, float]


@dataclass(frozen=True)
class WallPath:
    """A path that reaches a receiver: where it comes from, its length, and the wall by which it came (None: direct)."""

    bearing_rad: float
    length_m: float
    wall: str | None


def trace_paths(source: Point, receiver: Point, walls: Sequence[SegmentReflector]) -> list[WallPath]:
    """Return the paths from source to receiver, the shortest first: direct, or by one wall; none through a wall."""
    paths = []
    if not any(_crosses(source, receiver, wall) for wall in walls):
        paths.append(_leg(receiver, source, 0.0, None))
    for wall in walls:
        x, y = reflect_in_segment(*(np.array(part) for part in (*source, *receiver, *wall.start, *wall.end)))
        point = (float(x), float(y))
        others = [other for other in walls if other is not wall]
        blocked = any(_crosses(end, point, other) for other in others for end in (source, receiver))
        if np.isfinite(x) and not blocked:
            first_m = float(np.hypot(point[0] - source[0], point[1] - source[1]))
            paths.append(_leg(receiver, point, first_m, wall.name))
    return sorted(paths, key=lambda path: path.length_m)


def _leg(receiver: Point, point: Point, before_m: float, wall: str | None) -> WallPath:
    dx, dy = point[0] - receiver[0], point[1] - receiver[1]
    return WallPath(float(np.arctan2(dy, dx)), before_m + float(np.hypot(dx, dy)), wall)


def _crosses(start: Point, end: Point, wall: SegmentReflector) -> bool:
    return bool(crosses_segment(*(np.array(part) for part in (*start, *end, *wall.start, *wall.end))))
