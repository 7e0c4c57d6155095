"""Arguments and flags that several commands share and that only concern the terminal."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.settings import take_config

__all__ = [
    "CONFIG_HELP",
    "ConfigFile",
    "Debug",
    "FailIf",
    "Inputs",
    "Json",
    "Quiet",
    "Snapshot",
    "Strict",
    "Truth",
    "Verbose",
]

CONFIG_HELP = "Config file (TOML); flags and NLOSCTL_<COMMAND>_<OPTION> take precedence."

Inputs = Annotated[
    list[str],
    typer.Argument(
        metavar="INPUT",
        help="Files (Parquet, CSV, Arrow, JSON Lines), folders, globs, URLs, or - (standard input).",
        show_default=False,
    ),
]
Strict = Annotated[bool, typer.Option("--strict", rich_help_panel="Run", help="Exit 3 if a snapshot has no estimate.")]
FailIf = Annotated[
    list[str],
    typer.Option(
        "--fail-if",
        metavar="CONDITION",
        rich_help_panel="Run",
        help="Exit 4 if a metric meets it: 'fix_rate<0.95', 'ml:fix_rate<0.95'. Repeatable.",
    ),
]
Truth = Annotated[
    str | None,
    typer.Option(
        "--truth", metavar="FILE", rich_help_panel="Input", help="True positions: snapshot, truth_x_m, truth_y_m."
    ),
]
Snapshot = Annotated[
    str | None,
    typer.Option(
        "--snapshot", metavar="ID", rich_help_panel="Method", help="Snapshot to show; plot: by default the first."
    ),
]
ConfigFile = Annotated[
    str | None,
    typer.Option(
        "--config", metavar="FILE", is_eager=True, callback=take_config, rich_help_panel="Run", help=CONFIG_HELP
    ),
]
Json = Annotated[bool, typer.Option("--json", rich_help_panel="Messages", help="Print as JSON.")]
Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", rich_help_panel="Messages", help="No progress bar and no summary.")
]
Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", rich_help_panel="Messages", help="Print more detail to standard error.")
]
Debug = Annotated[bool, typer.Option("--debug", rich_help_panel="Messages", help="Print the traceback of an error.")]
