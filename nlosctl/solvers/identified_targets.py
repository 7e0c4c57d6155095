"""Targets found among unlabelled echoes, one snapshot at a time: located, and told to each row."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.options import option
from nlosctl.contract.results import Estimates, Flags, Solution, single_estimates
from nlosctl.contract.statuses import Status
from nlosctl.models.ranges import RangeCircles, range_circles
from nlosctl.solvers.echoes import Echoes, read_echoes
from nlosctl.solvers.range_fixes import finish_range_fix, optimize_ranges
from nlosctl.solvers.search_regions import search_region
from nlosctl.solvers.type_sets import Gate

__all__ = ["IDENTIFICATION_FLAGS", "Found", "IdentificationOptions", "identify"]

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

IDENTIFICATION_FLAGS = ("los", "target", "residual_m")
_ARRAYS = ("row", "target", "alternative", "position_m", "covariance_m2", "cost", "n_used", "status")
_MAX_ITERATIONS = 100

Found = IntArray | Status
"""Echoes (T, N) of the targets found, -1 where a sensor has none of a target; or the status that says why not."""


@dataclass(frozen=True, kw_only=True)
class IdentificationOptions:
    """Parameters that all methods of ``identify-los`` have."""

    gap_tolerance_m: float = option(
        20.0, unit="m", minimum=0.0, meaning="circles that miss each other by at most this have a point in the gap"
    )
    field_margin_m: float = option(
        20.0, unit="m", minimum=0.0, meaning="points up to this far outside the search field are kept"
    )
    max_echoes: int = option(100, minimum=1, meaning="most echoes of one sensor in a snapshot; more are an error")
    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="a second optimum whose cost is at most this much higher is as good"
    )


def identify(batch: RangeBatch, options: IdentificationOptions, find: Callable[[Echoes, Gate], Found]) -> Solution:
    """Return the targets that ``find`` finds in each snapshot, each located by range least squares.

    A snapshot without a target, or of fewer than three sensors, has one estimate that says so. A row that several
    targets take is told to be of the first of them.
    """
    parts: list[Estimates] = []
    shape = batch.range_m.shape
    los, target, residual = np.zeros(shape, dtype=bool), np.full(shape, np.nan), np.full(shape, np.nan)
    for snapshot in range(batch.size):
        echoes = read_echoes(batch, snapshot, options.max_echoes)
        gate = _gate(batch, echoes, options.field_margin_m)
        found = Status.TOO_FEW if echoes.sensors < 3 else find(echoes, gate)
        if isinstance(found, Status) or not found.shape[0]:
            parts.append(_nothing(snapshot, found if isinstance(found, Status) else Status.NO_TARGET))
            continue
        counts = (found >= 0).sum(axis=1)
        for count in np.unique(counts)[::-1]:
            numbers = np.flatnonzero(counts == count)
            rows = np.array([_rows(echoes, found[number]) for number in numbers])
            estimates, left_over = _locate(batch, snapshot, rows, echoes, gate, options)
            parts.append(replace(estimates, row=np.full_like(estimates.row, snapshot), target=numbers[estimates.row]))
            for place in range(numbers.shape[0]):
                free = ~(target[snapshot, rows[place]] < numbers[place])
                own = rows[place][free]
                los[snapshot, own], target[snapshot, own] = True, numbers[place]
                residual[snapshot, own] = left_over[place][free]
    columns = {"los": los, "target": target, "residual_m": residual}
    flags = Flags(used=los & np.isfinite(residual), columns=columns) if batch.want_flags else None
    return Solution(estimates=_join(parts), flags=flags)


def _gate(batch: RangeBatch, echoes: Echoes, margin_m: float) -> Gate:
    center_x, center_y = np.array([echoes.center_x]), np.array([echoes.center_y])
    sensor_x, sensor_y = echoes.sensor_x + echoes.center_x, echoes.sensor_y + echoes.center_y
    return Gate(search_region(batch.field, sensor_x[None], sensor_y[None], center_x, center_y), margin_m)


def _rows(echoes: Echoes, echo: IntArray) -> IntArray:
    seen = np.flatnonzero(echo >= 0)
    return echoes.row[seen, echo[seen]]


def _locate(
    batch: RangeBatch, snapshot: int, rows: IntArray, echoes: Echoes, gate: Gate, options: IdentificationOptions
) -> tuple[Estimates, FloatArray]:
    """Return the estimates (and alternatives) of the targets that rows (T, n) are of, and the residuals (T, n).

    An optimum outside the gate gives way to one inside.
    """
    targets = _targets_batch(batch, snapshot, rows)
    circles = range_circles(targets)
    one, other = optimize_ranges(circles, _MAX_ITERATIONS)
    offset_x, offset_y = circles.center_x - echoes.center_x, circles.center_y - echoes.center_y
    inside = [gate.holds(optimum.x + offset_x, optimum.y + offset_y) for optimum in (one, other)]
    solution = finish_range_fix(
        targets,
        circles,
        replace(one, converged=one.converged & (inside[0] | ~inside[1])),
        replace(other, converged=other.converged & (inside[1] | ~inside[0])),
        min_range_m=options.min_range_m,
        ambiguous_within=options.ambiguous_within,
    )
    return solution.estimates, circles.residual_m(*_best_positions(solution.estimates, circles))


def _best_positions(estimates: Estimates, circles: RangeCircles) -> tuple[FloatArray, FloatArray]:
    best = estimates.position_m[estimates.alternative == 0]
    return best[:, 0] - circles.center_x, best[:, 1] - circles.center_y


def _targets_batch(batch: RangeBatch, snapshot: int, rows: IntArray) -> RangeBatch:
    """Return a batch whose snapshots are the targets: rows (T, n) of one snapshot."""

    def take(values: FloatArray) -> FloatArray:
        return np.asfortranarray(values[snapshot][rows])

    return replace(
        batch,
        seed=np.repeat(batch.seed[snapshot], rows.shape[0]),
        want_flags=False,
        sensor=np.asfortranarray(batch.sensor[snapshot][rows]),
        sensor_xy_m=take(batch.sensor_xy_m),
        range_m=take(batch.range_m),
        range_std_m=take(batch.range_std_m),
        path=np.asfortranarray(batch.path[snapshot][rows]),
        sensor_height_m=take(batch.sensor_height_m),
    )


def _nothing(snapshot: int, status: Status) -> Estimates:
    nothing = np.full((1, 3), np.nan)
    estimates = single_estimates(
        position_m=nothing[:, :2],
        covariance_m2=nothing,
        cost=nothing[:, 0],
        n_used=np.zeros(1, dtype=np.int64),
        status=np.full(1, status, dtype=np.uint8),
    )
    return replace(estimates, row=np.full(1, snapshot, dtype=np.int64))


def _no_estimates() -> Estimates:
    one = _nothing(0, Status.NO_TARGET)
    return Estimates(**{name: getattr(one, name)[:0] for name in _ARRAYS})


def _join(parts: list[Estimates]) -> Estimates:
    """Return all estimates in order of snapshot, target and alternative."""
    parts = [_no_estimates(), *parts]
    joined: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    order = np.lexsort((joined["alternative"], joined["target"], joined["row"]))
    return Estimates(**{name: values[order] for name, values in joined.items()})
