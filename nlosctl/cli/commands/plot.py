"""``nlosctl plot``: pictures of files."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nlosctl.cli.options.completion import complete_view
from nlosctl.cli.options.declarations import (
    Columns,
    ConfigFile,
    Debug,
    InputFormat,
    Json,
    Kind,
    Overwrite,
    Quiet,
    SceneFile,
    key_values,
)
from nlosctl.cli.shared.terminal import Terminal, print_json, print_table
from nlosctl.errors import UsageError
from nlosctl.plotting.catalogue import VIEWS

if TYPE_CHECKING:
    from nlosctl.io.results.plot_inputs import DrawnFile

__all__ = ["PLOT_EPILOG", "plot"]

PLOT_EPILOG = "\n\n".join(
    [
        "Views: " + "; ".join(f"{view.name} ({view.shows})" for view in VIEWS.values()) + ".",
        "Examples: nlosctl plot bearings.parquet fixes.parquet --snapshot 7 -o snapshot.svg",
        "nlosctl plot fixes.parquet --view cdf -o errors.pdf",
        "nlosctl simulate ring --sweep bearing_std_deg=0.1,1,5 | nlosctl localize -m ls -m ml - | nlosctl evaluate - | "
        "nlosctl plot - -o rmse.svg",
    ]
)


def plot(
    inputs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE...",
            help="Measurements, estimates, flags, bounds or scores in any format, or - for standard input.",
            show_default=False,
        ),
    ] = None,
    output: Annotated[
        str | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="The picture: .png, .svg or .pdf; - is stdout, by --format."
        ),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            "--view",
            metavar="NAME",
            autocompletion=complete_view,
            help="What to show, where the files allow several (see --views).",
        ),
    ] = None,
    views: Annotated[
        bool, typer.Option("--views", help="List the views, with FILEs those that suit them, and stop.")
    ] = False,
    snapshot: Annotated[
        str | None, typer.Option("--snapshot", metavar="ID", help="Snapshot to draw; the first unless told.")
    ] = None,
    path: Annotated[
        list[str], typer.Option("--path", metavar="ID", help="Draw this path of the triplets. Repeatable.")
    ] = [],  # noqa: B006 - typer copies it
    x: Annotated[
        str | None,
        typer.Option("--x", metavar="KEY", help="Swept parameter along the x axis, where there are several."),
    ] = None,
    y: Annotated[
        str | None,
        typer.Option(
            "--y", metavar="FIGURE", help="Figure of evaluate (or of a bound map) to draw: rmse_m unless told."
        ),
    ] = None,
    linear: Annotated[bool, typer.Option("--linear", help="No logarithmic axes.")] = False,
    title: Annotated[str | None, typer.Option("--title", metavar="TEXT", help="Title over the picture.")] = None,
    size: Annotated[
        str | None, typer.Option("--size", metavar="WxH", help="Width and height in inches, such as 6.4x4.")
    ] = None,
    max_rows: Annotated[
        int,
        typer.Option("--max-rows", min=1000, help="Draw evenly spaced snapshots of a larger file, and say so."),
    ] = 1_000_000,
    scene: SceneFile = None,
    kind: Kind = None,
    column: Columns = [],  # noqa: B006
    input_format: InputFormat = None,
    format: Annotated[
        str | None, typer.Option("--format", metavar="FORMAT", help="Format of the picture: png, svg or pdf.")
    ] = None,
    overwrite: Overwrite = False,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
    config: ConfigFile = None,
) -> None:
    """Draw files: geometry and ellipses, errors, sweeps, ROC, bounds; the view is chosen by what they hold."""
    if views or not inputs:
        if not views:
            raise UsageError("name a file to draw; 'nlosctl plot --views' lists the views")
        with _opened(inputs or [], scene, kind, input_format) as files:
            _list_views(files, json)
        return
    if output is None:
        raise UsageError("name the picture: -o FILE.svg (or .png, .pdf), or -o - --format png for standard output")
    if output == "-" and (json or sys.stdout.isatty()):
        raise UsageError("a picture on standard output goes into a pipe, without --json; name a file with -o")
    from nlosctl.io.measurements.options import ReadOptions
    from nlosctl.io.writers.output_set import check_targets
    from nlosctl.plotting.figures import figure_bytes, picture_format, save_figure
    from nlosctl.plotting.plot_request import PlotRequest
    from nlosctl.plotting.views.pictures import choose_view, draw_picture

    chosen = picture_format(output, format)
    with _opened(inputs, scene, kind, input_format) as files:
        paths = [part.path for file in files for part in file.given.parts if part.path is not None]
        check_targets([output], overwrite=overwrite, inputs=paths)
        name = choose_view(files, view, one_snapshot=snapshot is not None)
        request = PlotRequest(
            files=files,
            read=ReadOptions(kind=kind, renames=key_values(column, "--column"), scene_file=scene),
            snapshot=snapshot,
            paths=path,
            x=x,
            y=y,
            linear=linear,
            title=title,
            size_in=None if size is None else _size(size),
            max_rows=max_rows,
        )
        picture = draw_picture(request, name)
    if output == "-":
        sys.stdout.buffer.write(figure_bytes(picture.figure, chosen))
    else:
        save_figure(picture.figure, output, format=chosen, overwrite=overwrite, inputs=paths)
    terminal = Terminal(quiet=quiet)
    terminal.note(f"{', '.join(file.name for file in files)}: view {name!r} in {output}")
    for note in picture.notes:
        terminal.note(f"note: {note}")
    if json:
        print_json({"view": name, "output": output, "notes": list(picture.notes)})


@contextmanager
def _opened(
    inputs: Sequence[str], scene: str | None, kind: str | None, input_format: str | None
) -> Iterator[list[DrawnFile]]:
    """Open the inputs; nothing heavy is imported where there are none."""
    if not inputs:
        yield []
        return
    from nlosctl.io.paths.inputs import expand_inputs
    from nlosctl.io.paths.locations import format_named
    from nlosctl.io.results.plot_inputs import open_drawn

    given = expand_inputs(inputs, None if input_format is None else format_named(input_format))
    with ExitStack() as stack:
        files = []
        for one in given:
            files.append(open_drawn(one, scene, kind))
            stack.callback(files[-1].close)
        yield files


def _list_views(files: Sequence[DrawnFile], json: bool) -> None:
    names = list(VIEWS)
    if files:
        from nlosctl.plotting.suitable_views import suitable_views

        names = suitable_views(files)
    rows: list[dict[str, Any]] = [
        {"view": name, "shows": VIEWS[name].shows, "takes": VIEWS[name].takes} for name in names
    ]
    if json:
        print_json(rows)
    else:
        print_table(rows, ["view", "shows", "takes"])


def _size(words: str) -> tuple[float, float]:
    width, _, height = words.lower().partition("x")
    try:
        size = float(width), float(height)
    except ValueError:
        size = (0.0, 0.0)
    if not all(1.0 <= side <= 50.0 for side in size):
        raise UsageError(f"--size takes WIDTHxHEIGHT in inches, each from 1 to 50. Got {words!r} instead.")
    return size
