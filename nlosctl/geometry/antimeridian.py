"""Rings and lines across the 180th meridian or about a pole, cut into parts as maps need them (RFC 7946, 3.1.9)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray

__all__ = ["crosses_antimeridian", "cut_line", "cut_ring", "ring_area", "rings_by_polygon"]


def crosses_antimeridian(path: FloatArray) -> BoolArray:
    """Return which paths (N, P, 2) of longitudes and latitudes cross the 180th meridian; a NaN crosses nothing."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(np.diff(path[..., 0], axis=-1)) > 180.0).any(axis=-1))


def ring_area(ring: FloatArray) -> float:
    """Return the area of a closed ring (V, 2), negative if it is clockwise."""
    x, y = ring.T
    return float(0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def rings_by_polygon(rings: Sequence[FloatArray]) -> list[list[FloatArray]]:
    """Return rings by polygon: each clockwise ring is a hole of the counter-clockwise one before it."""
    groups: list[list[FloatArray]] = []
    for ring in rings:
        if groups and ring_area(ring) < 0.0:
            groups[-1].append(ring)
        else:
            groups.append([ring])
    return groups


def cut_ring(ring: FloatArray) -> list[FloatArray]:
    """Return the parts of a closed ring (V, 2), counter-clockwise: closed rings between -180 and 180 degrees.

    A ring that goes around the earth contains the pole on its left, and its part reaches there.
    """
    corners = _unwrapped(ring)
    turns = round((corners[-1, 0] - corners[0, 0]) / 360.0)
    if turns:
        return [_with_pole(cut_line(ring), float(np.sign(turns)))]
    corners = corners[:-1]
    parts = []
    for shift in _shifts(corners):
        part = corners - (shift, 0.0)
        for side in (-1.0, 1.0):
            part = _clipped(part, side)
        if part.shape[0] >= 3 and np.ptp(part[:, 0]) > 0.0:
            parts.append(np.concatenate([part, part[:1]]))
    return parts


def cut_line(line: FloatArray) -> list[FloatArray]:
    """Return the parts of a line (P, 2) between -180 and 180 degrees."""
    unwrapped = _unwrapped(line)
    parts, part = [], [unwrapped[0]]
    for start, end in pairwise(unwrapped):
        for edge in _edges_between(start[0], end[0]):
            crossing = start + (end - start) * ((edge - start[0]) / (end[0] - start[0]))
            parts.append(np.array([*part, [edge, crossing[1]]]))
            part = [np.array([edge, crossing[1]])]
        if (end != part[-1]).any():
            part.append(end)
    parts.append(np.array(part))
    whole = [part for part in parts if part.shape[0] > 1]
    return [part - (360.0 * np.round(part[:, 0].mean() / 360.0), 0.0) for part in whole]


def _with_pole(lines: list[FloatArray], turn: float) -> FloatArray:
    """Return the ring that goes once around the earth, from its cut ``lines``: along them, and back by the pole."""
    line = lines[0] if len(lines) == 1 else np.concatenate([lines[-1], lines[0][1:]])
    line[[0, -1], 0] = -180.0 * turn, 180.0 * turn
    pole = 90.0 * turn
    return np.concatenate([line, [[180.0 * turn, pole], [-180.0 * turn, pole]], line[:1]])


def _unwrapped(path: FloatArray) -> FloatArray:
    """Return a path whose longitudes are continuous, beyond 180 degrees if need be."""
    step = np.diff(path[:, 0])
    turned = np.concatenate([[0.0], -360.0 * np.cumsum(np.round(step / 360.0))])
    return np.stack([path[:, 0] + turned, path[:, 1]], axis=1)


def _shifts(corners: FloatArray) -> FloatArray:
    """Return the multiples of 360 degrees by which parts of the corners are outside of -180 to 180 degrees."""
    low, high = (np.round(corners[:, 0].min() / 360.0), np.round(corners[:, 0].max() / 360.0))
    return 360.0 * np.arange(low, high + 1.0)


def _edges_between(start: float, end: float) -> FloatArray:
    """Return the odd multiples of 180 degrees after ``start``, up to ``end``, in the direction of travel."""
    sign = 1.0 if end > start else -1.0
    first, last = np.floor((sign * start - 180.0) / 360.0) + 1.0, np.floor((sign * end - 180.0) / 360.0)
    return sign * (180.0 + 360.0 * np.arange(first, last + 1.0))


def _clipped(corners: FloatArray, side: float) -> FloatArray:
    """Return the polygon (M, 2) without what is beyond 180 degrees east (``side`` 1) or west (-1)."""
    clipped: list[FloatArray] = []
    for start, end in zip(np.roll(corners, 1, axis=0), corners, strict=True):
        inside = [side * point[0] <= 180.0 for point in (start, end)]
        if inside[0] != inside[1]:
            edge = side * 180.0
            along = (edge - start[0]) / (end[0] - start[0])
            clipped.append(np.array([edge, start[1] + along * (end[1] - start[1])]))
        if inside[1]:
            clipped.append(end)
    return np.array(clipped).reshape(-1, 2)
