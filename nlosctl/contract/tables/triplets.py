"""The columns of files of triplets: departure direction, arrival direction and length of paths via a target."""

from __future__ import annotations

import math

from nlosctl.contract.tables.columns import Column, Spelling, Table
from nlosctl.contract.tables.shared import DEGREE, EARLIER_FLAGS, SNAPSHOT, TRUTH_POSITION, on_earth

__all__ = ["TRIPLETS"]

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
    return (*axes, *on_earth(name, f"{meaning} position"))


def _direction(name: str, meaning: str) -> tuple[Column, Column]:
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
            spellings=(
                Spelling(name=f"{name}_deg", scale=DEGREE),
                Spelling(
                    name=f"back_{name}_deg",
                    scale=DEGREE,
                    offset=math.pi,
                    meaning="turned by 180 degrees (an arrival: the direction of travel)",
                    usual=False,
                ),
            ),
        ),
        Column(
            name=f"{name}_std_rad",
            type="number",
            unit="rad",
            required=True,
            positive=True,
            constant_allowed=True,
            meaning=f"standard deviation of the {name.upper()} error",
            spellings=(Spelling(name=f"{name}_std_deg", scale=DEGREE),),
        ),
    )


_DOD = _direction("dod", "direction of departure: from the transmitter along the first segment of the path")
_DOA = _direction("doa", "direction of arrival: from the receiver towards the incoming wave")

TRIPLETS = Table(
    name="triplets",
    title="Triplets: direction of departure, direction of arrival and length of paths via a target",
    row_key=("path", "tx_x_m", "tx_y_m", "rx_x_m", "rx_y_m"),
    measurement_name="path",
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
            meaning="standard deviation of the path length error",
            spellings=(
                Spelling(name="toa_std_s", scale=_SPEED_OF_LIGHT_M_S),
                Spelling(name="toa_std_ns", scale=_SPEED_OF_LIGHT_M_S * 1e-9),
            ),
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
    ),
)
