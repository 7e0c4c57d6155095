"""Sources among unlabelled bearings: the best choice of disjoint sets of rows, their fixes, and the flags."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point
from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.results import (
    FORM,
    MISFIT_FORM,
    Estimates,
    Flags,
    Solution,
    has_covariance,
    has_position,
    no_estimates,
)
from nlosctl.contract.statuses import Status
from nlosctl.models.sight import bearing_lines
from nlosctl.solvers.association.pruning import rival_sets
from nlosctl.solvers.association.sensor_rows import SensorRows
from nlosctl.solvers.association.set_fits import SourceSets, sets_by_size
from nlosctl.solvers.bearings.line_fits import fit_least_squares
from nlosctl.solvers.bearings.multistart import find_optima
from nlosctl.solvers.bearings.ranked_optima import finish_alternatives
from nlosctl.solvers.echoes.assignment import Choice, choose_disjoint
from nlosctl.solvers.echoes.evidence import existence_probability

__all__ = ["EXISTENCE", "Sources", "choose_sources", "locate_sources"]

EXISTENCE = "existence_probability"
_MAX_ITERATIONS = 100
_AMBIGUOUS_WITHIN = 2.0


class Sources(NamedTuple):
    """T sources, by snapshot, the likeliest first: snapshots, rows (T, N) or -1, points about the local origins.

    ``number`` counts those of a snapshot from 0, ``existence`` is the probability that each exists, and ``proven`` is
    false if a better choice of sources may exist.
    """

    snapshot: IntArray
    number: IntArray
    rows: IntArray
    point: Point
    existence: FloatArray
    proven: BoolArray


def choose_sources(sets: SourceSets, weight: FloatArray, max_nodes: int) -> Sources:
    """Return the sets, ordered by snapshot, of largest total weight (C,) in each snapshot that share no row."""
    chosen, number, existence, proven = [], [], [], []
    bounds = np.append(0, np.flatnonzero(np.diff(sets.snapshot, append=-1)) + 1)
    for start, end in pairwise(bounds.tolist()):
        rows, own = sets.rows[start:end], weight[start:end]
        choice = _choose(rows, own, max_nodes)
        chosen.append(start + choice.indices)
        number.append(np.arange(choice.indices.shape[0]))
        existence.append(existence_probability(rows, own, choice.indices, float(own[choice.indices].sum())))
        proven.append(np.full(choice.indices.shape, choice.proven))
    nothing = np.empty(0, dtype=np.int64)
    index = np.concatenate([nothing, *chosen])
    return Sources(
        sets.snapshot[index],
        np.concatenate([nothing, *number]),
        sets.rows[index],
        tuple(part[index] for part in sets.point),
        np.concatenate([np.empty(0), *existence]),
        np.concatenate([np.empty(0, dtype=bool), *proven]),
    )


def _choose(rows: IntArray, weight: FloatArray, max_nodes: int) -> Choice:
    """Return the choice of disjoint sets (C, N) of one snapshot."""
    greedy, rivals = rival_sets(rows, weight)
    if not rivals.size:
        return Choice(greedy, True)
    candidates = np.union1d(greedy, rivals)
    choice = choose_disjoint(rows[candidates], weight[candidates], max_nodes)
    return Choice(candidates[choice.indices], choice.proven)


@dataclass(frozen=True)
class _Located:
    """Estimates of some sources, their rows (T, n) and the flag columns (T, n) of these."""

    estimates: Estimates
    members: IntArray
    rows: IntArray
    columns: dict[str, FloatArray]


def locate_sources(table: SensorRows, center: Point, sources: Sources, *, min_range_m: float) -> Solution:
    """Return the fixes of sources by maximum likelihood, from their points about ``center`` (B,), and the flags.

    A snapshot without a source has one estimate, no_target. Sources of a choice that is not proven are not_proven.
    """
    batch = table.batch
    parts = [
        _locate(dense, center, sources, members, min_range_m)
        for members, dense in sets_by_size(batch, sources.snapshot, sources.rows)
    ]
    empty = np.setdiff1d(np.arange(batch.size), sources.snapshot)
    nothing = replace(
        no_estimates(empty.shape[0], batch.dimension, Status.NO_TARGET),
        row=empty,
        columns={EXISTENCE: np.full(empty.shape, np.nan)},
    )
    estimates = _join([nothing, *(part.estimates for part in parts)])
    return Solution(estimates=estimates, flags=_flags(table, sources, parts) if batch.want_flags else None)


def _locate(dense: BearingBatch, center: Point, sources: Sources, members: IntArray, min_range_m: float) -> _Located:
    """Return the fixes of sources with n rows each, ``dense`` (T, n)."""
    lines = bearing_lines(dense)
    snapshot = sources.snapshot[members]
    start = tuple(
        part[members] + own[snapshot] - middle
        for part, own, middle in zip(sources.point, center, lines.center, strict=False)
    )
    optima = find_optima(lines, [start], _MAX_ITERATIONS)
    within = np.arange(members.shape[0]) if optima.snapshot is None else optima.snapshot
    solution = finish_alternatives(
        dense,
        optima,
        within,
        fit_least_squares(lines).normal,
        min_range_m=min_range_m,
        ambiguous_within=_AMBIGUOUS_WITHIN,
    )
    estimates = solution.estimates
    source = members[estimates.row]
    certain, unproven = has_covariance(estimates.status), ~sources.proven[source]
    estimates = replace(
        estimates,
        row=sources.snapshot[source],
        target=sources.number[source],
        status=np.where(certain & unproven, np.uint8(Status.NOT_PROVEN), estimates.status),
        columns={EXISTENCE: np.where(has_position(estimates.status), sources.existence[source], np.nan)},
    )
    own = sources.rows[members]
    columns: dict[str, Any] = {} if solution.flags is None else dict(solution.flags.columns)
    return _Located(estimates, members, own[own >= 0].reshape(members.shape[0], -1), columns)


def _flags(table: SensorRows, sources: Sources, parts: list[_Located]) -> Flags:
    """Return the flags, in the order of the batch as it was."""
    shape = table.order.shape
    names = {"residual_rad"} | ({"residual_elevation_rad"} if table.batch.dimension == 3 else set())
    numbers = {name: np.full(shape, np.nan) for name in ("target", *sorted(names))}
    for part in parts:
        snapshot = sources.snapshot[part.members][:, None]
        at = snapshot, table.order[snapshot, part.rows]
        numbers["target"][at] = sources.number[part.members][:, None]
        for name in names & part.columns.keys():
            numbers[name][at] = part.columns[name]
    los = np.isfinite(numbers["target"])
    return Flags(used=los & np.isfinite(numbers["residual_rad"]), columns={"los": los, **numbers})


def _join(parts: list[Estimates]) -> Estimates:
    """Return all estimates in order of snapshot, target and alternative."""
    joined: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts]) for name in (*FORM, *MISFIT_FORM)
    }
    order = np.lexsort((joined["alternative"], joined["target"], joined["row"]))
    existence = np.concatenate([part.columns[EXISTENCE] for part in parts])[order]
    return Estimates(**{name: values[order] for name, values in joined.items()}, columns={EXISTENCE: existence})
