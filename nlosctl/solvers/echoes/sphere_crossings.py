"""Seeds of targets in space: the points where the spheres of three sensors cross."""

from __future__ import annotations

from itertools import combinations
from math import comb

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, Point
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.type_sets import Gate
from nlosctl.solvers.ranges.squared_ranges import fit_squared_ranges

__all__ = ["cross_spheres", "far_apart"]

_SEEING = 4
"""A target is seen by at least so many of the sensors whose spheres are crossed, and by three of them if one fails."""

_MOST_CROSSINGS = 30_000
"""More sensors are used as long as there are no more crossings than this."""


def cross_spheres(echoes: Echoes, least: int, gate: Gate) -> Point:
    """Return the crossings (three arrays (P,)) inside the gate of the spheres of each three of some sensors far apart.

    Spheres that miss each other have the point nearest to all three in their sensors' plane. A target that ``least``
    sensors see is seen by four of the chosen ones.
    """
    wanted = min(echoes.sensors, echoes.sensors - least + _SEEING)
    while wanted < echoes.sensors and comb(wanted + 1, 3) * echoes.most**3 <= _MOST_CROSSINGS:
        wanted += 1
    chosen = np.flatnonzero(far_apart(echoes, wanted))
    present = [np.flatnonzero(np.isfinite(radius)) for radius in echoes.radius]
    found: list[Point] = []
    for triple in combinations(chosen.tolist(), 3):
        echo = np.stack(np.meshgrid(*(present[sensor] for sensor in triple), indexing="ij"), axis=-1).reshape(-1, 3)
        index = np.array(triple)
        radius = np.asfortranarray(echoes.radius[index, echo])
        sensor = tuple(np.asfortranarray(np.broadcast_to(part[index], radius.shape)) for part in echoes.sensor)
        fit = fit_squared_ranges(sensor, radius * radius, 1.0 / (radius * radius))
        for point in (fit.point, fit.mirror):
            inside = np.flatnonzero(gate.contains(*point))
            found.append(tuple(part[inside] for part in point))
    return tuple(np.concatenate(parts) for parts in zip(*found, strict=True))


def far_apart(echoes: Echoes, wanted: int) -> BoolArray:
    """Return which sensors (N,) are chosen: one after the other the one farthest from those before."""
    chosen = np.zeros(echoes.sensors, dtype=bool)
    nearest = _length(echoes.sensor)
    for _ in range(wanted):
        farthest = int(np.argmax(np.where(chosen, -1.0, nearest)))
        chosen[farthest] = True
        nearest = np.minimum(nearest, _length(tuple(part - part[farthest] for part in echoes.sensor)))
    return chosen


def _length(vector: Point) -> FloatArray:
    level = np.hypot(vector[0], vector[1])
    return np.asarray(level if len(vector) == 2 else np.hypot(level, vector[2]))
