"""Outlines of sets of grid cells as polygons with holes, along the edges of the cells."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.geometry.antimeridian import ring_area

__all__ = ["cell_outlines"]

Vertex = tuple[int, int]


def cell_outlines(inside: BoolArray) -> list[FloatArray]:
    """Return the closed rings (V, 2) about the true cells of a grid (rows, columns), in units of cells from its corner.

    Each counter-clockwise ring is the outside of a polygon; the clockwise rings after it are its holes. Cells that
    touch at a corner are in different polygons. Every corner of a cell on an outline is a vertex.
    """
    rings = _rings(inside)
    outer = [ring for ring in rings if ring_area(ring) > 0.0]
    holes: list[list[FloatArray]] = [[] for _ in outer]
    areas = [ring_area(ring) for ring in outer]
    for ring in rings:
        if ring_area(ring) < 0.0:
            start, end = ring[0], ring[1]
            middle = 0.5 * (start + end) + 0.25 * np.array([start[1] - end[1], end[0] - start[0]])  # left: in a cell
            around = [index for index, other in enumerate(outer) if _contains(other, middle)]
            holes[min(around, key=lambda index: areas[index])].append(ring)
    return [ring for own, inner in zip(outer, holes, strict=True) for ring in (own, *inner)]


def _rings(inside: BoolArray) -> list[FloatArray]:
    """Return all closed rings, with the cells on their left."""
    leaving = _edges(inside)
    rings: list[FloatArray] = []
    while leaving:
        start = next(iter(leaving))
        path, seen = [start], {start: 0}
        while True:
            vertex = path[-1]
            if vertex not in leaving:
                break
            following = _next(path, leaving)
            if following in seen:  # a loop is complete; what leads to it continues
                first = seen[following]
                rings.append(np.array([*path[first:], following], dtype=np.float64))
                for passed in path[first + 1 :]:
                    del seen[passed]
                del path[first + 1 :]
                continue
            seen[following] = len(path)
            path.append(following)
    return rings


def _edges(inside: BoolArray) -> dict[Vertex, list[Vertex]]:
    """Return the ends of the edges that leave each vertex, with a true cell on their left and none on their right."""
    padded = np.pad(inside, 1)
    leaving: dict[Vertex, list[Vertex]] = {}
    for (dy, dx), (start, end) in (
        ((-1, 0), ((0, 0), (1, 0))),
        ((0, 1), ((1, 0), (1, 1))),
        ((1, 0), ((1, 1), (0, 1))),
        ((0, -1), ((0, 1), (0, 0))),
    ):
        beyond = padded[1 + dy : padded.shape[0] - 1 + dy, 1 + dx : padded.shape[1] - 1 + dx]
        for row, column in np.argwhere(inside & ~beyond).tolist():
            leaving.setdefault((column + start[0], row + start[1]), []).append((column + end[0], row + end[1]))
    return leaving


def _next(path: list[Vertex], leaving: dict[Vertex, list[Vertex]]) -> Vertex:
    """Take and return the next vertex: where two edges leave, the left one, which stays with the cell."""
    vertex = path[-1]
    ends = leaving[vertex]
    index = 0
    if len(ends) > 1 and len(path) > 1:
        came = (vertex[0] - path[-2][0], vertex[1] - path[-2][1])
        turns = [came[0] * (end[1] - vertex[1]) - came[1] * (end[0] - vertex[0]) for end in ends]
        index = turns.index(max(turns))
    end = ends.pop(index)
    if not ends:
        del leaving[vertex]
    return end


def _contains(ring: FloatArray, point: FloatArray) -> bool:
    """Return whether a ring contains a point that is not on it."""
    x0, y0, y1 = ring[:-1, 0], ring[:-1, 1], ring[1:, 1]
    crosses = (y0 > point[1]) != (y1 > point[1])
    return bool(np.count_nonzero(crosses & (point[0] < np.where(crosses, x0, 0.0))) % 2)
