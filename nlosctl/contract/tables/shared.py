"""Columns that measurement files of several kinds have."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

from nlosctl.contract.tables.columns import Column, Spelling

__all__ = [
    "DEGREE",
    "EARLIER_FLAGS",
    "EARTH_PLACES",
    "LIGHT_M_S",
    "SNAPSHOT",
    "TIMES",
    "TRUTH_POSITION",
    "angles",
    "directions",
    "headings",
    "lengths",
    "on_earth",
]

EARTH_PLACES = ("sensor", "truth", "prior", "tx", "rx")
"""Locations whose ``_x_m`` and ``_y_m`` may be replaced by ``_lat_deg`` and ``_lon_deg`` (WGS 84)."""

LIGHT_M_S = 299_792_458.0
"""The speed of light in vacuum, metres per second."""

DEGREE = math.pi / 180.0
"""One degree in radians."""

SNAPSHOT = Column(
    name="snapshot",
    type="identifier",
    meaning="identifier of the snapshot: its rows are solved together; without the column a file is one snapshot",
)
"""The column that groups rows into snapshots."""

TIMES = (
    Column(
        name="time_s",
        type="number",
        unit="s",
        carried=True,
        meaning="time of the measurement in seconds from any origin; `window` makes snapshots of it",
    ),
    Column(
        name="time",
        type="identifier",
        carried=True,
        meaning="time of the measurement, ISO 8601 with offset or Z (without one: `timezone`), in place of time_s",
    ),
)
"""The time of a row, in at most one column of a file; it is read as a time only where times are needed."""


_LENGTHS = (("km", 1000.0, "kilometres"), ("cm", 0.01, "centimetres"), ("mm", 0.001, "millimetres"))
_ANGLES = (("deg", DEGREE), ("mdeg", 1e-3 * DEGREE))


def lengths(name: str, *, are_recent: bool) -> tuple[Spelling, ...]:
    """Return the spellings of ``name`` (without its unit) in other units of length."""
    return tuple(
        Spelling(name=f"{name}_{unit}", scale=scale, meaning=meaning, usual=False, is_recent=are_recent)
        for unit, scale, meaning in _LENGTHS
    )


def angles(name: str) -> tuple[Spelling, Spelling]:
    """Return the spellings of the standard deviation ``name`` (without its unit) in degrees and thousandths."""
    degrees = Spelling(name=f"{name}_deg", scale=DEGREE)
    return degrees, Spelling(name=f"{name}_mdeg", scale=1e-3 * DEGREE, usual=False, is_recent=True)


def directions(zeros: Sequence[tuple[str, str, bool]], relative: str) -> tuple[Spelling, ...]:
    """Return the spellings of a direction in degrees: towards or back, in thousandths, and relative to a heading.

    ``zeros`` are the names of absolute directions (without unit), each with its zero (``north`` or ``+x``) and whether
    it is clockwise; ``relative`` is the name relative to the heading, clockwise (with ``_ccw``: counter-clockwise).
    """
    degrees = [_direction(*zero, back=back) for back in (False, True) for zero in zeros]
    fine = [
        dataclasses.replace(
            known, name=known.name.replace("_deg", "_mdeg"), scale=1e-3 * known.scale, usual=False, is_recent=True
        )
        for known in degrees
    ]
    return (*degrees, *fine, *_relative_directions(relative))


def _direction(name: str, zero: str, clockwise: bool, *, back: bool) -> Spelling:
    sense, north = "clockwise" if clockwise else "counter-clockwise", zero == "north"
    turned = ", from the source to the sensor" if back else ""
    return Spelling(
        name=f"{'back_' if back else ''}{name}_deg",
        scale=-DEGREE if clockwise else DEGREE,
        offset=(0.5 * math.pi if north else 0.0) + (math.pi if back else 0.0),
        from_north=north,
        is_compass=north and clockwise and not back,
        meaning=f"{sense} from {zero}{turned}",
        usual=not back and not name.endswith(("_cw", "_ccw")),
    )


def _relative_directions(name: str) -> tuple[Spelling, ...]:
    return tuple(
        Spelling(
            name=f"{name}{sense}_{unit}",
            scale=scale if sense else -scale,
            offset=0.5 * math.pi,
            is_relative=True,
            is_recent=True,
            meaning=f"{'counter-' if sense else ''}clockwise from the heading",
            usual=False,
        )
        for sense in ("", "_ccw")
        for unit, scale in (*_ANGLES, ("rad", 1.0))
    )


def headings(prefix: str, relative: str, what: str) -> tuple[Column, Column]:
    """Return the columns of the heading, and its standard deviation, of ``what`` with relative directions."""
    only_with = tuple(spelling.name for spelling in _relative_directions(relative))
    return (
        Column(
            name=f"{prefix}heading_deg",
            type="number",
            unit="deg",
            nullable=True,
            only_with=only_with,
            meaning=f"heading of {what} for relative directions, clockwise from +y; default: that of the scene",
        ),
        Column(
            name=f"{prefix}heading_std_deg",
            type="number",
            unit="deg",
            nullable=True,
            only_with=only_with,
            meaning="standard deviation of the heading, which adds to that of the direction; default: the scene's",
        ),
    )


def on_earth(location: str, meaning: str) -> tuple[Column, Column]:
    """Return the columns of latitude and longitude of a location; ``meaning`` describes it."""
    return (
        Column(
            name=f"{location}_lat_deg",
            type="number",
            unit="deg",
            nullable=True,
            carried=True,
            meaning=f"{meaning}: latitude (WGS 84), in place of {location}_x_m and {location}_y_m",
        ),
        Column(
            name=f"{location}_lon_deg",
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
    *on_earth("truth", "true source position"),
)
"""The true position of a row's source."""

EARLIER_FLAGS = (
    Column(
        name="los",
        type="boolean",
        nullable=True,
        carried=True,
        meaning="flag of an earlier step: rows with false are not used by default",
    ),
    Column(
        name="ip",
        type="boolean",
        nullable=True,
        carried=True,
        meaning="flag of an earlier step: rows with true (indirect path) are not used by default",
    ),
    Column(
        name="used", type="boolean", nullable=True, carried=True, meaning="flag of an earlier step: the row was used"
    ),
)
"""Flags that an earlier step may have added to a row."""
