"""``nlosctl convert``: other programs' files to tables, tables to other formats, estimates to maps."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.completion import complete_exporter, complete_importer
from nlosctl.cli.options.declarations import ConfigFile, Debug, Json, Quiet
from nlosctl.cli.options.settings import takes_options
from nlosctl.cli.terminal import Terminal, preview_sinks, print_json, print_table
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.errors import UsageError

__all__ = ["convert"]


@takes_options()
def convert(
    inputs: Annotated[
        list[str] | None,
        typer.Argument(metavar="INPUT", help="File (or - for standard input); without it, list the formats."),
    ] = None,
    *,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="NAME",
            autocompletion=complete_importer,
            rich_help_panel="Input",
            help="Importer of another program's file, or auto; default: a table.",
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="NAME",
            autocompletion=complete_exporter,
            rich_help_panel="Output",
            help="Exporter of estimates; default: by the file extension.",
        ),
    ] = None,
    list_formats: Annotated[
        bool,
        typer.Option("--list", rich_help_panel="Method", help="List importers, exporters and table formats, and exit."),
    ] = False,
    show: Annotated[
        bool, typer.Option("--show", rich_help_panel="Method", help="Show the format's parameters and exit.")
    ] = False,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Convert files: logs of other programs to tables (--from), tables to tables, estimates to maps.

    Tables are copied unchanged, with their scene, between Parquet, CSV, Arrow and JSON Lines. The extension of the
    output selects its format; .geojson, .kml, .czml, .gpx, .geoparquet and .html take estimates, as 'localize -o' does
    too; the first two also take bearings and maps of the bound.
    """
    if show:
        _show(source, target, json)
        return
    if list_formats or not inputs:
        if options.parameters or source or target or write.output != "-" or (list_formats and inputs):
            raise UsageError("name a file to convert; 'nlosctl convert' alone lists the formats")
        _list(json)
        return
    if len(inputs) > 1 and not source:
        raise UsageError(f"convert takes one input, got {len(inputs)}: convert them one by one, or name their folder")
    from nlosctl.jobs.convert import convert

    with preview_sinks("table", write) as sinks:
        report = convert(
            inputs,
            read,
            write,
            importer=source,
            exporter=target,
            parameters=dict(options.parameters),
            protected=[config],
            receiver=(lambda schema, metadata: sinks["table"](schema)) if sinks else None,
        )
    terminal = Terminal(quiet)
    bad = f", {report.bad_rows} bad row{'s' if report.bad_rows > 1 else ''} set aside" if report.bad_rows else ""
    by = f" (importer {report.importer})" if report.importer else ""
    terminal.note(f"{', '.join(inputs)}: {report.rows} rows{bad}{by}")
    for note in report.notes:
        terminal.note(f"note: {note}")
    if report.loses_scene and write.scene_out is None:
        terminal.note("note: this format cannot store the scene; --scene-out FILE writes it, --scene FILE reads it")


def _list(json: bool) -> None:
    from nlosctl import registry
    from nlosctl.io.paths.locations import FileFormat

    rows = [
        {"way": entry.kind, "name": entry.name, "distribution": entry.distribution, "version": entry.version}
        for entry in registry.format_entries()
    ]
    rows += [{"way": "table", "name": known.value, "distribution": "", "version": ""} for known in FileFormat]
    if json:
        print_json(rows)
    else:
        print_table(rows, ["way", "name", "distribution", "version"])


def _show(importer: str | None, exporter: str | None, json: bool) -> None:
    from nlosctl import registry
    from nlosctl.contract.options import describe_options

    if (importer is None) == (exporter is None):
        raise UsageError("--show describes one format: name it with --from or --to")
    spec = registry.resolve_format(importer or exporter or "", "import" if exporter is None else "export")
    described = {
        "name": spec.full_name,
        "summary": spec.summary,
        "reference": spec.reference,
        "parameters": describe_options(spec.options),
    }
    if json:
        print_json(described)
        return
    for key in ("name", "summary", "reference"):
        typer.echo(f"{key:12s}{described[key]}")
    rows = [
        {
            "name": item["name"],
            "type": item["type"] + (f" in {item['bounds']}" if item["bounds"] else ""),
            "default": str(item["default"]),
            "meaning": item["meaning"],
        }
        for item in describe_options(spec.options)
    ]
    print_table(rows, ["name", "type", "default", "meaning"])
