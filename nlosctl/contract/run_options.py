"""The options of a run, each declared once with its flag and help: how to read, how to solve, what to write.

The command line, ``import nlosctl``, the pipeline and the readers use these frozen classes as they are. The command
line derives its flags from the fields and imports this module at start-up: it may import light modules only.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from nlosctl.contract.fields import Field, SensorsField, parse_field
from nlosctl.contract.limits import size
from nlosctl.contract.scene import EarthFrame, Scene, parse_frame
from nlosctl.errors import UsageError, did_you_mean

__all__ = ["PANELS", "Flag", "InputOptions", "OutputOptions", "SolveOptions", "flags_of"]

PANELS = ("Input", "Geometry", "Method", "Output", "Run", "Messages")
"""The panels of every command's help, in order."""

_SOLVE = "localize detect-ip identify-los"
_READ = f"{_SOLVE} bound validate"
_MEASUREMENTS = f"{_READ} plot convert"
_WRITE = f"{_SOLVE} bound evaluate simulate convert"
_STD_UNITS = {"deg": ("degrees", math.radians(1.0)), "m": ("metres", 1.0), "ns": ("nanoseconds", 299_792_458.0 * 1e-9)}
_NOISES = ("gaussian", "laplace")
_ENGINES = ("local", "dask")
_POOLS = ("snapshot", "sensor", "file")


@dataclass(frozen=True, kw_only=True)
class Flag:
    """A flag of the command line that sets an option; ``commands`` (names with blanks between) have it.

    ``parse`` converts text to the option's value; ``text`` is that of the default. A flag with a ``key`` sets
    that key of an option that is a mapping. ``complete`` names the kind of values that the shell offers, see
    `nlosctl.cli.options.completion`.
    """

    name: str
    panel: str
    help: str
    commands: str
    short: str = ""
    metavar: str | None = None
    minimum: int | None = None
    maximum: int | None = None
    complete: str = ""
    parse: Callable[[Any], Any] | None = None
    text: str | None = None
    key: str = ""


def flags_of(options: type[Any]) -> list[tuple[dataclasses.Field[Any], Flag]]:
    """Return the flags of an options class, each with the field that it sets."""
    return [(option, flag) for option in dataclasses.fields(options) for flag in option.metadata.get("flags", ())]


def _option(default: Any, name: str, panel: str, help: str, commands: str, **rest: Any) -> Any:
    """Declare a field with its flag."""
    return _with_flags(default, Flag(name=name, panel=panel, help=help, commands=commands, **rest))


def _with_flags(default: Any, *flags: Flag) -> Any:
    if isinstance(default, dict):
        return field(default_factory=dict, metadata={"flags": flags})
    return field(default=default, metadata={"flags": flags})


def _std(name: str, column: str, what: str, commands: str) -> Flag:
    """Return the flag ``name`` of a constant standard deviation, in degrees, metres or nanoseconds of light."""
    unit, scale = _STD_UNITS[name.rpartition("-")[2]]
    setting = name.removeprefix("--").replace("-", "_")

    def parse(value: float) -> float:
        if not 0.0 < value < math.inf:
            raise UsageError(f"`{setting}` must be a finite number larger than 0. Got {value:g} instead.")
        return value * scale

    help = f"Standard deviation of every {what} in {unit}, if not a column."
    metavar = name.rpartition("-")[2].upper()
    return Flag(name=name, panel="Input", help=help, commands=commands, metavar=metavar, parse=parse, key=column)


def _parse_names(text: str) -> tuple[str, ...]:
    return tuple(item.strip() for item in text.split(",") if item.strip())


# fmt: off
@dataclass(frozen=True, kw_only=True)
class InputOptions:
    """How measurements are read.

    ``columns`` maps a standard column name to the file's own, ``constants`` a missing column to its value (radians,
    metres); ``default_constants`` give way to a column of the file. ``scene`` is a scene or the name of a file; without
    one it is searched for as
    `nlosctl.io.scenes.scene_file.find_scene` describes. ``extra_columns`` are the columns to keep beside those of the
    measurement, by name or prefix (``sweep_*``); None keeps all. Columns that are not kept are not read. ``wide``,
    ``missing``, ``where`` and ``declination_deg`` change the rows before all else: `nlosctl.io.row_steps`.
    ``missing_std`` is what becomes of required standard deviations that are missing: ``error``, ``estimable`` (an error
    that names the setting ``estimate_std``) or ``unit`` (1 in every row).
    """

    input_format: str | None = _option(
        None, "--input-format", "Input", "Input format; default: detected from the name or contents.",
        f"{_READ} convert evaluate plot", metavar="FORMAT", complete="format")
    kind: str | None = _option(
        None, "--kind", "Input", "Kind: bearings, ranges or triplets; default: detected from the columns.",
        "localize bound validate plot", metavar="KIND", complete="kind")
    columns: Mapping[str, str] = _option(
        {}, "--column", "Input", "Read column HEADER of the file as NAME. Repeatable.",
        f"{_READ} plot", metavar="NAME=HEADER", complete="column")
    constants: Mapping[str, float] = _with_flags(
        {},
        _std("--bearing-std-deg", "bearing_std_rad", "bearing", "localize bound validate plot convert"),
        _std("--range-std-m", "range_std_m", "range", "localize identify-los bound validate plot convert"),
        _std("--dod-std-deg", "dod_std_rad", "departure direction", "localize detect-ip validate plot convert"),
        _std("--doa-std-deg", "doa_std_rad", "arrival direction", "localize detect-ip validate plot convert"),
        _std("--toa-std-ns", "path_length_std_m", "delay", "localize detect-ip validate plot convert"),
        _std("--path-length-std-m", "path_length_std_m", "path length", "localize detect-ip validate plot convert"))
    all_rows: bool = _option(
        False, "--all-rows", "Input", "Also use rows flagged by an earlier step (los false, ip true).",
        f"{_SOLVE} bound")
    max_snapshot_rows: int = _option(
        1_000_000, "--max-snapshot-rows", "Input", "Largest number of rows allowed in a snapshot.", _READ,
        minimum=1, metavar="N")
    max_spool_bytes: int = _option(
        10_000_000_000, "--max-spool-bytes", "Input", "Largest standard input to copy to disk for several passes.",
        "localize", minimum=1, metavar="N")
    wide: Sequence[str] = _option(
        (), "--wide", "Input", "Columns of a wide table, such as azimuth_deg=az_*; * is the sensor. Repeatable.",
        _MEASUREMENTS, metavar="NAME=PATTERN")
    missing: Sequence[str] = _option(
        (), "--missing", "Input", "Leave out rows with this measured value, such as -999. Repeatable.",
        _MEASUREMENTS, metavar="VALUE")
    where: Sequence[str] = _option(
        (), "--where", "Input", "Use only rows that meet a condition, such as 'snr_db >= 10'. Repeatable.",
        _MEASUREMENTS, metavar="CONDITION")
    declination_deg: float | str | None = _option(
        None, "--declination-deg", "Input", "Magnetic declination (degrees or column) to add to azimuths.",
        _MEASUREMENTS, metavar="DEG")
    scene: Scene | str | None = _option(  # noqa: RUF009
        None, "--scene", "Geometry", "Scene (TOML); default: in the table, STEM.scene.toml or scene.toml.",
        f"{_MEASUREMENTS} simulate", metavar="FILE")
    crs: str | None = _option(
        None, "--crs", "Geometry", "Projected CRS of x and y, such as EPSG:32632.", f"{_READ} convert", metavar="CODE")
    origin: str | tuple[float, float] | None = _option(
        None, "--origin", "Geometry", "Latitude and longitude of x = y = 0, in degrees (WGS 84).",
        f"{_READ} convert", metavar="LAT,LON")
    default_constants: Mapping[str, float] = field(default_factory=dict)
    extra_columns: Sequence[str] | None = None
    missing_std: str = "error"
    chunk_rows: int = field(default_factory=partial(size, "chunk_rows"))
    use_threads: bool = True

    @property
    def changes_rows(self) -> bool:
        """Whether an option changes the rows or columns of a file before they are mapped to the contract."""
        return bool(self.wide or self.missing or self.where or self.declination_deg is not None)

    @property
    def drops_rows(self) -> bool:
        """Whether an option may leave out rows."""
        return bool(self.wide or self.missing or self.where)

    @property
    def frame(self) -> EarthFrame | None:
        """The local plane on earth that ``crs`` or ``origin`` defines; raises UsageError if it cannot be parsed."""
        if self.crs is not None and self.origin is not None:
            raise UsageError("`crs` and `origin` both define the local plane; give one")
        if self.origin is None:
            return None if self.crs is None else parse_frame(self.crs, "`crs`")
        text = self.origin if isinstance(self.origin, str) else " ".join(map(repr, self.origin))
        return parse_frame(text, "`origin`")


@dataclass(frozen=True, kw_only=True)
class SolveOptions:
    """Which methods solve the measurements, with which parameters, and how the work is distributed.

    ``estimate_std`` is what has a factor of its standard deviations of its own, estimated from residuals: each
    snapshot, each sensor or the whole file. ``noise`` and ``use_ranges`` are options of the Cramér-Rao bound.
    ``jobs`` 0 means one worker per available CPU.
    """

    method: Sequence[str] = _option(
        (), "--method", "Method", "Method (see 'nlosctl methods'). Repeatable.", _SOLVE,
        short="-m", metavar="NAME", complete="method")
    parameters: Mapping[str, Any] = _option(
        {}, "--param", "Method",
        "Parameter of method, scenario, format or figure; METHOD:KEY=VALUE: only that method. Repeatable.",
        f"{_SOLVE} simulate convert reproduce", short="-p", metavar="KEY=VALUE", complete="parameter")
    sweep: Mapping[str, Any] = _option(
        {}, "--sweep", "Method", "Parameter values to run in turn; several sweeps form a grid. Repeatable.",
        f"{_SOLVE} simulate", metavar="KEY=V1,V2,...", complete="parameter")
    estimate_std: str | None = _option(
        None, "--estimate-std", "Method", "Estimate unknown stds from residuals: per snapshot, sensor or file.",
        "localize", metavar="snapshot|sensor|file")
    field: Field = _option(  # noqa: RUF009
        SensorsField(), "--field", "Geometry",
        "Search region: xmin,xmax,ymin,ymax, circle:x,y,r, polygon:FILE or sensors:FACTOR.",
        "localize identify-los", metavar="FIELD", parse=parse_field, text=str(SensorsField()))
    target_z_m: float | None = _option(
        None, "--target-z-m", "Geometry", "Height of the targets in metres, for slant ranges.",
        "localize identify-los bound", metavar="M")
    alternatives: int = _option(
        1, "--alternatives", "Method", "Largest number of estimates per snapshot and target.",
        "localize identify-los", minimum=1, metavar="N")
    noise: str = _option(
        "gaussian", "--noise", "Method", "Error distribution: gaussian or laplace.", "bound", metavar="NAME")
    use_ranges: bool = _option(
        True, "--use-ranges/--no-ranges", "Method", "Use the ranges in a file of bearings.", "bound")
    seed: int = _option(
        0, "--seed", "Method", "Random seed; each snapshot derives its own.", f"{_SOLVE} simulate reproduce",
        minimum=0, maximum=2**63 - 1, metavar="N")
    jobs: int = _option(
        0, "--jobs", "Run", "Number of parallel workers; 0 = one per available CPU.", f"{_SOLVE} reproduce", minimum=0,
        metavar="N")
    block_size: int = _option(
        8192, "--block-size", "Run", "Snapshots solved at a time; results do not depend on it.", _SOLVE, minimum=1,
        metavar="N")
    engine: str = _option(
        "local", "--engine", "Run", "Execution engine: local or dask.", f"{_SOLVE} bound", metavar="NAME")
    scheduler: str | None = _option(
        None, "--scheduler", "Run", "Dask scheduler, such as tcp://host:8786; default: threads.",
        f"{_SOLVE} bound", metavar="ADDRESS")
    worker_timeout: float = _option(
        60.0, "--worker-timeout", "Run", "Seconds without a Dask scheduler or worker before giving up.",
        f"{_SOLVE} bound", metavar="SECONDS")

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("jobs", 0), ("block_size", 1), ("alternatives", 1)):
            if getattr(self, name) < least:
                raise UsageError(f"`{name}` must be an int of at least {least}. Got {getattr(self, name)!r} instead.")
        if not 0.0 < self.worker_timeout < math.inf:
            raise UsageError(f"`worker_timeout` must be a finite number > 0. Got {self.worker_timeout:g} instead.")
        if self.noise not in _NOISES:
            raise UsageError(f"`noise` must be one of {', '.join(_NOISES)}. Got {self.noise!r} instead.")
        if self.engine not in _ENGINES:
            near = did_you_mean(self.engine, _ENGINES)
            raise UsageError(f"no engine {self.engine!r}{near}; there are: {', '.join(_ENGINES)}")
        if self.estimate_std is not None and self.estimate_std not in _POOLS:
            raise UsageError(f"`estimate_std` must be one of {', '.join(_POOLS)}. Got {self.estimate_std!r} instead.")
        if self.scheduler is not None and self.engine != "dask":
            raise UsageError("`scheduler` is only for the engine dask; set `engine` to dask too")


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Which tables are written, where and with which columns, and what is reported.

    A target is the name of a file or folder, ``-`` for standard output, or None for a table that is not wanted.
    """

    output: str = _option(
        "-", "--output", "Output", "Output file; - is standard output, FOLDER/ takes one file per part.", _WRITE,
        short="-o", metavar="FILE")
    estimates_out: str | None = _option(
        None, "--estimates-out", "Output", "Also write the estimates: a row per target or path.",
        "detect-ip identify-los", metavar="FILE")
    flags_out: str | None = _option(
        None, "--flags-out", "Output", "Also write the flags: a row per measurement.", "localize", metavar="FILE")
    trace_out: str | None = _option(
        None, "--trace-out", "Output", "Also write the state after each sensor (sequential methods).", "localize",
        metavar="FILE")
    scene_out: str | None = _option(
        None, "--scene-out", "Output", "Also write the scene as TOML.", "simulate convert", metavar="FILE")
    bad_rows: str | None = _option(
        None, "--bad-rows", "Output", "Write bad rows to FILE and continue with the others.", f"{_READ} convert",
        metavar="FILE")
    format: str | None = _option(
        None, "--format", "Output", "Output format; default: by the file extension, CSV on standard output.", _WRITE,
        metavar="FORMAT", complete="format")
    details: bool = _option(False, "--details", "Output", "Add the test statistics behind each flag.", "detect-ip")
    ellipse: float | None = _option(
        None, "--ellipse", "Output", "Add the error ellipse of probability P, such as 0.95.", _SOLVE, metavar="P")
    add: Sequence[str] = _option(
        (), "--add", "Output", "Further columns of the estimates, see 'nlosctl schema estimates'.", _SOLVE,
        metavar="NAMES", parse=_parse_names, text="")
    carry: Sequence[str] = _option(
        (), "--carry", "Output", "Copy an input column to the estimates. Repeatable.", _SOLVE, metavar="COLUMN")
    hash: bool = _option(False, "--hash", "Output", "Record SHA-256 hashes of the inputs in the provenance.", _SOLVE)
    overwrite: bool = _option(
        False, "--overwrite", "Output", "Replace existing output files.",
        f"{_READ} evaluate simulate convert plot reproduce")
    resume: bool = _option(
        False, "--resume", "Run", "Continue an interrupted run into a folder; the results are the same.",
        f"{_SOLVE} bound")
    report: str | None = _option(
        None, "--report", "Messages", "Write the summary as JSON; - is standard error.", f"{_SOLVE} bound evaluate",
        metavar="FILE")

    def __post_init__(self) -> None:
        if self.ellipse is not None and not 0.0 < self.ellipse < 1.0:
            raise UsageError(f"`ellipse` must be a probability between 0 and 1. Got {self.ellipse!r} instead.")
