"""``nlosctl report``: a page that shows files, to be opened in a browser."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from nlosctl.cli.options.declarations import ConfigFile, Debug, Json, Quiet
from nlosctl.cli.options.settings import takes_options, with_flags
from nlosctl.cli.terminal import Terminal, print_json
from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.errors import UsageError

__all__ = ["report"]


@takes_options()
def report(
    inputs: Annotated[
        list[str],
        typer.Argument(
            metavar="FILE",
            help="Measurements, flags, estimates, scores, bounds or maps; - is standard input.",
            show_default=False,
        ),
    ],
    *,
    read: InputOptions,
    write: OutputOptions,
    output: Annotated[
        str | None,
        typer.Option(
            "--output", "-o", metavar="FILE", rich_help_panel="Output", help="Page (.html); - is standard output."
        ),
    ] = None,
    title: Annotated[
        str | None,
        typer.Option("--title", metavar="TEXT", rich_help_panel="Output", help="Title of the figure or page."),
    ] = None,
    max_rows: Annotated[
        int,
        typer.Option(
            "--max-rows",
            metavar="N",
            min=1,
            rich_help_panel="Input",
            help="Largest number of rows to show; a larger file is thinned.",
        ),
    ] = 100_000,
    config: ConfigFile = None,
    json: Json = False,
    quiet: Quiet = False,
    debug: Debug = False,
) -> None:
    """Make one page of files for a browser: map, rays of each snapshot, estimates, statistics, provenance.

    The page works from the disk and loads nothing. It has the rays, range circles or hyperbolas of the chosen snapshot
    with its outliers, a table of estimates that filters and sorts, counts of statuses, errors and coverage where the
    truth is in the files, and residuals by sensor of flags. Large files are thinned, and the page names the total.
    Exit codes: 0 done, 1 bad data or files, 2 usage error, 130 interrupted.
    """
    if output is None:
        raise UsageError("name the page: -o FILE.html, or -o - for standard output")
    if output == "-" and (json or sys.stdout.isatty()):
        raise UsageError("a page on standard output needs a pipe and no --json; name a file with -o")
    from dataclasses import replace

    from nlosctl.jobs.report import report as make_page

    page, notes = make_page(
        inputs, read, replace(write, output=output), title=title, max_rows=max_rows, wording=with_flags
    )
    if output == "-":
        sys.stdout.buffer.write(page)
    terminal = Terminal(quiet)
    terminal.note(f"{', '.join(inputs)}: a page of {len(page) / 1e6:.1f} MB in {output}")
    for note in notes:
        terminal.note(f"note: {note}")
    if json:
        print_json({"output": output, "bytes": len(page), "notes": notes})
