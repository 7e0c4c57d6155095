"""Targets on a wall that may be points where detours over another target meet.

A path from a transmitter to a target T, over a wall, to a receiver is a direct path over T to the image of that
receiver in the wall. If all direct paths are blocked, such detours, and those that meet the wall first, may agree at a
point of the wall: behind T where the stations are in front of it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_invalid
from nlosctl.contract.scene import LineReflector, Scene, SegmentReflector
from nlosctl.geometry.lines import reflect_points
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.triplets.likelihood import TripletProblem

__all__ = ["Walls"]

_NEAR = 16.0
"""A target is on a wall within four standard deviations,"""
_ELSEWHERE = 100.0
"""and another one is elsewhere from ten on."""
_BETTER_NATS = 1.0
"""Detours are seldom alone: their fit must be better by so much."""
_STEPS = 24
_ASIDE = 7
"""Grid in front of the wall: steps to the nearest station, and half as many aside."""
_ZOOMS = 3


@dataclass(frozen=True)
class Walls:
    """The lines and segments of a scene, seen from local origins (B,). Circles have no images that are points."""

    scene: Scene
    center_x: FloatArray
    center_y: FloatArray

    def may_be_detours(
        self, problem: TripletProblem, x: FloatArray, y: FloatArray, information: SymmetricMatrix, paths: BoolArray
    ) -> BoolArray:
        """Return which targets x, y (B,) on a wall have another in front of it that explains their paths as detours.

        Positions are about the local origins. ``paths`` (B, K) support the target; as detours they fit better.
        """
        found = np.zeros(x.shape, dtype=bool)
        covariance = information.inverse()
        for reflector in self.scene.reflectors:
            if not isinstance(reflector, LineReflector | SegmentReflector):
                continue
            with ignoring_invalid():
                near = _on_wall(reflector, x + self.center_x, y + self.center_y, covariance)
            rows = np.flatnonzero(near & ~found & paths.any(axis=1))
            if rows.size:
                wall = _Wall(reflector, self.center_x[rows], self.center_y[rows], problem.take(rows), paths[rows])
                found[rows] = wall.detours_explain(x[rows], y[rows], information.take(rows))
        return found


def _on_wall(
    reflector: LineReflector | SegmentReflector, x: FloatArray, y: FloatArray, covariance: SymmetricMatrix
) -> BoolArray:
    """Return whether positions x, y (B,) are within some standard deviations of a wall."""
    size = np.hypot(*reflector.direction)
    along_x, along_y = np.array(reflector.direction) / size
    dx, dy = x - reflector.point[0], y - reflector.point[1]
    gap, along = along_x * dy - along_y * dx, along_x * dx + along_y * dy
    near: BoolArray = gap * gap <= _NEAR * covariance.quadratic_form(-along_y, along_x)
    if isinstance(reflector, SegmentReflector):
        past = along - np.clip(along, 0.0, size)
        near &= past * past <= _NEAR * covariance.quadratic_form(along_x, along_y)
    return near


class _Wall:
    """A wall with snapshots (N,): their paths over images of the receivers, or of the transmitters."""

    def __init__(
        self,
        reflector: LineReflector | SegmentReflector,
        center_x: FloatArray,
        center_y: FloatArray,
        problem: TripletProblem,
        supported: BoolArray,
    ) -> None:
        self.problem, self.supported = problem, supported
        self.angle = np.arctan2(reflector.direction[1], reflector.direction[0])
        self.point = (reflector.point[0] - center_x)[:, None], (reflector.point[1] - center_y)[:, None]
        cosine, sine = np.cos(2.0 * self.angle), np.sin(2.0 * self.angle)

        def image(node_x: FloatArray, node_y: FloatArray, ray_x: FloatArray, ray_y: FloatArray) -> list[FloatArray]:
            turned = cosine * ray_x + sine * ray_y, sine * ray_x - cosine * ray_y
            return [*reflect_points(node_x, node_y, *self.point, self.angle), *turned]

        tx = image(problem.tx_x, problem.tx_y, problem.dod_cosine, problem.dod_sine)
        rx = image(problem.rx_x, problem.rx_y, problem.doa_cosine, problem.doa_sine)
        self.over_images = (
            replace(problem, **dict(zip(("tx_x", "tx_y", "dod_cosine", "dod_sine"), tx, strict=True))),
            replace(problem, **dict(zip(("rx_x", "rx_y", "doa_cosine", "doa_sine"), rx, strict=True))),
        )

    def detours_explain(self, x: FloatArray, y: FloatArray, information: SymmetricMatrix) -> BoolArray:
        """Return whether paths over targets x, y (N,) on the wall are likelier detours over a target elsewhere."""
        stations = self._distance(np.hstack([self.problem.tx_x, self.problem.rx_x]),
                                  np.hstack([self.problem.tx_y, self.problem.rx_y]))  # fmt: skip
        side = np.sign(stations.sum(axis=1))
        reach = np.min(np.abs(stations), axis=1)
        normal = -np.sin(self.angle) * side, np.cos(self.angle) * side
        along = np.cos(self.angle), np.sin(self.angle)
        best = np.full(x.shape, np.inf)
        forward, aside, step = np.zeros(x.shape), np.zeros(x.shape), reach / _STEPS
        for zoom in range(_ZOOMS + 1):
            start_forward, start_aside = forward.copy(), aside.copy()
            forwards = np.arange(1, _STEPS) if zoom == 0 else np.arange(-2, 3)
            for i in forwards:
                for j in np.arange(-_ASIDE, _ASIDE + 1) if zoom == 0 else np.arange(-2, 3):
                    f, a = start_forward + i * step, start_aside + j * step
                    dx, dy = f * normal[0] + a * along[0], f * normal[1] + a * along[1]
                    cost = self._cost(x + dx, y + dy)
                    better = (cost < best) & (information.quadratic_form(dx, dy) > _ELSEWHERE) & (f > 0.0)
                    best = np.where(better, cost, best)
                    forward, aside = np.where(better, f, forward), np.where(better, a, aside)
            step = step / 3.0
        own = 0.5 * self.problem.chi_square(x, y, self.supported)
        return np.asarray(best <= own - _BETTER_NATS)

    def _distance(self, x: FloatArray, y: FloatArray) -> FloatArray:
        return np.asarray(np.cos(self.angle) * (y - self.point[1]) - np.sin(self.angle) * (x - self.point[0]))

    def _cost(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return half the chi-square (N,) of the supported paths as detours over targets x, y (N,)."""
        chi_square = np.full(self.supported.shape, np.inf)
        for problem in self.over_images:
            inverse = (problem.inverse_dod_std, problem.inverse_doa_std, problem.inverse_length_std)
            scaled = (part * scale for part, scale in zip(problem.residuals(x, y), inverse, strict=True))
            chi_square = np.minimum(chi_square, sum(part * part for part in scaled))
        return np.asarray(0.5 * np.where(self.supported, chi_square, 0.0).sum(axis=1))
