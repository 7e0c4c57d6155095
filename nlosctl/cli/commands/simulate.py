"""``nlosctl simulate``: a scenario to measurements with their truth."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

from nlosctl.cli.options.completion import complete_scenario
from nlosctl.cli.options.declarations import (
    ConfigFile,
    Debug,
    Format,
    Json,
    Output,
    Overwrite,
    Params,
    Quiet,
    Seed,
    Sweeps,
    key_values,
)
from nlosctl.cli.shared.reading import open_output
from nlosctl.cli.shared.terminal import Preview, Terminal, print_json, print_table
from nlosctl.errors import UsageError

if TYPE_CHECKING:
    from nlosctl.io.writers.output_set import OutputSet

__all__ = ["simulate"]


def simulate(
    scenario: Annotated[
        str | None,
        typer.Argument(
            metavar="SCENARIO", autocompletion=complete_scenario, help="Name of a scenario; none: list them."
        ),
    ] = None,
    trials: Annotated[int, typer.Option("--trials", "-n", min=1, help="Snapshots to draw.")] = 1000,
    seed: Seed = 0,
    param: Params = [],  # noqa: B006 - typer copies it
    sweep: Sweeps = [],  # noqa: B006
    output: Output = "-",
    scene_out: Annotated[
        str | None, typer.Option("--scene-out", metavar="FILE", help="Write the scene as TOML.")
    ] = None,
    show: Annotated[bool, typer.Option("--show", help="Show the parameters and stop.")] = False,
    format: Format = None,
    overwrite: Overwrite = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> None:
    """Draw measurements from a simulated world, with truth columns. The same seed gives the same file."""
    if scenario is None:
        if param or sweep or show or scene_out is not None or output != "-":
            raise UsageError("name a scenario; 'nlosctl simulate' alone lists them")
        _list(json)
        return
    if show:
        _show(scenario, json)
        return
    from nlosctl.io.scenes.scene_file import scene_to_toml
    from nlosctl.io.writers.output_set import OutputSet, check_targets
    from nlosctl.pipeline.simulate.simulation import Simulation

    terminal = Terminal(quiet=quiet)
    simulation = Simulation(
        scenario, key_values(param, "--param"), seed=seed, trials=trials, sweep=key_values(sweep, "--sweep")
    )
    check_targets([output, scene_out], overwrite=overwrite, inputs=[])
    with OutputSet() as outputs:
        rows = _write(simulation, output, format, overwrite, terminal, outputs)
        if scene_out is not None:
            outputs.write_text(scene_out, scene_to_toml(simulation.scene))
    terminal.note(f"{scenario}: {simulation.snapshots} snapshots of {simulation.kind}, {rows} rows, seed {seed}")


def _write(
    simulation: Any, output: str, format: str | None, overwrite: bool, terminal: Terminal, outputs: OutputSet
) -> int:
    rows = 0
    preview = Preview.wanted(output, format)
    with terminal.progress("simulate") as progress:
        if preview is not None:
            for table in simulation.tables():
                preview.write(table)
                rows += table.num_rows
            preview.show()
            return rows
        writer = outputs.take(
            open_output(
                output,
                simulation.schema,
                format_name=format,
                overwrite=overwrite,
                inputs=[],
                metadata=simulation.metadata,
                of_measurements=True,
            )
        )
        for table in simulation.tables():
            writer.write(table)
            rows += table.num_rows
            progress(rows, None)
    return rows


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


def _show(scenario: str, json: bool) -> None:
    from nlosctl.contract.options import describe_options
    from nlosctl.scenarios.catalogue import find_scenario

    spec = find_scenario(scenario)
    parameters = describe_options(spec.options)
    if json:
        print_json({"scenario": spec.name, "kind": spec.kind, "summary": spec.summary, "parameters": parameters})
        return
    typer.echo(f"{spec.name} ({spec.kind}): {spec.summary}\n{spec.reference}")
    rows = [{**item, "default": "required" if item["required"] else str(item["default"])} for item in parameters]
    print_table(rows, ["name", "type", "unit", "default", "bounds", "meaning"])
