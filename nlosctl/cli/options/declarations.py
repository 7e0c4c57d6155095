"""The options that several commands share, with one help text each."""

from __future__ import annotations

from typing import Annotated

import typer

from nlosctl.cli.options.completion import (
    complete_column,
    complete_format,
    complete_kind,
    complete_method,
    complete_parameter,
)
from nlosctl.cli.options.settings import take_config
from nlosctl.errors import UsageError

__all__ = [
    "CONFIG_HELP",
    "Add",
    "AllRows",
    "Alternatives",
    "BadRows",
    "BearingStdDeg",
    "BlockSize",
    "Carry",
    "Columns",
    "ConfigFile",
    "Crs",
    "Debug",
    "Details",
    "DoaStdDeg",
    "DodStdDeg",
    "Ellipse",
    "Engine",
    "EstimatesOut",
    "FlagsOut",
    "Format",
    "Hash",
    "InputFormat",
    "Inputs",
    "Jobs",
    "Json",
    "Kind",
    "MaxSnapshotRows",
    "Methods",
    "Origin",
    "Output",
    "Overwrite",
    "Params",
    "PathLengthStdM",
    "Quiet",
    "RangeStdM",
    "Report",
    "Resume",
    "SceneFile",
    "Scheduler",
    "SearchField",
    "Seed",
    "Strict",
    "Sweeps",
    "TargetZM",
    "TraceOut",
    "Verbose",
    "key_values",
]


def key_values(words: list[str], option: str) -> dict[str, str]:
    """Return ``KEY=VALUE`` words as a dictionary; raises UsageError for a word of another form or a repeated key."""
    pairs: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise UsageError(f"{option} takes KEY=VALUE. Got {word!r} instead.")
        if key in pairs:
            raise UsageError(f"{option} {key} is given twice")
        pairs[key] = value
    return pairs


Inputs = Annotated[
    list[str],
    typer.Argument(
        metavar="INPUT...",
        help="Files (Parquet, CSV, CSV.gz, Arrow, JSON Lines), folders, globs, or - for standard input.",
        show_default=False,
    ),
]
Output = Annotated[
    str,
    typer.Option(
        "--output", "-o", metavar="FILE", help="Where the main table goes; - is stdout, FOLDER/ takes a file per part."
    ),
]
Format = Annotated[
    str | None,
    typer.Option(
        "--format",
        metavar="FORMAT",
        autocompletion=complete_format,
        help="Format of the output, where its name does not tell.",
    ),
]
InputFormat = Annotated[
    str | None,
    typer.Option(
        "--input-format",
        metavar="FORMAT",
        autocompletion=complete_format,
        help="Format of the input, where neither name nor bytes tell.",
    ),
]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="Replace output files that exist.")]
Resume = Annotated[
    bool, typer.Option("--resume", help="Go on where an interrupted run into a folder stopped; the same bytes result.")
]
Engine = Annotated[
    str,
    typer.Option("--engine", metavar="NAME", help="Who does the work: local (this machine) or dask (a Dask cluster)."),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        "--scheduler", metavar="ADDRESS", help="The Dask scheduler, tcp://host:8786; a local cluster unless given."
    ),
]
Kind = Annotated[
    str | None,
    typer.Option(
        "--kind",
        metavar="KIND",
        autocompletion=complete_kind,
        help="Kind of the measurements, where the columns mislead.",
    ),
]
SceneFile = Annotated[
    str | None,
    typer.Option(
        "--scene",
        metavar="FILE",
        help="Scene (TOML). Else the one in the table, STEM.scene.toml, or scene.toml beside the input.",
    ),
]
Crs = Annotated[
    str | None,
    typer.Option(
        "--crs", metavar="CODE", help="Projected CRS of x and y (EPSG:32632), for places on earth in and out."
    ),
]
Origin = Annotated[
    str | None,
    typer.Option(
        "--origin",
        metavar="LAT,LON",
        help="Where the plane of x and y touches the earth (degrees, WGS 84), for places on earth in and out.",
    ),
]
Ellipse = Annotated[
    float | None,
    typer.Option(
        "--ellipse",
        metavar="P",
        help="Add semi-axes and orientation of the ellipse that holds the share P of Gaussian errors, such as 0.95.",
    ),
]
Add = Annotated[
    str,
    typer.Option("--add", metavar="NAMES", help="Further columns of the estimates: cep50, gdop, or both: cep50,gdop."),
]
Columns = Annotated[
    list[str],
    typer.Option(
        "--column",
        metavar="NAME=HEADER",
        autocompletion=complete_column,
        help="Read the column HEADER of the file as NAME. Repeatable.",
    ),
]
BearingStdDeg = Annotated[
    float | None,
    typer.Option("--bearing-std-deg", metavar="DEG", help="Std of every bearing, where the file has no such column."),
]
RangeStdM = Annotated[
    float | None,
    typer.Option("--range-std-m", metavar="M", help="Std of every range, where the file has no such column."),
]
DodStdDeg = Annotated[
    float | None,
    typer.Option("--dod-std-deg", metavar="DEG", help="Std of every direction of departure, where the file has none."),
]
DoaStdDeg = Annotated[
    float | None,
    typer.Option("--doa-std-deg", metavar="DEG", help="Std of every direction of arrival, where the file has none."),
]
PathLengthStdM = Annotated[
    float | None,
    typer.Option("--path-length-std-m", metavar="M", help="Std of every path length, where the file has none."),
]
Details = Annotated[
    bool, typer.Option("--details", help="Show in the flags what they were decided by (see 'nlosctl methods show').")
]
EstimatesOut = Annotated[
    str | None,
    typer.Option("--estimates-out", metavar="FILE", help="Write the estimates too: a row per target, or per path."),
]
FlagsOut = Annotated[
    str | None, typer.Option("--flags-out", metavar="FILE", help="Write the flags: a row per measurement.")
]
TraceOut = Annotated[
    str | None,
    typer.Option("--trace-out", metavar="FILE", help="Write the state after each sensor (sequential methods)."),
]
Alternatives = Annotated[
    int, typer.Option("--alternatives", min=1, metavar="N", help="At most N estimates per snapshot and target.")
]
Strict = Annotated[bool, typer.Option("--strict", help="Exit 3 when some snapshot got no estimate.")]
SearchField = Annotated[
    str,
    typer.Option(
        "--field",
        metavar="FIELD",
        help="Where to search: xmin,xmax,ymin,ymax or circle:x,y,r or polygon:FILE (metres), or sensors:FACTOR, the "
        "box of the sensors grown by FACTOR times its larger side.",
    ),
]
TargetZM = Annotated[
    float | None,
    typer.Option(
        "--target-z-m", metavar="M", help="Height of the targets: ranges are slant, from sensors at sensor_z_m."
    ),
]
BadRows = Annotated[
    str | None,
    typer.Option("--bad-rows", metavar="FILE", help="Set bad rows aside in FILE and go on with the rest."),
]
AllRows = Annotated[
    bool, typer.Option("--all-rows", help="Use also the rows that an earlier step flagged (los false, ip true).")
]
Methods = Annotated[
    list[str],
    typer.Option(
        "--method",
        "-m",
        metavar="NAME",
        autocompletion=complete_method,
        help="Method (see 'nlosctl methods'). Repeatable.",
    ),
]
Params = Annotated[
    list[str],
    typer.Option(
        "--param",
        "-p",
        metavar="KEY=VALUE",
        autocompletion=complete_parameter,
        help="A parameter ('nlosctl methods show NAME', 'simulate NAME --show', 'convert --from NAME --show' tell); "
        "METHOD:KEY=VALUE for one of several methods. Repeatable.",
    ),
]
Sweeps = Annotated[
    list[str],
    typer.Option(
        "--sweep",
        metavar="KEY=V1,V2,...",
        autocompletion=complete_parameter,
        help="A parameter in turn at several values, told in the column sweep_KEY; several sweeps make a grid. "
        "Repeatable.",
    ),
]
Carry = Annotated[
    list[str],
    typer.Option("--carry", metavar="COLUMN", help="Carry an input column over to the estimates. Repeatable."),
]
Seed = Annotated[
    int,
    typer.Option(
        "--seed", min=0, max=2**63 - 1, help="Seed of everything random; each snapshot draws its own from it."
    ),
]
Jobs = Annotated[
    int, typer.Option("--jobs", min=0, help="How many to work on at once; 0: as many as the machine gives.")
]
BlockSize = Annotated[
    int, typer.Option("--block-size", min=1, help="Snapshots solved at once; no result depends on it.")
]
MaxSnapshotRows = Annotated[
    int, typer.Option("--max-snapshot-rows", min=1, help="A snapshot with more rows than this is an error.")
]
Report = Annotated[
    str | None, typer.Option("--report", metavar="FILE", help="Write the summary as JSON (- is standard error).")
]
Hash = Annotated[bool, typer.Option("--hash", help="Put hashes of the inputs' content into the output's provenance.")]
Json = Annotated[bool, typer.Option("--json", help="Tell it as JSON.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="No progress, no summary.")]
Verbose = Annotated[bool, typer.Option("--verbose", "-v", help="Tell more on standard error.")]
Debug = Annotated[bool, typer.Option("--debug", help="Show the traceback of an error.")]
CONFIG_HELP = (
    "Defaults from TOML, a table per command (or NLOSCTL_CONFIG). A flag beats NLOSCTL_<COMMAND>_<OPTION>, that beats "
    "FILE; 'nlosctl config show' tells which holds."
)
ConfigFile = Annotated[
    str | None, typer.Option("--config", metavar="FILE", is_eager=True, callback=take_config, help=CONFIG_HELP)
]
