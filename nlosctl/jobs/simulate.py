"""Job: draw measurements from a scenario, with their truth."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nlosctl.contract.run_options import OutputOptions, SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.io.paths.locations import location
from nlosctl.io.scenes.scene_file import find_scene, scene_to_toml
from nlosctl.io.writers.output_set import OutputSet, check_targets
from nlosctl.jobs.console import Console, Silent
from nlosctl.jobs.files import open_output
from nlosctl.pipeline.simulate.simulation import Simulation

__all__ = ["simulate"]


def simulate(
    scenario: str,
    trials: int,
    options: SolveOptions,
    write: OutputOptions,
    *,
    scene: Scene | str | None = None,
    sink: Callable[[Any, dict[str, str]], Any] | None = None,
    console: Console | None = None,
) -> tuple[Simulation, int]:
    """Write ``trials`` snapshots of a scenario, and its scene if wanted; return the simulation and the number of rows.

    ``scene`` is a scene, or its file, for the scenarios that take one.
    ``sink`` returns, for schema and metadata, a receiver of the rows that replaces the output. Raises UsageError
    for an unknown scenario or parameter.
    """
    paths = [location(scene)] if isinstance(scene, str) else []
    own = find_scene(scene, {}, None) if isinstance(scene, str) else scene
    simulation = Simulation(
        scenario, options.parameters, seed=options.seed, trials=trials, sweep=options.sweep, scene=own
    )
    check_targets([write.output, write.scene_out], overwrite=write.overwrite, inputs=paths)
    rows = 0
    with OutputSet() as outputs, (console or Silent()).progress("simulate") as progress:
        if sink is not None:
            writer = sink(simulation.schema, simulation.metadata)
        else:
            output = open_output(
                write.output, simulation.schema, write, metadata=simulation.metadata, of_measurements=True
            )
            writer = outputs.take(output)
        for table in simulation.tables():
            writer.write(table)
            rows += table.num_rows
            progress(rows, None)
        if write.scene_out is not None:
            outputs.write_text(write.scene_out, scene_to_toml(simulation.scene), overwrite=write.overwrite)
    return simulation, rows
