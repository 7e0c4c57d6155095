"""Several paths of a sensor: rows that compete, and whether `alpha` is too small in snapshots without them."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt

import numpy as np

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.results import is_fix
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.pipeline.solve.method_runs import MethodRun, MethodTally
from nlosctl.solvers.mixture.outlier_options import LateOptions, OutlierOptions

__all__ = ["competing_rows", "count_lone_rows", "share_remark", "single_path_snapshots"]

_FEWEST_ROWS = 100
_STANDARD_ERRORS = 3.0
_MARGIN = 0.02
_GROUP_KEYS = ("sensor_y_m", "sensor_x_m", "reflector")


def single_path_snapshots(chunk: Chunk) -> BoolArray:
    """Return in which snapshots (S,) no sensor has several rows at one position by one reflector, which compete."""
    snapshot, same = _neighbours(chunk, ~chunk.left_out)
    single = np.ones(chunk.offsets.size - 1, dtype=bool)
    single[snapshot[1:][same]] = False
    return single


def competing_rows(chunk: Chunk) -> int:
    """Return the number of rows with a path number that share sensor, position and reflector with another."""
    _, same = _neighbours(chunk, ~chunk.left_out & (chunk.columns["path"] >= 0))
    return int(np.count_nonzero(np.append(same, False) | np.append(False, same)))


def _neighbours(chunk: Chunk, taking_part: BoolArray) -> tuple[IntArray, BoolArray]:
    """Return the snapshots (N,) of rows sorted by sensor, position and reflector, and which are as the next (N-1,)."""
    kept = np.flatnonzero(taking_part)
    snapshot = np.repeat(np.arange(chunk.offsets.size - 1), np.diff(chunk.offsets))[kept]
    keys = [*(chunk.columns[name][kept] for name in (*_GROUP_KEYS, "sensor") if name in chunk.columns), snapshot]
    order = np.lexsort(keys)
    return snapshot[order], np.logical_and.reduce([key[order[1:]] == key[order[:-1]] for key in keys])


def count_lone_rows(tallies: Sequence[tuple[int, MethodTally]], chunk: Chunk, estimates: ChunkEstimates) -> None:
    """Count the rows that take part in the fixes of single-path snapshots, and those used, by methods' indices."""
    single = single_path_snapshots(chunk)
    kept_before = np.concatenate([[0], np.cumsum(~chunk.left_out)])
    rows = np.diff(kept_before[chunk.offsets])
    for method, tally in tallies:
        mine = (estimates.method == method) & (estimates.alternative == 0) & is_fix(estimates.status)
        mine &= single[estimates.snapshot]
        tally.lone_rows += int(rows[estimates.snapshot[mine]].sum())
        tally.lone_rows_used += int(estimates.n_used[mine].sum())


def share_remark(run: MethodRun, tally: MethodTally) -> list[str]:
    """Return a line if more rows are not used than `alpha` and sampling errors explain."""
    if not isinstance(run.options, OutlierOptions | LateOptions) or tally.lone_rows < _FEWEST_ROWS:
        return []
    alpha = run.options.alpha
    share = 1.0 - tally.lone_rows_used / tally.lone_rows
    if share <= alpha + _MARGIN + _STANDARD_ERRORS * sqrt(alpha * (1.0 - alpha) / tally.lone_rows):
        return []
    return [
        f"{run.label}: {100.0 * share:.3g} % of the rows of snapshots with a fix are not used, more than the "
        f"{100.0 * alpha:.3g} % that alpha expects; set `parameters` alpha={share:.2g}{_or_estimate(run)}, or check "
        "whether the standard deviations are too small"
    ]


def _or_estimate(run: MethodRun) -> str:
    learning = run.spec.learning
    return " or alpha=estimate" if learning is not None and "alpha" in learning.options and run.learned is None else ""
