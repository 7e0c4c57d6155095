"""``nlosctl simulate``: a scenario to measurements with their truth."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.completion import complete_scenario
from nlosctl.cli.options.declarations import ConfigFile, Debug, Json, Quiet
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, preview_sinks, print_json, print_table
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.errors import UsageError

__all__ = ["simulate"]


@takes_options()
def simulate(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO", autocompletion=complete_scenario, help="Name of a scenario; without it, list them."
        ),
    ] = None,
    *,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    trials: Annotated[
        int, typer.Option("--trials", "-n", metavar="N", min=1, rich_help_panel="Method", help="Number of snapshots.")
    ] = 1000,
    show: Annotated[
        bool, typer.Option("--show", rich_help_panel="Method", help="Show the scenario's parameters and exit.")
    ] = False,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Simulate measurements of a scenario, with ground truth. The same seed gives the same file.

    With --scene FILE the sensors and reflectors are your own: the scenario is 'bearings' (default), 'ranges',
    'triplets' or 'arrivals', in space where the sensors have heights.
    """
    if scenario is None and read.scene is not None:
        scenario = "bearings"
    if scenario is None:
        if options.parameters or options.sweep or show or write.scene_out is not None or write.output != "-":
            raise UsageError("name a scenario; 'nlosctl simulate' alone lists them")
        _list(json)
        return
    if show:
        _show(scenario, json, in_scene=read.scene is not None)
        return
    from nlosctl.jobs.simulate import simulate

    terminal = Terminal(quiet)
    with preview_sinks("measurements", write) as sinks:
        simulation, rows = simulate(
            scenario, trials, options, write, scene=read.scene, sink=sinks.get("measurements"), console=terminal
        )
    drawn = f"{simulation.snapshots} snapshots of {simulation.kind}, {rows} rows, seed {options.seed}"
    terminal.note(f"{scenario}: {drawn}")


def _list(json: bool) -> None:
    from nlosctl.scenarios.catalogue import scenarios

    rows = [
        {"scenario": spec.name, "kind": spec.kind, "summary": spec.summary, "reference": spec.reference}
        for spec in scenarios().values()
    ]
    if json:
        print_json(rows)
    else:
        print_table(rows, ["scenario", "kind", "summary", "reference"])


def _show(scenario: str, json: bool, *, in_scene: bool) -> None:
    from nlosctl.contract.options import describe_options
    from nlosctl.contract.scene import Scene
    from nlosctl.scenarios.catalogue import find_scenario

    spec = find_scenario(scenario)
    if in_scene and spec.of_scene is not None:
        spec = spec.of_scene(Scene())
    parameters = describe_options(spec.options)
    if json:
        print_json({"scenario": spec.name, "kind": spec.kind, "summary": spec.summary, "parameters": parameters})
        return
    typer.echo(f"{spec.name} ({spec.kind}): {spec.summary}\n{spec.reference}")
    rows = [{**item, "default": "required" if item["required"] else str(item["default"])} for item in parameters]
    print_table(rows, ["name", "type", "unit", "default", "bounds", "meaning"])
