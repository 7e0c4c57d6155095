"""Columns that files of measurements only have in three dimensions: heights and elevations."""

from __future__ import annotations

import math

from nlosctl.contract.tables.columns import Column, Spelling
from nlosctl.contract.tables.shared import angles, lengths

__all__ = ["TARGET_HEIGHT", "TRUTH_HEIGHT", "elevation", "node_height", "sensor_height"]


def _heights(name: str) -> tuple[Spelling, ...]:
    """Return the other spellings of a height: in other units, and above the ellipsoid, for places on earth."""
    above = Spelling(
        name=f"{name.replace('_z', '_height')}_m", scale=1.0, meaning="height above the ellipsoid", usual=False
    )
    return (*lengths(name, are_recent=True), above)


TRUTH_HEIGHT = Column(
    name="truth_z_m", type="number", unit="m", nullable=True, carried=True, meaning="true source position: its height"
)
"""The height of the true position."""

TARGET_HEIGHT = (
    Column(
        name="target_z_m",
        type="number",
        unit="m",
        nullable=True,
        meaning="measured height of the target, the same in all rows of a snapshot",
        spellings=_heights("target_z"),
    ),
    Column(
        name="target_z_std_m",
        type="number",
        unit="m",
        nullable=True,
        meaning="standard deviation of target_z_m; 0, or without the column: the height is exact",
        spellings=_heights("target_z_std"),
    ),
)
"""A measured height of the target and its standard deviation."""


def sensor_height(meaning: str) -> Column:
    """Return the column of the height of sensors, which all rows have in three dimensions."""
    return Column(
        name="sensor_z_m",
        type="number",
        unit="m",
        required=True,
        scene_axis=2,
        meaning=meaning,
        spellings=_heights("sensor_z"),
    )


def node_height(node: str, meaning: str) -> Column:
    """Return the column of the height of a transmitter or receiver."""
    return Column(
        name=f"{node}_z_m",
        type="number",
        unit="m",
        required=True,
        scene_sensor=node,
        meaning=f"{meaning} position, height",
        spellings=lengths(f"{node}_z", are_recent=True),
    )


def elevation(name: str, what: str, replaced_by: str = "", *, estimable: bool = False) -> tuple[Column, Column]:
    """Return the columns of an elevation and of its standard deviation; ``what`` is the direction measured."""
    return (
        Column(
            name=f"{name}_rad",
            type="number",
            measured=True,
            unit="rad",
            nullable=True,
            largest_magnitude=0.5 * math.pi,
            is_bounded=True,
            too_large_means=f"they seem to be degrees: rename the column to {name}_deg",
            meaning=f"elevation of {what} above the x-y plane of the frame; empty: the row gives its azimuth alone",
            spellings=angles(name),
        ),
        Column(
            name=f"{name}_std_rad",
            type="number",
            unit="rad",
            nullable=True,
            positive=True,
            constant_allowed=True,
            estimable=estimable,
            replaced_by=replaced_by,
            meaning=f"standard deviation of {name}_rad",
            spellings=angles(f"{name}_std"),
        ),
    )
