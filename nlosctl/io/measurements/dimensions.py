"""Two or three dimensions: which columns of a file decide, and what its rows in space must have."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import CircleReflector, Scene
from nlosctl.contract.tables import Column, Table
from nlosctl.errors import DataError
from nlosctl.io.measurements.column_mapping import ColumnPlan
from nlosctl.io.measurements.missing_columns import missing_message
from nlosctl.io.measurements.row_checks import Fault, got, is_null

if TYPE_CHECKING:
    from nlosctl.io.measurements.reader import Chunk

__all__ = ["check_space", "complete_directions", "in_dimension", "refuse_several_heights"]

_HEIGHT, _HEIGHT_STD = "target_z_m", "target_z_std_m"
_ACROSS = "direction_std_rad"


def in_dimension(
    table: Table,
    names: Collection[str],
    constants: Collection[str],
    scene: Scene,
    file: str,
    asked: int | None,
    *,
    needs_stds: bool,
) -> tuple[Table, list[str]]:
    """Return the table of ``file`` in the dimension ``asked``, and remarks on what is then not used.

    Default: three if a file with the columns ``names`` has elevations, their standard deviations (if it ``needs_stds``)
    and the heights of all sensors, in columns, ``constants`` or the scene; else two. Raises DataError for a scene that
    is not of space.
    """
    space = table.in_space()
    lacking = _lacking(space, names, constants, scene, needs_stds=needs_stds)
    if asked == 3 or (asked is None and lacking == []):
        _refuse_circles(scene, file)
        return space, []
    unused = [
        name
        for column in table.space
        if column.name not in table.names and not column.carried
        for name in column.accepted_names
        if name in names or name in constants
    ]
    if table.name == "ranges" or not unused:
        return table, []
    reason = f", since there are no {' and no '.join(lacking)}" if lacking and asked is None else ""
    verb = "is" if len(unused) == 1 else "are"
    return table, [f"solved in two dimensions: {', '.join(unused)} {verb} not used{reason}"]


def _lacking(
    space: Table, names: Collection[str], constants: Collection[str], scene: Scene, *, needs_stds: bool
) -> list[str] | None:
    """Return what a file lacks of three dimensions, as text; None if its kind is only solved in them when asked."""
    given = {*names, *constants}
    elevations = [column for column in space.columns if column.name.endswith("elevation_rad")]
    if not elevations:
        return None
    there = [column for column in elevations if not given.isdisjoint(column.accepted_names)]
    lacking = [] if there else ["elevations"]
    stds = [_std_of(space, column) for column in there]
    if needs_stds and any(_is_absent(space, std, given) for std in stds):
        lacking.append("standard deviations of elevations")
    heights = [column for column in space.columns if column.required and column.name.endswith("_z_m")]
    if any(given.isdisjoint(column.accepted_names) for column in heights) and not scene.has_heights:
        lacking.append("heights of the sensors" if len(heights) == 1 else "heights of transmitters and receivers")
    return lacking


def _std_of(space: Table, elevation: Column) -> Column:
    return space.column(elevation.name.replace("_rad", "_std_rad"))


def _is_absent(space: Table, std: Column, given: Collection[str]) -> bool:
    accepted = {*std.accepted_names, *(space.column(std.replaced_by).accepted_names if std.replaced_by else ())}
    return accepted.isdisjoint(given)


def _refuse_circles(scene: Scene, file: str) -> None:
    for reflector in scene.reflectors:
        if isinstance(reflector, CircleReflector):
            raise DataError(
                f"{file}: in its scene reflector {reflector.name!r} is a circle, of two dimensions; in three give "
                "kind = 'sphere' with a center of three numbers"
            )


def check_space(plan: ColumnPlan, header: Sequence[str], file: str) -> None:
    """Raise DataError for elevations without standard deviations and the reverse, and heights like that."""
    given = {*plan.mapped, *plan.constants}
    for column in plan.table.columns:
        if column.replaced_by in given and column.name in given:
            names = [
                plan.mapped[name].name if name in plan.mapped else name for name in (column.name, column.replaced_by)
            ]
            raise DataError(f"{file}: {names[0]!r} and {names[1]!r} are the same quantity; drop one")
        if not column.name.endswith("elevation_rad"):
            continue
        std = _std_of(plan.table, column)
        if plan.units and std.name in given:
            required = next(iter(plan.units))
            raise DataError(
                f"{file}: {std.name!r} needs {required!r} as a relative weight beside it; give both, or neither"
            )
        if column.name in given and {std.name, std.replaced_by}.isdisjoint({*given, *plan.units}):
            raise DataError(missing_message([std], header, plan.table, file, estimable=False))
        if std.name in plan.mapped and column.name not in given:
            raise DataError(
                f"{file}: column {plan.mapped[std.name].name!r} needs {column.name!r}; give both, or neither"
            )
    if _HEIGHT_STD in given and _HEIGHT not in given:
        raise DataError(f"{file}: column {plan.mapped[_HEIGHT_STD].name!r} needs {_HEIGHT!r}; give both, or neither")


def complete_directions(plan: ColumnPlan, columns: dict[str, npt.NDArray[Any]], faults: list[Fault]) -> None:
    """Add what the columns (N,) of rows in space imply, and the faults of rows that lack a standard deviation.

    ``bearing_std_rad`` follows from ``direction_std_rad``; the standard deviation of a height is 0 without a column.
    """
    for name, values in list(columns.items()):
        std = name.replace("_rad", "_std_rad")
        if name.endswith("elevation_rad") and std in plan.mapped:
            faults += _missing_std(plan, std, values, columns[std], "the standard deviation of the row's elevation")
    if _ACROSS in columns:
        elevation = columns.get("elevation_rad", np.zeros(1))
        columns["bearing_std_rad"] = columns[_ACROSS] / np.cos(np.where(np.isnan(elevation), 0.0, elevation))
    if _HEIGHT not in columns:
        return
    height = columns[_HEIGHT]
    if plan.mapped[_HEIGHT].name.endswith("_height_m"):
        columns["target_above_ground"] = np.ones(height.shape)
    if _HEIGHT_STD not in columns:
        columns[_HEIGHT_STD] = np.where(np.isnan(height), np.nan, 0.0)
        return
    stds = columns[_HEIGHT_STD]
    faults += _missing_std(plan, _HEIGHT_STD, height, stds, "the standard deviation of the row's height")
    if (stds < 0.0).any():
        describe = got(stds, "a number of at least 0 (0: the height is exact)")
        faults.append(Fault(mask=stds < 0.0, column=plan.mapped[_HEIGHT_STD].name, describe=describe))
    columns[_HEIGHT_STD] = np.where(np.isnan(height), np.nan, stds)


def _missing_std(plan: ColumnPlan, name: str, values: FloatArray, std: FloatArray, what: str) -> list[Fault]:
    without = ~np.isnan(values) & np.isnan(std)
    return [Fault(mask=without, column=plan.mapped[name].name, describe=is_null(what))] if without.any() else []


def refuse_several_heights(chunk: Chunk) -> None:
    """Raise DataError for a snapshot whose rows that take part have different heights of the target."""
    for name in (_HEIGHT, _HEIGHT_STD):
        values = chunk.columns.get(name)
        if values is None:
            continue
        first = np.repeat(chunk.offsets[:-1], np.diff(chunk.offsets))
        other = (values != values[first]) & ~(np.isnan(values) & np.isnan(values[first]))
        if other.any():
            row = int(np.argmax(other))
            snapshot = chunk.snapshot[int(np.searchsorted(chunk.offsets, row, side="right")) - 1].as_py()
            raise DataError(
                f"{chunk.source}, snapshot {snapshot!r}, column {name!r}: got {values[row]:g} beside "
                f"{values[first[row]]:g}, expected one height in all rows of a snapshot; give each height its snapshot"
            )
