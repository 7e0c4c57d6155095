"""Initial estimates of single paths in space, and the suprema of their likelihood on and straight above the nodes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_overflow
from nlosctl.geometry.directions import Vector
from nlosctl.geometry.symmetric import dot
from nlosctl.models.triplets import SpacePaths
from nlosctl.solvers.triplets.legs import Node, cross_rays
from nlosctl.solvers.triplets.likelihood import TripletProblem

__all__ = ["space_crossings", "space_starts", "space_suprema"]

_GUESSES = (-0.7, 0.7)
"""Elevations (radians) tried where a direction has only an azimuth."""

_SECTIONS, _GOLDEN = 60, 0.5 * (np.sqrt(5.0) - 1.0)


def space_starts(rows: SpacePaths, problem: TripletProblem) -> Iterator[Vector]:
    """Yield initial estimates (three arrays (N,)): where both rays meet the ellipsoid, and the middle first.

    A ray without elevation is aimed at the point of the other, and up and down besides. NaN where there is nothing new.
    """
    tx, rx = (_of_column(node) for node in (problem.tx, problem.rx))
    measured = [np.asarray(node.elevation_rad) for node in (tx, rx)]
    on_dod, on_doa = _on_ellipsoid(rows, tx, rx, measured[0]), _on_ellipsoid(rows, rx, tx, measured[1])
    aimed_dod = _on_ellipsoid(rows, tx, rx, np.where(tx.has_elevation, measured[0], _elevation(tx, on_doa)))
    aimed_doa = _on_ellipsoid(rows, rx, tx, np.where(rx.has_elevation, measured[1], _elevation(rx, on_dod)))
    yield tuple(0.5 * (a + b) for a, b in zip(aimed_dod, aimed_doa, strict=True))
    yield aimed_dod
    yield aimed_doa
    for guess in _GUESSES:
        for node, other in ((tx, rx), (rx, tx)):
            if not node.has_elevation.all():
                yield _on_ellipsoid(rows, node, other, np.where(node.has_elevation, np.nan, guess))


def space_crossings(rows: SpacePaths, problem: TripletProblem) -> Vector:
    """Return where the two rays cross (three arrays (N,)); NaN behind a node, and far away."""
    with ignoring_overflow():
        crossing = cross_rays(*(_of_column(node) for node in (problem.tx, problem.rx)))
        usable = dot(crossing, crossing) < 100.0 * rows.path_length_m**2
    return tuple(np.where(usable, part, np.nan) for part in crossing)


def space_suprema(
    rows: SpacePaths, problem: TripletProblem, best_cost: FloatArray
) -> Iterator[tuple[IntArray, Vector, FloatArray]]:
    """Yield rows (M,) with targets (three arrays (M,)) on nodes and straight above and below them, and their costs.

    The azimuth at that node is then any, so that the likelihood of a wrong triplet may have its supremum there. Rows
    whose costs exceed ``best_cost`` (N,) in any case are left out.
    """
    everywhere = np.arange(best_cost.shape[0])
    for first in (True, False):
        node = problem.tx if first else problem.rx
        point = tuple(part[:, 0] for part in node.position)
        yield everywhere, point, _cost_beside(problem, first, point)
        azimuth = _other(problem, first).residuals(*point)[0] * _other(problem, first).inverse_std
        elevation, inverse_std = np.asarray(node.elevation_rad)[:, 0], np.asarray(node.inverse_elevation_std)[:, 0]
        for side in (-1.0, 1.0):
            own = 0.5 * ((side * 0.5 * np.pi - elevation) * inverse_std) ** 2
            some = np.flatnonzero(own + 0.5 * azimuth[:, 0] ** 2 <= best_cost)
            if some.size:
                above, cost = _lowest_above(problem.take(some), first, side, rows.path_length_m[some])
                yield some, above, own[some] + cost


def _lowest_above(
    problem: TripletProblem, first: bool, side: float, highest_m: FloatArray
) -> tuple[Vector, FloatArray]:
    """Return the targets (three arrays (N,)) straight above or below nodes that cost least, by golden sections."""
    x, y, z = (part[:, 0] for part in (problem.tx if first else problem.rx).position)
    low, high = np.zeros_like(z), highest_m
    for _ in range(_SECTIONS):
        step = _GOLDEN * (high - low)
        lower, upper = high - step, low + step
        costs = [_cost_beside(problem, first, (x, y, z + side * at)) for at in (lower, upper)]
        falls = costs[0] < costs[1]
        low, high = np.where(falls, low, lower), np.where(falls, upper, high)
    point = (x, y, z + side * 0.5 * (low + high))
    return point, _cost_beside(problem, first, point)


def _other(problem: TripletProblem, first: bool) -> Node:
    return problem.rx if first else problem.tx


def _cost_beside(problem: TripletProblem, first: bool, point: Vector) -> FloatArray:
    """Return half the chi-square (N,) without the direction measured at the first node (or the second)."""
    nothing = np.zeros_like(problem.path_length_m)
    tx, rx = (
        replace(node, inverse_std=nothing, inverse_elevation_std=nothing) if free else node
        for node, free in ((problem.tx, first), (problem.rx, not first))
    )
    return replace(problem, tx=tx, rx=rx).cost(*point)


def _of_column(node: Node) -> Node:
    """Return a node (N, 1) as flat arrays (N,)."""
    return node.map(lambda values: values[:, 0])


def _on_ellipsoid(rows: SpacePaths, node: Node, other: Node, elevation_rad: FloatArray) -> Vector:
    """Return where rays with these elevations meet the ellipsoid: at (l^2 - d^2) / (2 (l - d cos)) from the node.

    Where there is no ellipsoid it is that of a longer path.
    """
    base = rows.frame.length_m
    length = np.maximum(rows.path_length_m, base + rows.path_length_std_m)
    ray = node.ray(elevation_rad)
    along = dot([b - a for a, b in zip(node.position, other.position, strict=True)], ray)
    reach = 0.5 * (length - base) * (length + base) / (length - along)
    return tuple(own + reach * part for own, part in zip(node.position, ray, strict=True))


def _elevation(node: Node, point: Vector) -> FloatArray:
    """Return the elevation at which nodes see points."""
    x, y, z = (part - own for part, own in zip(point, node.position, strict=True))
    return np.asarray(np.arctan2(z, np.hypot(x, y)))
