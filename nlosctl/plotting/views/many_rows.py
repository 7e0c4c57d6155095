"""Snapshots of many rows: rays and circles that fade with their number, tracks of moving sensors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.plotting.library import Axes, LineCollection
from nlosctl.plotting.plane import draw_sensors

__all__ = ["MANY_ROWS", "circle_outlines", "draw_faint_lines", "draw_tracks"]

MANY_ROWS = 50
"""Snapshots of more rows are drawn with faint lines and without wedges."""

_CORNERS = 121
_OPAQUE_LINES = 12.0
_FAINTEST, _STRONGEST = 0.025, 0.6
_RASTER_LINES = 300
_MOST_TRACKS = 40


def circle_outlines(center: FloatArray, radius: FloatArray) -> FloatArray:
    """Return closed outlines (N, 121, 2) of circles about centres (N, 2)."""
    turn = np.linspace(0.0, 2.0 * np.pi, _CORNERS)
    around = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
    outlines: FloatArray = center[:, None] + radius[:, None, None] * around
    return outlines


def draw_faint_lines(axes: Axes, lines: Sequence[FloatArray], *, color: str, label: str, **look: Any) -> None:
    """Draw N polylines (P, 2) whose opacity falls with their number, so that many together show a density."""
    count = len(lines)
    opacity = float(np.clip(_OPAQUE_LINES / max(count, 1), _FAINTEST, _STRONGEST))
    drawn = LineCollection(lines, colors=color, alpha=opacity, linewidths=0.9, **look)
    drawn.set_rasterized(count > _RASTER_LINES)
    axes.add_collection(drawn, autolim=False)
    axes.plot([], [], color=color, linewidth=0.9, label=f"{label} ({count})")


def draw_tracks(axes: Axes, names: Sequence[str], position_m: FloatArray) -> None:
    """Draw sensors (K, 2) of rows in file order: those that move as a line with a triangle at its end."""
    order = np.unique(np.array(names, dtype=object).astype(str), return_inverse=True)[1]
    ends: dict[str, FloatArray] = {}
    tracks = []
    for number in range(int(order.max(initial=-1)) + 1):
        rows = np.flatnonzero(order == number)
        ends[str(names[rows[-1]])] = position_m[rows[-1]]
        if (position_m[rows] != position_m[rows[0]]).any():
            tracks.append(position_m[rows])
    if tracks:
        axes.add_collection(LineCollection(tracks, colors="black", linewidths=1.6, zorder=3.0), autolim=False)
        axes.plot([], [], color="black", linewidth=1.6, label="track of a sensor")
    if len(ends) <= _MOST_TRACKS or not tracks:
        draw_sensors(axes, list(ends), np.array(list(ends.values())))
