"""The columns of every table that nlosctl reads or writes: the one place that defines them. Imports no numpy."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Literal

__all__ = [
    "ESTIMATES",
    "FLAGS",
    "KINDS",
    "TABLES",
    "TRUTH",
    "Column",
    "ColumnType",
    "Spelling",
    "Table",
]

ColumnType = Literal["number", "integer", "boolean", "text", "identifier"]
"""``identifier`` is text or an integer, whichever the file holds."""


@dataclass(frozen=True, kw_only=True)
class Spelling:
    """Another name for a column, in another unit: ``canonical = value * scale + offset``."""

    name: str
    scale: float
    offset: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Column:
    """One column: its name, type, unit and what a value must satisfy.

    ``too_large_means`` says what values beyond ``largest_magnitude`` plainly are. ``constant_option`` is the
    option that gives a constant for the missing column. ``scene_axis`` (0: x, 1: y) lets the scene's sensor fill
    the column. ``names_reflector`` marks text that names a reflector of the scene. ``carried`` columns are truth
    or flags of an earlier step: checked for their type, carried through, and seen by no method. ``of_circles`` marks
    flags that are said only in a scene with circles.
    """

    name: str
    type: ColumnType
    meaning: str
    unit: str = ""
    required: bool = False
    positive: bool = False
    largest_magnitude: float | None = None
    too_large_means: str = ""
    nullable: bool = False
    constant_allowed: bool = False
    constant_option: str = ""
    scene_axis: int | None = None
    names_reflector: bool = False
    carried: bool = False
    of_circles: bool = False
    spellings: tuple[Spelling, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Table:
    """A table: its name, title and columns in order.

    ``row_key`` names the columns that, besides ``snapshot``, no two measurements may have all equal.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    primary_kind: bool = field(default=False)
    row_key: tuple[str, ...] = ()

    def column(self, name: str) -> Column:
        """Return the column called ``name``; raise KeyError where there is none."""
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
        """The columns that a file must have (``snapshot`` apart, see docs/conventions.md)."""
        return tuple(column for column in self.columns if column.required)


_DEGREE = math.pi / 180.0

_SNAPSHOT = Column(
    name="snapshot",
    type="identifier",
    meaning="rows that share it are solved together; without the column a file is one snapshot",
)

_TRUTH = (
    Column(name="truth_x_m", type="number", unit="m", nullable=True, carried=True, meaning="true source position"),
    Column(name="truth_y_m", type="number", unit="m", nullable=True, carried=True, meaning="true source position"),
    Column(
        name="truth_los",
        type="boolean",
        nullable=True,
        carried=True,
        meaning="whether the row really follows its stated path (direct, or by its reflector)",
    ),
)

_EARLIER_FLAGS = (
    Column(
        name="los",
        type="boolean",
        nullable=True,
        carried=True,
        meaning="flag of an earlier step: rows with false are left out unless --all-rows",
    ),
    Column(
        name="ip",
        type="boolean",
        nullable=True,
        carried=True,
        meaning="flag of an earlier step: rows with true (indirect path) are left out unless --all-rows",
    ),
    Column(name="used", type="boolean", nullable=True, carried=True, meaning="flag of an earlier step: used there"),
)

_SENSOR = (
    Column(name="sensor", type="identifier", required=True, meaning="name of the sensor"),
    Column(name="sensor_x_m", type="number", unit="m", required=True, scene_axis=0, meaning="sensor position, x"),
    Column(name="sensor_y_m", type="number", unit="m", required=True, scene_axis=1, meaning="sensor position, y"),
)

_RANGE = (
    Column(
        name="range_m",
        type="number",
        unit="m",
        nullable=True,
        positive=True,
        meaning="path length from source to sensor",
    ),
    Column(
        name="range_std_m",
        type="number",
        unit="m",
        nullable=True,
        positive=True,
        constant_allowed=True,
        constant_option="--range-std-m",
        meaning="standard deviation of the range error",
    ),
)

BEARINGS = Table(
    name="bearings",
    title="Bearings: directions from sensors to where a wave comes from",
    primary_kind=True,
    row_key=("sensor", "sensor_x_m", "sensor_y_m", "path", "reflector"),
    columns=(
        _SNAPSHOT,
        *_SENSOR,
        Column(
            name="bearing_rad",
            type="number",
            unit="rad",
            required=True,
            largest_magnitude=2.0 * math.pi,
            too_large_means="plainly degrees: name the column bearing_deg (or azimuth_deg for compass bearings)",
            meaning="direction from the sensor to where the wave comes from, counter-clockwise from +x",
            spellings=(
                Spelling(name="bearing_deg", scale=_DEGREE),
                Spelling(name="azimuth_deg", scale=-_DEGREE, offset=0.5 * math.pi),
            ),
        ),
        Column(
            name="bearing_std_rad",
            type="number",
            unit="rad",
            required=True,
            positive=True,
            constant_allowed=True,
            constant_option="--bearing-std-deg",
            meaning="standard deviation of the bearing error",
            spellings=(Spelling(name="bearing_std_deg", scale=_DEGREE),),
        ),
        Column(
            name="path",
            type="integer",
            nullable=True,
            meaning="numbers several measurements of one sensor in one snapshot (resolved multipath)",
        ),
        Column(
            name="reflector",
            type="text",
            nullable=True,
            names_reflector=True,
            meaning="reflector of the scene by which the wave came; empty or absent: the direct path",
        ),
        *_RANGE,
        *_TRUTH,
        *_EARLIER_FLAGS,
    ),
)

ESTIMATES = Table(
    name="estimates",
    title="Estimates: a row per snapshot, method, target and alternative",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        Column(name="method", type="text", required=True, meaning="name of the method"),
        Column(name="target", type="integer", required=True, meaning="number of the target, from 0"),
        Column(
            name="alternative",
            type="integer",
            required=True,
            meaning="rank of the alternative, from 0, best first",
        ),
        Column(name="x_m", type="number", unit="m", required=True, nullable=True, meaning="estimated position"),
        Column(name="y_m", type="number", unit="m", required=True, nullable=True, meaning="estimated position"),
        Column(
            name="cov_xx_m2",
            type="number",
            unit="m2",
            required=True,
            nullable=True,
            meaning="covariance of the position error",
        ),
        Column(
            name="cov_xy_m2",
            type="number",
            unit="m2",
            required=True,
            nullable=True,
            meaning="covariance of the position error",
        ),
        Column(
            name="cov_yy_m2",
            type="number",
            unit="m2",
            required=True,
            nullable=True,
            meaning="covariance of the position error",
        ),
        Column(name="n_measurements", type="integer", required=True, meaning="rows of the snapshot"),
        Column(name="n_used", type="integer", required=True, meaning="rows that the estimate rests on"),
        Column(
            name="cost",
            type="number",
            required=True,
            nullable=True,
            meaning="the method's own: half the chi-square, or the negative log-likelihood in nats (methods show)",
        ),
        Column(name="status", type="text", required=True, meaning="how it ended: one of the status words"),
        Column(
            name="covariance_kind",
            type="text",
            nullable=True,
            meaning="what the covariance accounts for: inliers or posterior (robust methods)",
        ),
        *_TRUTH[:2],
    ),
)

FLAGS = Table(
    name="flags",
    title="Flags: a row per measurement in input order; the input's columns are carried through",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        Column(name="method", type="text", nullable=True, meaning="name of the method, where several ran"),
        Column(name="used", type="boolean", required=True, meaning="whether the estimate rests on the row"),
        Column(
            name="residual_rad",
            type="number",
            unit="rad",
            nullable=True,
            meaning="bearing, measured minus predicted at the estimate",
        ),
        Column(
            name="under_horizon",
            type="boolean",
            nullable=True,
            of_circles=True,
            meaning="whether the bearing points under the sensor's horizon, from where no wave comes by its circle",
        ),
        Column(
            name="los",
            type="boolean",
            nullable=True,
            meaning="whether the row agrees with its stated path, direct or by its reflector",
        ),
    ),
)

TRUTH = Table(
    name="truth",
    title="Truth: the true position of the source of each snapshot",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        *(dataclasses.replace(column, required=True) for column in _TRUTH[:2]),
    ),
)

KINDS: dict[str, Table] = {table.name: table for table in (BEARINGS,)}
"""The kinds of measurement, by name."""

TABLES: dict[str, Table] = {**KINDS, **{table.name: table for table in (ESTIMATES, FLAGS, TRUTH)}}
"""Every table, by name: ``schemas/`` holds one file for each."""
