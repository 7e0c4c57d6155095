"""Solve a chunk: whole snapshots in dense batches of equal K, one method after the other, results in chunk order."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, IntArray, SeedArray
from nlosctl.contract.batches import Batch, batch_class
from nlosctl.contract.fields import Field, SensorsField
from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.results import Estimates, Flags, Solution, Trace, no_estimates
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.errors import MethodError, NlosctlError, in_one_line
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.io.results.measurement_layouts import ChunkTrace, chunk_trace
from nlosctl.models.search_regions import near_edge
from nlosctl.pipeline.solve.merged_flags import flags_of_windows, scattered
from nlosctl.pipeline.solve.method_runs import BlockSolver, MethodRun
from nlosctl.pipeline.solve.reference_rows import (
    about_origin,
    alike_blocks,
    lacks_reference,
    with_references,
    without_reference_row,
)
from nlosctl.pipeline.solve.report import fit_p_values
from nlosctl.pipeline.solve.target_heights import by_height, has_geometry_stds

__all__ = ["ChunkSolution", "ChunkSolver", "dense_batch", "dense_blocks", "keep_freed_memory"]

Columns = Mapping[str, npt.NDArray[Any]]
Solved = tuple[IntArray, IntArray, Solution]
"""A solution of a dense batch with the chunk indices of its snapshots (B,) and rows (B, K)."""

_WHOLE_FIELD = SensorsField()
_EDGE_SHARE = 0.01
"""An estimate is on the edge of the search region within this share of the region's larger side."""

_LARGEST_KEPT = (32 << 20) - (64 << 10)
"""Just below the largest size to which glibc raises its thresholds."""


@dataclass(frozen=True, kw_only=True)
class ChunkSolution:
    """The estimates of a chunk (None without an estimating method), flags (N,) by method, and the trace if wanted."""

    estimates: ChunkEstimates | None
    flags: Sequence[Flags] = ()
    trace: ChunkTrace | None = None


@dataclass(frozen=True, kw_only=True)
class ChunkSolver:
    """Solves chunks of one kind of measurement by several methods.

    At most ``block_size`` snapshots are in a dense batch, at most ``alternatives`` estimates of a target are kept.
    """

    kind: str
    scene: Scene
    runs: tuple[MethodRun, ...]
    dimension: int = 2
    field: Field = _WHOLE_FIELD
    block_size: int = 8192
    alternatives: int = 1
    want_flags: bool = False
    want_details: bool = False
    want_trace: bool = False
    calibration: Any = None

    def solve(self, chunk: Chunk, seed: SeedArray) -> ChunkSolution:
        """Return the results of all snapshots by each method; ``seed`` (S,) is the random seed of each snapshot."""
        keep_freed_memory()
        estimates: list[ChunkEstimates] = []
        flags: list[Flags] = []
        traces: list[tuple[int, IntArray, IntArray, Trace]] = []
        alike = alike_blocks if self.kind == "arrivals" else by_height
        blocks = [
            part
            for block in dense_blocks(chunk.offsets, ~chunk.left_out, self.block_size)
            for part in alike(chunk, *block)
        ]
        for method, run in enumerate(self.runs):
            solve = run.solver(chunk)
            if self.kind != "triplets" and (
                self.calibration is not None or has_geometry_stds(self.scene, chunk.columns)
            ):
                from nlosctl.pipeline.solve.shared_causes.correlated_methods import solver_with_causes

                solve = solver_with_causes(solve, run, chunk, self.calibration)
            if self.scene.frame is not None and self.scene.frame.on_ellipsoid:
                from nlosctl.pipeline.solve.earth_centred import solver_on_earth

                solve = solver_on_earth(solve, self.scene.frame)
            solved = [
                (snapshot, row, self._solve_block(chunk, snapshot, row, seed, run, solve)) for snapshot, row in blocks
            ]
            if run.spec.estimates:
                estimates += [self._chunk_estimates(chunk, method, *part) for part in solved]
            if self.want_flags:
                flags.append(self._chunk_flags(chunk, run, solved))
            if self.want_trace:
                traces += [(method, snapshot, row, part.trace) for snapshot, row, part in solved if part.trace]
        return ChunkSolution(
            estimates=_in_order(estimates, self.alternatives) if estimates else None,
            flags=flags,
            trace=chunk_trace(traces) if self.want_trace else None,
        )

    def _solve_block(
        self, chunk: Chunk, snapshot: IntArray, row: IntArray, seed: SeedArray, run: MethodRun, solve: BlockSolver
    ) -> Solution:
        is_short = self.kind == "arrivals" and lacks_reference(run.spec, chunk, int(snapshot[0]), row)
        if row.shape[1] + is_short < run.spec.minimum_measurements:
            return Solution(estimates=no_estimates(row.shape[0], self.dimension, Status.TOO_FEW))
        batch = dense_batch(
            self.kind,
            chunk.columns,
            row,
            scene=self.scene,
            dimension=self.dimension,
            seed=seed[snapshot],
            field=self.field,
            flags=self.want_flags,
            details=self.want_details,
            trace=self.want_trace and run.spec.traces,
        )
        try:
            solution = solve(batch, row)
        except NlosctlError:
            raise
        except (Exception, SystemExit) as error:
            raise MethodError(f"method {run.spec.name!r} failed: {in_one_line(error)}") from error
        fault = contract_violation(solution, (row.shape[0], row.shape[1] + is_short), self.dimension)
        if fault:
            raise MethodError(f"method {run.spec.name!r} {fault}")
        return without_reference_row(solution) if is_short else solution

    def _chunk_estimates(
        self, chunk: Chunk, method: int, snapshot: IntArray, row: IntArray, solution: Solution
    ) -> ChunkEstimates:
        estimates = solution.estimates
        size = estimates.row.shape[0]
        kinds = np.full(size, None, dtype=object)
        kinds[np.isfinite(estimates.covariance_m2[:, 0])] = estimates.covariance_kind
        single = estimates.measurement
        searches, offsets = self.runs[method].spec.searches, chunk.offsets
        counts = np.diff(offsets) if chunk.windows is None else chunk.windows.measurements(offsets)
        return ChunkEstimates(
            snapshot=snapshot[estimates.row],
            measurement=np.full(size, -1, dtype=np.int64) if single is None else row[estimates.row, single],
            method=np.full(size, method, dtype=np.int64),
            target=estimates.target,
            alternative=estimates.alternative,
            position_m=estimates.position_m,
            covariance_m2=estimates.covariance_m2,
            n_measurements=counts[snapshot[estimates.row]],
            n_used=estimates.n_used,
            cost=estimates.cost,
            fit_p_value=fit_p_values(estimates),
            search_failure=np.full(size, np.nan) if estimates.search_failure is None else estimates.search_failure,
            status=estimates.status,
            covariance_kind=kinds,
            on_edge=self._on_edge(chunk, row[estimates.row], estimates) if searches else np.zeros(size, dtype=bool),
            columns=estimates.columns,
        )

    def _on_edge(self, chunk: Chunk, row: IntArray, estimates: Estimates) -> BoolArray:
        """Return which estimates (E,), of snapshots with the rows (E, K), are on the edge of the search region.

        In space that is its top or bottom too, unless the height is exactly known.
        """
        if not row.size:
            return np.zeros(row.shape[0], dtype=bool)
        place = estimates.position_m.T
        sensors = tuple(chunk.columns[f"sensor_{axis}_m"][row] for axis in "xyz"[: len(place)])
        beside = near_edge(self.field, sensors[:2], place[:2], _EDGE_SHARE)
        if len(place) == 2:
            return beside
        held = estimates.covariance_m2[:, -1] == 0.0
        return np.where(held, beside, near_edge(self.field, sensors, place, _EDGE_SHARE))

    def _chunk_flags(self, chunk: Chunk, run: MethodRun, solved: Sequence[Solved]) -> Flags:
        """Return flags (N,): rows that took no part are not used, and null in the other columns."""
        size = chunk.left_out.shape[0]
        used = np.zeros(size, dtype=bool)
        parts: dict[str, list[tuple[IntArray, Any]]] = {}
        for _, row, solution in solved:
            if solution.flags is None:
                continue
            used[row] = solution.flags.used
            asked: dict[str, Any] = {"details": self.want_details, "dimension": self.dimension}
            own = run.spec.flag_columns(run.options, self.scene, chunk.columns, **asked)
            for name in (*own, "std_factor"):
                if name in solution.flags.columns:
                    parts.setdefault(name, []).append((row, solution.flags.columns[name]))
        flags = Flags(used=used, columns={name: scattered(size, column) for name, column in parts.items()})
        return flags if chunk.windows is None else flags_of_windows(flags, chunk.windows.leader)


def dense_blocks(offsets: IntArray, kept: BoolArray, block_size: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the indices of snapshots (B,) and rows (B, K) of blocks that cover all snapshots of a chunk.

    ``offsets`` (S+1,) are row offsets, ``kept`` (N,) the rows that take part; K counts only those and may be 0. B is
    at most ``block_size``.
    """
    kept_rows = np.flatnonzero(kept)
    kept_before = np.concatenate([[0], np.cumsum(kept)])
    first = kept_before[offsets[:-1]]
    counts = kept_before[offsets[1:]] - first
    for count in np.flatnonzero(np.bincount(counts)):
        members = np.flatnonzero(counts == count)
        within = np.arange(count, dtype=np.int64)
        for start in range(0, members.shape[0], block_size):
            snapshot = members[start : start + block_size]
            row = first[snapshot][:, None] + within
            yield snapshot, kept_rows[row] if count else row


def dense_batch(
    kind: str,
    columns: Columns,
    row: IntArray,
    *,
    scene: Scene,
    dimension: int = 2,
    seed: SeedArray | None = None,
    field: Field = _WHOLE_FIELD,
    flags: bool = False,
    details: bool = False,
    trace: bool = False,
) -> Batch:
    """Return the dense batch of the rows (B, K) of flat ``columns``: read-only arrays in Fortran order.

    ``seed`` (B,) is the random seed of each snapshot, zeros by default; ``flags``, ``details`` and ``trace`` are what
    the batch asks of a method.
    """
    cls = batch_class(kind)
    arrays = {}
    sources = {**cls.SOURCES, **cls.OPTIONAL_SOURCES, **(cls.SPACE_SOURCES if dimension == 3 else {})}
    for name, parts in sources.items():
        if columns.keys() >= set(parts):
            arrays[name] = _gather(row, [columns[part] for part in parts])
        elif name in cls.ABSENT:
            arrays[name] = np.full(row.shape, cls.ABSENT[name], order="F")
            arrays[name].flags.writeable = False
    if dimension == 3 and "target_z_m" in columns and not np.isnan(columns["target_z_m"][row[:, 0]]).all():
        arrays |= {name: _gather(row[:, 0], [columns[name]]) for name in ("target_z_m", "target_z_std_m")}
    if "speed_std" in columns:
        arrays["speed_std"] = _gather(row[:, 0], [columns["speed_std"]])
    for name, (rest, origin) in cls.EXACT.items():
        arrays |= dict(zip((name, origin), about_origin(columns[name][row], columns[rest][row]), strict=True))
    if kind == "arrivals":
        arrays = with_references(arrays, columns, row)
    batch: Batch = cls(
        scene=scene,
        field=field,
        dimension=dimension,
        seed=np.zeros(row.shape[0], dtype=np.uint64) if seed is None else seed,
        want_flags=flags,
        want_details=flags and details,
        want_trace=trace,
        **arrays,
    )
    return batch


@functools.cache
def keep_freed_memory() -> None:
    """Make glibc keep freed memory for the next block of snapshots; no effect with other C libraries.

    glibc returns a freed block to the system if it is larger than any block freed before, or if twice that size is free
    at the end of the heap: each block of snapshots would fault its pages in again, a fifth of the time of fast methods.
    Freeing one large array, whose pages are never touched, raises both thresholds for good.
    """
    np.empty(_LARGEST_KEPT, dtype=np.uint8)


def _gather(row: IntArray, parts: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    dense = np.empty(row.shape if len(parts) == 1 else (*row.shape, len(parts)), dtype=parts[0].dtype, order="F")
    for axis, part in enumerate(parts):
        (dense if len(parts) == 1 else dense[..., axis])[...] = part[row]
    dense.flags.writeable = False
    return dense


def _in_order(parts: Sequence[ChunkEstimates], alternatives: int) -> ChunkEstimates:
    whole = parts[0] if len(parts) == 1 else ChunkEstimates.join(parts)
    if bool((whole.snapshot[1:] > whole.snapshot[:-1]).all()):
        return whole
    order = np.lexsort((whole.alternative, whole.target, whole.method, whole.snapshot))
    return whole.take(order[whole.alternative[order] < alternatives])
