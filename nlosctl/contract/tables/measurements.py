"""The columns of measurement files, a table for each kind of measurement."""

from __future__ import annotations

import dataclasses
import math

from nlosctl.contract.tables.columns import Column, Spelling, Table

__all__ = ["BEARINGS", "EARTH_PLACES", "RANGES", "TRIPLETS", "TRUTH_POSITION"]

EARTH_PLACES = ("sensor", "truth", "prior", "tx", "rx")
"""Places whose ``_x_m`` and ``_y_m`` may be told as ``_lat_deg`` and ``_lon_deg`` (WGS 84)."""

_DEGREE = math.pi / 180.0

_SNAPSHOT = Column(
    name="snapshot",
    type="identifier",
    meaning="rows that share it are solved together; without the column a file is one snapshot",
)


def _on_earth(place: str, meaning: str) -> tuple[Column, Column]:
    return (
        Column(
            name=f"{place}_lat_deg",
            type="number",
            unit="deg",
            nullable=True,
            carried=True,
            meaning=f"{meaning}: latitude (WGS 84), in place of {place}_x_m and {place}_y_m",
        ),
        Column(
            name=f"{place}_lon_deg",
            type="number",
            unit="deg",
            nullable=True,
            carried=True,
            meaning=f"{meaning}: longitude (WGS 84)",
        ),
    )


TRUTH_POSITION = (
    Column(name="truth_x_m", type="number", unit="m", nullable=True, carried=True, meaning="true source position"),
    Column(name="truth_y_m", type="number", unit="m", nullable=True, carried=True, meaning="true source position"),
    *_on_earth("truth", "true source position"),
)
"""The true position of a row's source."""

_TRUTH = (
    *TRUTH_POSITION,
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
    Column(
        name="sensor_x_m",
        type="number",
        unit="m",
        required=True,
        scene_axis=0,
        earth_place="sensor",
        meaning="sensor position, x",
    ),
    Column(
        name="sensor_y_m",
        type="number",
        unit="m",
        required=True,
        scene_axis=1,
        earth_place="sensor",
        meaning="sensor position, y",
    ),
    *_on_earth("sensor", "sensor position"),
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
    row_key=("sensor", "sensor_x_m", "sensor_y_m", "path", "reflector"),
    together=(tuple(column.name for column in _PRIOR),),
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
                Spelling(name="azimuth_deg", scale=-_DEGREE, offset=0.5 * math.pi, from_north=True),
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
        *_on_earth("prior", "where the source was expected before"),
        *_TRUTH,
        *_EARLIER_FLAGS,
    ),
)

RANGES = Table(
    name="ranges",
    title="Ranges: path lengths from targets to sensors, any number for a sensor",
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


def _node(name: str, meaning: str) -> tuple[Column, ...]:
    axes = (
        Column(
            name=f"{name}_{axis}_m",
            type="number",
            unit="m",
            required=True,
            earth_place=name,
            meaning=f"{meaning} position, {axis} to the {side}",
        )
        for axis, side in (("x", "east"), ("y", "north"))
    )
    return (*axes, *_on_earth(name, f"{meaning} position"))


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
        *TRUTH_POSITION,
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
