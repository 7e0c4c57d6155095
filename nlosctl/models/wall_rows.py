"""Finite walls of the scene: which rows can a point be seen by, along the path that each states?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlosctl.contract.scene import Scene, SegmentReflector
from nlosctl.geometry.blocks import gather_rows
from nlosctl.geometry.segments import crosses_segment

__all__ = ["WallRows", "locate_walls"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]
BoolArray = npt.NDArray[np.bool_]


@dataclass(frozen=True)
class WallRows:
    """The segment reflectors of a scene, ends x1, y1, x2, y2 (metres) by their place in it, and the rows' reflectors.

    ``reflector`` (B, K) is -1 for direct rows; ``center`` (B,) is the local origin of the points asked for.
    """

    ends_m: dict[int, tuple[float, float, float, float]]
    reflector: IntArray
    center_x: FloatArray
    center_y: FloatArray

    def take(self, rows: IntArray) -> WallRows:
        """Return those of some snapshots, in any order and as often as named."""
        return WallRows(self.ends_m, gather_rows(self.reflector, rows), self.center_x[rows], self.center_y[rows])

    def unseen(self, origin_x: FloatArray, origin_y: FloatArray, x: FloatArray, y: FloatArray) -> BoolArray:
        """Return to which rows (B, K), with unfolded origins, points (B,) about the local origins can't be visible.

        A row by a wall needs its way to meet the wall between its ends, a direct row must not meet any wall.
        """
        unseen = np.zeros(origin_x.shape, dtype=bool)
        for place, (x1, y1, x2, y2) in self.ends_m.items():
            corners = (x1 - self.center_x, y1 - self.center_y, x2 - self.center_x, y2 - self.center_y)
            with np.errstate(invalid="ignore", over="ignore"):
                meets = crosses_segment(
                    origin_x, origin_y, x[:, None], y[:, None], *(corner[:, None] for corner in corners)
                )
            unseen |= (self.reflector == place) & ~meets
            unseen |= (self.reflector < 0) & meets
        return unseen


def locate_walls(scene: Scene, reflector: IntArray, center_x: FloatArray, center_y: FloatArray) -> WallRows | None:
    """Return the walls of a scene for rows (B, K) about local origins (B,); None where it has none."""
    ends = {
        place: (*wall.start, *wall.end)
        for place, wall in enumerate(scene.reflectors)
        if isinstance(wall, SegmentReflector)
    }
    return WallRows(ends, reflector, center_x, center_y) if ends else None
