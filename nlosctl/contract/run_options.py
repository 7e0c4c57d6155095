"""The options of a run, each declared once with its flag and help: how to read, how to solve, what to write.

The command line, ``import nlosctl``, the pipeline and the readers use these frozen classes as they are. The command
line derives its flags from the fields and imports this module at start-up: it may import light modules only.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from nlosctl.contract.calibration import Calibration
from nlosctl.contract.fields import Field, SensorsField, parse_field
from nlosctl.contract.flags import STD_FLAGS, Flag, check_speed, option, parse_speed, std_in_metres, with_flags
from nlosctl.contract.limits import size
from nlosctl.contract.scene import EarthFrame, Scene, parse_frame
from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.contract.windows import KEEPS, parse_window
from nlosctl.errors import UsageError, did_you_mean

__all__ = ["PANELS", "Flag", "InputOptions", "OutputOptions", "SolveOptions", "flags_of"]

PANELS = ("Input", "Geometry", "Method", "Output", "Run", "Messages")
"""The panels of every command's help, in order."""

_SOLVE, _TABLES = "localize detect-ip identify-los", "localize detect-ip identify-los track"
_ESTIMATE, _ENGINE = f"{_SOLVE} calibrate track", f"{_SOLVE} calibrate bound"
_METHOD, _READ = f"{_ESTIMATE} posterior", f"{_ESTIMATE} bound posterior validate"
_CALIBRATED, _MEASUREMENTS = f"{_SOLVE} track bound validate", f"{_READ} plot report convert describe"
_WRITE = f"{_TABLES} bound posterior evaluate simulate convert"
_ARRIVALS, _REPORT = "localize posterior validate plot report convert describe", f"{_METHOD} bound evaluate"
_NOISES, _ENGINES, _POOLS = ("gaussian", "laplace"), ("local", "dask"), ("snapshot", "sensor", "file")


def flags_of(options: type[Any]) -> list[tuple[dataclasses.Field[Any], Flag]]:
    """Return the flags of an options class, each with the field that it sets."""
    return [(option, flag) for option in dataclasses.fields(options) for flag in option.metadata.get("flags", ())]


def parse_names(text: str) -> tuple[str, ...]:
    """Return the names in a list with commas."""
    return tuple(item.strip() for item in text.split(",") if item.strip())


# fmt: off
@dataclass(frozen=True, kw_only=True)
class InputOptions:
    """How measurements are read.

    ``columns`` maps a standard column name to the file's own, ``constants`` a missing column to its value (radians,
    metres); ``default_constants`` give way to a column of the file. ``scene`` is a scene or the name of a file; without
    one it is searched for: `nlosctl.io.scenes.scene_file.find_scene`. ``extra_columns`` are the columns to keep beside
    those of the measurement, by name or prefix (``sweep_*``), and no others are read; None keeps all. ``wide``,
    ``missing``, ``where`` and ``declination_deg`` change the rows before all else: `nlosctl.io.row_steps`.
    ``missing_std`` is what becomes of required standard deviations that are missing: ``error``, ``estimable`` (an error
    that names the setting ``estimate_std``) or ``unit`` (1 in every row). ``speed_m_s`` makes lengths of arrival times,
    also of the constant ``arrival_std_s``, which becomes ``arrival_std_m``; its ``speed_std_m_s`` is one scale error of
    all arrivals of a snapshot. ``window`` makes snapshots of times: `nlosctl.io.measurements.windows`; chunks keep the
    rows' times for ``keep_times`` (track, motion). Rows of any number of targets are ``unlabelled``: always or marked.
    """

    input_format: str | None = option(
        None, "--input-format", "Input", "Input format; default: detected from the name or contents.",
        f"{_MEASUREMENTS} evaluate", metavar="FORMAT", complete="format")
    kind: str | None = option(
        None, "--kind", "Input", "Kind: bearings, ranges, arrivals or triplets; default: detected from the columns.",
        "localize identify-los bound posterior track validate plot report describe", metavar="KIND", complete="kind")
    dimensions: int | None = option(
        None, "--dimensions", "Input", "Dimensions, 2 or 3; default: 3 with elevations, stds and sensor heights.",
        f"{_READ} plot report describe", minimum=2, maximum=3, metavar="N")
    columns: Mapping[str, str] = option(
        {}, "--column", "Input", "Read column HEADER of the file as NAME. Repeatable.",
        f"{_READ} plot report describe", metavar="NAME=HEADER", complete="column")
    constants: Mapping[str, float] = with_flags({}, *STD_FLAGS)
    all_rows: bool = option(
        False, "--all-rows", "Input", "Also use rows flagged by an earlier step (los false, ip true).",
        f"{_METHOD} bound")
    max_snapshot_rows: int = option(
        1_000_000, "--max-snapshot-rows", "Input", "Largest number of rows allowed in a snapshot.",
        f"{_READ} describe", minimum=1, metavar="N")
    max_spool_bytes: int = option(
        10_000_000_000, "--max-spool-bytes", "Input", "Largest standard input to copy to disk for several passes.",
        "localize calibrate posterior track", minimum=1, metavar="N")
    wide: Sequence[str] = option(
        (), "--wide", "Input", "Columns of a wide table, such as azimuth_deg=az_*; * is the sensor. Repeatable.",
        _MEASUREMENTS, metavar="NAME=PATTERN")
    missing: Sequence[str] = option(
        (), "--missing", "Input", "Leave out rows with this measured value, such as -999. Repeatable.",
        _MEASUREMENTS, metavar="VALUE")
    where: Sequence[str] = option(
        (), "--where", "Input", "Use only rows that meet a condition, such as 'snr_db >= 10'. Repeatable.",
        _MEASUREMENTS, metavar="CONDITION")
    declination_deg: float | str | None = option(
        None, "--declination-deg", "Input", "Magnetic declination (degrees or column) to add to azimuths.",
        _MEASUREMENTS, metavar="DEG")
    speed_m_s: float = option(
        LIGHT_M_S, "--speed-m-s", "Input", "Speed of the wave of arrival times: light, sound (343) or a number in m/s.",
        f"{_MEASUREMENTS} evaluate", metavar="SPEED", parse=parse_speed, text="light")
    speed_std_m_s: float = option(
        0.0, "--speed-std-m-s", "Input", "Standard deviation of the speed of the wave in m/s; 0: exactly known.",
        f"bound {_ARRIVALS}", metavar="M_S")
    window: str | None = option(
        None, "--window", "Input", "Snapshots from times: a width such as 2s or 500ms, auto or all.",
        _MEASUREMENTS, metavar="WIDTH")
    by: Sequence[str] = option(
        (), "--by", "Input", "Treat each value of a column separately, such as a tag or session. Repeatable.",
        _MEASUREMENTS, metavar="NAME")
    window_keep: str = option(
        "all", "--window-keep", "Input", "Rows of a sensor in a window: all, nearest or mean.",
        _MEASUREMENTS, metavar="WHICH")
    timezone: str | None = option(
        None, "--timezone", "Input", "Time zone of times without an offset, such as Europe/Berlin.",
        _MEASUREMENTS, metavar="ZONE")
    max_sort_rows: int = option(
        10_000_000, "--max-sort-rows", "Input", "Largest number of rows to sort by time.", _MEASUREMENTS, minimum=1,
        metavar="N")
    scene: Scene | str | None = option(  # noqa: RUF009
        None, "--scene", "Geometry", "Scene (TOML); default: in the table, STEM.scene.toml or scene.toml.",
        f"{_MEASUREMENTS} simulate", metavar="FILE")
    calibration: Calibration | str | None = option(  # noqa: RUF009
        None, "--calibration", "Geometry", "Calibration of the sensors (TOML).", _CALIBRATED, metavar="FILE")
    crs: str | None = option(
        None, "--crs", "Geometry", "Projected CRS of x and y, such as EPSG:32632.", f"{_READ} report convert describe",
        metavar="CODE")
    origin: str | tuple[float, float] | None = option(
        None, "--origin", "Geometry", "Latitude and longitude of x = y = 0, in degrees (WGS 84).",
        f"{_READ} report convert describe", metavar="LAT,LON")
    default_constants: Mapping[str, float] = field(default_factory=dict)
    extra_columns: Sequence[str] | None = None
    missing_std: str = "error"
    unlabelled: str = ""
    keep_times: str = ""
    chunk_rows: int = field(default_factory=partial(size, "chunk_rows"))
    use_threads: bool = True

    def __post_init__(self) -> None:
        if self.window is not None:
            parse_window(self.window)
        if self.speed_std_m_s or not 0.0 < self.speed_m_s < math.inf:
            check_speed(self.speed_m_s, self.speed_std_m_s)
        for name in ("constants", "default_constants"):
            if "arrival_std_s" in getattr(self, name):
                object.__setattr__(self, name, std_in_metres(getattr(self, name), self.speed_m_s))
        if self.dimensions not in (None, 2, 3):
            raise UsageError(f"`dimensions` must be 2 or 3. Got {self.dimensions!r} instead.")
        if self.window_keep not in KEEPS:
            near = did_you_mean(self.window_keep, KEEPS)
            raise UsageError(f"`window_keep` must be one of {', '.join(KEEPS)}. Got {self.window_keep!r}{near}.")
        if self.max_sort_rows < 1:
            raise UsageError(f"`max_sort_rows` must be an int of at least 1. Got {self.max_sort_rows!r} instead.")

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

    method: Sequence[str] = option(
        (), "--method", "Method", "Method (see 'nlosctl methods'). Repeatable.", _METHOD,
        short="-m", metavar="NAME", complete="method")
    parameters: Mapping[str, Any] = option(
        {}, "--param", "Method",
        "Parameter of method, scenario, format or figure; METHOD:KEY=VALUE: only that method. Repeatable.",
        f"{_METHOD} bound simulate convert reproduce", short="-p", metavar="KEY=VALUE", complete="parameter")
    sweep: Mapping[str, Any] = option(
        {}, "--sweep", "Method", "Parameter values to run in turn; several sweeps form a grid. Repeatable.",
        f"{_SOLVE} simulate", metavar="KEY=V1,V2,...", complete="parameter")
    estimate_std: str | None = option(
        None, "--estimate-std", "Method", "Estimate unknown stds from residuals: per snapshot, sensor or file.",
        "localize", metavar="snapshot|sensor|file")
    field: Field = option(  # noqa: RUF009
        SensorsField(), "--field", "Geometry",
        "Search region: xmin,xmax,ymin,ymax[,zmin,zmax], circle:x,y,r, polygon:FILE or sensors:FACTOR.",
        "localize identify-los calibrate posterior track", metavar="FIELD", parse=parse_field, text=str(SensorsField()))
    target_z_m: float | None = option(
        None, "--target-z-m", "Geometry", "Height of the targets in metres (in the plane: for slant ranges).",
        f"{_METHOD} bound", metavar="M")
    target_z_std_m: float | None = option(
        None, "--target-z-std-m", "Geometry", "Standard deviation of the targets' height, in 3 dimensions.",
        f"{_METHOD} bound", metavar="M")
    alternatives: int = option(
        1, "--alternatives", "Method", "Largest number of estimates per snapshot and target.",
        "localize identify-los", minimum=1, metavar="N")
    noise: str = option(
        "gaussian", "--noise", "Method", "Error distribution: gaussian or laplace.", "bound", metavar="NAME")
    use_ranges: bool = option(
        True, "--use-ranges/--no-ranges", "Method", "Use the ranges in a file of bearings.", "bound")
    seed: int = option(
        0, "--seed", "Method", "Random seed; each snapshot derives its own.", f"{_ESTIMATE} simulate reproduce",
        minimum=0, maximum=2**63 - 1, metavar="N")
    jobs: int = option(
        0, "--jobs", "Run", "Number of parallel workers; 0 = one per available CPU.", f"{_ESTIMATE} reproduce",
        minimum=0, metavar="N")
    block_size: int = option(
        8192, "--block-size", "Run", "Snapshots solved at a time; results do not depend on it.", _ESTIMATE, minimum=1,
        metavar="N")
    engine: str = option(
        "local", "--engine", "Run", "Execution engine: local or dask.", _ENGINE, metavar="NAME")
    scheduler: str | None = option(
        None, "--scheduler", "Run", "Dask scheduler, such as tcp://host:8786; default: threads.",
        _ENGINE, metavar="ADDRESS")
    worker_timeout: float = option(
        60.0, "--worker-timeout", "Run", "Seconds without a Dask scheduler or worker before giving up.",
        _ENGINE, metavar="SECONDS")

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
        if self.target_z_std_m is not None and (self.target_z_m is None or not 0.0 <= self.target_z_std_m < math.inf):
            fault = "needs `target_z_m`" if self.target_z_m is None else "must be a finite number of at least 0"
            raise UsageError(f"`target_z_std_m` {fault}. Got {self.target_z_std_m:g}.")
        if self.scheduler is not None and self.engine != "dask":
            raise UsageError("`scheduler` is only for the engine dask; set `engine` to dask too")


@dataclass(frozen=True, kw_only=True)
class OutputOptions:
    """Which tables are written, where and with which columns, and what is reported.

    A target is the name of a file or folder, ``-`` for standard output, or None for a table that is not wanted.
    """

    output: str = option(
        "-", "--output", "Output", "Output file; - is standard output, FOLDER/ takes one file per part.",
        f"{_WRITE} calibrate", short="-o", metavar="FILE")
    estimates_out: str | None = option(
        None, "--estimates-out", "Output", "Also write the estimates: a row per target or path.",
        "detect-ip identify-los", metavar="FILE")
    flags_out: str | None = option(
        None, "--flags-out", "Output", "Also write the flags: a row per measurement.", "localize track", metavar="FILE")
    trace_out: str | None = option(
        None, "--trace-out", "Output", "Also write the state after each sensor (sequential methods).", "localize",
        metavar="FILE")
    scene_out: str | None = option(
        None, "--scene-out", "Output", "Also write the scene as TOML.", "simulate convert", metavar="FILE")
    bad_rows: str | None = option(
        None, "--bad-rows", "Output", "Write bad rows to FILE and continue with the others.", f"{_READ} convert",
        metavar="FILE")
    format: str | None = option(
        None, "--format", "Output", "Output format; default: by the file extension, CSV on standard output.", _WRITE,
        metavar="FORMAT", complete="format")
    details: bool = option(False, "--details", "Output", "Add the test statistics behind each flag.", "detect-ip")
    ellipse: float | None = option(
        None, "--ellipse", "Output", "Add the error ellipse of probability P, such as 0.95.", _SOLVE, metavar="P")
    add: Sequence[str] = option(
        (), "--add", "Output", "Further columns of the estimates, see 'nlosctl schema estimates'.", _SOLVE,
        metavar="NAMES", parse=parse_names, text="")
    carry: Sequence[str] = option(
        (), "--carry", "Output", "Copy an input column to the estimates. Repeatable.", _TABLES, metavar="COLUMN")
    hash: bool = option(False, "--hash", "Output", "Record SHA-256 hashes of the inputs in the provenance.", _TABLES)
    overwrite: bool = option(
        False, "--overwrite", "Output", "Replace existing output files.",
        f"{_READ} evaluate simulate convert plot report reproduce")
    resume: bool = option(
        False, "--resume", "Run", "Continue an interrupted run into a folder; the results are the same.",
        f"{_TABLES} bound")
    report: str | None = option(
        None, "--report", "Messages", "Write the summary as JSON; - is standard error.", _REPORT, metavar="FILE")

    def __post_init__(self) -> None:
        if self.ellipse is not None and not 0.0 < self.ellipse < 1.0:
            raise UsageError(f"`ellipse` must be a probability between 0 and 1. Got {self.ellipse!r} instead.")
