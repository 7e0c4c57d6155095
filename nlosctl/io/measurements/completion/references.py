"""Differences of arrival times: to which sensors they refer, where those are, and which form a snapshot has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from enum import IntEnum
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

__all__ = ["FORM", "Form", "arrival_plan", "check_arrivals", "resolve_references"]

FORM = "difference_form"
"""The column of the form of a row's snapshot."""


class Form(IntEnum):
    """What the differences of a snapshot are.

    All to one reference, which has a row of its own or not; or to several, and then independent of each other.
    """

    WITH_REFERENCE = 0
    WITHOUT_REFERENCE = 1
    OF_PAIRS = 2


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
    """Return the chunk with the `Form` of each row's snapshot (N,), and the positions and stds of references.

    With one reference the position and std are those of the snapshot: of the rows, else of the scene, and without a std
    the root mean square of the others'. With several the position is that of the row, of the scene, or of a row of
    that sensor in the snapshot, there is no such std, and the reference's own rows, which have no information, are left
    out. Raises DataError for a reference without a position that is needed.
    """
    columns, offsets = chunk.columns, chunk.offsets
    counts = np.diff(offsets)
    snapshot = np.repeat(np.arange(counts.shape[0]), counts)
    reference, own = columns["reference"], columns["sensor"] == columns["reference"]
    several = np.maximum.reduceat(reference != reference[offsets[:-1]][snapshot], offsets[:-1])
    has_own = np.maximum.reduceat(own & ~chunk.left_out, offsets[:-1])
    one_form = np.where(has_own, Form.WITH_REFERENCE, Form.WITHOUT_REFERENCE)
    form = np.where(several, Form.OF_PAIRS, one_form)[snapshot]
    pairs = form == Form.OF_PAIRS
    _refuse_std(chunk, pairs, names)
    axes = [axis for axis in _AXES if f"reference_{axis}_m" in columns]
    same = _row_of_reference(columns, snapshot)
    found: dict[str, npt.NDArray[Any]] = {FORM: form}
    for axis in axes:
        given = columns[f"reference_{axis}_m"]
        of_sensor = np.append(columns[f"sensor_{axis}_m"], np.nan)[same]
        of_row = np.where(np.isnan(given), of_sensor, given)
        found[f"reference_{axis}_m"] = np.where(pairs, of_row, _first_known(given, offsets))
    unknown = np.isnan([found[f"reference_{axis}_m"] for axis in axes]).any(axis=0)
    unknown &= (pairs & ~own) | (form == Form.WITHOUT_REFERENCE)
    if unknown.any():
        row = int(np.argmax(unknown))
        raise DataError(
            f"{_where(chunk, row)}, column 'reference': sensor {names[reference[row]]!r} has no row there and no "
            f"position; add columns {', '.join(f'reference_{axis}_m' for axis in axes)}, or the sensor to a scene"
        )
    found[_STD] = _stds(columns, chunk.left_out, offsets)
    return replace(chunk, columns={**columns, **found}, left_out=chunk.left_out | (pairs & own))


def _refuse_std(chunk: Chunk, pairs: BoolArray, names: Sequence[str]) -> None:
    """Raise DataError for a std of a reference's arrival among independent differences, whose std is their own."""
    given = pairs & ~np.isnan(chunk.columns[_STD])
    if given.any():
        row = int(np.argmax(given))
        raise DataError(
            f"{_where(chunk, row)}, column {_STD!r}: got {chunk.columns[_STD][row]:g} m for "
            f"{names[chunk.columns['reference'][row]]!r}, but the differences there are to several references: each is "
            "independent, and its arrival_std_m is that of the difference; empty the column, or give each reference "
            "its snapshots"
        )


def _row_of_reference(columns: Any, snapshot: IntArray) -> IntArray:
    """Return for each row (N,) the first row of its reference as a sensor in the snapshot, N without one."""
    size = snapshot.shape[0]
    codes = int(max(columns["sensor"].max(initial=0), columns["reference"].max(initial=0))) + 1
    key, wanted = snapshot * codes + columns["sensor"], snapshot * codes + columns["reference"]
    order = np.argsort(key, kind="stable")
    at = np.minimum(np.searchsorted(key[order], wanted), size - 1)
    return np.asarray(np.where(key[order[at]] == wanted, order[at], size))


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
