"""Is the scene too large for a flat plane? What it costs is measured on the very lines between sensors and fixes."""

from __future__ import annotations

import threading
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, ignoring_invalid
from nlosctl.contract.scene import EarthFrame
from nlosctl.geometry.earth import EarthPlane, flat_errors
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.pipeline.solve.solve_chunk import FlatEstimates, Problem

__all__ = ["FlatPlaneTally"]


_TOLD_FROM = 0.1
"""An error larger than this share of the stated standard deviation is told."""

_STATED = {
    "bearings": (("sensor", "bearing_std_rad", "rad"), ("sensor", "range_std_m", "m")),
    "ranges": (("sensor", "range_std_m", "m"),),
    "triplets": (("tx", "dod_std_rad", "rad"), ("rx", "doa_std_rad", "rad"), ("rx", "path_length_std_m", "m")),
}
"""From where lines go to the fix, and the std to hold the error of their direction or length against."""


class FlatPlaneTally:
    """The largest error of the plane over a run, by its unit: share of the std, error, length of the line in metres.

    It is kept in ``worst``, where the parts of a run are put together. Without a frame on earth it counts nothing.
    Takes estimates from several threads.
    """

    def __init__(self, frame: EarthFrame | None, worst: dict[str, tuple[float, ...]]) -> None:
        self._plane = None if frame is None else plane_of(frame)
        self._worst = worst
        self._lock = threading.Lock()

    def add(self, problem: Problem, estimates: FlatEstimates | None) -> None:
        """Take the estimates of a chunk: the lines from each kept row's sensor to its snapshot's first fix."""
        if self._plane is None or estimates is None:
            return
        counts = np.diff(problem.offsets)
        fix = np.full((counts.shape[0], 2), np.nan)
        places, first = np.unique(estimates.snapshot, return_index=True)
        fix[places] = estimates.position_m[first]
        target = np.repeat(fix, counts, axis=0)
        rows = np.flatnonzero(problem.kept & np.isfinite(target[:, 0]))
        for place, std, unit in _STATED[problem.kind]:
            if std in problem.columns and rows.shape[0]:
                error = _errors(self._plane, problem.columns, place, target, rows)[unit]
                self._take(unit, error, problem.columns[std][rows])

    def remarks(self) -> list[str]:
        """Return what to say of errors that are more than a tenth of the stated std."""
        said = []
        for unit, (share, error, length) in sorted(self._worst.items(), reverse=True):
            if share > _TOLD_FROM:
                size = f"turns lines by up to {np.degrees(error):.2g} deg" if unit == "rad" else ""
                size = size or f"stretches lines by up to {error:.2g} m"
                said.append(
                    f"the scene is large for a flat plane: it {size} ({share:.0%} of the stated std, on a line of "
                    f"{length / 1e3:.3g} km); choose an --origin amid it, a --crs made for it, or smaller snapshots"
                )
        return said

    def _take(self, unit: str, found: tuple[FloatArray, FloatArray], std: FloatArray) -> None:
        error, length = found
        with ignoring_invalid():
            share = np.where(np.isfinite(error) & (std > 0.0), error / std, 0.0)
        place = int(np.argmax(share))
        worst = (float(share[place]), float(error[place]), float(length[place]))
        with self._lock:
            self._worst[unit] = max(worst, self._worst.get(unit, worst))


def _errors(
    plane: EarthPlane, columns: Mapping[str, npt.NDArray[Any]], place: str, target: FloatArray, rows: Any
) -> dict[str, tuple[FloatArray, FloatArray]]:
    x, y = columns[f"{place}_x_m"][rows], columns[f"{place}_y_m"][rows]
    to_x, to_y = target[rows, 0], target[rows, 1]
    turned, stretched = (np.abs(part) for part in flat_errors(plane, x, y, to_x, to_y))
    length = np.hypot(to_x - x, to_y - y)
    return {"rad": (turned, length), "m": (stretched, length)}
