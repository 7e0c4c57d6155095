"""Targets on a wall that may be points where detours over another target meet.

A path from a transmitter to a target T, over a wall, to a receiver is a direct path over T to the image of that
receiver in the wall. If all direct paths are blocked, such detours, and those that meet the wall first, may agree at a
point of the wall: behind T where the stations are in front of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_invalid
from nlosctl.contract.scene import LineReflector, PlaneReflector, Reflector, Scene, SegmentReflector
from nlosctl.geometry.blocks import rows_of
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.triplets.legs import Node
from nlosctl.solvers.triplets.likelihood import TripletProblem

__all__ = ["Walls"]

_NEAR = 16.0
"""A target is on a wall within four standard deviations,"""
_ELSEWHERE = 100.0
"""and another one is elsewhere from ten on."""
_BETTER_NATS = 1.0
"""Detours are seldom alone: their fit must be better by so much."""
_GRID = {2: (24, 7), 3: (12, 3)}
"""Grid in front of the wall, by dimension: steps to the nearest station, and steps aside."""
_ZOOMS = 3


@dataclass(frozen=True)
class Walls:
    """The walls of a scene, seen from local origins (D arrays (B,)). Circles have no images that are points."""

    scene: Scene
    center: tuple[FloatArray, ...]

    def may_be_detours(
        self, problem: TripletProblem, point: tuple[FloatArray, ...], information: SymmetricMatrix, paths: BoolArray
    ) -> BoolArray:
        """Return which targets (D arrays (B,)) on a wall have another in front that explains their paths as detours.

        Positions are about the local origins. ``paths`` (B, K) support the target; as detours they fit better.
        """
        found = np.zeros(point[0].shape, dtype=bool)
        covariance = information.inverse()
        position = tuple(map(np.add, point, self.center))
        for reflector in self.scene.reflectors:
            wall = _Wall.of(reflector, len(point))
            if wall is None:
                continue
            with ignoring_invalid():
                near = wall.is_near(position, covariance)
            if len(point) == 3:
                found |= wall.hides(position, self.center, problem, paths)
            rows = np.flatnonzero(near & ~found & paths.any(axis=1))
            if rows.size:
                detours = _Detours(wall, rows_of(self.center, rows), problem.take(rows), paths[rows])
                found[rows] = detours.explain(rows_of(point, rows), information.take(rows))
        return found


@dataclass(frozen=True)
class _Wall:
    """A flat wall: a point, the unit normal and the unit tangents; a segment has an ``extent`` along the first."""

    point: tuple[float, ...]
    normal: tuple[float, ...]
    tangents: tuple[tuple[float, ...], ...]
    extent: float | None = None

    @classmethod
    def of(cls, reflector: Reflector, dimension: int) -> _Wall | None:
        """Return the wall of a reflector, None if it is not flat; lines and segments are vertical in space."""
        if isinstance(reflector, PlaneReflector):
            *tangents, normal = np.linalg.svd(np.array([reflector.normal]))[2][[1, 2, 0]].tolist()
            return cls(reflector.point, tuple(normal), tuple(map(tuple, tangents)))
        if not isinstance(reflector, LineReflector | SegmentReflector):
            return None
        along_x, along_y = reflector.direction
        size = float(np.hypot(along_x, along_y))
        along_x, along_y = along_x / size, along_y / size
        extent = size if isinstance(reflector, SegmentReflector) else None
        if dimension == 2:
            return cls(reflector.point, (-along_y, along_x), ((along_x, along_y),), extent)
        tangents = ((along_x, along_y, 0.0), (0.0, 0.0, 1.0))
        return cls((*reflector.point, 0.0), (-along_y, along_x, 0.0), tangents, extent)

    def is_near(self, position: tuple[FloatArray, ...], covariance: SymmetricMatrix) -> BoolArray:
        """Return whether positions (D arrays (B,)) are within some standard deviations of the wall."""
        apart = [part - own for part, own in zip(position, self.point, strict=True)]
        gap, along = _along(self.normal, apart), _along(self.tangents[0], apart)
        near: BoolArray = gap * gap <= _NEAR * _variance(covariance, self.normal)
        if self.extent is not None:
            past = along - np.clip(along, 0.0, self.extent)
            near &= past * past <= _NEAR * _variance(covariance, self.tangents[0])
        return near

    def hides(
        self,
        position: tuple[FloatArray, ...],
        center: tuple[FloatArray, ...],
        problem: TripletProblem,
        paths: BoolArray,
    ) -> BoolArray:
        """Return whether targets (D arrays (B,)) are behind the wall for all nodes of their ``paths`` (B, K).

        They then are the image of a target in front, by paths that the wall reflects twice.
        """
        apart = [part - own for part, own in zip(position, self.point, strict=True)]
        gap, along = _along(self.normal, apart), _along(self.tangents[0], apart)
        behind = np.asarray(paths.any(axis=1))
        for node in (problem.tx, problem.rx):
            offset = [
                part + (own - base)[:, None] for part, own, base in zip(node.position, center, self.point, strict=True)
            ]
            behind &= (~paths | (_along(self.normal, offset) * gap[:, None] < 0.0)).all(axis=1)
        return behind if self.extent is None else behind & (along >= 0.0) & (along <= self.extent)


class _Detours:
    """A wall with snapshots (N,): their paths over images of the receivers, or of the transmitters."""

    def __init__(
        self, wall: _Wall, center: tuple[FloatArray, ...], problem: TripletProblem, supported: BoolArray
    ) -> None:
        self.wall, self.problem, self.supported = wall, problem, supported
        self.point = [(part - own)[:, None] for part, own in zip(wall.point, center, strict=True)]
        over_tx, over_rx = (node.mirrored(wall.normal, self._distance(node)) for node in (problem.tx, problem.rx))
        self.over_images = (replace(problem, tx=over_tx), replace(problem, rx=over_rx))

    def explain(self, point: tuple[FloatArray, ...], information: SymmetricMatrix) -> BoolArray:
        """Return whether paths over targets (D arrays (N,)) on the wall are likelier detours over one elsewhere."""
        stations = np.hstack([self._distance(self.problem.tx), self._distance(self.problem.rx)])
        side, reach = np.sign(stations.sum(axis=1)), np.min(np.abs(stations), axis=1)
        axes = (tuple(part * side for part in self.wall.normal), *self.wall.tangents)
        steps, aside = _GRID[len(point)]
        best, place = np.full(reach.shape, np.inf), [np.zeros(reach.shape) for _ in axes]
        step = reach / steps
        for zoom in range(_ZOOMS + 1):
            start = [part.copy() for part in place]
            near = range(-2, 3)
            ranges = [near] * len(axes) if zoom else [range(1, steps), *[range(-aside, aside + 1)] * (len(axes) - 1)]
            for cell in product(*ranges):
                at = [origin + index * step for origin, index in zip(start, cell, strict=True)]
                shift = [sum(a * axis[i] for a, axis in zip(at, axes, strict=True)) for i in range(len(axes))]
                cost = self._cost(tuple(map(np.add, point, shift)))
                better = (cost < best) & (information.quadratic_form(*shift) > _ELSEWHERE) & (at[0] > 0.0)
                best = np.where(better, cost, best)
                place = [np.where(better, new, old) for new, old in zip(at, place, strict=True)]
            step = step / 3.0
        own = 0.5 * self.problem.chi_square(point, self.supported)
        return np.asarray(best <= own - _BETTER_NATS)

    def _distance(self, node: Node) -> FloatArray:
        """Return the distances (N, K) of nodes from the wall, positive on the side of the normal."""
        return _along(self.wall.normal, [part - own for part, own in zip(node.position, self.point, strict=True)])

    def _cost(self, point: tuple[FloatArray, ...]) -> FloatArray:
        """Return half the chi-square (N,) of the supported paths as detours over targets (D arrays (N,))."""
        over_tx, over_rx = (problem.squares(*point) for problem in self.over_images)
        return np.asarray(0.5 * np.where(self.supported, np.minimum(over_tx, over_rx), 0.0).sum(axis=1))


def _variance(covariance: SymmetricMatrix, axis: tuple[float, ...]) -> FloatArray:
    """Return the variances along an axis."""
    return covariance.quadratic_form(*(np.asarray(part) for part in axis))


def _along(axis: tuple[float, ...], vector: Sequence[FloatArray]) -> FloatArray:
    """Return the components of vectors (D arrays) along an axis."""
    return np.asarray(sum(part * own for part, own in zip(vector, axis, strict=True)))
