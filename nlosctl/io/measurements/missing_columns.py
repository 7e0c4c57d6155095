"""Columns that a file lacks: other names (`rename`), what is near or could replace them, and the message."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence, Set

from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import KINDS, Column, Table, contract_names
from nlosctl.errors import DataError, UsageError, did_you_mean

__all__ = [
    "is_of_one_station",
    "measured_names",
    "missing_message",
    "named_like_degrees",
    "refuse_mixed_stds",
    "rename",
    "unit_stds",
]

_NO_UNITS = {
    "std",
    "sd",
    "sigma",
    "err",
    "error",
    "var",
    "id",
    "nr",
    "no",
    "name",
    "type",
    "flag",
    "quality",
    "true",
    "truth",
}
_SPREAD = re.compile(r"std|sigma|sd|err|unc|acc|var", re.IGNORECASE)
_LAT = re.compile(r"(?:.*[_. ])?(?:lat|latitude)(?:[_. ]?(?:deg|degrees|wgs84))?", re.IGNORECASE)
_LON = re.compile(r"(?:.*[_. ])?(?:lon|lng|long|longitude)(?:[_. ]?(?:deg|degrees|wgs84))?", re.IGNORECASE)
_SENSOR = re.compile(
    r"(?:sensor|station|anchor|receiver|node|beacon|observer|site|array)s?(?:[_. ]?(?:id|name|no|nr|num|number))?",
    re.IGNORECASE,
)


_MEASURED = frozenset(KINDS["bearings"].column("bearing_rad").accepted_names) | frozenset(
    KINDS["ranges"].column("range_m").accepted_names
)
"""The names of columns of bearings and ranges."""


def is_of_one_station(names: Collection[str], scene: Scene) -> bool:
    """Return whether a file with these columns has bearings or ranges of one station, whose position is known."""
    if "sensor" in names or _MEASURED.isdisjoint(names) or any(map(_named_like_sensor, names)):
        return False
    return "sensor_x_m" in names or len(scene.sensor_names) == 1


def _named_like_sensor(name: str) -> bool:
    return _SENSOR.fullmatch(name) is not None


def named_like_degrees(names: Sequence[str]) -> tuple[str, str] | None:
    """Return the first of ``names`` like latitudes and the first like longitudes, None without both."""
    lat = next((name for name in names if _LAT.fullmatch(name)), None)
    lon = next((name for name in names if _LON.fullmatch(name)), None)
    return None if lat is None or lon is None else (lat, lon)


def unit_stds(table: Table, given: Set[str]) -> dict[str, float]:
    """Return a standard deviation of 1 for each that a table requires and that is not among the columns ``given``.

    Those of elevations, which are in the unit of the required ones, follow where the elevations are given.
    """
    in_place = {column.replaced_by for column in table.columns}
    absent = [
        column
        for column in table.columns
        if column.constant_allowed
        and given.isdisjoint((column.name, column.replaced_by))
        and column.name not in in_place
    ]
    units = {column.unit for column in absent if column.required}
    beside = [column for column in absent if column.estimable and not column.required and column.unit in units]
    wanted = [column for column in absent if column.required]
    wanted += [column for column in beside if not given.isdisjoint(measured_names(column.name, table))]
    return {column.name: 1.0 for column in wanted}


def measured_names(std: str, table: Table) -> tuple[str, ...]:
    """Return the names of the measured column whose standard deviation the column ``std`` is."""
    return table.column(table.column(std).measures or std.replace("_std_", "_")).accepted_names


def refuse_mixed_stds(first: Mapping[str, float], other: Mapping[str, float], file: str) -> None:
    """Raise DataError if ``file`` lacks other standard deviations than the first one: their weights don't compare."""
    if other != first:
        raise DataError(
            f"{file}: some of the files have standard deviations and some don't, so that their rows can't be weighed; "
            "add them to all, or drop them from all"
        )


def missing_message(
    missing: Sequence[Column], header: Sequence[str], table: Table, file: str, *, estimable: bool
) -> str:
    """Return the message on the columns ``missing`` of a file whose own names of columns are ``header``.

    ``estimable`` is whether the run can estimate standard deviations.
    """
    free = [name for name in header if name not in contract_names()]
    unknown = _unknown_unit(missing, free)
    if unknown is not None:
        name, unit, known = unknown
        return (
            f"{file}, column {name!r}: unknown unit {unit!r}, expected one of the suffixes {', '.join(known)}; "
            f"convert it, or read another column with `columns` {name.rpartition('_')[0]}{known[0]}=HEADER"
        )
    parts = []
    for column in missing:
        others = list(column.usual_names)
        if column.earth_place:
            others = [f"{column.earth_place}_lat_deg with {column.earth_place}_lon_deg"]
        accepted = f", also accepted: {', '.join(others)}" if others else ""
        option = f", or set `constants[{column.name!r}]`" if column.constant_allowed else ""
        option += ", or estimate it by `estimate_std`" if estimable and column.estimable else ""
        scene = ", or pass a scene with its sensors" if column.scene_axis is not None else ""
        parts.append(f"{column.name!r}{_near(column, free)}{accepted}{option}{scene}")
    comment = "; the first line begins with '#', expected the header there" if header[0].startswith("#") else ""
    plural = "s" if len(missing) > 1 else ""
    return (
        f"{file}: missing column{plural} {'; '.join(parts)}{_places(missing, free)}. The file has: "
        f"{', '.join(header) or 'no columns'}; "
        f"rename one with `columns` NAME=HEADER, or set another `kind` than {table.name}{comment}"
    )


def _unknown_unit(missing: Sequence[Column], free: Sequence[str]) -> tuple[str, str, list[str]] | None:
    """Return a name in ``free`` that states a measured quantity in an unknown unit, the unit, and the known suffixes.

    If a measured value is missing, the quantities of all kinds are looked for: the file may be of another kind.
    """
    columns = [column for column in missing if column.unit]
    if any(column.measured for column in missing):
        columns += [column for table in KINDS.values() for column in table.all_columns if column.measured]
    for column in columns:
        for accepted in column.accepted_names:
            quantity = accepted.rpartition("_")[0]
            known = [
                name.removeprefix(quantity) for name in column.accepted_names if name.rpartition("_")[0] == quantity
            ]
            for name in free:
                before, _, unit = name.rpartition("_")
                if before == quantity and unit.isalpha() and unit.lower() not in _NO_UNITS:
                    return name, unit, known
    return None


def _near(column: Column, free: Sequence[str]) -> str:
    """Return the name in ``free`` that the column may have, for a message: a spread only for a standard deviation."""
    if column.name == "sensor" and (like := next(filter(_named_like_sensor, free), None)):
        return f" (did you mean {like!r}?)"
    is_spread = "_std_" in column.name
    own = {name.lower(): name for name in free if bool(_SPREAD.search(name)) == is_spread}
    for accepted in column.accepted_names:
        quantity = accepted.rpartition("_")[0] or accepted
        if quantity in own:
            return f" (did you mean {own[quantity]!r}?)"
    near = did_you_mean(column.name, own)
    return near if not near else f" (did you mean {own[near.split(chr(39))[1]]!r}?)"


def _places(missing: Sequence[Column], free: Sequence[str]) -> str:
    """Return the renaming of latitudes and longitudes to those of a place that is missing, for a message."""
    place = next((column.earth_place for column in missing if column.earth_place), "")
    degrees = named_like_degrees(free) if place else None
    if degrees is None:
        return ""
    return f"; for degrees: `columns` {place}_lat_deg={degrees[0]} and `columns` {place}_lon_deg={degrees[1]}"


def usable_defaults(defaults: Mapping[str, float], names: Sequence[str], table: Table) -> dict[str, float]:
    """Return the constants among ``defaults`` that the table takes and a file with columns ``names`` lacks."""
    wanted = {column.name: column for column in table.columns if column.constant_allowed}
    return {
        name: value
        for name, value in defaults.items()
        if name in wanted
        and not set(wanted[name].accepted_names) & set(names)
        and set(measured_names(name, table)) & set(names)
    }


def rename(names: Sequence[str], renames: Mapping[str, str], table: Table, file: str) -> tuple[str, ...]:
    """Return the file's names with ``renames`` (contract's name -> file's name) applied.

    Two columns may exchange their names. Raises UsageError for a name that the contract does not have, DataError if the
    file does not have the column, or has the new name already.
    """
    known = [accepted for column in table.all_columns for accepted in column.accepted_names]
    by_file_name = {}
    for wanted, given in renames.items():
        if wanted not in known:
            raise UsageError(
                f"`columns` {wanted}={given}: {table.name} have no column {wanted!r}{did_you_mean(wanted, known)}"
            )
        if given not in names:
            raise DataError(
                f"{file}: `columns` {wanted}={given}: no column {given!r}{did_you_mean(given, names)}. "
                f"The file has: {', '.join(names)}"
            )
        if wanted in names and wanted not in renames.values():
            raise DataError(f"{file}: `columns` {wanted}={given}: the file already has a column {wanted!r}")
        by_file_name[given] = wanted
    return tuple(by_file_name.get(name, name) for name in names)
