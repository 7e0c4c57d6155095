"""``nlosctl schema``: the columns of the tables."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from nlosctl.cli.options.completion import complete_table
from nlosctl.cli.options.declarations import Debug, Json
from nlosctl.cli.terminal import print_json, print_table
from nlosctl.errors import DataError, UsageError, did_you_mean

__all__ = ["schema"]

_SCENE = "scene"


def schema(
    table: Annotated[
        str | None,
        typer.Argument(metavar="TABLE", autocompletion=complete_table, help="Name of a table; without it, list them."),
    ] = None,
    write: Annotated[
        str | None,
        typer.Option(
            "--write",
            metavar="FOLDER",
            rich_help_panel="Output",
            help="Write all tables as Frictionless schemas (JSON).",
        ),
    ] = None,
    json: Json = False,
    debug: Debug = False,
) -> None:
    """Show the columns of a table: name, type, unit, meaning; with --json as a Frictionless Table Schema.

    'schema scene' shows the keys of a scene file; with --json as a JSON Schema.
    """
    from nlosctl.contract.tables import TABLES

    if write is not None:
        _write(write)
        return
    if table is None:
        rows = [{"table": known.name, "title": known.title} for known in TABLES.values()]
        if json:
            print_json(rows)
        else:
            scene = {"table": _SCENE, "title": "Scene file (TOML, not a table): sensors, reflectors, position on earth"}
            print_table([*rows, scene], ["table", "title"])
        return
    if table == _SCENE:
        _show_scene(json)
        return
    if table not in TABLES:
        known = [*TABLES, _SCENE]
        raise UsageError(f"no table {table!r}{did_you_mean(table, known)}; there are: {', '.join(known)}")
    if json:
        from nlosctl.io.schemas import table_schema

        print_json(table_schema(TABLES[table]))
        return
    _show(table)


def _show_scene(json: bool) -> None:
    from nlosctl.io.scenes.scene_schema import scene_keys, scene_schema

    if json:
        print_json(scene_schema())
    else:
        print_table(scene_keys(), ["table", "key", "type", "required", "meaning"])


def _show(name: str) -> None:
    from nlosctl.contract.tables import TABLES

    rows = [
        {
            "column": column.name,
            "type": column.type,
            "unit": column.unit,
            "required": "required" if column.required else "",
            "also": ", ".join(spelling.name for spelling in column.spellings),
            "meaning": f"{column.meaning} (--add {column.add})" if column.add else column.meaning,
        }
        for column in TABLES[name].all_columns
    ]
    print_table(rows, ["column", "type", "unit", "required", "also", "meaning"])


def _write(folder: str) -> None:
    from nlosctl.io.schemas import write_schemas

    try:
        written = write_schemas(Path(folder))
    except OSError as error:
        raise DataError(f"--write {folder}: cannot be written: {error.strerror}") from error
    for path in written:
        typer.echo(str(path))
