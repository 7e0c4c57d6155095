"""Targets among unlabelled echoes, identified one snapshot at a time, located, and written to the flags."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.options import option
from nlosctl.contract.results import FORM, MISFIT_FORM, Estimates, Flags, Solution, has_covariance, has_position
from nlosctl.contract.statuses import Status
from nlosctl.geometry.regions import Region
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.models.search_regions import search_region
from nlosctl.solvers.echoes.echoes import Echoes, read_echoes, sensor_positions
from nlosctl.solvers.echoes.type_sets import Gate
from nlosctl.solvers.ranges.optima import finish_range_fix, optimize_ranges, with_covariances

__all__ = ["EXISTENCE", "IDENTIFICATION_FLAGS", "IdentificationOptions", "IdentifiedEchoes", "identify"]


IDENTIFICATION_FLAGS = ("los", "target", "residual_m")
EXISTENCE = "existence_probability"
_MAX_ITERATIONS = 100


@dataclass(frozen=True)
class IdentifiedEchoes:
    """Echoes (T, N) of the identified targets, -1 where a sensor has none.

    ``existence`` (T,) is the probability that a target exists, if the method has one; ``proven`` is false if a better
    set of targets may exist.
    """

    echo: IntArray
    existence: FloatArray | None = None
    proven: bool = True


@dataclass(frozen=True, kw_only=True)
class IdentificationOptions:
    """Parameters that all methods of ``identify-los`` have."""

    gap_tolerance_m: float = option(
        20.0, unit="m", minimum=0.0, meaning="circles that miss each other by at most this have a point in the gap"
    )
    field_margin_m: float = option(
        20.0, unit="m", minimum=0.0, meaning="points up to this far outside the search region are kept"
    )
    max_echoes: int = option(100, minimum=1, meaning="most echoes of one sensor in a snapshot; more are an error")
    min_range_m: float = option(
        0.0, unit="m", minimum=0.0, meaning="a fix closer than this to a sensor that it uses is degenerate"
    )
    ambiguous_within: float = option(
        2.0, unit="nats", minimum=0.0, meaning="a second optimum whose cost is at most this much higher is as good"
    )


def identify(
    batch: RangeBatch, options: IdentificationOptions, find: Callable[[Echoes, Gate], IdentifiedEchoes]
) -> Solution:
    """Return the targets that ``find`` finds in each snapshot, each located by range least squares.

    A snapshot without a target, or of fewer than three sensors (in space four, or three and a height), has one estimate
    with that status. A
    row shared by several targets is flagged as that of the nearest. Targets of a set that is not proven to be the best
    are not_proven.
    """
    parts: list[Estimates] = []
    targets: list[_Target] = []
    all_echoes = [read_echoes(batch, snapshot, options.max_echoes) for snapshot in range(batch.size)]
    region = _regions(batch, all_echoes)
    for snapshot, echoes in enumerate(all_echoes):
        gate = Gate(region.take(np.array([snapshot])), options.field_margin_m)
        if echoes.sensors < echoes.least_sensors:
            parts.append(_nothing(snapshot, Status.TOO_FEW, batch.dimension))
            continue
        identified = find(echoes, gate)
        if not identified.echo.shape[0]:
            parts.append(_nothing(snapshot, Status.NO_TARGET, batch.dimension))
        existence = np.full(identified.echo.shape[0], np.nan) if identified.existence is None else identified.existence
        targets += [
            _Target(snapshot, number, _rows(echoes, echo), echoes.center, float(existence[number]), identified.proven)
            for number, echo in enumerate(identified.echo)
        ]
    residuals: dict[_Target, FloatArray] = {}
    for count in sorted({len(target.rows) for target in targets}):
        chosen = [target for target in targets if len(target.rows) == count]
        estimates, left_over = _locate(batch, chosen, region, options)
        parts.append(estimates)
        residuals.update(zip(chosen, left_over, strict=True))
    return Solution(
        estimates=_join(parts, batch.dimension), flags=_flags(batch, targets, residuals) if batch.want_flags else None
    )


@dataclass(frozen=True, eq=False)
class _Target:
    """An identified target: its snapshot, its number there, the rows of its echoes, and the snapshot's local origin.

    ``existence`` and ``proven`` are as in `IdentifiedEchoes`.
    """

    snapshot: int
    number: int
    rows: IntArray
    center: tuple[float, ...]
    existence: float
    proven: bool


def _regions(batch: RangeBatch, all_echoes: list[Echoes]) -> Region:
    """Return the search regions (B,) about the local origins of the echoes."""
    center = np.array([echoes.center for echoes in all_echoes]).reshape(-1, batch.dimension)
    return search_region(batch.field, sensor_positions(batch, slice(None)), tuple(center.T))


def _rows(echoes: Echoes, echo: IntArray) -> IntArray:
    seen = np.flatnonzero(echo >= 0)
    return echoes.row[seen, echo[seen]]


def _locate(
    batch: RangeBatch, targets: list[_Target], region: Region, options: IdentificationOptions
) -> tuple[Estimates, FloatArray]:
    """Return the estimates (and alternatives) of targets of n echoes each, and the residuals (T, n).

    An optimum outside the field and its margin is replaced by one inside.
    """
    snapshot = np.array([target.snapshot for target in targets])
    dense = _targets_batch(batch, snapshot, np.array([target.rows for target in targets]))
    circles = range_rows(dense)
    one, other = with_covariances(circles, *optimize_ranges(circles, _MAX_ITERATIONS, options.ambiguous_within))
    origin = np.array([target.center for target in targets])
    offset = [part - own for part, own in zip(circles.center, origin.T, strict=True)]
    own_region = region.take(snapshot)
    inside = [
        own_region.edge_distance_m(*map(np.add, optimum.point, offset)) >= -options.field_margin_m
        for optimum in (one, other)
    ]
    estimates = finish_range_fix(
        dense,
        circles,
        replace(one, converged=one.converged & (inside[0] | ~inside[1])),
        replace(other, converged=other.converged & (inside[1] | ~inside[0])),
        min_range_m=options.min_range_m,
        ambiguous_within=options.ambiguous_within,
    ).estimates
    best = estimates.position_m[estimates.alternative == 0]
    residual = circles.residual_m(*(part - own for part, own in zip(best.T, circles.center, strict=True)))
    number, existence, proven = (
        np.array([getattr(target, name) for target in targets])[estimates.row]
        for name in ("number", "existence", "proven")
    )
    certain = has_covariance(estimates.status)
    return replace(
        estimates,
        row=snapshot[estimates.row],
        target=number,
        status=np.where(certain & ~proven, np.uint8(Status.NOT_PROVEN), estimates.status),
        columns={EXISTENCE: np.where(has_position(estimates.status), existence, np.nan)},
    ), residual


def _flags(batch: RangeBatch, targets: list[_Target], residuals: dict[_Target, FloatArray]) -> Flags:
    """Return the flags; a row shared by several targets belongs to that of the smallest residual, else to the first."""
    shape = batch.range_m.shape
    los, number, residual = np.zeros(shape, dtype=bool), np.full(shape, np.nan), np.full(shape, np.nan)
    for target in targets:
        own = residuals[target]
        nearer = np.abs(own) < np.nan_to_num(np.abs(residual[target.snapshot, target.rows]), nan=np.inf)
        taken = ~los[target.snapshot, target.rows] | nearer
        rows = target.rows[taken]
        los[target.snapshot, rows] = True
        number[target.snapshot, rows] = target.number
        residual[target.snapshot, rows] = own[taken]
    columns = {"los": los, "target": number, "residual_m": residual}
    return Flags(used=los & np.isfinite(residual), columns=columns)


def _targets_batch(batch: RangeBatch, snapshot: IntArray, rows: IntArray) -> RangeBatch:
    """Return a batch whose snapshots are targets: ``rows`` (T, n) of the snapshots (T,)."""
    index = snapshot[:, None], rows
    return replace(
        batch,
        seed=batch.seed[snapshot],
        want_flags=False,
        sensor=np.asfortranarray(batch.sensor[index]),
        sensor_xy_m=np.asfortranarray(batch.sensor_xy_m[index]),
        range_m=np.asfortranarray(batch.range_m[index]),
        range_std_m=np.asfortranarray(batch.range_std_m[index]),
        path=np.asfortranarray(batch.path[index]),
        reflector=None,
        sensor_height_m=np.asfortranarray(batch.sensor_height_m[index]),
        sensor_z_m=None if batch.sensor_z_m is None else np.asfortranarray(batch.sensor_z_m[index]),
        target_z_m=None if batch.target_z_m is None else batch.target_z_m[snapshot],
        target_z_std_m=None if batch.target_z_std_m is None else batch.target_z_std_m[snapshot],
    )


def _nothing(snapshot: int, status: Status, dimension: int) -> Estimates:
    nan = np.full(1, np.nan)
    row = np.full(1, snapshot, dtype=np.int64)
    return Estimates.of(
        np.full(1, status, dtype=np.uint8),
        (nan,) * dimension,
        SymmetricMatrix.full(1, np.nan, dimension),
        nan,
        0,
        row=row,
        columns={EXISTENCE: nan},
    )


def _join(parts: list[Estimates], dimension: int) -> Estimates:
    """Return all estimates in order of snapshot, target and alternative."""
    parts = [_nothing(0, Status.NO_TARGET, dimension), *parts]  # the first row is dropped: there may be no other part
    names = (*FORM, *MISFIT_FORM)
    joined: dict[str, Any] = {name: np.concatenate([getattr(part, name) for part in parts])[1:] for name in names}
    order = np.lexsort((joined["alternative"], joined["target"], joined["row"]))
    existence = np.concatenate([part.columns[EXISTENCE] for part in parts])[1:][order]
    columns = {} if np.isnan(existence).all() else {EXISTENCE: existence}
    return Estimates(**{name: values[order] for name, values in joined.items()}, columns=columns)
