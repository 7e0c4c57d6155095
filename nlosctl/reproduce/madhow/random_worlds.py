"""Random worlds that fit the caption of Figure 10 of Ananthasubramaniam and Madhow, with the source at location A."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.scene import Scene
from nlosctl.geometry.angles import wrap_angle
from nlosctl.geometry.lines import crosses_segment, reflect_in_segment
from nlosctl.io.results.tables import measurement_table
from nlosctl.reproduce.experiment import Chunk
from nlosctl.reproduce.simulated import Simulated
from nlosctl.scenarios.madhow_walls import MadhowWallsOptions

__all__ = ["random_worlds", "worlds_of_caption"]

_Points = tuple[FloatArray, FloatArray]
_Walls = tuple[FloatArray, FloatArray, FloatArray, FloatArray]

_FIELD_M = 500.0
_CANDIDATES = 50_000
_DIRECT = np.array([True, True, True, False])
_REFLECTED = np.array([False, False, True, True])
"""Which paths R1 to R4 receive with the source at A."""


def random_worlds(chunk: Chunk) -> Simulated:
    """Sample the chunk's trials, each in a world of its own, with the options of ``madhow-walls``: a row per receiver.

    The scene is empty, because every trial has other walls; suppression as published does not use them.
    """
    generator = chunk.generator()
    options = MadhowWallsOptions()
    points, specular = worlds_of_caption(generator, chunk.size)
    source, receivers = points[:, :1], points[:, 1:5]
    std = np.radians(options.bearing_std_deg)
    errors = std * generator.standard_normal((2, chunk.size, 4))
    direct_m, direct_rad = _polar(source - receivers)
    last_leg_m, reflected_rad = _polar(specular - receivers)
    reflected_m = last_leg_m + _polar(specular - source)[0]
    power = np.where(_DIRECT, direct_m**-2.0, 0.0)
    reflected_power = np.where(_REFLECTED, options.reflected_power * reflected_m**-2.0, 0.0)
    sums = [
        power * part(direct_rad + errors[0]) + reflected_power * part(reflected_rad + errors[1])
        for part in (np.sin, np.cos)
    ]
    columns = {
        "snapshot": np.repeat(chunk.trials, 4),
        "sensor": np.tile(np.array(["R1", "R2", "R3", "R4"], dtype=object), chunk.size),
        "sensor_x_m": receivers[..., 0].ravel(),
        "sensor_y_m": receivers[..., 1].ravel(),
        "bearing_rad": wrap_angle(np.arctan2(*sums).ravel()),
        "bearing_std_rad": np.full(4 * chunk.size, std),
    }
    table = measurement_table("bearings", columns)
    return Simulated(kind="bearings", columns=columns, table=table, scene=Scene(), truth_m=source[:, 0])


def worlds_of_caption(generator: np.random.Generator, count: int) -> tuple[FloatArray, FloatArray]:
    """Return worlds (count, 9, 2) that fit the caption, and their specular points (count, 4, 2).

    A world has the source, R1 to R4, and the ends of the blocking and of the reflecting wall, all uniform in the field.
    Worlds are rejected unless two receivers have only the direct path (R1, R2), one the direct and the reflected one
    (R3), and one, which the blocking wall hides, only the reflected one (R4), and none a path off the blocking wall.
    Receivers without a reflected path have the source as their specular point.
    """
    worlds, speculars, found = [], [], 0
    while found < count:
        points = generator.uniform(0.0, _FIELD_M, (_CANDIDATES, 9, 2))
        role, specular = _roles(points)
        order = np.argsort(role, axis=1)
        fits = np.all(np.take_along_axis(role, order, axis=1) == [0, 0, 1, 2], axis=1)
        points, specular, order = points[fits], specular[fits], order[fits][..., None]
        points[:, 1:5] = np.take_along_axis(points[:, 1:5], order, axis=1)
        worlds.append(points)
        speculars.append(np.where(_REFLECTED[:, None], np.take_along_axis(specular, order, axis=1), points[:, :1]))
        found += points.shape[0]
    return np.concatenate(worlds)[:count], np.concatenate(speculars)[:count]


def _roles(points: FloatArray) -> tuple[IntArray, FloatArray]:
    """Return each receiver's role (W, 4), 0: R1 or R2, 1: R3, 2: R4, 3: none of them, and its specular point."""
    x, y = points[..., 0], points[..., 1]
    source, receivers = (x[:, :1], y[:, :1]), (x[:, 1:5], y[:, 1:5])
    blocking, reflecting = ((x[:, k, None], y[:, k, None], x[:, k + 1, None], y[:, k + 1, None]) for k in (5, 7))
    hidden = crosses_segment(*source, *receivers, *blocking)
    direct = ~hidden & ~crosses_segment(*source, *receivers, *reflecting)
    specular_x, specular_y, reflected = _reflected(source, receivers, reflecting, blocking)
    *_, unwanted = _reflected(source, receivers, blocking, reflecting)
    role = np.select([unwanted, direct & ~reflected, direct & reflected, hidden & reflected], [3, 0, 1, 2], 3)
    return role, np.stack([specular_x, specular_y], axis=-1)


def _reflected(
    source: _Points, receivers: _Points, wall: _Walls, other: _Walls
) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the specular points x, y on a wall, and whether the other wall lets that path through."""
    x, y = reflect_in_segment(*source, *receivers, *wall)
    blocked = crosses_segment(*source, x, y, *other) | crosses_segment(*receivers, x, y, *other)
    return x, y, np.isfinite(x) & ~blocked


def _polar(offsets: FloatArray) -> tuple[FloatArray, FloatArray]:
    x, y = offsets[..., 0], offsets[..., 1]
    return np.hypot(x, y), np.arctan2(y, x)
