"""The columns of files of triplets: departure direction, arrival direction and length of paths via a target."""

from __future__ import annotations

import dataclasses
import math

from nlosctl.contract.tables.columns import Column, Spelling, Table
from nlosctl.contract.tables.shared import (
    EARLIER_FLAGS,
    LIGHT_M_S,
    SNAPSHOT,
    TIMES,
    TRUTH_POSITION,
    angles,
    directions,
    headings,
    lengths,
    on_earth,
)
from nlosctl.contract.tables.space import TARGET_HEIGHT, TRUTH_HEIGHT, elevation, node_height

__all__ = ["TRIPLETS"]


def _node(name: str, meaning: str) -> tuple[Column, ...]:
    axes = (
        Column(
            name=f"{name}_{axis}_m",
            type="number",
            unit="m",
            required=True,
            earth_place=name,
            scene_sensor=name,
            meaning=f"{meaning} position, {axis} to the {side}",
            spellings=lengths(f"{name}_{axis}", are_recent=True),
        )
        for axis, side in (("x", "east"), ("y", "north"))
    )
    return (*axes, *on_earth(name, f"{meaning} position"))


def _node_name(name: str, meaning: str) -> Column:
    return Column(
        name=name,
        type="identifier",
        nullable=True,
        only_with=(),
        meaning=f"name of the {meaning}, a sensor of the scene, in place of its position; default: {name!r}",
    )


def _direction(name: str, node: str, meaning: str) -> tuple[Column, Column]:
    return (
        Column(
            name=f"{name}_rad",
            type="number",
            measured=True,
            unit="rad",
            required=True,
            largest_magnitude=2.0 * math.pi,
            too_large_means=f"they seem to be degrees: rename the column to {name}_deg",
            meaning=f"{meaning}, counter-clockwise from +x",
            measured_at=node,
            spellings=_spellings(name),
        ),
        Column(
            name=f"{name}_std_rad",
            type="number",
            unit="rad",
            required=True,
            positive=True,
            constant_allowed=True,
            meaning=f"standard deviation of the {name.upper()} error",
            spellings=angles(f"{name}_std"),
        ),
    )


def _spellings(name: str) -> tuple[Spelling, ...]:
    """Return the spellings of a direction; those that a compass shows are recent."""
    known = directions(((name, "+x", False), (f"{name}_azimuth", "north", True)), f"relative_{name}")
    meanings = {f"{name}_deg": "", f"back_{name}_deg": "turned by 180 degrees (an arrival: the direction of travel)"}
    return tuple(
        dataclasses.replace(
            spelling,
            meaning=meanings.get(spelling.name, spelling.meaning),
            usual=spelling.name == f"{name}_deg",
            is_recent=spelling.name not in meanings,
        )
        for spelling in known
    )


def _times(name: str) -> tuple[Spelling, ...]:
    """Return the spellings of a length as a time of flight ``name`` (without its unit)."""
    units = (("s", 1.0), ("ns", 1e-9), ("us", 1e-6), ("ms", 1e-3))
    return tuple(
        Spelling(
            name=f"{name}_{unit}", scale=LIGHT_M_S * scale, usual=unit in ("s", "ns"), is_recent=unit not in ("s", "ns")
        )
        for unit, scale in units
    )


_DOD = _direction("dod", "tx", "direction of departure: from the transmitter along the first segment of the path")
_DOA = _direction("doa", "rx", "direction of arrival: from the receiver towards the incoming wave")

TRIPLETS = Table(
    name="triplets",
    title="Triplets: direction of departure, direction of arrival and length of paths via a target",
    row_key=("path", "tx_x_m", "tx_y_m", "rx_x_m", "rx_y_m"),
    measurement_name="path",
    times=TIMES,
    columns=(
        SNAPSHOT,
        Column(name="path", type="integer", required=True, meaning="number of the path in its snapshot"),
        *_node("tx", "transmitter"),
        *_node("rx", "receiver"),
        _DOD[0],
        _DOA[0],
        Column(
            name="path_length_m",
            type="number",
            measured=True,
            unit="m",
            required=True,
            positive=True,
            too_small_means="if delays are relative to the first path, add its delay to all (where that is the direct "
            "path: the distance from transmitter to receiver over the speed of light)",
            meaning="length of the path from transmitter to receiver",
            spellings=(*_times("toa"), *lengths("path_length", are_recent=True)),
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
            meaning="standard deviation of the path length error",
            spellings=(*_times("toa_std"), *lengths("path_length_std", are_recent=True)),
        ),
        Column(
            name="target_radius_m",
            type="number",
            unit="m",
            nullable=True,
            meaning="distance of the points at which the target scatters from its centre; default: 0, a point",
        ),
        *TRUTH_POSITION,
        Column(
            name="truth_ip",
            type="boolean",
            nullable=True,
            carried=True,
            meaning="true flag: the path is indirect, with scatterers besides the target",
        ),
        *EARLIER_FLAGS,
        _node_name("tx", "transmitter"),
        _node_name("rx", "receiver"),
        *headings("tx_", "relative_dod", "the transmitter's array"),
        *headings("rx_", "relative_doa", "the receiver's array"),
    ),
    space=(
        node_height("tx", "transmitter"),
        node_height("rx", "receiver"),
        *elevation("dod_elevation", "the direction of departure"),
        *elevation("doa_elevation", "the direction of arrival"),
        *TARGET_HEIGHT,
        TRUTH_HEIGHT,
    ),
)
