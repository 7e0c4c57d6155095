"""Calibrations (TOML) as inputs of plots."""

from __future__ import annotations

from typing import Any

from nlosctl.contract.limits import parse_toml, read_limited
from nlosctl.contract.scene import Scene
from nlosctl.io.calibrations.calibration_file import read_calibration
from nlosctl.io.paths.inputs import Input
from nlosctl.io.paths.locations import location
from nlosctl.io.results.plot_inputs import PlotInput

__all__ = ["is_calibration", "open_calibration"]

_METHOD = "ml"


def is_calibration(given: Any) -> bool:
    """Return whether an input is the name of a calibration."""
    return str(given).lower().endswith(".toml")


def open_calibration(name: str) -> PlotInput:
    """Return a calibration as an input, with the method that made it; raises DataError if it can't be read."""
    calibration = read_calibration(name)
    facts = parse_toml(read_limited(location(name), name), name).get("calibration", {})
    method = facts.get("method", _METHOD) if isinstance(facts, dict) else _METHOD
    return PlotInput(
        content="calibration",
        kind=calibration.kind,
        names=(),
        scene=Scene(),
        source=Input(name=calibration.source, parts=()),
        calibration=calibration,
        method=str(method),
    )
