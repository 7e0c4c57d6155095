"""Solve the snapshots of one chunk with one or several methods: flat arrays in, flat arrays out."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, SeedArray
from nlosctl.contract.fields import Field, SensorsField
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Estimates, Solution, Trace, Words, single_estimates
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.errors import MethodError, NlosctlError, in_one_line
from nlosctl.models.search_regions import search_region
from nlosctl.pipeline.solve.dense_blocks import Block, dense_blocks
from nlosctl.pipeline.solve.flag_columns import FlagColumn
from nlosctl.pipeline.solve.heap import keep_freed_memory
from nlosctl.pipeline.solve.solution_check import fault_of

__all__ = ["FlatEstimates", "FlatFlags", "FlatTrace", "MethodRun", "Problem", "solve_flat"]


_EDGE_SHARE = 0.01
"""A fix this near to the edge of the search field, in units of its larger side, touches it."""


@dataclass(frozen=True, kw_only=True)
class MethodRun:
    """A method with the options of this run; ``sweep`` are those that the run sweeps, with their values here."""

    spec: MethodSpec
    options: Any
    sweep: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    @property
    def label(self) -> str:
        """The name of the method, with the swept values."""
        values = ", ".join(f"{key}={value}" for key, value in self.sweep.items())
        return f"{self.spec.name} ({values})" if values else self.spec.name


@dataclass(frozen=True, kw_only=True)
class Problem:
    """A chunk as a method run needs it: flat columns (N,), row offsets (S+1,), rows kept (N,), seeds (S,)."""

    kind: str
    scene: Scene
    field: Field = dataclasses.field(default_factory=SensorsField)
    columns: Mapping[str, npt.NDArray[Any]]
    offsets: IntArray
    kept: BoolArray
    seed: SeedArray


@dataclass(frozen=True, kw_only=True)
class FlatEstimates:
    """Estimates (E,) of a chunk, by snapshot, then method, target and alternative.

    ``row`` is the measurement that an estimate is of, where each is solved by itself, else -1; ``on_edge`` tells which
    touch the edge of the search field, of methods that search.
    """

    snapshot: IntArray
    row: IntArray
    method: IntArray
    target: IntArray
    alternative: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray
    n_measurements: IntArray
    n_used: IntArray
    cost: FloatArray
    status: npt.NDArray[np.uint8]
    covariance_kind: npt.NDArray[np.object_]
    on_edge: BoolArray


@dataclass(frozen=True, kw_only=True)
class FlatTrace:
    """The states (T,) that methods went through, by snapshot, method, step; ``measurement`` is a row of the chunk."""

    snapshot: IntArray
    method: IntArray
    step: IntArray
    measurement: IntArray
    position_m: FloatArray
    covariance_m2: FloatArray


@dataclass(frozen=True, kw_only=True)
class FlatFlags:
    """Flags (N,) of a chunk by one method; rows that took no part are not used and say nothing."""

    used: BoolArray
    columns: Mapping[str, npt.NDArray[Any] | Words]


def solve_flat(
    problem: Problem,
    runs: Sequence[MethodRun],
    *,
    block_size: int,
    alternatives: int,
    want_flags: bool,
    want_details: bool = False,
    want_trace: bool = False,
) -> tuple[FlatEstimates | None, list[FlatFlags], FlatTrace | None]:
    """Solve all snapshots of a chunk by each method; flags come in the order of the methods, none if not wanted.

    The estimates are None where no method makes any, the trace where it is not wanted.
    """
    keep_freed_memory()
    parts: list[FlatEstimates] = []
    traces = [_no_trace()]
    flags: list[FlatFlags] = []
    blocks = list(dense_blocks(problem.offsets, problem.kept, block_size))
    for number, run in enumerate(runs):
        solutions = [
            (block, _solve_block(problem, block, run, want_flags, want_details, want_trace)) for block in blocks
        ]
        parts += [
            _flatten(problem, block, solution.estimates, number, run.spec.searches)
            for block, solution in solutions
            if run.spec.estimates
        ]
        if want_flags:
            flags.append(_scatter_flags(problem, run, solutions, details=want_details))
        if want_trace:
            traces += [_flatten_trace(block, solution.trace, number) for block, solution in solutions if solution.trace]
    estimates = _in_order(_concatenate(parts), alternatives) if parts else None
    return estimates, flags, _trace_in_order(traces) if want_trace else None


def _solve_block(
    problem: Problem, block: Block, run: MethodRun, want_flags: bool, want_details: bool, want_trace: bool
) -> Solution:
    if block.row.shape[1] < run.spec.minimum_measurements:
        return _too_few(block.row.shape[0])
    batch = block.batch(
        problem.kind,
        problem.columns,
        problem.scene,
        problem.seed,
        field=problem.field,
        flags=want_flags,
        details=want_details,
        trace=want_trace and run.spec.traces,
    )
    try:
        solution = run.spec.solve(batch, run.options)
    except NlosctlError:
        raise
    except (Exception, SystemExit) as error:
        raise MethodError(f"method {run.spec.name!r} failed: {in_one_line(error)}") from error
    fault = fault_of(solution, block.row.shape)
    if fault:
        raise MethodError(f"method {run.spec.name!r} {fault}")
    return solution


def _too_few(size: int) -> Solution:
    nothing = np.full((size, 3), np.nan)
    return Solution(
        estimates=single_estimates(
            position_m=nothing[:, :2],
            covariance_m2=nothing,
            cost=nothing[:, 0],
            n_used=np.zeros(size, dtype=np.int64),
            status=np.full(size, Status.TOO_FEW, dtype=np.uint8),
        )
    )


def _flatten(problem: Problem, block: Block, estimates: Estimates, method: int, searches: bool) -> FlatEstimates:
    snapshot = block.snapshot[estimates.row]
    size = snapshot.shape[0]
    single = estimates.measurement
    return FlatEstimates(
        snapshot=snapshot,
        row=np.full(size, -1, dtype=np.int64) if single is None else block.row[estimates.row, single],
        method=np.full(size, method, dtype=np.int64),
        target=estimates.target,
        alternative=estimates.alternative,
        position_m=estimates.position_m,
        covariance_m2=estimates.covariance_m2,
        n_measurements=(problem.offsets[1:] - problem.offsets[:-1])[snapshot],
        n_used=estimates.n_used,
        cost=estimates.cost,
        status=estimates.status,
        covariance_kind=_covariance_kinds(estimates),
        on_edge=_on_edge(problem, block, estimates) if searches else np.zeros(size, dtype=bool),
    )


def _covariance_kinds(estimates: Estimates) -> npt.NDArray[np.object_]:
    kinds = np.full(estimates.row.shape[0], None, dtype=object)
    kinds[np.isfinite(estimates.covariance_m2[:, 0])] = estimates.covariance_kind
    return kinds


def _on_edge(problem: Problem, block: Block, estimates: Estimates) -> BoolArray:
    """Return which estimates (E,) are within a hundredth of the search field's larger side of its edge."""
    row = block.row[estimates.row]
    if not row.size:
        return np.zeros(row.shape[0], dtype=bool)
    x, y = estimates.position_m[:, 0], estimates.position_m[:, 1]
    sensor_x, sensor_y = problem.columns["sensor_x_m"][row], problem.columns["sensor_y_m"][row]
    center_x, center_y = sensor_x[:, 0], sensor_y[:, 0]
    region = search_region(problem.field, sensor_x, sensor_y, center_x, center_y)
    xmin, xmax, ymin, ymax = region.bounds_m
    return region.on_edge(x - center_x, y - center_y, _EDGE_SHARE * np.maximum(xmax - xmin, ymax - ymin))


def _no_trace() -> FlatTrace:
    nothing = np.empty(0, dtype=np.int64)
    return FlatTrace(
        snapshot=nothing,
        method=nothing,
        step=nothing,
        measurement=nothing,
        position_m=np.empty((0, 2)),
        covariance_m2=np.empty((0, 3)),
    )


def _flatten_trace(block: Block, trace: Trace, method: int) -> FlatTrace:
    return FlatTrace(
        snapshot=block.snapshot[trace.row],
        method=np.full(trace.row.shape, method, dtype=np.int64),
        step=trace.step,
        measurement=block.row[trace.row, trace.measurement],
        position_m=trace.position_m,
        covariance_m2=trace.covariance_m2,
    )


def _trace_in_order(parts: list[FlatTrace]) -> FlatTrace:
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in FlatTrace.__annotations__}
    order = np.lexsort((arrays["step"], arrays["method"], arrays["snapshot"]))
    return FlatTrace(**{name: array[order] for name, array in arrays.items()})


def _concatenate(parts: list[FlatEstimates]) -> FlatEstimates:
    if len(parts) == 1:
        return parts[0]
    return FlatEstimates(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in FlatEstimates.__annotations__}
    )


def _in_order(estimates: FlatEstimates, alternatives: int) -> FlatEstimates:
    if bool((estimates.snapshot[1:] > estimates.snapshot[:-1]).all()):
        return estimates
    order = np.lexsort((estimates.alternative, estimates.target, estimates.method, estimates.snapshot))
    order = order[estimates.alternative[order] < alternatives]
    return FlatEstimates(**{name: getattr(estimates, name)[order] for name in FlatEstimates.__annotations__})


def _scatter_flags(
    problem: Problem, run: MethodRun, solutions: list[tuple[Block, Solution]], *, details: bool
) -> FlatFlags:
    rows = problem.kept.shape[0]
    used = np.zeros(rows, dtype=bool)
    columns: dict[str, FlagColumn] = {}
    for block, solution in solutions:
        flags = solution.flags
        if flags is None:
            continue
        used[block.row] = flags.used
        for name in run.spec.flag_columns(run.options, problem.scene, problem.columns, details=details):
            if name in flags.columns:
                columns.setdefault(name, FlagColumn(rows)).set(block.row, flags.columns[name])
    return FlatFlags(used=used, columns={name: column.values() for name, column in columns.items()})
