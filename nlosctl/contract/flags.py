"""Declaration of an option of a run with its flags of the command line, and the flags of constant standard deviations.

Those of arrival times become lengths by the speed of the wave. Imports light modules only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.errors import UsageError, did_you_mean

__all__ = ["STD_FLAGS", "Flag", "check_speed", "option", "parse_speed", "std_in_metres", "with_flags"]


_LARGEST_SHARE = 0.25
_SPEEDS = {"light": LIGHT_M_S, "sound": 343.0}

_STD_UNITS = {
    "deg": ("degrees", math.radians(1.0)),
    "m": ("metres", 1.0),
    "s": ("seconds", 1.0),
    "ns": ("nanoseconds", LIGHT_M_S * 1e-9),
}

_CONSTANT = "localize calibrate track posterior validate plot report convert describe"
_OF_DIRECTIONS = f"identify-los bound {_CONSTANT}"


@dataclass(frozen=True, kw_only=True)
class Flag:
    """A flag of the command line that sets an option; ``commands`` (names with blanks between) have it.

    ``parse`` converts text to the option's value; ``text`` is that of the default. A flag with a ``key`` sets
    that key of an option that is a mapping. ``complete`` names the kind of values that the shell offers, see
    `nlosctl.cli.options.completion`.
    """

    name: str
    panel: str
    help: str
    commands: str
    short: str = ""
    metavar: str | None = None
    minimum: int | None = None
    maximum: int | None = None
    complete: str = ""
    parse: Callable[[Any], Any] | None = None
    text: str | None = None
    key: str = ""


def option(default: Any, name: str, panel: str, help: str, commands: str, **rest: Any) -> Any:
    """Declare a field with its flag."""
    return with_flags(default, Flag(name=name, panel=panel, help=help, commands=commands, **rest))


def with_flags(default: Any, *flags: Flag) -> Any:
    """Declare a field with several flags."""
    if isinstance(default, dict):
        return field(default_factory=dict, metadata={"flags": flags})
    return field(default=default, metadata={"flags": flags})


def parse_speed(text: str) -> float:
    """Return a speed in m/s, given as a number or by name; raises UsageError."""
    if text in _SPEEDS:
        return _SPEEDS[text]
    try:
        return float(text)
    except ValueError:
        near = did_you_mean(text, _SPEEDS)
        raise UsageError(f"`speed_m_s` must be light, sound or a number in m/s. Got {text!r}{near}.") from None


def check_speed(speed_m_s: float, std_m_s: float) -> None:
    """Raise UsageError for a speed that can't be one, or a standard deviation of it."""
    if not 0.0 < speed_m_s < math.inf:
        raise UsageError(f"`speed_m_s` must be a finite number larger than 0. Got {speed_m_s:g} instead.")
    if not 0.0 <= std_m_s < math.inf:
        raise UsageError(f"`speed_std_m_s` must be a finite number of at least 0. Got {std_m_s:g} instead.")
    if std_m_s > 0.0 and speed_m_s == LIGHT_M_S:
        raise UsageError(f"`speed_std_m_s` needs the speed of the wave: set `speed_m_s`. Got {std_m_s:g} for light.")
    if std_m_s > _LARGEST_SHARE * speed_m_s:
        raise UsageError(
            f"`speed_std_m_s` must be at most a quarter of the speed, {speed_m_s:g}. Got {std_m_s:g} instead."
        )


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
    _std_flag("--bearing-std-deg", "bearing_std_rad", "bearing", _OF_DIRECTIONS),
    _std_flag("--elevation-std-deg", "elevation_std_rad", "elevation", _OF_DIRECTIONS),
    _std_flag("--direction-std-deg", "direction_std_rad", "direction, across the ray,", _OF_DIRECTIONS),
    _std_flag("--range-std-m", "range_std_m", "range", _OF_DIRECTIONS),
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
