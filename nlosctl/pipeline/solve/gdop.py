"""Geometric dilution of precision of fixes: what the geometry of the rows used does to errors of one metre."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.models.information import UNIT_INFORMATION
from nlosctl.pipeline.solve.dense_blocks import dense_blocks
from nlosctl.pipeline.solve.solve_chunk import FlatEstimates, MethodRun, Problem

__all__ = ["gdop", "refuse_gdop"]


_AT_ONCE = 4096
_CONDITION_LIMIT = 1e12


def refuse_gdop(kind: str, runs: Sequence[MethodRun]) -> None:
    """Raise UsageError where a GDOP has no meaning: for triplets, and where a snapshot has several targets."""
    if kind not in UNIT_INFORMATION or any(run.spec.job != "localize" for run in runs):
        raise UsageError(
            f"--add gdop: there for 'localize' of {' and '.join(UNIT_INFORMATION)}, where a snapshot is of one source"
        )


def gdop(problem: Problem, estimates: FlatEstimates, used: Sequence[BoolArray]) -> FloatArray:
    """Return the GDOP (E,) of estimates: sqrt(trace(G^-1)), where G sums u u^T over the rows that the fix rests on.

    u is the unit vector across a row's line of position, or along its range (times cos(elevation) where ranges are
    slant): the root of the trace of the covariance for errors of 1 m in each, for ranges the usual definition.
    ``used`` (N,) is of each method. NaN where there is no position or the rows leave a direction open.
    """
    found = np.full(estimates.snapshot.shape, np.nan)
    for number, rows_used in enumerate(used):
        mine = np.flatnonzero((estimates.method == number) & np.isfinite(estimates.position_m[:, 0]))
        for rank in np.unique(estimates.alternative[mine]).tolist():
            _of_rank(problem, estimates, mine[estimates.alternative[mine] == rank], rows_used, found)
    return found


def _of_rank(problem: Problem, estimates: FlatEstimates, chosen: IntArray, used: BoolArray, found: FloatArray) -> None:
    """Write the GDOP of estimates, of which a snapshot has one at most."""
    place = np.full(problem.offsets.shape[0] - 1, -1, dtype=np.int64)
    place[estimates.snapshot[chosen]] = chosen
    for block in dense_blocks(problem.offsets, used & problem.kept, _AT_ONCE):
        of = place[block.snapshot]
        there = of >= 0
        if not block.row.shape[1] or not there.any():
            continue
        batch = block.batch(problem.kind, problem.columns, problem.scene, problem.seed, flags=False)
        position = np.where(there[:, None], estimates.position_m[of], np.nan)
        found[of[there]] = _dilution(UNIT_INFORMATION[problem.kind](batch, position[:, 0], position[:, 1]))[there]


def _dilution(geometry: Symmetric2x2) -> FloatArray:
    with ignoring_division():
        smaller, larger = geometry.eigenvalues()
        regular = (smaller * _CONDITION_LIMIT > larger) & np.isfinite(larger)
        return np.where(regular, np.sqrt(geometry.trace / geometry.determinant), np.nan)
