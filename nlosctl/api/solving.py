"""Functions that solve measurements: positions, flags, bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from nlosctl import registry
from nlosctl.api.tables import BadRows, SceneLike, TableSink, input_options, inputs_of, names_of, set_aside
from nlosctl.contract.fields import parse_field
from nlosctl.contract.methods import Job
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.jobs import bound as bound_job
from nlosctl.jobs.files import Destination
from nlosctl.jobs.solve import solve
from nlosctl.pipeline.solve.report import RunReport

__all__ = ["Detection", "Localization", "bound", "detect_ip", "identify_los", "localize"]


@dataclass(frozen=True, kw_only=True)
class Localization:
    """Estimates and flags as Arrow tables, as the command line writes them, and the report of the run.

    ``bad_rows`` is a table of the rows that were set aside, if that was asked for.
    """

    estimates: Any
    flags: Any
    report: RunReport
    bad_rows: Any | None = None


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Flags as an Arrow table, as the command line writes them, estimates or None, and the report of the run.

    ``bad_rows`` is a table of the rows that were set aside, if that was asked for.
    """

    flags: Any
    estimates: Any | None
    report: RunReport
    bad_rows: Any | None = None


def localize(
    table: Any,
    *,
    method: str | Sequence[str] = "ml",
    scene: SceneLike = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    kind: str | None = None,
    field: str = "sensors:1",
    target_z_m: float | None = None,
    target_z_std_m: float | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    bad_rows: BadRows = None,
    estimate_std: str | None = None,
    alternatives: int = 1,
    ellipse: float | None = None,
    add: str | Sequence[str] = (),
    carry: str | Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Localization:
    """Estimate positions from a table of measurements; the results are those of ``nlosctl localize``, to the bit.

    ``table`` is a pyarrow Table, a DataFrame of polars or pandas, a dict of columns, anything else that
    `pyarrow.table` accepts, or the path of a file, folder or glob (a list of them: several files). ``scene`` is a Scene
    or the path of a scene file; default: the scene in the table's metadata, or beside its file. ``columns`` maps
    standard column names to those of the table, ``constants`` missing standard deviations to their values;
    ``bearing_std_deg=2.0`` is short for ``constants={"bearing_std_deg": 2.0}``. A bad row is an error, unless
    ``bad_rows`` is True (the result has them in ``bad_rows``) or the name of a file for them. ``field`` is the search
    region: ``xmin,xmax,ymin,ymax``, ``circle:x,y,r``, ``polygon:FILE`` or ``sensors:FACTOR``. ``target_z_m`` is the
    height of the targets if ranges are slant. ``crs`` or ``origin`` (latitude and longitude in degrees) define the
    local plane on earth. ``wide`` (``azimuth_deg=az_*``), ``missing``, ``where`` (``snr_db >= 10``), each one or
    several, and ``declination_deg`` change the rows before anything else, as the flags of the command line do.
    ``window`` (``2s``, ``auto`` or ``all``), ``by``, ``window_keep`` and ``timezone`` make snapshots of the column
    ``time_s`` or ``time``. ``estimate_std`` estimates unknown standard deviations: one factor for each
    ``snapshot``, each ``sensor`` or the whole ``file``. ``ellipse`` (a probability) and ``add`` (such as nees) add
    columns. ``dimensions`` is 2 or 3, by default as on the command line; in three, ``target_z_m`` is a height of the
    targets, exact without ``target_z_std_m``. ``speed_m_s`` is the speed of arrival times: ``light`` by default,
    ``sound`` or a number, ``speed_std_m_s`` its standard deviation. ``sweep`` runs parameters through several
    values, recorded in columns ``sweep_KEY``; ``parameters`` are those of the method.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    read = input_options(columns, constants, scene, parameters, kind=kind, all_rows=all_rows, crs=crs, origin=origin)
    options = SolveOptions(
        method=names_of(method),
        parameters=parameters,
        sweep=sweep or {},
        field=parse_field(field),
        target_z_m=target_z_m,
        target_z_std_m=target_z_std_m,
        estimate_std=estimate_std,
        alternatives=alternatives,
        seed=seed,
        jobs=jobs,
        block_size=block_size,
    )
    write = OutputOptions(ellipse=ellipse, add=names_of(add), carry=names_of(carry))
    tables, report = _solve("localize", table, read, options, write, ["estimates", "flags"], bad_rows)
    return Localization(**tables, report=report)


def bound(
    table: Any,
    *,
    map: tuple[float, float, float, float, float] | None = None,
    scene: SceneLike = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    noise: str = "gaussian",
    use_ranges: bool = True,
    target_z_m: float | None = None,
    target_z_std_m: float | None = None,
    motion: str = "none",
    **stds: Any,
) -> Any:
    """Return the Cramér-Rao bound of each snapshot at its true position as a table; see ``nlosctl bound``.

    With ``map`` (xmin, xmax, ymin, ymax, step, in metres) the bound is over a grid of positions, for the sensors, paths
    and standard deviations of the first snapshot. ``noise`` is the error distribution, gaussian or laplace; without
    ``use_ranges`` the ranges in a table of bearings are not used. ``target_z_m`` is the height of the
    source, for slant ranges. ``motion`` velocity is the bound on position and velocity of sources that move within a
    snapshot. The other arguments are those of `localize`.

    Raises DataError for faults of the data, UsageError for an invalid map.
    """
    read = input_options(columns, constants, scene, stds, kind=kind, all_rows=all_rows, crs=crs, origin=origin)
    heights: dict[str, Any] = {"target_z_m": target_z_m, "target_z_std_m": target_z_std_m}
    options = SolveOptions(noise=noise, use_ranges=use_ranges, parameters={"motion": motion}, **heights)
    bounds = TableSink()
    bound_job.bound(
        inputs_of(table),
        None if map is None else ",".join(str(float(number)) for number in map),
        read,
        options,
        OutputOptions(),
        Destination(sinks={"bound": bounds.start}),
    )
    return bounds.table()


def detect_ip(
    table: Any,
    *,
    method: str | Sequence[str] = "chi2",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    bad_rows: BadRows = None,
    details: bool = False,
    carry: str | Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Detection:
    """Flag indirect paths in a table of triplets; the results are those of ``nlosctl detect-ip``, to the bit.

    ``details`` adds the test statistics behind each flag; the estimates are None if no method makes any. The other
    arguments are those of `localize`.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    read = input_options(columns, constants, None, parameters, kind="triplets", all_rows=all_rows)
    options = SolveOptions(
        method=names_of(method), parameters=parameters, sweep=sweep or {}, seed=seed, jobs=jobs, block_size=block_size
    )
    write = OutputOptions(details=details, carry=names_of(carry))
    estimated = any(registry.resolve(name, "triplets", "detect-ip").estimates for name in options.method)
    wanted = ["flags", *(["estimates"] if estimated else [])]
    tables, report = _solve("detect-ip", table, read, options, write, wanted, bad_rows)
    return Detection(**{"estimates": None, **tables}, report=report)


def identify_los(
    table: Any,
    *,
    method: str | Sequence[str] = "assignment",
    kind: str | None = None,
    field: str = "sensors:1",
    target_z_m: float | None = None,
    target_z_std_m: float | None = None,
    scene: SceneLike = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    bad_rows: BadRows = None,
    alternatives: int = 1,
    carry: str | Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Localization:
    """Identify the line-of-sight rows of several targets; the results are those of ``nlosctl identify-los``.

    The table has ranges or bearings, any number per sensor, in any order; one with both is read as ranges unless
    ``kind`` is ``bearings``. ``field`` is the region where targets are searched for.
    The other arguments are those of `localize`.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    read = input_options(columns, constants, scene, parameters, kind=kind, all_rows=all_rows)
    options = SolveOptions(
        method=names_of(method),
        parameters=parameters,
        sweep=sweep or {},
        field=parse_field(field),
        target_z_m=target_z_m,
        target_z_std_m=target_z_std_m,
        alternatives=alternatives,
        seed=seed,
        jobs=jobs,
        block_size=block_size,
    )
    wanted = ["flags", "estimates"]
    write = OutputOptions(carry=names_of(carry))
    tables, report = _solve("identify-los", table, read, options, write, wanted, bad_rows)
    return Localization(**tables, report=report)


def _solve(
    job: Job,
    table: Any,
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    wanted: Sequence[str],
    bad_rows: BadRows,
) -> tuple[dict[str, Any], RunReport]:
    sinks = {name: TableSink() for name in wanted}
    destination = Destination(sinks={name: sink.start for name, sink in sinks.items()})
    with set_aside(bad_rows) as aside:
        run = solve(job, inputs_of(table), read, options, replace(write, **aside.options), destination)
        return {**{name: sink.table() for name, sink in sinks.items()}, **aside.tables()}, run.report
