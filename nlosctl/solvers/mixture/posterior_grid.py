"""The posterior of a position on local grids about the modes of a mixture, for a covariance that is calibrated."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.mixture.likelihood import Mixture
from nlosctl.solvers.mixture.modes import Modes

__all__ = ["posterior_covariance"]


_STEPS = 17
_REACH = 4.5
"""Each mode's grid has so many points on a side and reaches so many standard deviations either way."""

_POINTS = 32768


def posterior_covariance(
    mixture: Mixture, modes: Modes, allowed: Callable[[IntArray, FloatArray, FloatArray], BoolArray]
) -> SymmetricMatrix:
    """Return the second moments (B, T) of the posterior about each mode, in square metres; NaN for missing modes.

    The posterior is flat-prior within the search region and is integrated over grids about all modes, each point
    counted for the mode that it is nearest to. So the moment about the best mode includes the chance that another
    mode is the true one.
    """
    snapshot, index = np.nonzero(np.isfinite(modes.cost))
    size = modes.cost.shape[0]
    block = max(1, _POINTS // (_STEPS * _STEPS))
    parts = [
        _moments(mixture, modes, allowed, snapshot[start : start + block], index[start : start + block])
        for start in range(0, snapshot.shape[0], block)
    ]
    of_mode = np.concatenate(parts, axis=1) if parts else np.zeros((6, 0))
    totals = [np.bincount(snapshot, weights=part, minlength=size).astype(np.float64) for part in of_mode]
    with ignoring_division():
        mean_x, mean_y, xx, xy, yy = (total / totals[0] for total in totals[1:])
    dx, dy = modes.x - modes.x[:, :1], modes.y - modes.y[:, :1]  # moments are about the best mode: shift them
    return SymmetricMatrix(
        xx[:, None] - 2.0 * dx * mean_x[:, None] + dx * dx,
        xy[:, None] - dx * mean_y[:, None] - dy * mean_x[:, None] + dx * dy,
        yy[:, None] - 2.0 * dy * mean_y[:, None] + dy * dy,
    )


def _moments(
    mixture: Mixture,
    modes: Modes,
    allowed: Callable[[IntArray, FloatArray, FloatArray], BoolArray],
    snapshot: IntArray,
    index: IntArray,
) -> FloatArray:
    """Return mass and moments up to the second (6, N) about each snapshot's best mode, over the grids of N modes."""
    hessian = modes.hessian.at(snapshot, index).at(slice(None), None)
    axis = np.linspace(-_REACH, _REACH, _STEPS)
    u, v = (part.ravel()[None, :] for part in np.meshgrid(axis, axis, indexing="ij"))
    smaller, larger = hessian.eigenvalues()  # steps along the axes of the ellipse, so that no frame is special
    turn = 0.5 * np.arctan2(2.0 * hessian.xy, hessian.xx - hessian.yy)
    cosine, sine = np.cos(turn), np.sin(turn)
    tiny = np.finfo(np.float64).tiny
    short, long = u / np.sqrt(np.maximum(larger, tiny)), v / np.sqrt(np.maximum(smaller, tiny))
    step_x, step_y = cosine * short - sine * long, sine * short + cosine * long
    x, y = modes.x[snapshot, index][:, None] + step_x, modes.y[snapshot, index][:, None] + step_y
    with ignoring_overflow():
        nats = modes.cost[snapshot, 0][:, None] - mixture.take(snapshot).score(x, y)
        weight = np.exp(np.minimum(nats, 1.0)) / np.sqrt(np.maximum(hessian.determinant, tiny))
    weight[~(allowed(snapshot, x, y) & _nearest(modes, snapshot, index, x, y))] = 0.0
    x, y = x - modes.x[snapshot, 0][:, None], y - modes.y[snapshot, 0][:, None]
    x[weight == 0.0] = y[weight == 0.0] = 0.0
    parts = (weight, weight * x, weight * y, weight * x * x, weight * x * y, weight * y * y)
    return np.stack([np.cumsum(part, axis=1)[:, -1] for part in parts])


def _nearest(modes: Modes, snapshot: IntArray, index: IntArray, x: FloatArray, y: FloatArray) -> BoolArray:
    """Return which points (N, P) are nearer to their own mode than to the others, in standard deviations."""

    def squared_distance(t: IntArray | int) -> FloatArray:
        dx, dy = x - modes.x[snapshot, t][:, None], y - modes.y[snapshot, t][:, None]
        return modes.hessian.at(snapshot, t).at(slice(None), None).quadratic_form(dx, dy)

    own = squared_distance(index)
    nearest = np.ones(x.shape, dtype=bool)
    for t in range(modes.cost.shape[1]):
        other = np.isfinite(modes.cost[snapshot, t]) & (index != t)
        if other.any():
            nearest &= ~(other[:, None] & (squared_distance(t) < own))
    return nearest
