"""The flags of constant standard deviations; those of arrival times become lengths by the speed of the wave."""

from __future__ import annotations

import math
from collections.abc import Mapping

from nlosctl.contract.flags import Flag
from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.errors import UsageError

__all__ = ["STD_FLAGS", "std_in_metres"]

_STD_UNITS = {
    "deg": ("degrees", math.radians(1.0)),
    "m": ("metres", 1.0),
    "s": ("seconds", 1.0),
    "ns": ("nanoseconds", LIGHT_M_S * 1e-9),
}

_CONSTANT = "localize validate plot convert describe"


def std_in_metres(constants: Mapping[str, float], speed_m_s: float) -> Mapping[str, float]:
    """Return constants with the standard deviation of arrivals in metres in place of seconds."""
    if "arrival_std_m" in constants:
        raise UsageError("the standard deviation of arrivals is given in metres and in a unit of time; give one")
    rest = {name: value for name, value in constants.items() if name != "arrival_std_s"}
    return {**rest, "arrival_std_m": constants["arrival_std_s"] * speed_m_s}


def _std_flag(name: str, column: str, what: str, commands: str) -> Flag:
    """Return the flag ``name`` of a constant standard deviation, in degrees, metres, seconds or nanoseconds of light.

    Nanoseconds for a ``column`` of seconds are converted to seconds.
    """
    unit, scale = _STD_UNITS[name.rpartition("-")[2]]
    scale = 1e-9 if unit == "nanoseconds" and column.endswith("_s") else scale
    setting = name.removeprefix("--").replace("-", "_")

    def parse(value: float) -> float:
        if not 0.0 < value < math.inf:
            raise UsageError(f"`{setting}` must be a finite number larger than 0. Got {value:g} instead.")
        return value * scale

    help = f"Standard deviation of every {what} in {unit}, if not a column."
    metavar = name.rpartition("-")[2].upper()
    return Flag(name=name, panel="Input", help=help, commands=commands, metavar=metavar, parse=parse, key=column)


# fmt: off
STD_FLAGS = (
    _std_flag("--bearing-std-deg", "bearing_std_rad", "bearing", f"bound {_CONSTANT}"),
    _std_flag("--elevation-std-deg", "elevation_std_rad", "elevation", f"bound {_CONSTANT}"),
    _std_flag("--direction-std-deg", "direction_std_rad", "direction, across the ray,", f"bound {_CONSTANT}"),
    _std_flag("--range-std-m", "range_std_m", "range", f"identify-los bound {_CONSTANT}"),
    _std_flag("--arrival-std-m", "arrival_std_m", "arrival", f"bound {_CONSTANT}"),
    _std_flag("--arrival-std-s", "arrival_std_s", "arrival", f"bound {_CONSTANT}"),
    _std_flag("--arrival-std-ns", "arrival_std_s", "arrival", f"bound {_CONSTANT}"),
    _std_flag("--dod-std-deg", "dod_std_rad", "departure direction", f"detect-ip {_CONSTANT}"),
    _std_flag("--doa-std-deg", "doa_std_rad", "arrival direction", f"detect-ip {_CONSTANT}"),
    _std_flag("--dod-elevation-std-deg", "dod_elevation_std_rad", "departure elevation", f"detect-ip {_CONSTANT}"),
    _std_flag("--doa-elevation-std-deg", "doa_elevation_std_rad", "arrival elevation", f"detect-ip {_CONSTANT}"),
    _std_flag("--toa-std-ns", "path_length_std_m", "delay", f"detect-ip {_CONSTANT}"),
    _std_flag("--path-length-std-m", "path_length_std_m", "path length", f"detect-ip {_CONSTANT}"),
)
# fmt: on
"""A flag for each standard deviation that a constant can fill, with the commands that have it."""
