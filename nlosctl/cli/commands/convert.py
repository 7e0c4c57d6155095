"""``nlosctl convert``: other programs' files to tables, tables to other formats, estimates to maps."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nlosctl.cli.options.completion import complete_exporter, complete_importer
from nlosctl.cli.options.declarations import (
    BadRows,
    ConfigFile,
    Crs,
    Debug,
    Format,
    InputFormat,
    Json,
    Origin,
    Output,
    Overwrite,
    Params,
    Quiet,
    SceneFile,
    key_values,
)
from nlosctl.cli.shared.reading import ReadWords
from nlosctl.cli.shared.terminal import Preview, Terminal, print_json, print_table
from nlosctl.errors import UsageError
from nlosctl.io.paths.locations import Location, location

if TYPE_CHECKING:
    from nlosctl.io.writers.output_set import OutputSet

__all__ = ["convert"]


def convert(
    inputs: Annotated[
        list[str] | None,
        typer.Argument(metavar="INPUT...", help="File (or - for standard input); none: list the formats."),
    ] = None,
    source: Annotated[
        str | None,
        typer.Option(
            "--from",
            metavar="NAME",
            autocompletion=complete_importer,
            help="Importer of another program's file; none: a table.",
        ),
    ] = None,
    target: Annotated[
        str | None,
        typer.Option(
            "--to",
            metavar="NAME",
            autocompletion=complete_exporter,
            help="Exporter of estimates, where the extension tells none.",
        ),
    ] = None,
    param: Params = [],  # noqa: B006 - typer copies it
    window: Annotated[
        str | None,
        typer.Option("--window", metavar="TIME", help="How long a snapshot of an imported log lasts: 0.1s, 2min, all."),
    ] = None,
    output: Output = "-",
    scene_out: Annotated[
        str | None, typer.Option("--scene-out", metavar="FILE", help="Write the scene as TOML.")
    ] = None,
    list_formats: Annotated[
        bool, typer.Option("--list", help="List importers, exporters and formats of tables.")
    ] = False,
    show: Annotated[bool, typer.Option("--show", help="Show the parameters and stop.")] = False,
    scene: SceneFile = None,
    crs: Crs = None,
    origin: Origin = None,
    bad_rows: BadRows = None,
    format: Format = None,
    input_format: InputFormat = None,
    overwrite: Overwrite = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> None:
    """Convert files: logs of other programs to tables (--from), tables to tables, estimates to maps.

    Tables pass as they are, with their scene, between Parquet, CSV, Arrow and JSON Lines. The extension of the output
    tells its format; .geojson, .kml, .czml and .geoparquet take estimates, as 'localize -o' does too.
    """
    if show:
        _show(source, target, json)
        return
    if list_formats or not inputs:
        if param or source or target or output != "-" or (list_formats and inputs):
            raise UsageError("name a file to convert; 'nlosctl convert' alone lists the formats")
        _list(json)
        return
    if len(inputs) > 1:
        raise UsageError(f"convert takes one input, got {len(inputs)}: convert them one by one, or name their folder")
    from nlosctl.io.writers.output_set import OutputSet

    words = ReadWords(inputs=inputs, scene=scene, crs=crs, origin=origin)
    terminal = Terminal(quiet=quiet)
    given = key_values([*param, *([] if window is None else [f"window={window}"])], "--param")
    with ExitStack() as stack, OutputSet() as outputs:
        conversion = _Conversion(
            stack, outputs, words, bad_rows, overwrite, [location(name) for name in (scene, config) if name]
        )
        conversion.check([output, scene_out, bad_rows])
        if source is not None:
            conversion.read_foreign(source, given if target is None else {}, input_format)
        else:
            conversion.read_table(input_format)
        conversion.write_scene(scene_out)
        rows, kept = conversion.write(output, target, format, given if source is None or target else {})
    bad = f", {kept} bad rows set aside" if kept else ""
    terminal.note(f"{inputs[0]}: {rows} rows{bad}")
    if conversion.loses_scene and scene_out is None:
        terminal.note("note: this format has no room for the scene: --scene-out FILE writes it, --scene FILE reads it")


class _Conversion:
    """One input on its way to one output."""

    def __init__(
        self,
        stack: ExitStack,
        outputs: OutputSet,
        words: ReadWords,
        bad_rows: str | None,
        overwrite: bool,
        others: list[Location],
    ) -> None:
        from nlosctl.io.scenes.scene_file import plane_of

        self._stack, self._outputs, self._words = stack, outputs, words
        self._bad_rows, self._overwrite = bad_rows, overwrite
        if words.frame is not None:
            plane_of(words.frame)  # a CRS of no use is told at once
        word = words.inputs[0]
        self._paths = [*([] if word == "-" else [location(word)]), *others]
        self._tables: Any = None
        self._log: Any = None
        self.schema: Any = None
        self.metadata: dict[str, str] = {}
        self.loses_scene = False

    def check(self, targets: Sequence[str | None]) -> None:
        """Refuse outputs that can't be written, before any work is done."""
        from nlosctl.io.writers.output_set import check_targets

        check_targets(targets, overwrite=self._overwrite, inputs=self._paths)

    def read_foreign(self, importer: str, parameters: dict[str, str], input_format: str | None) -> None:
        """Read another program's file."""
        from nlosctl.pipeline.convert.importer import Import
        from nlosctl.pipeline.engine.provenance import file_metadata

        if input_format is not None:
            raise UsageError("--input-format is for tables; --from names the importer")
        word = self._words.inputs[0]
        job = Import(
            importer,
            parameters,
            scene_file=self._words.scene,
            frame=self._words.frame,
            bad_rows=self._aside(()),
        )
        found = job.read(word)
        content = {"importer": importer, "parameters": parameters, "inputs": [{"name": word}]}
        self.schema, self._tables, self._log = found.table.schema, iter([found.table]), job.log
        self.metadata = file_metadata("convert", content, found.scene)

    def read_table(self, input_format: str | None) -> None:
        """Read a table as it is."""
        from nlosctl.io.conversion.table_copy import TableCopy
        from nlosctl.io.paths.inputs import expand_inputs
        from nlosctl.io.paths.locations import format_named

        chosen = None if input_format is None else format_named(input_format)
        try:
            (given, *more) = expand_inputs(self._words.inputs, chosen)
        except UsageError as error:
            raise UsageError(
                f"{error}; a file of another program: --from NAME ('nlosctl convert' lists them)"
            ) from None
        if more:
            raise UsageError("convert takes one input; convert the files of a glob one by one, or name their folder")
        copy = TableCopy(given, scene_file=self._words.scene, frame=self._words.frame)
        self._stack.callback(copy.close)
        sink = self._aside(copy.schema.names)
        if sink is not None:
            copy.set_bad_rows_aside(sink)
        self.schema, self.metadata = copy.schema, copy.metadata
        self._tables, self._log = copy.tables(), copy.log

    def write(
        self, output: str, exporter: str | None, format: str | None, parameters: dict[str, str]
    ) -> tuple[int, int]:
        """Write all rows; return how many, and how many were bad."""
        from nlosctl.contract.limits import size
        from nlosctl.io.paths.locations import FileFormat, format_named, format_of_path
        from nlosctl.io.writers.table_writer import TableWriter
        from nlosctl.pipeline.convert.map_writer import MapWriter, exporter_of

        name = exporter or exporter_of(output, format)
        common: dict[str, Any] = {"overwrite": self._overwrite, "inputs": self._paths, "metadata": self.metadata}
        preview = Preview.wanted(output, format) if name is None else None
        if name is not None:
            writer: Any = MapWriter(output, name, parameters, frame=self._words.frame, **common)
        else:
            if parameters:
                raise UsageError("--param is for importers and exporters; a table has none")
            chosen = None if format is None else format_named(format)
            kind = chosen or (FileFormat.CSV if output == "-" else format_of_path(output))
            self.loses_scene = self._scene_text is not None and preview is None and not kind.carries_metadata
            writer = preview or TableWriter(
                output, self.schema, format=chosen, group_rows=size("measurement_group_rows"), **common
            )
        rows = 0
        sink = writer if preview is not None else self._outputs.take(writer)
        for table in self._tables:
            sink.write(table)
            rows += table.num_rows
        if preview is not None:
            preview.show()
        return rows, self._log.total

    def write_scene(self, target: str | None) -> None:
        """Write the scene, if that is wanted."""
        if target is not None:
            self._outputs.write_text(target, self._scene_text or "")

    @property
    def _scene_text(self) -> str | None:
        return self.metadata.get("nlosctl.scene")

    def _aside(self, names: Any) -> Any:
        from nlosctl.io.writers.table_writer import BadRowWriter, TableWriter

        if self._bad_rows is None:
            return None
        schema = BadRowWriter.schema(names)
        writer = TableWriter(self._bad_rows, schema, overwrite=self._overwrite, inputs=self._paths)
        return BadRowWriter(self._outputs.take(writer))


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
        raise UsageError("--show tells of one format: name it with --from or --to")
    spec = registry.resolve_format(importer or exporter or "", "import" if exporter is None else "export")
    told = {
        "name": spec.full_name,
        "summary": spec.summary,
        "reference": spec.reference,
        "parameters": describe_options(spec.options),
    }
    if json:
        print_json(told)
        return
    for key in ("name", "summary", "reference"):
        typer.echo(f"{key:12s}{told[key]}")
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
