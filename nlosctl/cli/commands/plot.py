"""``nlosctl plot``: figures of files."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import TYPE_CHECKING, Annotated, Any

import typer

from nlosctl.cli.options.completion import complete_view
from nlosctl.cli.options.declarations import ConfigFile, Debug, Json, Quiet, Snapshot
from nlosctl.cli.options.settings import takes_options, with_flags
from nlosctl.cli.terminal import Terminal, print_json, print_table
from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.errors import UsageError
from nlosctl.plotting.catalogue import VIEWS

if TYPE_CHECKING:
    from nlosctl.io.results.plot_inputs import PlotInput

__all__ = ["VIEWS_TEXT", "plot"]

VIEWS_TEXT = "Views: " + "; ".join(f"{view.name} ({view.shows})" for view in VIEWS.values()) + "."
"""The views for the help of the command."""


@takes_options()
def plot(
    inputs: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="FILE",
            help="Measurements, estimates, flags, bounds, scores or a calibration; - is standard input.",
            show_default=False,
        ),
    ] = None,
    *,
    read: InputOptions,
    write: OutputOptions,
    output: Annotated[
        str | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            rich_help_panel="Output",
            help="Figure (.png, .svg, .pdf); - is standard output, with --format.",
        ),
    ] = None,
    view: Annotated[
        str | None,
        typer.Option(
            "--view",
            metavar="NAME",
            autocompletion=complete_view,
            rich_help_panel="Method",
            help="View (see --views); default: the first that suits the files.",
        ),
    ] = None,
    views: Annotated[
        bool, typer.Option("--views", rich_help_panel="Method", help="List the views that suit the files, and exit.")
    ] = False,
    snapshot: Snapshot = None,
    path: Annotated[
        list[str],
        typer.Option(
            "--path", metavar="ID", rich_help_panel="Method", help="Path of the triplets to plot. Repeatable."
        ),
    ] = [],  # noqa: B006 - typer copies it
    x: Annotated[
        str | None, typer.Option("--x", metavar="KEY", rich_help_panel="Method", help="Swept parameter of the x axis.")
    ] = None,
    y: Annotated[
        str | None,
        typer.Option(
            "--y",
            metavar="METRIC",
            rich_help_panel="Method",
            help="Metric of evaluate or bound, or efficiency; default: rmse_m.",
        ),
    ] = None,
    target_z_m: Annotated[
        float | None,
        typer.Option(
            "--target-z-m",
            metavar="M",
            rich_help_panel="Geometry",
            help="Height of the targets in metres (in the plane: for slant ranges).",
        ),
    ] = None,
    linear: Annotated[bool, typer.Option("--linear", rich_help_panel="Output", help="Use linear axes.")] = False,
    title: Annotated[
        str | None,
        typer.Option("--title", metavar="TEXT", rich_help_panel="Output", help="Title of the figure or page."),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            "--size", metavar="WxH", rich_help_panel="Output", help="Width and height in inches, such as 6.4x4."
        ),
    ] = None,
    max_rows: Annotated[
        int,
        typer.Option(
            "--max-rows",
            metavar="N",
            min=1000,
            rich_help_panel="Input",
            help="Largest number of rows to show; a larger file is thinned.",
        ),
    ] = 1_000_000,
    format: Annotated[
        str | None,
        typer.Option("--format", metavar="FORMAT", rich_help_panel="Output", help="Figure format: png, svg or pdf."),
    ] = None,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Plot files: geometry and ellipses, errors, sweeps, ROC, bounds; their contents select the view."""
    if views or not inputs:
        if not views:
            raise UsageError("name a file to plot; 'nlosctl plot --views' lists the views")
        with _opened(inputs or [], read) as files:
            _list_views(files, json)
        return
    if output is None:
        raise UsageError("name the figure: -o FILE.svg (or .png, .pdf), or -o - --format png for standard output")
    if output == "-" and (json or sys.stdout.isatty()):
        raise UsageError("a figure on standard output needs a pipe and no --json; name a file with -o")
    from nlosctl.io.writers.output_set import check_targets
    from nlosctl.plotting.figures import figure_bytes, picture_format, save_figure
    from nlosctl.plotting.plot_request import PlotRequest
    from nlosctl.plotting.views.pictures import choose_view, draw_picture

    chosen = picture_format(output, format)
    with _opened(inputs, read) as files:
        paths = [part.path for file in files for part in file.source.parts if part.path is not None]
        check_targets([output], overwrite=write.overwrite, inputs=paths)
        name = choose_view(files, view, one_snapshot=snapshot is not None)
        request = PlotRequest(
            files=files,
            read=read,
            snapshot=snapshot,
            paths=path,
            x=x,
            y=y,
            by=read.by[0] if read.by and read.window is None else None,
            target_z_m=target_z_m,
            linear=linear,
            title=title,
            size_in=None if size is None else _size(size),
            max_rows=max_rows,
        )
        picture = draw_picture(request, name, wording=with_flags)
    if output == "-":
        sys.stdout.buffer.write(figure_bytes(picture.figure, chosen))
    else:
        save_figure(picture.figure, output, format=chosen, overwrite=write.overwrite, inputs=paths)
    terminal = Terminal(quiet=quiet)
    terminal.note(f"{', '.join(file.name for file in files)}: view {name!r} in {output}")
    for note in picture.notes:
        terminal.note(f"note: {note}")
    if json:
        print_json({"view": name, "output": output, "notes": list(picture.notes)})


@contextmanager
def _opened(inputs: Sequence[str], read: InputOptions) -> Iterator[list[PlotInput]]:
    """Open the inputs; the readers are imported only if there are inputs."""
    if not inputs:
        yield []
        return
    from nlosctl.io.results.calibration_input import is_calibration, open_calibration
    from nlosctl.io.results.plot_inputs import open_plot_input
    from nlosctl.jobs.files import open_inputs

    files = [open_calibration(name) for name in inputs if is_calibration(name)]
    tables = [name for name in inputs if not is_calibration(name)]
    given = open_inputs(tables, read.input_format) if tables else []
    with ExitStack() as stack:
        for source in given:
            files.append(open_plot_input(source, read))
            stack.callback(files[-1].close)
        yield files


def _list_views(files: Sequence[PlotInput], json: bool) -> None:
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


def _size(text: str) -> tuple[float, float]:
    width, _, height = text.lower().partition("x")
    try:
        size = float(width), float(height)
    except ValueError:
        size = (0.0, 0.0)
    if not all(1.0 <= side <= 50.0 for side in size):
        raise UsageError(f"--size takes WIDTHxHEIGHT in inches, each from 1 to 50. Got {text!r} instead.")
    return size
