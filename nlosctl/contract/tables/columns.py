"""Declarations of columns and tables."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Literal

__all__ = ["SWEEP_PREFIX", "Column", "ColumnType", "Spelling", "Table", "is_swept"]

SWEEP_PREFIX = "sweep_"
"""The name of a column of swept values is this prefix and the name of the parameter."""

_OF_RADARS = frozenset(
    f"{SWEEP_PREFIX}{word}"
    for word in ("id", "index", "no", "nr", "num", "number", "count", "counter", "time", "time_s", "timestamp", "utc")
)


def is_swept(name: str) -> bool:
    """Return whether a column holds the swept values of a parameter; not the number or time of a radar's sweep."""
    return name.startswith(SWEEP_PREFIX) and name.lower() not in _OF_RADARS


ColumnType = Literal["number", "exact", "integer", "boolean", "text", "identifier"]
"""``identifier`` is text or an integer, as in the file; ``exact`` numbers are 64-bit integers if all of a file are."""


@dataclass(frozen=True, kw_only=True)
class Spelling:
    """Another name for a column, in another unit: ``canonical = value * scale + offset``.

    With ``from_north`` it is a direction from true north, for any plane on the earth; ``is_compass`` marks those that a
    compass shows, to which a declination can be added. ``meaning`` completes "as ...".
    Messages on a missing column list the ``usual`` spellings only. ``is_relative`` marks a direction from the heading
    of its sensor. An ``is_recent`` spelling is ignored beside another one: it once was a column without meaning.
    ``seconds`` is the unit of a time of arrival: its ``scale`` is that of light, and proportional to the speed.
    """

    name: str
    scale: float
    offset: float = 0.0
    from_north: bool = False
    is_compass: bool = False
    is_relative: bool = False
    is_recent: bool = False
    seconds: float = 0.0
    meaning: str = ""
    usual: bool = True


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: its name, type, unit and what a value must satisfy.

    ``too_large_means`` explains values beyond ``largest_magnitude``, ``too_small_means`` those that are not positive.
    ``constant_allowed`` lets the setting ``constants`` fill a missing column; ``estimable`` marks standard deviations
    that the setting ``estimate_std`` estimates. ``scene_axis`` (0: x, 1: y, 2: height) lets the scene's sensor
    position fill it. ``names_reflector`` marks text that names a reflector of the scene, ``measured`` a measured
    value. ``carried`` columns are truth or flags of an earlier step: checked for their type and copied, never passed
    to a method. ``of_horizons`` marks flags that are only set in a scene with circles, in space with opaque spheres,
    ``of_space`` those of three dimensions. ``earth_place`` names the location (see `EARTH_PLACES`) whose latitude and
    longitude can replace it.
    ``add`` is the name by which the setting ``add`` requests a result column. ``measured_at`` names the node where a
    direction is measured: ``sensor``, ``tx`` or ``rx``. A column with ``only_with`` is used only in a file with one of
    these columns (without any: only by a step of reading). ``scene_sensor`` is the column that names the sensor of the
    scene whose position can fill this one; it is also the default of that name. ``every_run`` marks a result column
    that every run writes, but a file need not have. Values of a column with ``is_bounded`` are within
    ``largest_magnitude`` in any unit. ``replaced_by`` names a column that can be there in place of this one.
    ``measures`` is the measured column of a standard deviation that is not named after it.
    """

    name: str
    type: ColumnType
    meaning: str
    unit: str = ""
    required: bool = False
    positive: bool = False
    largest_magnitude: float | None = None
    too_large_means: str = ""
    too_small_means: str = ""
    nullable: bool = False
    constant_allowed: bool = False
    estimable: bool = False
    scene_axis: int | None = None
    names_reflector: bool = False
    measured: bool = False
    measured_at: str = ""
    only_with: tuple[str, ...] | None = None
    scene_sensor: str = ""
    carried: bool = False
    of_horizons: bool = False
    of_space: bool = False
    earth_place: str = ""
    add: str = ""
    every_run: bool = False
    is_bounded: bool = False
    replaced_by: str = ""
    measures: str = ""
    spellings: tuple[Spelling, ...] = ()

    @property
    def heading_names(self) -> tuple[str, str]:
        """The columns of the heading, and its standard deviation, of the node where it is measured."""
        prefix = "" if self.measured_at == "sensor" else f"{self.measured_at}_"
        return f"{prefix}heading_deg", f"{prefix}heading_std_deg"

    @property
    def usual_names(self) -> tuple[str, ...]:
        """The names of its usual other spellings."""
        return tuple(spelling.name for spelling in self.spellings if spelling.usual)

    @property
    def accepted_names(self) -> tuple[str, ...]:
        """The name and its other spellings."""
        return (self.name, *(spelling.name for spelling in self.spellings))


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table: its name, title and columns in order.

    ``row_key`` names the columns that, with ``snapshot``, identify a measurement. ``measurement_name`` names the column
    that estimates of single measurements carry. ``together`` names alternative groups of optional columns: a
    file has all columns of one alternative or none of any, and so has every row. ``covariances`` names the entries xx,
    xy, yy of matrices that must be positive definite. ``times`` are columns with the time of a row: they count among
    ``columns`` only where times are needed (`with_further`), elsewhere columns of these names are copied as they are.
    The same holds for ``space`` in three dimensions (`in_space`): ``dimension`` is that of the positions that the
    columns locate.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    row_key: tuple[str, ...] = ()
    measurement_name: str = ""
    together: tuple[tuple[tuple[str, ...], ...], ...] = ()
    covariances: tuple[tuple[str, str, str], ...] = ()
    times: tuple[Column, ...] = ()
    space: tuple[Column, ...] = ()
    dimension: int = 2

    def with_further(self, *, times: bool, headings: bool) -> Table:
        """Return the table with the times among its columns, and the headings in every file that has them."""
        columns, rest = (*self.columns, *(self.times if times else ())), () if times else self.times
        if headings:  # not with relative directions only
            columns = tuple(replace(part, only_with=None) if part.name == "heading_deg" else part for part in columns)
        return replace(self, columns=columns, times=rest)

    def in_space(self) -> Table:
        """Return the table in three dimensions, with heights and elevations among its columns."""
        new = {column.name for column in self.space}
        kept = (column for column in self.columns if column.name not in new)
        return replace(self, columns=(*kept, *self.space), space=(), dimension=3)

    @property
    def all_columns(self) -> tuple[Column, ...]:
        """The columns, with those of space and times."""
        names = set(self.names)
        return (*self.columns, *(column for column in self.space if column.name not in names), *self.times)

    @property
    def space_names(self) -> frozenset[str]:
        """The names, and other spellings, of the columns that the table only has in three dimensions."""
        return frozenset(name for column in self.space for name in column.accepted_names)

    def used_columns(self, names: Collection[str]) -> tuple[Column, ...]:
        """Return the columns that a file with the columns ``names`` can use."""
        return tuple(
            column
            for column in self.columns
            if column.only_with is None or any(other in names for other in column.only_with)
        )

    def column(self, name: str) -> Column:
        """Return the column called ``name``; raise KeyError if it does not exist."""
        for column in self.columns:
            if column.name == name:
                return column
        raise KeyError(name)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of all columns, in order."""
        return tuple(column.name for column in self.columns)

    @property
    def required(self) -> tuple[Column, ...]:
        """The columns that a file must have; for ``snapshot`` see docs/conventions.md."""
        return tuple(column for column in self.columns if column.required)
