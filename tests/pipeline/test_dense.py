"""Chunks to dense batches and back, compared with slow loops over single snapshots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Estimates, Flags, Solution
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.errors import MethodError, UsageError
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.solve_chunk import ChunkSolution, ChunkSolver, dense_batch, dense_blocks


@st.composite
def ragged(draw: st.DrawFn) -> tuple[list[int], list[bool]]:
    """Return rows per snapshot, and which rows are kept."""
    counts = draw(st.lists(st.integers(1, 6), min_size=1, max_size=30))
    total = sum(counts)
    return counts, draw(st.lists(st.booleans(), min_size=total, max_size=total))


def offsets_of(counts: list[int]) -> np.ndarray:
    """Return row offsets."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


@pytest.mark.extensive
@given(ragged(), st.integers(1, 7))
def test_blocks_hold_each_snapshot_once_with_its_kept_rows(case: tuple[list[int], list[bool]], size: int) -> None:
    """Every snapshot is in one block with the indices of its kept rows in order; blocks are bounded and uniform."""
    counts, kept = case
    offsets = offsets_of(counts)
    found: dict[int, list[int]] = {}
    for snapshots, row in dense_blocks(offsets, np.array(kept), size):
        assert 1 <= snapshots.shape[0] == row.shape[0] <= size
        for snapshot, rows in zip(snapshots.tolist(), row.tolist(), strict=True):
            assert snapshot not in found
            found[snapshot] = rows
    expected = {
        index: [row for row in range(offsets[index], offsets[index + 1]) if kept[row]] for index in range(len(counts))
    }
    assert found == expected


@given(ragged(), st.integers(1, 7))
def test_batches_hold_the_columns_of_their_rows(case: tuple[list[int], list[bool]], size: int) -> None:
    """A batch has the values of its rows and its snapshots' seeds; arrays are read-only and in Fortran order."""
    counts, kept = case
    columns, seed = columns_of(sum(counts)), np.arange(len(counts), dtype=np.uint64) * 7
    for snapshot, row in dense_blocks(offsets_of(counts), np.array(kept), size):
        batch: Any = dense_batch("bearings", columns, row, scene=Scene(), seed=seed[snapshot], flags=True)
        assert batch.seed.tolist() == [7 * index for index in snapshot]
        for name in ("sensor", "bearing_rad", "bearing_std_rad", "path", "reflector"):
            dense = getattr(batch, name)
            assert dense.tolist() == [[columns[name][r] for r in rows] for rows in row.tolist()]
            assert not dense.flags.writeable
            assert dense.flags.f_contiguous
        expected = [[[columns["sensor_x_m"][r], columns["sensor_y_m"][r]] for r in rows] for rows in row.tolist()]
        assert batch.sensor_xy_m.tolist() == expected
        assert batch.sensor_xy_m.shape == (*row.shape, 2)


def test_only_batches_in_space_have_heights_and_elevations() -> None:
    """The same columns give a batch of the plane without them, and one in space with them, heights by snapshot."""
    row = np.arange(12).reshape(4, 3)
    of_space = {name: np.arange(12.0) + 100.0 * i for i, name in enumerate(["sensor_z_m", "elevation_rad"])}
    heights = {"target_z_m": np.repeat([1.5, 2.5, 0.0, 9.0], 3), "target_z_std_m": np.zeros(12)}
    columns = {**columns_of(12), **of_space, **heights}
    plane: Any = dense_batch("bearings", columns, row, scene=Scene())
    assert plane.dimension == 2
    assert [getattr(plane, name) for name in (*of_space, *heights)] == [None] * 4
    assert not plane.height_held
    space: Any = dense_batch("bearings", columns, row, scene=Scene(), dimension=3)
    assert space.dimension == 3
    for name, column in of_space.items():
        assert getattr(space, name).tolist() == column[row].tolist()
        assert getattr(space, name).flags.f_contiguous
    assert space.elevation_std_rad is None
    assert space.target_z_m.tolist() == [1.5, 2.5, 0.0, 9.0]
    assert space.height_held
    columns["target_z_std_m"] = np.repeat([0.0, 0.3, 0.0, 0.0], 3)
    measured: Any = dense_batch("bearings", columns, row, scene=Scene(), dimension=3)
    assert not measured.height_held


def columns_of(total: int) -> dict[str, Any]:
    """Return flat columns with a different value in every row."""
    index = np.arange(total)
    return {
        "sensor": index % 4,
        "sensor_x_m": index + 0.5,
        "sensor_y_m": -index - 0.25,
        "bearing_rad": np.sin(index),
        "bearing_std_rad": 0.01 + index,
        "path": index % 3,
        "reflector": np.full(total, -1),
    }


@dataclass(frozen=True, kw_only=True)
class NoOptions:
    """A method without options."""


def ladder(batch: Any, options: Any) -> Solution:
    """Return K alternatives of each snapshot, computed from its own numbers; use every second row and flag all rows."""
    size, count = batch.bearing_rad.shape
    row = np.repeat(np.arange(size), count)
    alternative = np.tile(np.arange(count), size)
    first = batch.sensor_xy_m[:, 0, :][row]
    used = np.broadcast_to(np.arange(count) % 2 == 0, (size, count))
    return Solution(
        estimates=Estimates(
            row=row,
            target=np.zeros_like(row),
            alternative=alternative,
            position_m=first + alternative[:, None],
            covariance_m2=np.ones((row.shape[0], 3)),
            cost=batch.seed[row].astype(float),
            n_used=np.full(row.shape, count),
            status=np.full(row.shape, Status.OK, dtype=np.uint8),
        ),
        flags=Flags(used=used, columns={"residual_rad": 2.0 * batch.bearing_rad, "los": used}),
    )


def method(name: str, solve: Any, minimum: int = 1, flags: tuple[str, ...] = ("residual_rad", "los")) -> MethodRun:
    """Return a run of a toy method."""
    spec = MethodSpec(
        name=name,
        kind="bearings",
        job="localize",
        summary="a toy",
        reference="none",
        options=NoOptions,
        solve=solve,
        cost="its seed",
        minimum_measurements=minimum,
        flags=flags,
    )
    return MethodRun(spec=spec, options=NoOptions())


def solve(counts: list[int], kept: list[bool], runs: list[MethodRun], **settings: Any) -> ChunkSolution:
    """Return the solution of a chunk with a different seed for each snapshot."""
    chunk = Chunk(
        table=None,
        snapshot=None,
        offsets=offsets_of(counts),
        columns=columns_of(sum(counts)),
        left_out=~np.array(kept),
        source="",
    )
    solver = ChunkSolver(kind="bearings", scene=Scene(), runs=tuple(runs), **settings)
    return solver.solve(chunk, np.arange(len(counts), dtype=np.uint64) + 100)


def by_loop(counts: list[int], kept: list[bool], minimums: list[int], alternatives: int) -> list[tuple[Any, ...]]:
    """Return the expected result of `ladder`, computed snapshot by snapshot."""
    offsets, columns, rows = offsets_of(counts), columns_of(sum(counts)), []
    for index in range(len(counts)):
        mine = [row for row in range(offsets[index], offsets[index + 1]) if kept[row]]
        for number, minimum in enumerate(minimums):
            if len(mine) < minimum:
                rows.append((index, number, 0, None, counts[index], 0, "too_few"))
                continue
            for alternative in range(min(alternatives, len(mine))):
                x = columns["sensor_x_m"][mine[0]] + alternative
                rows.append((index, number, alternative, x, counts[index], len(mine), "ok"))
    return rows


def as_rows(estimates: ChunkEstimates) -> list[tuple[Any, ...]]:
    """Return estimates as rows."""
    x = [None if np.isnan(value) else value for value in estimates.position_m[:, 0].tolist()]
    words = [Status(code).word for code in estimates.status]
    counts = (estimates.n_measurements.tolist(), estimates.n_used.tolist())
    ids = (estimates.snapshot.tolist(), estimates.method.tolist(), estimates.alternative.tolist())
    return list(zip(*ids, x, *counts, words, strict=True))


@settings(deadline=None)
@given(ragged(), st.integers(1, 7), st.integers(1, 4))
def test_estimates_come_in_order_and_no_more_than_wanted(
    case: tuple[list[int], list[bool]], size: int, alternatives: int
) -> None:
    """Estimates are in the order of a loop over snapshots, methods and at most N alternatives."""
    counts, kept = case
    runs = [method("one", ladder, minimum=1), method("two", ladder, minimum=3)]
    estimates = solve(counts, kept, runs, block_size=size, alternatives=alternatives).estimates
    assert estimates is not None
    assert as_rows(estimates) == by_loop(counts, kept, [1, 3], alternatives)
    seeds = [None if np.isnan(cost) else cost for cost in estimates.cost]
    expected = [None if row[3] is None else 100.0 + row[0] for row in as_rows(estimates)]
    assert seeds == expected


@settings(deadline=None)
@given(ragged(), st.integers(1, 7))
def test_flags_come_back_to_their_rows(case: tuple[list[int], list[bool]], size: int) -> None:
    """Each row has its own flags; rows left out, or of an unsolved snapshot, are not used and have null flags."""
    counts, kept = case
    (flags,) = solve(counts, kept, [method("two", ladder, minimum=2)], block_size=size, want_flags=True).flags
    offsets, bearing = offsets_of(counts), columns_of(sum(counts))["bearing_rad"]
    expected: list[tuple[bool, float | None, bool | None]] = [(False, None, None)] * sum(counts)
    for index in range(len(counts)):
        mine = [row for row in range(offsets[index], offsets[index + 1]) if kept[row]]
        if len(mine) >= 2:
            for number, row in enumerate(mine):
                expected[row] = (number % 2 == 0, 2.0 * bearing[row], number % 2 == 0)
    assert flags.used.tolist() == [used for used, _, _ in expected]
    residual: Any = flags.columns.get("residual_rad", np.full(sum(counts), np.nan))
    los: Any = flags.columns.get("los", np.full(sum(counts), None, dtype=object))
    assert [None if np.isnan(value) else value for value in residual] == [value for _, value, _ in expected]
    assert los.tolist() == [value for _, _, value in expected]


def test_a_method_that_breaks_its_contract_is_named() -> None:
    """An exception or an invalid result becomes a MethodError that names the method; nlosctl's own errors pass."""

    def failing(batch: Any, options: Any) -> Solution:
        raise ZeroDivisionError("division by zero")

    def usage(batch: Any, options: Any) -> Solution:
        raise UsageError("needs a scene")

    with pytest.raises(MethodError, match="'bad' failed: ZeroDivisionError: division by zero"):
        solve([2], [True, True], [method("bad", failing)])
    with pytest.raises(MethodError, match="'none' returned a NoneType"):
        solve([2], [True, True], [method("none", lambda batch, options: None)])
    with pytest.raises(UsageError, match="needs a scene"):
        solve([2], [True, True], [method("usage", usage)])
