"""Column mapping: which column of a file gives which column of the contract, and names as codes."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.arrays import IntArray
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import EARTH_PLACES, KINDS, Column, ColumnType, Table, contract_names
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.measurements.missing_columns import missing_message, unit_stds

__all__ = [
    "METHOD",
    "NULL_CODE",
    "SNAPSHOT",
    "ColumnPlan",
    "CoordinateColumns",
    "MappedColumn",
    "NameCodes",
    "are_flags_by_method",
    "check_constants",
    "columns_to_read",
    "coordinate_columns",
    "kind_of_columns",
    "kind_table",
    "plan_columns",
]

SNAPSHOT = "snapshot"
METHOD = "method"
NULL_CODE = -1
"""The code of an empty name, and an integer that is null."""

_DISTINCTIVE = {
    kind: [
        frozenset(column.accepted_names)
        for column in table.columns
        if column.required and not column.constant_allowed and column.scene_axis is None and not column.scene_sensor
    ]
    for kind, table in KINDS.items()
}
"""The names of each column that only a file of that kind must have."""

_FILLABLE = {
    kind: [frozenset(column.accepted_names) for column in table.columns if column.required and column.constant_allowed]
    for kind, table in KINDS.items()
}
"""The names of each required column that a constant may fill."""


@dataclass(frozen=True, kw_only=True)
class MappedColumn:
    """A contract column and the file's column for it: ``contract's value = file's value * scale + offset``.

    A direction with ``is_relative`` is yet without the heading of its sensor.
    """

    column: Column
    name: str
    scale: float = 1.0
    offset: float = 0.0
    from_north: bool = False
    is_relative: bool = False

    @property
    def converted(self) -> bool:
        """Whether the file's unit differs from the contract's."""
        return self.scale != 1.0 or self.offset != 0.0


@dataclass(frozen=True, kw_only=True)
class CoordinateColumns:
    """The file's columns of latitude and longitude (degrees), and the columns of x and y that they give."""

    lat: str
    lon: str
    x: str
    y: str
    nullable: bool


@dataclass(frozen=True, kw_only=True)
class ColumnPlan:
    """The sources of the contract's columns in one file; ``units`` are those of unknown standard deviations, 1."""

    table: Table
    mapped: Mapping[str, MappedColumn]
    constants: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, float] = field(default_factory=dict)
    has_snapshot: bool = True

    @property
    def scene_axes(self) -> tuple[str, ...]:
        """The columns that the scene's sensor positions in the plane can fill: all of them, or none."""
        return tuple(column.name for column in self.table.columns if column.scene_axis in (0, 1))

    @property
    def relative(self) -> list[str]:
        """The names of the directions that are relative to a heading."""
        return [name for name, mapped in self.mapped.items() if mapped.is_relative]

    @property
    def types(self) -> dict[str, ColumnType]:
        """The contract's type of each column that the file has."""
        return {mapped.name: mapped.column.type for mapped in self.mapped.values()}


def kind_table(kind: str) -> Table:
    """Return the table of a kind; raise UsageError with the nearest name if it does not exist."""
    if kind not in KINDS:
        raise UsageError(f"no kind {kind!r}{did_you_mean(kind, KINDS)}; there are: {', '.join(KINDS)}")
    return KINDS[kind]


def kind_of_columns(names: Iterable[str], constants: Collection[str] = ()) -> str:
    """Return the kind that misses the fewest of its required columns among ``names``, then among ``constants`` too."""
    given = frozenset(names)

    def unfit(kind: str) -> tuple[int, int]:
        missing = sum(given.isdisjoint(accepted) for accepted in _DISTINCTIVE[kind])
        return missing, sum(given.union(constants).isdisjoint(accepted) for accepted in _FILLABLE[kind])

    return min(_DISTINCTIVE, key=unfit)


def coordinate_columns(names: Sequence[str], renames: Mapping[str, str], file: str) -> list[CoordinateColumns]:
    """Return the latitudes and longitudes among a file's columns ``names`` that have no x and y beside them.

    ``renames`` (contract's name -> file's name) are their other names. Raises DataError for one without the other.
    """
    known = {*names, *renames}
    pairs = []
    for owner in EARTH_PLACES:
        lat, lon = (renames.get(f"{owner}_{axis}_deg", f"{owner}_{axis}_deg") for axis in ("lat", "lon"))
        x, y = f"{owner}_x_m", f"{owner}_y_m"
        if x in known or y in known:
            continue
        if (lat in names) != (lon in names):
            given, absent = (lat, lon) if lat in names else (lon, lat)
            near = did_you_mean(absent, {*names} - {given})
            raise DataError(f"{file}: column {given!r} needs {absent!r}{near}; give both, or neither")
        if lat in names:
            pairs.append(CoordinateColumns(lat=lat, lon=lon, x=x, y=y, nullable=owner in ("truth", "prior")))
    return pairs


def plan_columns(
    names: Sequence[str], table: Table, constants: Mapping[str, float], scene: Scene, file: str, header: Sequence[str],
    missing_std: str = "error",
) -> ColumnPlan:  # fmt: skip
    """Return the sources of the contract's columns, given the columns of ``file``: renamed ``names``, own ``header``.

    Raises DataError if a required column is missing, or given twice, or only a part of a group is there; UsageError for
    a constant that the file has as a column, or that is not allowed.
    """
    if names and names[0].startswith("#") and (bare := names[0].lstrip("# ")) in contract_names():
        raise DataError(f"{file}: the header begins with '#': got {names[0]!r}, expected {bare!r}")
    matches = {column.name: _find(column, names, constants, file) for column in table.columns}
    mapped = {name: match for name, match in matches.items() if match is not None}
    check_constants(table, constants, mapped, file)
    units = unit_stds(table, {*mapped, *constants}) if missing_std == "unit" else {}
    given = {*mapped, *constants, *units}
    required = [column for column in table.columns if column.required and column.replaced_by not in given]
    absent = [column for column in required if column.name not in given]
    missing = [column for column in absent if not _is_in_scene(column, scene, names, mapped)]
    if missing:
        raise DataError(missing_message(missing, header, table, file, estimable=missing_std == "estimable"))
    for name in {column.scene_sensor for column in absent if column.scene_sensor} & set(names):
        mapped[name] = MappedColumn(column=table.column(name), name=name)
    plan = ColumnPlan(table=table, mapped=mapped, constants=constants, units=units, has_snapshot=SNAPSHOT in mapped)
    for group in (*table.together, (plan.scene_axes,)):
        _check_group(group, mapped, file)
    return plan


def _is_in_scene(column: Column, scene: Scene, names: Sequence[str], mapped: Mapping[str, Any]) -> bool:
    """Return whether the scene's sensors have the positions for a column that the file lacks."""
    node = column.scene_sensor
    if not scene.sensors or (column.name.endswith("_z_m") and not scene.has_heights):
        return False
    if not node:
        return column.scene_axis is not None
    half = not {f"{node}_x_m", f"{node}_y_m"}.isdisjoint(mapped)
    return not half and (node in names or any(known.name == node for known in scene.sensors))


def _find(column: Column, names: Sequence[str], constants: Collection[str], file: str) -> MappedColumn | None:
    """Return the file's column for one of the contract; recent spellings give way to all that gave it before."""
    if column.only_with is not None and not any(other in names for other in column.only_with):
        return None
    spellings = [spelling for spelling in column.spellings if spelling.name in names]
    elder = [spelling for spelling in spellings if not spelling.is_recent]
    if elder or column.name in names or column.name in constants:
        spellings = elder
    given = [*([column.name] if column.name in names else []), *(spelling.name for spelling in spellings)]
    if len(given) > 1:
        raise DataError(f"{file}: columns {given[0]!r} and {given[1]!r} are the same quantity; drop or rename one")
    if not given:
        return None
    if not spellings:
        return MappedColumn(column=column, name=column.name)
    attributes = ("name", "scale", "offset", "from_north", "is_relative")
    return MappedColumn(column=column, **{name: getattr(spellings[0], name) for name in attributes})


def _check_group(alternatives: Sequence[Sequence[str]], mapped: Mapping[str, MappedColumn], file: str) -> None:
    """Raise DataError if a file has some, not all, of a group of columns, or columns of several alternatives."""
    given = [name for name in dict.fromkeys(chain(*alternatives)) if name in mapped]
    group = next((group for group in alternatives if set(given) <= set(group)), None)
    if group is None:
        raise DataError(f"{file}: columns {', '.join(given)}; give {' or '.join(map(', '.join, alternatives))} alone")
    if given and (absent := [name for name in group if name not in mapped]):
        raise DataError(
            f"{file}: column {mapped[given[0]].name!r} needs {' and '.join(map(repr, absent))}; "
            f"give all of {', '.join(group)}, or drop {' and '.join(map(repr, given))}"
        )


def check_constants(table: Table, constants: Mapping[str, float], mapped: Mapping[str, Any], file: str) -> None:
    """Raise UsageError for a constant that the table does not take, that is ``mapped`` to a column, or not positive."""
    allowed = {column.name: column for column in table.columns if column.constant_allowed}
    for name, value in constants.items():
        if name not in allowed:
            known = f"{did_you_mean(name, allowed)}; they take: {', '.join(allowed) or 'none'}"
            raise UsageError(f"{table.name} take no constant {name!r}{known}")
        option = f"`constants[{name!r}]`"
        if name in mapped:
            raise UsageError(f"{option} is given, but {file} has a column {mapped[name].name!r}; leave the option out")
        if not 0.0 < value < float("inf"):
            raise UsageError(f"{option} must be a finite number larger than 0. Got {value!r} instead.")


def columns_to_read(names: tuple[str, ...], plan: ColumnPlan, extra: Sequence[str] | None) -> tuple[str, ...]:
    """Return the columns among ``names`` that a measurement needs, or that ``extra`` names or matches (``sweep_*``)."""
    if extra is None:
        return names
    used = ("los", "ip", SNAPSHOT)
    needed = {given.name for name, given in plan.mapped.items() if not given.column.carried or name in used}
    if are_flags_by_method(names):
        needed.add(METHOD)
    if plan.scene_axes:
        needed |= {"sensor_lat_deg", "sensor_lon_deg"}  # checked where x and y are empty
    beginnings = tuple(name[:-1] for name in extra if name.endswith("*"))
    return tuple(name for name in names if name in needed or name in extra or name.startswith(beginnings))


def are_flags_by_method(names: Iterable[str]) -> bool:
    """Return whether the columns are those of flags from an earlier step, with the method of each flag."""
    return {METHOD, "used"} <= set(names)


class NameCodes:
    """Integer codes of names; integers are names too, by their decimal text.

    A new name gets the next code if the set ``grows``, else ``UNKNOWN``.
    """

    UNKNOWN = -2

    def __init__(self, names: tuple[str, ...] = (), grows: bool = True) -> None:
        self.names: list[str] = list(names)
        self._codes: dict[str, int] = {name: code for code, name in enumerate(names)}
        self._grows = grows
        self._last_dictionary: Any = None
        self._last_codes: IntArray = np.empty(0, dtype=np.int64)

    def encode(self, column: Any) -> IntArray:
        """Return the codes (N,) of a text or integer column, `NULL_CODE` for null and empty text."""
        if not pa.types.is_dictionary(column.type):
            column = column.dictionary_encode()
        codes = self._codes_of(column.dictionary)
        indices = column.indices
        if indices.null_count:
            indices = indices.fill_null(len(codes) - 1)
        return np.asarray(codes[indices.to_numpy(zero_copy_only=False)])

    def _codes_of(self, dictionary: Any) -> IntArray:
        """Return the codes of the entries of a dictionary, and of null at the end."""
        if self._last_dictionary is None or not dictionary.equals(self._last_dictionary):
            texts = dictionary.cast(pa.string()).to_pylist()
            self._last_codes = np.array([*(self._code(text) for text in texts), NULL_CODE], dtype=np.int64)
            self._last_dictionary = dictionary
        return self._last_codes

    def _code(self, text: str | None) -> int:
        if text is None or text == "":
            return NULL_CODE
        if text not in self._codes:
            if not self._grows:
                return self.UNKNOWN
            self._codes[text] = len(self.names)
            self.names.append(text)
        return self._codes[text]
