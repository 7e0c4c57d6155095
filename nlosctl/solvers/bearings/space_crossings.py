"""Candidate positions in space: where two rays pass each other, and where a ray has a range or a height."""

from __future__ import annotations

from functools import reduce

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.measured_height import GroundHeight
from nlosctl.models.space.lines import SpaceLines
from nlosctl.models.space.measured_angles import Vector
from nlosctl.solvers.bearings.ray_crossings import Candidates, gather

__all__ = ["cross_in_space", "ends_at_height", "ends_of_ranges"]

_ROUNDS_ON_GROUND = 4
"""So often the plane that replaces the ground moves under the crossing: then its bend is below a metre."""


def cross_in_space(lines: SpaceLines, first: IntArray, second: IntArray) -> Candidates:
    """Return the points nearest to the rays of pairs of rows, by weighted least squares.

    Two rays with elevations have the middle of their closest approach, weighted by their errors there; a ray and a
    vertical half-plane their intersection; two half-planes a point only with a measured height. Not valid where the
    lines are parallel, or where the point is behind a sensor. ``first`` and ``second`` are (P,) or (B, P).
    """
    normals, offsets = lines.planes(slice(None), None)
    pair = [_Row(lines, normals, offsets, index) for index in (first, second)]
    with ignoring_overflow():
        point = _meet(lines, pair, None)
        for _ in range(_ROUNDS_ON_GROUND if isinstance(lines.height, GroundHeight) else 1):
            point = _meet(lines, pair, point)
        whole = lines.whole(point)
        valid = np.logical_and.reduce([row.along_m(whole) > 0.0 for row in pair])
        valid &= np.logical_and.reduce([np.isfinite(part) for part in point])
    return _candidates(point, valid)


def ends_of_ranges(lines: SpaceLines, measured_m: FloatArray) -> Candidates:
    """Return the ends (B, K) of rays at their ranges; not valid in rows without a range or an elevation."""
    point = lines.ends(measured_m)
    return _candidates(point[: lines.unknowns], np.isfinite(point[0]))


def ends_at_height(lines: SpaceLines) -> Candidates:
    """Return where the rays (B, K) with an elevation first have the height of the source; not valid if they do not.

    That of a row by a sphere is behind the point where it is reflected.
    """
    with ignoring_overflow():
        ends = lines.ends(np.ones(lines.angles.cos_azimuth.shape))
        x, y, z = (end - origin for end, origin in zip(ends, lines.origin, strict=True))
        if lines.height is not None:
            reach = lines.height.reach_m(lines.origin, (x, y, z), lines.first_leg_m())
        else:
            assert lines.held_m is not None  # noqa: S101 - asked for where there is a height
            reach = (lines.held_m[:, None] - lines.origin[2]) / z
        point = tuple(origin + reach * part for origin, part in zip(lines.origin, (x, y, z), strict=True))
    return _candidates(point[: lines.unknowns], (reach > 0.0) & np.isfinite(reach))


def _candidates(point: Point, valid: BoolArray) -> Candidates:
    """Return candidates whose invalid points are the local origins: their cost is a number."""
    return Candidates(tuple(np.where(valid, part, 0.0) for part in point), valid)


def _rays(lines: SpaceLines) -> Vector:
    """Return the unit directions (B, K) of the rays; without an elevation level for the sensor."""
    directions = lines.angles.directions()
    return directions if lines.axes is None else lines.axes.unfolded(directions, slice(None))


class _Row:
    """One row of each pair: the planes of its azimuth and its elevation, and its direction, (B, P) each."""

    def __init__(self, lines: SpaceLines, normals: Point, offsets: FloatArray, index: IntArray) -> None:
        count = lines.rows

        def pick(block: FloatArray, start: int) -> FloatArray:
            return gather(block[:, start : start + count], index)

        unknowns = lines.unknowns
        self.normals = [[pick(part, start) for part in normals[:unknowns]] for start in (0, count)]
        self.offsets = [pick(offsets, start) for start in (0, count)]
        self.std = [pick(lines.std, start) for start in (0, count)]
        self.origin = [gather(part, index) for part in lines.origin]
        self.ray = [gather(part, index) for part in _rays(lines)]

    def along_m(self, point: Point) -> FloatArray:
        """Return how far points are along the ray."""
        parts = zip(point, self.origin, self.ray, strict=True)
        return reduce(np.add, [(part - origin) * ray for part, origin, ray in parts])


def _meet(lines: SpaceLines, pair: list[_Row], near: Point | None) -> Point:
    """Return the points (B, P) nearest to both rows of pairs, with weights by the distances of points ``near``.

    The level distance of an azimuth is taken as the whole one: then the weights need no axes.
    """
    shape = pair[0].offsets[0].shape
    matrix = SymmetricMatrix.full(shape, 0.0, lines.unknowns)
    right = [np.zeros(shape) for _ in range(lines.unknowns)]
    for row in pair:
        squared = np.ones(shape)
        if near is not None:
            away = [part - origin for part, origin in zip(lines.whole(near), row.origin, strict=True)]
            squared = reduce(np.add, [part * part for part in away])
        for normal, offset, std in zip(row.normals, row.offsets, row.std, strict=True):
            weight = 1.0 / (std * std * squared)
            matrix += SymmetricMatrix.outer(*normal, weight=weight)
            for total, part in zip(right, normal, strict=True):
                total += weight * part * offset
    if lines.height is not None:
        about = tuple(np.zeros(shape) for _ in lines.origin) if near is None else near
        up, level = lines.height.plane(*about)
        weight = np.broadcast_to((lines.height.inverse_std**2)[:, None], shape)
        if near is None:  # angles are in units of a distance of one
            weight = weight * np.maximum(reduce(np.add, [part[:, :1] ** 2 for part in lines.origin]), 1.0)
        matrix += SymmetricMatrix.outer(*up, weight=weight)
        for total, part in zip(right, up, strict=True):
            total += weight * part * level
    return matrix.solve(*right)
