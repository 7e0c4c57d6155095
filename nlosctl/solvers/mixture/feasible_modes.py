"""Modes of ranges that the scene hides from a row that they take as direct, and modes that it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from nlosctl.solvers.mixture.modes import Modes
from nlosctl.solvers.mixture.range_rows import RangeOutlierModel

__all__ = ["prefer_feasible_modes"]


def prefer_feasible_modes(model: RangeOutlierModel, modes: Modes, within_nats: float) -> Modes:
    """Return the modes without those that the scene forbids.

    They stay where no other mode is left, or where they are likelier than the best other by more than ``within_nats``:
    a fix there is infeasible.
    """
    if not model.circles.restricted:
        return modes
    snapshot, index = np.nonzero(np.isfinite(modes.cost))
    x, y = modes.x[snapshot, index], modes.y[snapshot, index]
    probability, _ = model.mixture.take(snapshot).responsibilities(x, y)
    hidden = np.zeros(modes.cost.shape, dtype=bool)
    hidden[snapshot, index] = (model.circles.take(snapshot).unseen(x, y) & (probability > 0.5)).any(axis=1)
    feasible = np.where(hidden, np.inf, modes.cost).min(axis=1)
    dropped = hidden & (modes.cost >= feasible[:, None] - within_nats) & np.isfinite(feasible)[:, None]
    if not dropped.any():
        return modes
    cost = np.where(dropped, np.inf, modes.cost)
    order = np.argsort(cost, axis=1, kind="stable")
    at = np.arange(cost.shape[0])[:, None], order
    return replace(modes, x=modes.x[at], y=modes.y[at], cost=cost[at], hessian=modes.hessian.at(*at))
