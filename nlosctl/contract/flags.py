"""Declaration of an option of a run together with its flags of the command line. Imports light modules only."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.errors import UsageError, did_you_mean

__all__ = ["Flag", "option", "parse_speed", "with_flags"]


_SPEEDS = {"light": LIGHT_M_S, "sound": 343.0}


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
