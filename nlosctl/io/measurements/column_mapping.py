"""Which column of a file holds what: names, other spellings, renames, constants, the scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import EARTH_PLACES, KINDS, Column, ColumnType, Spelling, Table, contract_names
from nlosctl.errors import DataError, UsageError, did_you_mean

__all__ = [
    "ColumnPlan",
    "CoordinateColumns",
    "FoundColumn",
    "coordinate_columns",
    "kind_of_columns",
    "kind_table",
    "plan_columns",
    "rename",
]

SNAPSHOT = "snapshot"


@dataclass(frozen=True, kw_only=True)
class FoundColumn:
    """A contract column and the column that holds it: ``canonical = value * scale + offset``."""

    column: Column
    name: str
    scale: float = 1.0
    offset: float = 0.0
    from_north: bool = False

    @property
    def converted(self) -> bool:
        """Whether the file holds another unit than the contract's."""
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
    """How the columns of one file give those of the contract; ``types`` are by the (renamed) file's names."""

    table: Table
    found: Mapping[str, FoundColumn]
    constants: Mapping[str, float] = field(default_factory=dict)
    from_scene: tuple[str, ...] = ()
    has_snapshot: bool = True

    @property
    def types(self) -> dict[str, ColumnType]:
        """The contract's type of each column that the file has."""
        return {found.name: found.column.type for found in self.found.values()}


def kind_table(kind: str) -> Table:
    """Return the table of a kind; raise UsageError with the nearest name where there is none."""
    if kind not in KINDS:
        raise UsageError(f"no kind {kind!r}{did_you_mean(kind, KINDS)}; there are: {', '.join(KINDS)}")
    return KINDS[kind]


def kind_of_columns(names: Iterable[str]) -> str:
    """Return the kind whose required columns are all among ``names``, else the one that lacks the fewest."""
    there = frozenset(names)

    def missing(table: Table) -> int:
        return sum(not there.intersection(column.accepted_names) for column in table.required if _must_be_there(column))

    return min(KINDS.values(), key=missing).name


def rename(names: Sequence[str], renames: Mapping[str, str], table: Table, file: str) -> tuple[str, ...]:
    """Return the file's names with ``renames`` (contract's name -> file's name) applied.

    Raises UsageError for a name that the contract doesn't have, DataError where the file lacks the column or
    has the new name already.
    """
    known = [accepted for column in table.columns for accepted in column.accepted_names]
    by_file_name = {}
    for wanted, given in renames.items():
        if wanted not in known:
            raise UsageError(
                f"--column {wanted}={given}: {table.name} have no column {wanted!r}{did_you_mean(wanted, known)}"
            )
        if given not in names:
            raise DataError(f"{file}: --column {wanted}={given}: no column {given!r}{did_you_mean(given, names)}")
        if wanted in names and wanted != given:
            raise DataError(f"{file}: --column {wanted}={given}: the file has a column {wanted!r} already")
        by_file_name[given] = wanted
    return tuple(by_file_name.get(name, name) for name in names)


def coordinate_columns(names: Sequence[str], renames: Mapping[str, str]) -> list[CoordinateColumns]:
    """Return the latitudes and longitudes among a file's columns ``names`` that have no x and y beside them.

    ``renames`` (contract's name -> file's name) are their other names.
    """
    known = {*names, *renames}
    pairs = []
    for owner in EARTH_PLACES:
        lat, lon = (renames.get(f"{owner}_{axis}_deg", f"{owner}_{axis}_deg") for axis in ("lat", "lon"))
        x, y = f"{owner}_x_m", f"{owner}_y_m"
        if lat in names and lon in names and x not in known and y not in known:
            pairs.append(CoordinateColumns(lat=lat, lon=lon, x=x, y=y, nullable=owner in ("truth", "prior")))
    return pairs


def plan_columns(
    names: Sequence[str], table: Table, constants: Mapping[str, float], scene: Scene, file: str
) -> ColumnPlan:
    """Return where each contract column comes from, ``names`` being the renamed columns of ``file``.

    Raises DataError where a required column is missing or told twice, UsageError for a constant that the file
    has as a column, or that is not allowed.
    """
    if names and names[0].startswith("#") and names[0].lstrip("# ") in contract_names():
        raise DataError(f"{file}: the header begins with '#': got {names[0]!r}, expected {names[0].lstrip('# ')!r}")
    found = {}
    for column in table.columns:
        held = _find(column, names, file)
        if held is not None:
            found[column.name] = held
    _check_constants(table, constants, found, file)
    from_scene = tuple(
        column.name
        for column in table.columns
        if column.scene_axis is not None and column.name not in found and scene.sensors
    )
    given = {*found, *constants, *from_scene}
    missing = [column for column in table.required if column.name not in given]
    if missing:
        raise DataError(_missing(missing, names, table, file))
    return ColumnPlan(
        table=table, found=found, constants=dict(constants), from_scene=from_scene, has_snapshot=SNAPSHOT in found
    )


def _find(column: Column, names: Sequence[str], file: str) -> FoundColumn | None:
    spellings = (Spelling(name=column.name, scale=1.0), *column.spellings)
    there = [spelling for spelling in spellings if spelling.name in names]
    if len(there) > 1:
        raise DataError(
            f"{file}: columns {there[0].name!r} and {there[1].name!r} say the same thing; drop or rename one"
        )
    if not there:
        return None
    chosen = there[0]
    return FoundColumn(
        column=column, name=chosen.name, scale=chosen.scale, offset=chosen.offset, from_north=chosen.from_north
    )


def _check_constants(table: Table, constants: Mapping[str, float], found: Mapping[str, FoundColumn], file: str) -> None:
    allowed = {column.name: column for column in table.columns if column.constant_allowed}
    for name, value in constants.items():
        if name not in allowed:
            raise UsageError(
                f"{table.name} take no constant {name!r}{did_you_mean(name, allowed)}; "
                f"they take: {', '.join(allowed) or 'none'}"
            )
        option = allowed[name].constant_option
        if name in found:
            raise UsageError(f"{option} is given, but {file} has a column {found[name].name!r}; leave the option out")
        if not 0.0 < value < float("inf"):
            raise UsageError(f"{option} must be a finite number larger than 0. Got {value!r} instead.")


def _missing(missing: Sequence[Column], names: Sequence[str], table: Table, file: str) -> str:
    told = []
    for column in missing:
        others = [spelling.name for spelling in column.spellings]
        near = did_you_mean(column.name, [name for name in names if name not in contract_names()])
        if column.earth_place:
            others = [f"{column.earth_place}_lat_deg with {column.earth_place}_lon_deg"]
        accepted = f", also accepted: {', '.join(others)}" if others else ""
        option = f", or give {column.constant_option}" if column.constant_option else ""
        scene = ", or give a scene with its sensors" if column.scene_axis is not None else ""
        told.append(f"{column.name!r}{near}{accepted}{option}{scene}")
    comment = "; the first line begins with '#', expected the header there" if names[0].startswith("#") else ""
    plural = "s" if len(missing) > 1 else ""
    return (
        f"{file}: missing column{plural} {'; '.join(told)}. The file has: {', '.join(names) or 'no columns'}; "
        f"--column NAME=COLUMN reads one under another name, --kind another kind than {table.name}{comment}"
    )


def _must_be_there(column: Column) -> bool:
    return not column.constant_allowed and column.scene_axis is None
