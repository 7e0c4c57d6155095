"""The columns of files of bearings and of ranges, which sensors measure."""

from __future__ import annotations

import dataclasses
import math

from nlosctl.contract.tables.columns import Column, Table
from nlosctl.contract.tables.shared import (
    EARLIER_FLAGS,
    SNAPSHOT,
    TIMES,
    TRUTH_POSITION,
    angles,
    directions,
    headings,
    lengths,
    on_earth,
)
from nlosctl.contract.tables.space import TARGET_HEIGHT, TRUTH_HEIGHT, elevation, sensor_height

__all__ = ["BEARINGS", "RANGES", "SENSOR", "TRUTH_PATH"]


_ZEROS = (
    ("bearing", "+x", False),
    ("bearing_cw", "+x", True),
    ("azimuth", "north", True),
    ("azimuth_ccw", "north", False),
)
_RELATIVE = "relative_bearing"

TRUTH_PATH = (
    *TRUTH_POSITION,
    Column(
        name="truth_los",
        type="boolean",
        nullable=True,
        carried=True,
        meaning="true flag: the wave followed the stated path (direct, or by the reflector)",
    ),
)

_TRUTH_TARGET = Column(
    name="truth_target",
    type="integer",
    nullable=True,
    carried=True,
    meaning="true target of the row, for rows of several targets, numbered from 0; null for a false row",
)

SENSOR = (
    Column(
        name="sensor",
        type="identifier",
        required=True,
        meaning="name of the sensor; without the column a file is of one station, and repeated readings are numbered",
    ),
    Column(
        name="sensor_x_m",
        type="number",
        unit="m",
        required=True,
        scene_axis=0,
        earth_place="sensor",
        meaning="sensor position, x",
        spellings=lengths("sensor_x", are_recent=True),
    ),
    Column(
        name="sensor_y_m",
        type="number",
        unit="m",
        required=True,
        scene_axis=1,
        earth_place="sensor",
        meaning="sensor position, y",
        spellings=lengths("sensor_y", are_recent=True),
    ),
    *on_earth("sensor", "sensor position"),
    Column(
        name="sensor_std_m",
        type="number",
        unit="m",
        nullable=True,
        meaning="standard deviation of each coordinate of the sensor position; default: the scene's position_std_m",
        spellings=lengths("sensor_std", are_recent=True),
    ),
)

_RANGE = (
    Column(
        name="range_m",
        type="number",
        measured=True,
        unit="m",
        nullable=True,
        positive=True,
        meaning="path length from source to sensor",
        spellings=lengths("range", are_recent=False),
    ),
    Column(
        name="range_std_m",
        type="number",
        unit="m",
        nullable=True,
        positive=True,
        constant_allowed=True,
        estimable=True,
        meaning="standard deviation of the range error",
        spellings=lengths("range_std", are_recent=False),
    ),
)

_PATH = (
    Column(
        name="path",
        type="integer",
        nullable=True,
        meaning="number of the path, for several measurements of one sensor in one snapshot (resolved multipath)",
    ),
    Column(
        name="reflector",
        type="text",
        nullable=True,
        names_reflector=True,
        meaning="reflector of the scene on the path; empty or absent for the direct path",
    ),
)

_PRIOR_POSITION = (
    Column(name="prior_x_m", type="number", unit="m", nullable=True, meaning="prior position of the source"),
    Column(name="prior_y_m", type="number", unit="m", nullable=True, meaning="prior position of the source"),
)

_PRIOR_STD = Column(
    name="prior_std_m",
    type="number",
    unit="m",
    nullable=True,
    positive=True,
    meaning="standard deviation of the prior position, the same in x and y",
)

_PRIOR_COVARIANCE = tuple(
    Column(
        name=f"prior_cov_{entry}_m2",
        type="number",
        unit="m2",
        nullable=True,
        positive=entry != "xy",
        meaning="covariance of the prior position, in place of prior_std_m; as in estimates",
    )
    for entry in ("xx", "xy", "yy")
)

_VECTOR = tuple(
    Column(
        name=f"unit_{axis}",
        type="number",
        nullable=True,
        carried=True,
        only_with=(),
        meaning=f"direction vector of any length in place of an angle, {axis}{note}",
    )
    for axis, note in (("x", ""), ("y", ""), ("z", " (optional)"))
)

BEARINGS = Table(
    name="bearings",
    title="Bearings: directions of arrival at sensors",
    row_key=("sensor", "sensor_x_m", "sensor_y_m", "path", "reflector"),
    together=(
        (
            tuple(column.name for column in (*_PRIOR_POSITION, _PRIOR_STD)),
            tuple(column.name for column in (*_PRIOR_POSITION, *_PRIOR_COVARIANCE)),
        ),
    ),
    covariances=(("prior_cov_xx_m2", "prior_cov_xy_m2", "prior_cov_yy_m2"),),
    times=TIMES,
    columns=(
        SNAPSHOT,
        *SENSOR,
        Column(
            name="bearing_rad",
            type="number",
            measured=True,
            unit="rad",
            required=True,
            largest_magnitude=2.0 * math.pi,
            too_large_means="they seem to be degrees: rename the column to bearing_deg (compass bearings: azimuth_deg)",
            meaning="direction from the sensor towards the incoming wave, counter-clockwise from +x",
            measured_at="sensor",
            spellings=directions(_ZEROS, _RELATIVE),
        ),
        Column(
            name="bearing_std_rad",
            type="number",
            unit="rad",
            required=True,
            positive=True,
            constant_allowed=True,
            estimable=True,
            replaced_by="direction_std_rad",
            meaning="standard deviation of the bearing error",
            spellings=angles("bearing_std"),
        ),
        *_PATH,
        *_RANGE,
        *_PRIOR_POSITION,
        _PRIOR_STD,
        *_PRIOR_COVARIANCE,
        *on_earth("prior", "prior position of the source"),
        *TRUTH_PATH,
        _TRUTH_TARGET,
        *EARLIER_FLAGS,
        *headings("", _RELATIVE, "the sensor"),
        *_VECTOR,
    ),
    space=(
        sensor_height("sensor position, height"),
        *elevation("elevation", "the bearing", replaced_by="direction_std_rad", estimable=True),
        Column(
            name="direction_std_rad",
            type="number",
            unit="rad",
            positive=True,
            constant_allowed=True,
            estimable=True,
            measures="bearing_rad",
            meaning="standard deviation of the direction across the ray, the same in every direction, in place of "
            "bearing_std_rad and elevation_std_rad: right near the zenith too",
            spellings=angles("direction_std"),
        ),
        *TARGET_HEIGHT,
        TRUTH_HEIGHT,
    ),
)

RANGES = Table(
    name="ranges",
    title="Ranges: path lengths from targets to sensors, any number per sensor",
    times=TIMES,
    columns=(
        SNAPSHOT,
        *SENSOR,
        *(dataclasses.replace(column, required=True, nullable=False) for column in _RANGE),
        Column(
            name="sensor_z_m",
            type="number",
            unit="m",
            scene_axis=2,
            meaning="sensor height, for slant ranges to targets at a height of their own (target_z_m)",
            spellings=lengths("sensor_z", are_recent=True),
        ),
        TARGET_HEIGHT[0],
        *_PATH,
        *TRUTH_PATH,
        _TRUTH_TARGET,
        *EARLIER_FLAGS,
    ),
    space=(
        sensor_height("sensor position, height; in the plane: for slant ranges to targets at a height (target_z_m)"),
        *TARGET_HEIGHT,
        TRUTH_HEIGHT,
    ),
)
