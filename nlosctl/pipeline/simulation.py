"""Scenarios drawn into tables of measurements with their truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from typing import Any

from nlosctl.contract.options import parse_options
from nlosctl.contract.scene import Scene
from nlosctl.io.simulated_tables import measurement_table
from nlosctl.pipeline.provenance import file_metadata
from nlosctl.scenarios.catalogue import find_scenario
from nlosctl.scenarios.drawing import draw_block, draw_snapshots

__all__ = ["Simulation"]


class Simulation:
    """A scenario with its parameters, seed and number of snapshots.

    Raises UsageError for an unknown scenario or parameter.
    """

    def __init__(self, scenario: str, parameters: Mapping[str, Any], *, seed: int, trials: int) -> None:
        self._spec = find_scenario(scenario)
        self._options = parse_options(self._spec.options, parameters, f"scenario {scenario!r}")
        self._seed, self._trials = seed, trials

    @property
    def kind(self) -> str:
        """The kind of the measurements."""
        return self._spec.kind

    @property
    def scene(self) -> Scene:
        """The scenario's sensors and reflectors."""
        return self._spec.scene(self._options)

    @property
    def schema(self) -> Any:
        """The Arrow schema of the tables."""
        return measurement_table(self._spec.kind, draw_block(self._spec, self._options, self._seed, 0, 1)).schema

    @property
    def metadata(self) -> dict[str, str]:
        """The metadata of the file: provenance and scene."""
        content = {
            "scenario": self._spec.name,
            "parameters": dataclasses.asdict(self._options),
            "seed": self._seed,
            "trials": self._trials,
        }
        return file_metadata("simulate", content, self.scene)

    def tables(self) -> Iterator[Any]:
        """Yield the measurements, a block of snapshots at a time."""
        for columns in draw_snapshots(self._spec, self._options, self._seed, self._trials):
            yield measurement_table(self._spec.kind, columns)
