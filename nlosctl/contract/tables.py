"""The columns of every table that nlosctl reads or writes: the one place that defines them. Imports no numpy."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass, field
from typing import Literal

__all__ = [
    "BOUND",
    "ESTIMATES",
    "FLAGS",
    "KINDS",
    "RANGES",
    "TABLES",
    "TRACE",
    "TRIPLETS",
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
    ``measurement_name`` names the column that estimates of single measurements carry.
    """

    name: str
    title: str
    columns: tuple[Column, ...]
    primary_kind: bool = field(default=False)
    row_key: tuple[str, ...] = ()
    measurement_name: str = ""

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

_PRIOR = (
    Column(name="prior_x_m", type="number", unit="m", nullable=True, meaning="where the source was expected before"),
    Column(name="prior_y_m", type="number", unit="m", nullable=True, meaning="where the source was expected before"),
    Column(
        name="prior_std_m",
        type="number",
        unit="m",
        nullable=True,
        positive=True,
        meaning="standard deviation of the prior position in x and in y",
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
        *_PRIOR,
        *_TRUTH,
        *_EARLIER_FLAGS,
    ),
)

RANGES = Table(
    name="ranges",
    title="Ranges: path lengths from targets to sensors, any number for a sensor",
    primary_kind=True,
    columns=(
        _SNAPSHOT,
        *_SENSOR,
        *(dataclasses.replace(column, required=True, nullable=False) for column in _RANGE),
        Column(
            name="sensor_z_m",
            type="number",
            unit="m",
            meaning="sensor height; with --target-z-m the ranges are slant and are reduced to the targets' plane",
        ),
        Column(
            name="path",
            type="integer",
            nullable=True,
            meaning="numbers several measurements of one sensor in one snapshot (resolved multipath)",
        ),
        *_TRUTH,
        Column(
            name="truth_target",
            type="integer",
            nullable=True,
            carried=True,
            meaning="number of the target that the echo is of, from 0; null for a false echo",
        ),
        *_EARLIER_FLAGS,
    ),
)

_SPEED_OF_LIGHT_M_S = 299_792_458.0


def _node(name: str, meaning: str) -> tuple[Column, Column]:
    return (
        Column(
            name=f"{name}_x_m", type="number", unit="m", required=True, meaning=f"{meaning} position, x to the east"
        ),
        Column(
            name=f"{name}_y_m", type="number", unit="m", required=True, meaning=f"{meaning} position, y to the north"
        ),
    )


def _direction(name: str, meaning: str) -> tuple[Column, Column]:
    return (
        Column(
            name=f"{name}_rad",
            type="number",
            unit="rad",
            required=True,
            largest_magnitude=2.0 * math.pi,
            too_large_means=f"plainly degrees: name the column {name}_deg",
            meaning=f"{meaning}, counter-clockwise from +x",
            spellings=(Spelling(name=f"{name}_deg", scale=_DEGREE),),
        ),
        Column(
            name=f"{name}_std_rad",
            type="number",
            unit="rad",
            required=True,
            positive=True,
            constant_allowed=True,
            constant_option=f"--{name}-std-deg",
            meaning="standard deviation of its error",
            spellings=(Spelling(name=f"{name}_std_deg", scale=_DEGREE),),
        ),
    )


_DOD = _direction("dod", "direction of departure: from the transmitter to where the path goes first")
_DOA = _direction("doa", "direction of arrival: from the receiver to where the wave comes from")

TRIPLETS = Table(
    name="triplets",
    title="Triplets: direction of departure, direction of arrival and length of paths over a target",
    primary_kind=True,
    row_key=("path",),
    measurement_name="path",
    columns=(
        _SNAPSHOT,
        Column(name="path", type="integer", required=True, meaning="numbers the paths of a snapshot"),
        *_node("tx", "transmitter"),
        *_node("rx", "receiver"),
        _DOD[0],
        _DOA[0],
        Column(
            name="path_length_m",
            type="number",
            unit="m",
            required=True,
            positive=True,
            meaning="length of the path from transmitter to receiver",
            spellings=(
                Spelling(name="toa_s", scale=_SPEED_OF_LIGHT_M_S),
                Spelling(name="toa_ns", scale=_SPEED_OF_LIGHT_M_S * 1e-9),
            ),
        ),
        _DOD[1],
        _DOA[1],
        Column(
            name="path_length_std_m",
            type="number",
            unit="m",
            required=True,
            positive=True,
            constant_allowed=True,
            constant_option="--path-length-std-m",
            meaning="standard deviation of its error",
            spellings=(
                Spelling(name="toa_std_s", scale=_SPEED_OF_LIGHT_M_S),
                Spelling(name="toa_std_ns", scale=_SPEED_OF_LIGHT_M_S * 1e-9),
            ),
        ),
        *_TRUTH[:2],
        Column(
            name="truth_ip",
            type="boolean",
            nullable=True,
            carried=True,
            meaning="whether the path is indirect: over more than the target",
        ),
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
            name="residual_m",
            type="number",
            unit="m",
            nullable=True,
            meaning="range, measured minus predicted at the estimate",
        ),
        Column(
            name="target",
            type="integer",
            nullable=True,
            meaning="number of the target that the row is given to, from 0",
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
        Column(
            name="los_probability",
            type="number",
            nullable=True,
            meaning="probability that the row agrees with its stated path",
        ),
        Column(
            name="ip",
            type="boolean",
            nullable=True,
            meaning="whether the path is indirect (triplets)",
        ),
        Column(name="p_value", type="number", nullable=True, meaning="how often a direct path looks so indirect"),
        Column(name="reason", type="text", nullable=True, meaning="why it is flagged, or what could not be judged"),
        Column(name="blind", type="boolean", nullable=True, meaning="whether the rule is blind or degenerate here"),
        Column(
            name="outside_safe_region",
            type="boolean",
            nullable=True,
            meaning="whether the difference is significantly larger than eta_m",
        ),
        Column(
            name="direct_probability",
            type="number",
            nullable=True,
            meaning="posterior probability that the path is direct to a common target",
        ),
        *(
            Column(
                name=f"residual_{name}_rad",
                type="number",
                unit="rad",
                nullable=True,
                meaning=f"{name.upper()}, measured minus predicted at the estimate",
            )
            for name in ("dod", "doa")
        ),
        *(
            Column(
                name=f"{points}_{axis}_m",
                type="number",
                unit="m",
                nullable=True,
                meaning=f"where {points.replace('_', ' and ').upper().replace('AND', 'and')} meet",
            )
            for points in ("dod_doa", "dod_toa", "doa_toa")
            for axis in ("x", "y")
        ),
        *(
            Column(
                name=f"{word}{number}_m",
                type="number",
                unit="m",
                nullable=True,
                meaning=f"{meaning} {number}, in the frame of the baseline",
            )
            for word, meaning in (("lambda", "difference of intersections"), ("threshold", "threshold of difference"))
            for number in range(1, 7)
        ),
    ),
)

TRACE = Table(
    name="trace",
    title="Trace: a row per snapshot and step of a sequential method, what one sensor hands to the next",
    columns=(
        Column(name="snapshot", type="identifier", required=True, meaning="as in the measurements"),
        Column(name="method", type="text", required=True, meaning="name of the method"),
        Column(name="step", type="integer", required=True, meaning="number of measurements used so far"),
        Column(name="sensor", type="identifier", required=True, meaning="sensor of the measurement just used"),
        Column(name="x_m", type="number", unit="m", required=True, meaning="position so far"),
        Column(name="y_m", type="number", unit="m", required=True, meaning="position so far"),
        Column(name="cov_xx_m2", type="number", unit="m2", required=True, meaning="covariance of the position so far"),
        Column(name="cov_xy_m2", type="number", unit="m2", required=True, meaning="covariance of the position so far"),
        Column(name="cov_yy_m2", type="number", unit="m2", required=True, meaning="covariance of the position so far"),
    ),
)

BOUND = Table(
    name="bound",
    title="Bound: the Cramer-Rao bound of the position, a row per snapshot or per vertex of a map",
    columns=(
        Column(name="snapshot", type="identifier", nullable=True, meaning="as in the measurements; not in a map"),
        Column(name="x_m", type="number", unit="m", required=True, nullable=True, meaning="position it is for"),
        Column(name="y_m", type="number", unit="m", required=True, nullable=True, meaning="position it is for"),
        *(
            Column(name=name, type="number", unit=unit, required=True, nullable=True, meaning=meaning)
            for name, unit, meaning in (
                ("bound_xx_m2", "m2", "least covariance of an unbiased estimate; null where it has no bound"),
                ("bound_xy_m2", "m2", "least covariance of an unbiased estimate"),
                ("bound_yy_m2", "m2", "least covariance of an unbiased estimate"),
                ("rms_m", "m", "root of the trace: least RMSE"),
                ("semi_major_m", "m", "semi-axis of the one-sigma ellipse"),
                ("semi_minor_m", "m", "semi-axis of the one-sigma ellipse"),
                ("orientation_rad", "rad", "direction of the major axis, counter-clockwise from +x"),
                ("cep50_m", "m", "radius of the circle that holds half of the Gaussian errors"),
            )
        ),
        Column(name="n_used", type="integer", required=True, meaning="rows that can see the position as the scene is"),
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

KINDS: dict[str, Table] = {table.name: table for table in (BEARINGS, RANGES, TRIPLETS)}
"""The kinds of measurement, by name."""

TABLES: dict[str, Table] = {**KINDS, **{table.name: table for table in (ESTIMATES, FLAGS, TRACE, BOUND, TRUTH)}}
"""Every table, by name: ``schemas/`` holds one file for each."""
