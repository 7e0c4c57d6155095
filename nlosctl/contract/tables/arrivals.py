"""The columns of files of arrival times, and of differences of arrival times to a reference."""

from __future__ import annotations

from nlosctl.contract.tables.bearings_ranges import SENSOR, TRUTH_PATH
from nlosctl.contract.tables.columns import Column, Spelling, Table
from nlosctl.contract.tables.shared import EARLIER_FLAGS, LIGHT_M_S, SNAPSHOT, TIMES, lengths
from nlosctl.contract.tables.space import TARGET_HEIGHT, TRUTH_HEIGHT, sensor_height

__all__ = ["ARRIVALS", "DIFFERENCES", "OFFSET"]

_UNITS = (
    ("s", 1.0, "seconds"),
    ("ms", 1e-3, "milliseconds"),
    ("us", 1e-6, "microseconds"),
    ("ns", 1e-9, "nanoseconds"),
)
_METRES = (Spelling(name="tdoa_m", scale=1.0, meaning="difference to the arrival at the reference"),)


def _times(name: str, what: str = "") -> tuple[Spelling, ...]:
    """Return the spellings of an arrival in units of time."""
    return tuple(
        Spelling(
            name=f"{name}_{unit}",
            scale=LIGHT_M_S * seconds,
            seconds=seconds,
            meaning=f"{words} times the speed of the wave{what}",
            usual=unit in ("s", "ns"),
        )
        for unit, seconds, words in _UNITS
    )


_TDOA = (*_METRES, *_times("tdoa", ", a difference to the arrival at the reference"))

DIFFERENCES = tuple(spelling.name for spelling in _TDOA)
"""The names of the column of arrivals in a file of differences to a reference."""

_REFERENCE = (
    Column(
        name="reference",
        type="identifier",
        only_with=DIFFERENCES,
        meaning="sensor whose arrival is subtracted from the row's; its own row, if there is one, has the difference "
        "0; if a snapshot has several references, its differences are independent",
    ),
    *(
        Column(
            name=f"reference_{axis}_m",
            type="number",
            unit="m",
            nullable=True,
            only_with=DIFFERENCES,
            meaning=f"position of the reference, {axis}; default: that of its row, or of the scene",
            spellings=lengths(f"reference_{axis}", are_recent=True),
        )
        for axis in ("x", "y")
    ),
    Column(
        name="reference_std_m",
        type="number",
        unit="m",
        nullable=True,
        positive=True,
        only_with=DIFFERENCES,
        meaning="standard deviation of the reference's arrival; default: that of its row, else equal to the others'; "
        "empty if a snapshot has several references",
        spellings=_times("reference_std"),
    ),
)

_REFERENCE_HEIGHT = Column(
    name="reference_z_m",
    type="number",
    unit="m",
    nullable=True,
    only_with=DIFFERENCES,
    meaning="position of the reference, height; default: that of its row, or of the scene",
    spellings=lengths("reference_z", are_recent=True),
)

OFFSET = (
    Column(
        name="offset_m",
        type="number",
        unit="m",
        nullable=True,
        meaning="offset of the snapshot's arrivals: the time of emission, times the speed of the wave; exact to "
        "the rounding of a floating-point number; null for differences to several references",
    ),
    Column(
        name="offset_std_m", type="number", unit="m", nullable=True, meaning="standard deviation of the offset error"
    ),
    *(
        Column(
            name=f"cov_{axis}_offset_m2",
            type="number",
            unit="m2",
            nullable=True,
            of_space=axis == "z",
            meaning=f"covariance of the errors of {axis}_m and the offset",
        )
        for axis in "xyz"
    ),
)
"""The columns of estimates with the offset of arrivals."""

ARRIVALS = Table(
    name="arrivals",
    title="Arrival times at sensors, of one source with an unknown offset, or their differences",
    row_key=("sensor", "sensor_x_m", "sensor_y_m", "reference"),
    times=TIMES,
    columns=(
        SNAPSHOT,
        *SENSOR,
        Column(
            name="arrival_m",
            type="exact",
            measured=True,
            unit="m",
            required=True,
            meaning="arrival time, times the speed of the wave: distance from the source plus the snapshot's offset",
            spellings=(*_times("arrival"), *_TDOA),
        ),
        Column(
            name="arrival_std_m",
            type="number",
            unit="m",
            required=True,
            positive=True,
            constant_allowed=True,
            estimable=True,
            meaning="standard deviation of the arrival error, of a single arrival; if a snapshot has differences to "
            "several references: of the difference",
            spellings=_times("arrival_std"),
        ),
        *_REFERENCE,
        *TRUTH_PATH,
        Column(
            name="truth_offset_m",
            type="number",
            unit="m",
            nullable=True,
            carried=True,
            meaning="true offset of the snapshot: the time of emission, times the speed of the wave",
        ),
        *EARLIER_FLAGS,
    ),
    space=(sensor_height("sensor position, height"), _REFERENCE_HEIGHT, *TARGET_HEIGHT, TRUTH_HEIGHT),
)
