"""Columns that measurement files of several kinds have."""

from __future__ import annotations

import math

from nlosctl.contract.tables.columns import Column

__all__ = ["DEGREE", "EARLIER_FLAGS", "EARTH_PLACES", "SNAPSHOT", "TRUTH_POSITION", "on_earth"]

EARTH_PLACES = ("sensor", "truth", "prior", "tx", "rx")
"""Locations whose ``_x_m`` and ``_y_m`` may be replaced by ``_lat_deg`` and ``_lon_deg`` (WGS 84)."""

DEGREE = math.pi / 180.0
"""One degree in radians."""

SNAPSHOT = Column(
    name="snapshot",
    type="identifier",
    meaning="identifier of the snapshot: its rows are solved together; without the column a file is one snapshot",
)
"""The column that groups rows into snapshots."""


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
