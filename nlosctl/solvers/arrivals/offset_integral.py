"""The likelihood of late and direct arrivals at positions: the offset of their clock integrated out, its prior flat.

At a position the likelihood, as a function of the offset, has a peak of width s_k at t_k - |x - a_k| for each row, the
excess of that row. No row is early, and one at least is direct: the offset ends a few s_k before the earliest excess,
as the search region's does. The trapezoidal rule over nodes about each excess, in steps of a fraction of s_k,
integrates it.
"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, Point
from nlosctl.solvers.arrivals.outlier_model import ArrivalOutlierModel

__all__ = ["cost_without_offset"]

_NEAR = np.linspace(-5.2, 5.2, 14)
"""The nodes about an excess, in standard deviations; those of each row are shifted by another part of their step."""

_STEP = float(_NEAR[1] - _NEAR[0])
_AT_ONCE = 1 << 16


def cost_without_offset(model: ArrivalOutlierModel, point: Point) -> FloatArray:
    """Return the negative logarithm (B, P) of the likelihood, integrated over offsets, at points (D arrays (B, P))."""
    size, count = point[0].shape
    step = max(1, _AT_ONCE // (size * _NEAR.shape[0] * model.mixture.count))
    cost = np.empty((size, count))
    for first in range(0, count, step):
        at = slice(first, first + step)
        cost[:, at] = _cost(model, tuple(np.ascontiguousarray(part[:, at]) for part in point))
    return cost


def _cost(model: ArrivalOutlierModel, point: Point) -> FloatArray:
    size, count = point[0].shape
    offset = np.sort(_nodes(model, point), axis=-1)
    nodes = offset.shape[-1]
    where = tuple(np.broadcast_to(part[..., None], offset.shape).reshape(size, -1) for part in point)
    score = model.mixture.score(*where, offset.reshape(size, -1)).reshape(offset.shape)
    least = score.min(axis=-1)
    density = np.exp(least[..., None] - score)
    total = np.zeros((size, count))
    for node in range(nodes - 1):
        width = offset[..., node + 1] - offset[..., node]
        total += 0.5 * width * (density[..., node] + density[..., node + 1])
    return np.asarray(least - np.log(total))


def _nodes(model: ArrivalOutlierModel, point: Point) -> FloatArray:
    """Return offsets (B, P, M), not in order."""
    rows, found = model.arrivals, []
    count = rows.std_m.shape[1]
    for k in range(count):
        squared = np.sum([(part - own[:, k, None]) ** 2 for part, own in zip(point, rows.sensor, strict=True)], axis=0)
        if rows.height is not None:
            squared = squared + (rows.height[:, k] ** 2)[:, None]
        excess = rows.arrival_m[:, k, None] - np.sqrt(squared)
        shifted = _NEAR + (k / count - 0.5) * _STEP
        found.append(excess[..., None] + rows.std_m[:, k, None, None] * shifted)
    return np.concatenate(found, axis=-1)
