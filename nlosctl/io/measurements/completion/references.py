"""Differences of arrival times: which sensor they refer to, where it is, and the row that it lacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.contract.tables.arrivals import DIFFERENCES
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import ColumnPlan
from nlosctl.io.measurements.completion.exact_numbers import REST, refuse_rounded
from nlosctl.io.measurements.row_checks import Describe, Fault
from nlosctl.io.measurements.scene_columns import SceneColumns

if TYPE_CHECKING:
    from nlosctl.io.measurements.reader import Chunk

__all__ = ["arrival_plan", "check_arrivals", "resolve_references"]

_AXES = ("x", "y", "z")
_STD = "reference_std_m"


def arrival_plan(plan: ColumnPlan, file: str, speed_m_s: float) -> ColumnPlan:
    """Return the plan with times as lengths; raise DataError for differences without a column of their references."""
    mapped = plan.mapped["arrival_m"]
    if mapped.name in DIFFERENCES and "reference" not in plan.mapped:
        raise DataError(
            f"{file}: column {mapped.name!r} needs 'reference', the sensor whose arrival is subtracted; add it, or "
            "rename arrivals to arrival_s, arrival_ns or arrival_m"
        )
    seconds = {spelling.name: spelling.seconds for column in plan.table.columns for spelling in column.spellings}
    scaled = {
        name: replace(given, scale=seconds[given.name] * speed_m_s)
        for name, given in plan.mapped.items()
        if seconds.get(given.name)
    }
    return replace(plan, mapped={**plan.mapped, **scaled})


def check_arrivals(
    plan: ColumnPlan, scene: SceneColumns, batch: Any, columns: dict[str, npt.NDArray[Any]], faults: list[Fault]
) -> None:
    """Add the faults of arrivals (N,) that are rounded, and of rows of a reference whose difference is not 0.

    Positions of references that the file lacks are those of the scene.
    """
    mapped = plan.mapped["arrival_m"]
    refuse_rounded(mapped, batch.column(mapped.name), columns["arrival_std_m"], faults)
    if mapped.name not in DIFFERENCES:
        columns.pop("reference", None)
        return
    reference = columns["reference"]
    own = (columns["sensor"] == reference) & ((columns["arrival_m"] != 0.0) | (columns[REST] != 0.0))
    if own.any():
        describe: Describe = lambda index: (  # noqa: E731
            f"got {columns['arrival_m'][index]:g} m in the row of the reference itself, expected 0; correct the value, "
            "or the name in 'reference'"
        )
        faults.append(Fault(mask=own, column=mapped.name, describe=describe))
    places = scene.places_of(reference, columns)
    for axis, known in zip(_AXES[: plan.table.dimension], places, strict=False):
        name = f"reference_{axis}_m"
        given = columns.get(name)
        columns[name] = known if given is None else np.where(np.isnan(given), known, given)
    columns.setdefault(_STD, np.full(reference.shape, np.nan))


def resolve_references(chunk: Chunk, names: Sequence[str]) -> Chunk:
    """Return the chunk with ``lacks_reference`` (N,), and the position and std of the reference in such snapshots.

    The position is that of the rows, else of the scene; the std that of the rows, else the root mean square of the
    others'. If the reference has a row itself, nothing is lacking. Raises DataError for a reference without a position,
    and for differences to several references in one snapshot.
    """
    columns, offsets = chunk.columns, chunk.offsets
    first = np.repeat(offsets[:-1], np.diff(offsets))
    reference = columns["reference"]
    several = reference != reference[first]
    if several.any():
        row = int(np.argmax(several))
        raise DataError(
            f"{_where(chunk, row)}: differences to several references ({names[reference[first[row]]]!r}, "
            f"{names[reference[row]]!r}), expected one in all rows of a snapshot; give each reference its snapshots"
        )
    has_own = np.maximum.reduceat((columns["sensor"] == reference) & ~chunk.left_out, offsets[:-1])
    lacks = np.repeat(~has_own, np.diff(offsets))
    found: dict[str, npt.NDArray[Any]] = {"lacks_reference": lacks.astype(np.int64)}
    axes = [axis for axis in _AXES if f"reference_{axis}_m" in columns]
    for axis in axes:
        found[f"reference_{axis}_m"] = _first_known(columns[f"reference_{axis}_m"], offsets)
    unknown = lacks & np.isnan([found[f"reference_{axis}_m"] for axis in axes]).any(axis=0)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise DataError(
            f"{_where(chunk, row)}, column 'reference': sensor {names[reference[row]]!r} has no row there and no "
            f"position; add columns {', '.join(f'reference_{axis}_m' for axis in axes)}, or the sensor to a scene"
        )
    found[_STD] = _stds(columns, chunk.left_out, offsets)
    return replace(chunk, columns={**columns, **found})


def _where(chunk: Chunk, row: int) -> str:
    snapshot = chunk.snapshot[int(np.searchsorted(chunk.offsets, row, side="right")) - 1].as_py()
    return f"{chunk.source}, snapshot {snapshot!r}"


def _first_known(values: FloatArray, offsets: IntArray) -> FloatArray:
    """Return for each row (N,) the first value of its snapshot that is not NaN, else NaN."""
    index = np.where(np.isnan(values), values.shape[0], np.arange(values.shape[0]))
    first = np.minimum.reduceat(index, offsets[:-1])
    return np.repeat(np.append(values, np.nan)[first], np.diff(offsets))


def _stds(columns: Any, left_out: BoolArray, offsets: IntArray) -> FloatArray:
    """Return the std (N,) of the reference's arrival: given, else the root mean square of its snapshot's."""
    counts = np.diff(offsets)
    given = _first_known(columns[_STD], offsets)
    taken = ~left_out
    squares = np.add.reduceat(np.where(taken, columns["arrival_std_m"] ** 2, 0.0), offsets[:-1])
    usual = np.sqrt(squares / np.maximum(np.add.reduceat(taken, offsets[:-1], dtype=np.int64), 1))
    return np.where(np.isnan(given), np.repeat(usual, counts), given)
