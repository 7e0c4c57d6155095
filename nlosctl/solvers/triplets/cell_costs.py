"""The likelihood of triplets on a map: at points, or of cells about them.

A point that is uniform in a square of side h has the variance h^2 / 12 by each coordinate. It blurs an angle at a
distance r by h / (sqrt(12) r), and the length of a path, whose gradient is u + v with the unit vectors of both legs, by
|u + v| h / sqrt(12).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.solvers.triplets.legs import Node
from nlosctl.solvers.triplets.likelihood import TripletProblem

__all__ = ["cell_cost"]


def cell_cost(problem: TripletProblem, point: Point, spread_m: float) -> FloatArray:
    """Return half the chi-square (N,) of all paths of N snapshots at points about their local origins.

    ``spread_m`` is the std by each coordinate of a point within its cell: the stds are widened by it, and the logarithm
    of how much is added. A height that is held is no coordinate of the points.
    """
    held = problem.held
    if held is not None:
        point = (*point[:2], held.z_m)
    if spread_m == 0.0:
        return problem.cost(*point)
    along = [_unit_vector(node, point) for node in (problem.tx, problem.rx)]
    both = np.sum([(one + other) ** 2 for one, other in zip(along[0][:2], along[1][:2], strict=True)], axis=0)
    inverse_length_std, total = _widened(problem.inverse_length_std, np.sqrt(both) * spread_m)
    nodes = []
    for node, (*_, distance) in zip((problem.tx, problem.rx), along, strict=True):
        inverse_std, blur = _widened(node.inverse_std, spread_m / distance)
        total = total + blur
        elevation = node.inverse_elevation_std
        if elevation is not None:
            elevation, blur = _widened(elevation, spread_m / distance)
            total = total + blur
        nodes.append(replace(node, inverse_std=inverse_std, inverse_elevation_std=elevation))
    wider = replace(problem, tx=nodes[0], rx=nodes[1], inverse_length_std=inverse_length_std)
    return np.asarray(wider.cost(*point) + sum_measurements(total))


def _unit_vector(node: Node, point: Point) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return x and y of the unit vectors (N, K) from a node to points (N,), and the distances."""
    away = [part[:, None] - own for part, own in zip(point, node.position, strict=True)]
    distance = np.sqrt(np.sum([part * part for part in away], axis=0))
    distance = np.maximum(distance, np.finfo(np.float64).tiny ** 0.25)
    return away[0] / distance, away[1] / distance, distance


def _widened(inverse_std: FloatArray, spread: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return inverse stds with a further spread, and the logarithm of how much wider they are."""
    blur = 0.5 * np.log1p((inverse_std * spread) ** 2)
    return inverse_std * np.exp(-blur), blur
