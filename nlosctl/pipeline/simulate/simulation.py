"""Simulation of a scenario: tables of measurements with their truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np

from nlosctl.contract.options import parse_options
from nlosctl.contract.scene import Scene
from nlosctl.errors import UsageError
from nlosctl.io.arrow_columns import SweepColumns
from nlosctl.io.results.tables import measurement_table
from nlosctl.pipeline.engine.writing import file_metadata
from nlosctl.pipeline.solve.sweeps import SweepWords, swept_options
from nlosctl.scenarios.catalogue import find_scenario
from nlosctl.scenarios.spec import ScenarioSpec, draw_block, draw_snapshots

__all__ = ["Simulation"]


class Simulation:
    """A scenario with its parameters, seed and number of snapshots, at every point of the sweep.

    The snapshots of the points follow each other, ``trials`` of each, with consecutive numbers. Every point uses the
    same random numbers, so that points differ by their parameters only. ``scene`` is for the scenarios that take one.
    Raises UsageError for an unknown scenario or parameter, and for a sweep whose points do not fit into one file.
    """

    def __init__(
        self,
        scenario: str,
        parameters: Mapping[str, Any],
        *,
        seed: int,
        trials: int,
        sweep: SweepWords | None = None,
        scene: Scene | None = None,
    ) -> None:
        self._spec = _in_scene(find_scenario(scenario), scene)
        parse = partial(parse_options, self._spec.options, owner=f"scenario {scenario!r}")
        if trials < 1:
            raise UsageError(f"`trials` must be an int of at least 1. Got {trials!r} instead.")
        points = list(swept_options(sweep or {}, parameters, parse))
        self._options = [options for _, options in points]
        self._sweep = dict(sweep or {})
        self._sweeps = SweepColumns([values for values, _ in points])
        self._seed, self._trials = seed, trials
        self.scene = self._common_scene()
        self.schema = self._common_schema()

    @property
    def kind(self) -> str:
        """The kind of the measurements."""
        return self._spec.kind

    @property
    def snapshots(self) -> int:
        """The number of snapshots of all points of the sweep."""
        return self._trials * len(self._options)

    @property
    def metadata(self) -> dict[str, str]:
        """The metadata of the file: provenance and scene."""
        content: dict[str, Any] = {
            "scenario": self._spec.name,
            "parameters": dataclasses.asdict(self._options[0]),
            "seed": self._seed,
            "trials": self._trials,
        }
        if self._sweep:
            for key in self._sweep:
                del content["parameters"][key]
            content["sweep"] = self._sweeps.values()
        return file_metadata("simulate", content, self.scene)

    def tables(self) -> Iterator[Any]:
        """Yield the measurements, a block of snapshots at a time."""
        for point, options in enumerate(self._options):
            for columns in draw_snapshots(self._spec, options, self._seed, self._trials):
                snapshot = columns["snapshot"] + np.int64(point * self._trials)
                columns = {**columns, "snapshot": snapshot}
                yield measurement_table(self.kind, columns, self._sweeps, point, self._spec.further)

    def _common_scene(self) -> Scene:
        """Return the scene of all points, without sensors that move: the rows have their positions."""
        scenes = [self._spec.scene(options) for options in self._options]
        first = scenes[0]
        if any(scene.reflectors != first.reflectors for scene in scenes):
            raise UsageError(
                f"`sweep` {', '.join(self._sweep)}: moves the reflectors, and a file has one scene; "
                f"simulate the values one by one with `parameters`"
            )
        sensors = tuple(sensor for sensor in first.sensors if all(sensor in scene.sensors for scene in scenes))
        return dataclasses.replace(first, sensors=sensors)

    def _common_schema(self) -> Any:
        """Return the Arrow schema of the tables, the same at every point."""
        first = [draw_block(self._spec, options, self._seed, 0, 1) for options in self._options]
        tables = [measurement_table(self.kind, columns, self._sweeps, 0, self._spec.further) for columns in first]
        if any(table.schema != tables[0].schema for table in tables):
            raise UsageError(
                f"`sweep` {', '.join(self._sweep)}: its values give files of different columns; "
                f"simulate them one by one with `parameters`"
            )
        return tables[0].schema


def _in_scene(spec: ScenarioSpec, scene: Scene | None) -> ScenarioSpec:
    """Return the scenario in the user's scene, if there is one; raises UsageError for a scenario that takes none."""
    if scene is None:
        return spec
    if spec.of_scene is None:
        raise UsageError(
            f"scenario {spec.name!r} has a scene of its own; `scene` is for the scenarios arrivals, bearings, ranges "
            "and triplets"
        )
    return spec.of_scene(scene)
