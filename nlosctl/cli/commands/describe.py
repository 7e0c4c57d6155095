"""``nlosctl describe``: what is in a file, before anyone solves it."""

from __future__ import annotations

from typing import Annotated, Any

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, Json, Quiet
from nlosctl.cli.options.settings import takes_options, with_flags
from nlosctl.cli.terminal import Terminal, print_json, print_table
from nlosctl.contract.run_options import InputOptions

__all__ = ["describe"]


@takes_options()
def describe(
    file: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            help="Table of measurements (file, folder, URL or - for standard input), or log of another program.",
            show_default=False,
        ),
    ],
    read: InputOptions,
    *,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Describe a file: kind, rows, snapshots, sensors, times, ranges of values, suspicious things, commands.

    Logs of other programs are recognized by their content. The commands run as they stand.
    """
    from nlosctl.jobs.describe import describe as job

    found = job([file], read, console=Terminal(quiet))
    for suspicion in found["suspicions"]:
        suspicion["text"] = with_flags(suspicion["text"])
    if json:
        print_json(found)
    else:
        _print(file, found)


def _print(file: str, found: dict[str, Any]) -> None:
    importer = f", read by the importer {found['importer']}" if found["importer"] else ""
    why = [name for name in found["columns"] if name in _measured()]
    typer.echo(f"{file}: {found['kind']} ({', '.join(why)}){importer}" if why else f"{file}: {found['kind']}{importer}")
    typer.echo(f"{found['rows']} rows, {found['snapshots']} snapshots, {found['sensors']} sensors")
    if found["time"] is not None:
        time = found["time"]
        typer.echo(f"from {time['first']} to {time['last']}, largest gap {time['largest_gap_s']:g} s")
    typer.echo()
    rows = [{"column": name, "min": span["min"], "max": span["max"]} for name, span in found["columns"].items()]
    print_table(rows, ["column", "min", "max"])
    for title, lines in (
        ("Suspicious:", [suspicion["text"] for suspicion in found["suspicions"]]),
        ("Commands:", found["commands"]),
    ):
        if lines:
            typer.echo("\n".join(["", title, *(f"  {line}" for line in lines)]))


def _measured() -> frozenset[str]:
    from nlosctl.contract.tables import measured_names

    return measured_names()
