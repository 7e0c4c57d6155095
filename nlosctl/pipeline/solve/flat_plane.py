"""The error of the flat plane: how much it turns and stretches the lines between sensors and estimates."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from nlosctl.arrays import ignoring_invalid
from nlosctl.contract.scene import EarthFrame
from nlosctl.geometry.earth import flat_errors
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.io.scenes.scene_file import plane_of

__all__ = ["flat_plane_errors", "flat_plane_remarks"]

_REPORTED_SHARE = 0.1
"""An error above this share of the stated standard deviation is reported."""

_STATED = {
    "bearings": (("sensor", "bearing_std_rad", "rad"), ("sensor", "range_std_m", "m")),
    "ranges": (("sensor", "range_std_m", "m"),),
    "arrivals": (("sensor", "arrival_std_m", "m"),),
    "triplets": (("tx", "dod_std_rad", "rad"), ("rx", "doa_std_rad", "rad"), ("rx", "path_length_std_m", "m")),
}
"""The start of the line to the estimate, the std to compare its error with, and the unit: a direction or a length."""


def flat_plane_errors(
    frame: EarthFrame, kind: str, chunk: Chunk, estimates: ChunkEstimates
) -> dict[str, tuple[float, ...]]:
    """Return the largest error of the plane by its unit: share of the std, error, length of the line in metres.

    The lines are those from each used row's sensor to its snapshot's first estimate.
    """
    counts = np.diff(chunk.offsets)
    position = np.full((counts.shape[0], 2), np.nan)
    snapshot, first = np.unique(estimates.snapshot, return_index=True)
    position[snapshot] = estimates.position_m[first]
    target = np.repeat(position, counts, axis=0)
    rows = np.flatnonzero(~chunk.left_out & np.isfinite(target[:, 0]))
    to_x, to_y = target[rows, 0], target[rows, 1]
    worst: dict[str, tuple[float, ...]] = {}
    for start, std_name, unit in _STATED[kind]:
        if std_name not in chunk.columns or not rows.shape[0]:
            continue
        x, y, std = (chunk.columns[name][rows] for name in (f"{start}_x_m", f"{start}_y_m", std_name))
        turned, stretched = flat_errors(plane_of(frame), x, y, to_x, to_y)
        error, length = np.abs(turned if unit == "rad" else stretched), np.hypot(to_x - x, to_y - y)
        with ignoring_invalid():
            share = np.where(np.isfinite(error) & (std > 0.0), error / std, 0.0)
        index = int(np.argmax(share))
        candidate = (float(share[index]), float(error[index]), float(length[index]))
        worst[unit] = max(candidate, worst.get(unit, candidate))
    return worst


def flat_plane_remarks(worst: Mapping[str, Any]) -> list[str]:
    """Return a line for each unit in which the error is more than a tenth of the stated std."""
    remarks = []
    for unit, (share, error, length) in sorted(worst.items(), reverse=True):
        if share > _REPORTED_SHARE:
            size = f"stretches lines by up to {error:.2g} m"
            if unit == "rad":
                size = f"turns lines by up to {np.degrees(error):.2g} deg"
            remarks.append(
                f"the scene is large for a flat plane: it {size} ({share:.0%} of the stated std, on a line of "
                f"{length / 1e3:.3g} km); choose an `origin` amid it, a `crs` made for it, or smaller snapshots"
            )
    return remarks
