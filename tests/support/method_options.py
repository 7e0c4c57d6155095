"""Options with which every built-in method can be tried."""

from __future__ import annotations

from typing import Any

from nlosctl import registry

BUILT_IN = [entry for entry in registry.entries() if entry.distribution == "nlosctl"]

_OPTIONS: dict[str, dict[str, Any]] = {
    "ranges.tca": {"targets": 2},
    "ranges.extended-tca": {"eta": 20.0},
    "bearings.ml-grid": {"step_m": 20e3},
}
"""Options without a default, and those whose default makes a test take a minute."""


def options_of(entry: registry.MethodEntry) -> Any:
    """Return the options to try a method with."""
    return registry.load(entry).options(**_OPTIONS.get(entry.full_name, {}))
