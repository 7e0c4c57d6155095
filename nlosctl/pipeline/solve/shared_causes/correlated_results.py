"""Estimates and flags as correlations of their rows change them: positions, covariances, costs, ranks and statuses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.results import Estimates, Flags, has_covariance
from nlosctl.contract.statuses import Status
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import arrival_rows
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.models.shared_causes.joint_rows import JointRows
from nlosctl.models.sight import bearing_lines
from nlosctl.solvers.optimization.split_batches import take_snapshots

__all__ = ["Changes", "changed_estimates", "changed_flags", "dense_covariances"]

_CROSS = ("cov_x_offset_m2", "cov_y_offset_m2", "cov_z_offset_m2")


@dataclass(frozen=True)
class Changes:
    """The estimates ``chosen`` (N,) with other positions (N, D) and covariances (N, U, U) of their unknowns.

    ``chi_square`` (N,), ``cost`` (N,), and by how much the offset of arrivals is larger than the
    likeliest of independent rows; None where they stay. A covariance that is not finite changes nothing.
    """

    chosen: IntArray
    position_m: FloatArray
    covariance: FloatArray
    chi_square: FloatArray | None = None
    cost: FloatArray | None = None
    offset_step_m: FloatArray | None = None

    @classmethod
    def join(cls, parts: Sequence[Changes]) -> Changes:
        """Return changes of several estimates as one, without those that are not finite."""
        joined: dict[str, Any] = {}
        known = np.concatenate([np.isfinite(part.covariance).all(axis=(1, 2)) for part in parts])
        for name in cls.__dataclass_fields__:
            values = [getattr(part, name) for part in parts]
            joined[name] = None if values[0] is None else np.concatenate(values)[known]
        return cls(**joined)


def dense_covariances(estimates: Estimates, chosen: IntArray, rows: JointRows) -> FloatArray:
    """Return the covariances (N, U, U) of the unknowns of estimates: coordinates, and the offset of arrivals."""
    count = len(rows.slopes)
    coordinates = count - rows.nuisances
    dense = SymmetricMatrix(*estimates.covariance_m2[chosen].T).dense()[:, :coordinates, :coordinates]
    if not rows.nuisances:
        return dense
    whole = np.empty((chosen.shape[0], count, count))
    whole[:, :coordinates, :coordinates] = dense
    for axis, name in enumerate(_CROSS[:coordinates]):
        whole[:, axis, -1] = whole[:, -1, axis] = estimates.columns[name][chosen]
    whole[:, -1, -1] = estimates.columns["offset_std_m"][chosen] ** 2
    return whole


def changed_estimates(estimates: Estimates, changes: Changes, batch: Any, options: Any, *, ranks: bool) -> Estimates:
    """Return the estimates with their changes; ``ranks``: ordered by cost, and ambiguous by it, too."""
    chosen = changes.chosen
    covariance, columns = estimates.covariance_m2.copy(), dict(estimates.columns)
    has_offset = "offset_std_m" in columns and batch.reference_xy_m is None  # independent differences have none
    count = changes.covariance.shape[1] - has_offset
    entries = [(i, j) for i in range(count) for j in range(i + 1)]
    covariance[chosen, : len(entries)] = np.stack([changes.covariance[:, i, j] for i, j in entries], axis=1)
    replaced: dict[str, Any] = {"covariance_m2": covariance, "position_m": estimates.position_m.copy()}
    replaced["position_m"][chosen] = changes.position_m
    if has_offset:
        columns |= _offset_columns(columns, changes, batch, estimates.row[chosen], count)
    for field, values in (("cost", changes.cost), ("chi_square", changes.chi_square)):
        array = getattr(estimates, field)
        if array is not None and values is not None:
            replaced[field] = array.copy()
            replaced[field][chosen] = values
    changed = replace(estimates, columns=columns, **replaced)
    if not ranks:
        return changed
    return _ranked(changed, estimates, _within(options, batch), pairs=not hasattr(batch, "bearing_rad"))


def _offset_columns(
    columns: dict[str, FloatArray], changes: Changes, batch: Any, row: IntArray, count: int
) -> dict[str, FloatArray]:
    """Return the columns of the offset of arrivals."""
    found = {name: columns[name].copy() for name in ("offset_m", "offset_std_m", *_CROSS) if name in columns}
    for axis, name in enumerate(_CROSS[:count]):
        found[name][changes.chosen] = changes.covariance[:, axis, -1]
    found["offset_std_m"][changes.chosen] = np.sqrt(changes.covariance[:, -1, -1])
    if changes.offset_step_m is not None:
        offset, origin = _offset(batch, row, changes.position_m)
        found["offset_m"][changes.chosen] = offset + changes.offset_step_m + origin
    return found


def _offset(batch: Any, row: IntArray, position_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the likeliest offset (N,) of independent arrivals at positions, and the origin of the arrivals."""
    rows = arrival_rows(replace(take_snapshots(batch, row), speed_std=None))
    point = [position_m[:, axis] - middle for axis, middle in enumerate(rows.center)]
    return rows.compare(*point).offset_m, rows.origin_m


def _within(options: Any, batch: Any) -> float:
    """Return how many nats worse an alternative may be for a fix to be ambiguous."""
    within = getattr(options, "ambiguous_within", None)
    if within is None:
        ranged = getattr(batch, "range_m", None) is not None and getattr(options, "use_ranges", False)
        within = 4.0 if ranged else 2.0
    return float(within)


def _ranked(estimates: Estimates, before: Estimates, within: float, *, pairs: bool) -> Estimates:
    """Return the estimates of each snapshot in the order of their costs, the first ambiguous if the next is near.

    Of ``pairs`` both are. A first estimate without a covariance stays the first.
    """
    certain = has_covariance(estimates.status)
    key = np.where(certain, estimates.cost, np.where(estimates.alternative == 0, -np.inf, np.inf))
    order = np.lexsort((estimates.alternative, key, estimates.row))
    status = estimates.status.copy()
    first = np.flatnonzero(np.diff(estimates.row[order], prepend=-1) != 0)
    first = first[first + 1 < order.shape[0]]
    first = first[estimates.row[order[first + 1]] == estimates.row[order[first]]]
    best, other = order[first], order[first + 1]
    judged = certain[other] & np.isin(status[best], (Status.OK, Status.AMBIGUOUS))
    best, other = best[judged], other[judged]
    near = estimates.cost[other] - estimates.cost[best] <= within
    was = np.abs(before.cost[other] - before.cost[best]) <= within
    swapped = estimates.alternative[best] > 0
    held = np.where(swapped, status[other], status[best])
    now = np.where(near, np.uint8(Status.AMBIGUOUS), np.where(was, np.uint8(Status.OK), held))
    status[best] = now
    if pairs:
        status[other] = now
    else:
        status[other[status[other] == Status.AMBIGUOUS]] = Status.OK
    names = ("row", "target", "position_m", "covariance_m2", "cost", "n_used", "chi_square", "degrees_of_freedom")
    taken = {name: values[order] for name in names if (values := getattr(estimates, name)) is not None}
    columns = {name: values[order] for name, values in estimates.columns.items()}
    return replace(estimates, status=status[order], columns=columns, **taken)


def changed_flags(kind: str, flags: Flags, estimates: Estimates, batch: Any) -> Flags:
    """Return the flags with the residuals at the positions of the best estimates."""
    best = np.flatnonzero((estimates.alternative == 0) & has_covariance(estimates.status))
    row, position = estimates.row[best], estimates.position_m[best]
    residuals = _residuals(kind, take_snapshots(batch, row), position)
    if "offset_m" in estimates.columns and kind == "arrivals" and batch.reference_xy_m is None:
        offset, origin = _offset(batch, row, position)
        residuals["residual_m"] += (offset + origin - estimates.columns["offset_m"][best])[:, None]
    columns = dict(flags.columns)
    for name in residuals.keys() & columns.keys():
        values = np.array(columns[name], dtype=np.float64)
        values[row] = residuals[name]
        columns[name] = values
    return replace(flags, columns=columns)


def _residuals(kind: str, batch: Any, position_m: FloatArray) -> dict[str, FloatArray]:
    """Return measured minus predicted values (B, K) at positions, by the name of their flag column."""
    if kind == "bearings":
        lines: Any = bearing_lines(batch)
        point = [position_m[:, axis] - lines.center[axis] for axis in range(lines.unknowns)]
        found: dict[str, FloatArray] = lines.residuals(batch, *point)
        return found
    rows: Any = range_rows(batch) if kind == "ranges" else arrival_rows(replace(batch, speed_std=None))
    return {"residual_m": rows.residual_m(*(position_m[:, axis] - mid for axis, mid in enumerate(rows.center)))}
