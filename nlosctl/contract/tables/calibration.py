"""The columns of a calibration as a table."""

from __future__ import annotations

from nlosctl.contract.tables.columns import Column, Table

__all__ = ["CALIBRATION", "DEVIATIONS"]

_STD = "standard deviation of the offset; null if it is not determined"

CALIBRATION = Table(
    name="calibration",
    title="Calibration: a row per sensor, and per value of the columns with offsets of their own",
    columns=(
        Column(name="name", type="text", required=True, meaning="name of the sensor"),
        *(
            Column(name=name, type="number", unit=unit, nullable=True, meaning=meaning)
            for name, unit, meaning in (
                ("heading_offset_deg", "deg", "what its bearings are too large by, counter-clockwise"),
                ("heading_std_deg", "deg", _STD),
                ("range_offset_m", "m", "what its ranges are too long by"),
                ("range_offset_std_m", "m", _STD),
                ("arrival_offset_m", "m", "what its arrivals are too late by, times the speed of the wave"),
                ("arrival_offset_std_m", "m", _STD),
            )
        ),
        Column(name="std_scale", type="number", required=True, meaning="factor of its stated standard deviations"),
        Column(name="std_dof", type="number", nullable=True, meaning="degrees of freedom of that; null: it is exact"),
    ),
)

DEVIATIONS = Table(
    name="deviations",
    title="Deviations: a row per array and order, and per value of the columns with deviations of their own",
    columns=(
        Column(name="sensor", type="text", required=True, meaning="name of the array"),
        Column(name="order", type="integer", required=True, meaning="how often the part repeats in a turn, from 1"),
        *(
            Column(
                name=f"{part}_deg",
                type="number",
                unit="deg",
                required=True,
                meaning=f"what bearings are too large by, times the {word} of order times the true bearing less the "
                "heading, counter-clockwise",
            )
            for part, word in (("cos", "cosine"), ("sin", "sine"))
        ),
        *(
            Column(
                name=f"{part}_std_deg",
                type="number",
                unit="deg",
                nullable=True,
                meaning=f"standard deviation of {part}_deg; null if it is not determined",
            )
            for part in ("cos", "sin")
        ),
    ),
)
