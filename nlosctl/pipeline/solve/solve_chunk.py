"""Solve a chunk: whole snapshots in dense batches of equal K, one method after the other, results in chunk order."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, SeedArray
from nlosctl.contract.fields import Field, SensorsField
from nlosctl.contract.result_checks import contract_violation
from nlosctl.contract.results import Flags, Solution, Trace, Words, no_estimates
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.errors import MethodError, NlosctlError, in_one_line
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.io.results.measurement_layouts import ChunkTrace, chunk_trace
from nlosctl.models.search_regions import search_region
from nlosctl.pipeline.solve.dense_batches import dense_batch, dense_blocks, keep_freed_memory
from nlosctl.pipeline.solve.merged_flags import flags_of_windows
from nlosctl.pipeline.solve.method_runs import BlockSolver, MethodRun
from nlosctl.pipeline.solve.reference_rows import alike_blocks, lacks_reference, without_reference_row
from nlosctl.pipeline.solve.report import fit_p_values

__all__ = ["ChunkSolution", "ChunkSolver"]

Columns = Mapping[str, npt.NDArray[Any]]
Solved = tuple[IntArray, IntArray, Solution]
"""A solution of a dense batch with the chunk indices of its snapshots (B,) and rows (B, K)."""

_WHOLE_FIELD = SensorsField()
_EDGE_SHARE = 0.01
"""An estimate is on the edge of the search region within this share of the region's larger side."""


@dataclass(frozen=True, kw_only=True)
class ChunkSolution:
    """The estimates of a chunk (None without an estimating method), flags (N,) by method, and the trace if wanted."""

    estimates: ChunkEstimates | None
    flags: Sequence[Flags] = ()
    trace: ChunkTrace | None = None


@dataclass(frozen=True, kw_only=True)
class ChunkSolver:
    """Solves chunks of one kind of measurement by several methods.

    ``dimension`` is 2 or 3. At most ``block_size`` snapshots are in a dense batch, at most ``alternatives`` estimates
    of a target are kept.
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

    def solve(self, chunk: Chunk, seed: SeedArray) -> ChunkSolution:
        """Return the results of all snapshots by each method; ``seed`` (S,) is the random seed of each snapshot."""
        keep_freed_memory()
        estimates: list[ChunkEstimates] = []
        flags: list[Flags] = []
        traces: list[tuple[int, IntArray, IntArray, Trace]] = []
        blocks = [
            part
            for block in dense_blocks(chunk.offsets, ~chunk.left_out, self.block_size)
            for part in alike_blocks(chunk, *block)
        ]
        for method, run in enumerate(self.runs):
            solve = run.solver(chunk)
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
        is_short = lacks_reference(chunk.columns, row)
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
            on_edge=self._on_edge(chunk, row[estimates.row], estimates.position_m)
            if searches
            else np.zeros(size, dtype=bool),
            columns=estimates.columns,
        )

    def _on_edge(self, chunk: Chunk, row: IntArray, position_m: FloatArray) -> BoolArray:
        """Return which estimates (E,), of snapshots with the rows (E, K), are on the edge of the search region."""
        if not row.size:
            return np.zeros(row.shape[0], dtype=bool)
        sensor_x, sensor_y = chunk.columns["sensor_x_m"][row], chunk.columns["sensor_y_m"][row]
        center_x, center_y = sensor_x[:, 0], sensor_y[:, 0]
        region = search_region(self.field, (sensor_x, sensor_y), (center_x, center_y))
        (xmin, ymin), (xmax, ymax) = region.bounds_m
        x, y = position_m[:, 0], position_m[:, 1]
        tolerance_m = _EDGE_SHARE * np.maximum(xmax - xmin, ymax - ymin)
        return region.on_edge(x - center_x, y - center_y, tolerance_m=tolerance_m)

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
        flags = Flags(used=used, columns={name: _scatter(size, column) for name, column in parts.items()})
        return flags if chunk.windows is None else flags_of_windows(flags, chunk.windows.leader)


def _in_order(parts: Sequence[ChunkEstimates], alternatives: int) -> ChunkEstimates:
    whole = parts[0] if len(parts) == 1 else ChunkEstimates.join(parts)
    if bool((whole.snapshot[1:] > whole.snapshot[:-1]).all()):
        return whole
    order = np.lexsort((whole.alternative, whole.target, whole.method, whole.snapshot))
    return whole.take(order[whole.alternative[order] < alternatives])


def _scatter(size: int, parts: Sequence[tuple[IntArray, npt.NDArray[Any] | Words]]) -> npt.NDArray[Any] | Words:
    """Return a flag column (N,) from its values at rows (B, K): null (NaN, None or masked) in all other rows."""
    first = parts[0][1]
    if isinstance(first, Words):
        words = tuple(dict.fromkeys([None, *(word for _, part in parts for word in part.words)]))  # type: ignore[union-attr]
        code = np.zeros(size, dtype=np.uint8)
        for row, part in parts:
            code[row] = np.array([words.index(word) for word in part.words], dtype=np.uint8)[part.code]  # type: ignore[union-attr]
        return Words(code=code, words=words)
    null, dtype = {"f": (np.nan, np.dtype(float)), "O": (None, first.dtype)}.get(first.dtype.kind, (0, first.dtype))
    values = np.full(size, null, dtype=dtype)
    unset = np.ones(size, dtype=bool)
    for row, part in parts:
        values[row] = part
        unset[row] = False
    return values if first.dtype.kind in "fO" else np.ma.MaskedArray(values, mask=unset)
