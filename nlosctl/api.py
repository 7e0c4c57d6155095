"""The jobs of the command line as functions on Arrow tables: what ``import nlosctl`` provides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any

from nlosctl import registry
from nlosctl.contract.fields import parse_field
from nlosctl.contract.methods import Job
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.io.results.in_memory import gather, input_of_table
from nlosctl.jobs import bound as bound_job
from nlosctl.jobs import evaluate as evaluate_job
from nlosctl.jobs import simulate as simulate_job
from nlosctl.jobs.files import Destination
from nlosctl.jobs.solve import solve
from nlosctl.pipeline.evaluate.evaluate import Evaluation
from nlosctl.pipeline.solve.report import RunReport

__all__ = ["Detection", "Localization", "bound", "detect_ip", "evaluate", "identify_los", "localize", "simulate"]

SceneLike = Scene | str | PathLike[str] | None


@dataclass(frozen=True, kw_only=True)
class Localization:
    """Estimates and flags as Arrow tables, as the command line writes them, and the report of the run."""

    estimates: Any
    flags: Any
    report: RunReport


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Flags as an Arrow table, as the command line writes them, estimates or None, and the report of the run."""

    flags: Any
    estimates: Any | None
    report: RunReport


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
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
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

    ``table`` is a pyarrow Table, or anything that `pyarrow.table` accepts. ``scene`` is a Scene or the path of a scene
    file; default: the scene in the table's metadata. ``columns`` maps standard column names to those of the table,
    ``constants`` missing standard deviations to their values, in radians or metres. ``field`` is the search region:
    ``xmin,xmax,ymin,ymax``, ``circle:x,y,r``, ``polygon:FILE`` or ``sensors:FACTOR``. ``target_z_m`` is the height of
    the targets if ranges are slant. ``crs`` or ``origin`` (latitude and longitude in degrees) define the local plane
    on earth. ``ellipse`` (a probability) and ``add`` (such as nees) add columns. ``sweep`` runs parameters through
    several values, recorded in columns ``sweep_KEY``; ``parameters`` are those of the method.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    read = _input_options(columns, constants, scene, kind=kind, all_rows=all_rows, crs=crs, origin=origin)
    options = SolveOptions(
        method=_names(method),
        parameters=parameters,
        sweep=sweep or {},
        field=parse_field(field),
        target_z_m=target_z_m,
        alternatives=alternatives,
        seed=seed,
        jobs=jobs,
        block_size=block_size,
    )
    write = OutputOptions(ellipse=ellipse, add=_names(add), carry=_names(carry))
    tables, report = _solve("localize", table, read, options, write, ["estimates", "flags"])
    return Localization(estimates=tables["estimates"], flags=tables["flags"], report=report)


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
) -> Any:
    """Return the Cramér-Rao bound of each snapshot at its true position as a table; see ``nlosctl bound``.

    With ``map`` (xmin, xmax, ymin, ymax, step, in metres) the bound is over a grid of positions, for the sensors, paths
    and standard deviations of the first snapshot. ``noise`` is the error distribution, gaussian or laplace; without
    ``use_ranges`` the ranges in a table of bearings are not used. The other arguments are those of `localize`.

    Raises DataError for faults of the data, UsageError for an invalid map.
    """
    read = _input_options(columns, constants, scene, kind=kind, all_rows=all_rows, crs=crs, origin=origin)
    options = SolveOptions(noise=noise, use_ranges=use_ranges)
    bounds = _TableSink()
    bound_job.bound(
        [input_of_table(table)],
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
    read = _input_options(columns, constants, None, kind="triplets", all_rows=all_rows)
    options = SolveOptions(
        method=_names(method), parameters=parameters, sweep=sweep or {}, seed=seed, jobs=jobs, block_size=block_size
    )
    write = OutputOptions(details=details, carry=_names(carry))
    estimated = any(registry.resolve(name, "triplets", "detect-ip").estimates for name in options.method)
    wanted = ["flags", *(["estimates"] if estimated else [])]
    tables, report = _solve("detect-ip", table, read, options, write, wanted)
    return Detection(flags=tables["flags"], estimates=tables.get("estimates"), report=report)


def identify_los(
    table: Any,
    *,
    method: str | Sequence[str] = "assignment",
    field: str = "sensors:1",
    target_z_m: float | None = None,
    scene: SceneLike = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    alternatives: int = 1,
    carry: str | Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Localization:
    """Identify the line-of-sight echoes of several targets; the results are those of ``nlosctl identify-los``.

    The table has ranges, any number per sensor, in any order. ``field`` is the region where targets are searched for.
    The other arguments are those of `localize`.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    read = _input_options(columns, constants, scene, kind="ranges", all_rows=all_rows)
    options = SolveOptions(
        method=_names(method),
        parameters=parameters,
        sweep=sweep or {},
        field=parse_field(field),
        target_z_m=target_z_m,
        alternatives=alternatives,
        seed=seed,
        jobs=jobs,
        block_size=block_size,
    )
    wanted = ["flags", "estimates"]
    tables, report = _solve("identify-los", table, read, options, OutputOptions(carry=_names(carry)), wanted)
    return Localization(estimates=tables["estimates"], flags=tables["flags"], report=report)


def simulate(
    scenario: str,
    *,
    trials: int = 1000,
    seed: int = 0,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Any:
    """Draw a table of measurements with ground truth; its metadata contain the scene.

    ``sweep`` runs parameters through several values, with ``trials`` snapshots each; see ``nlosctl simulate``. Raises
    UsageError for an unknown scenario or parameter.
    """
    options = SolveOptions(parameters=parameters, sweep=sweep or {}, seed=seed)
    drawn = _TableSink()
    simulate_job.simulate(scenario, trials, options, OutputOptions(), sink=drawn.start)
    return drawn.table()


def evaluate(
    table: Any,
    *,
    best_alternative: bool = False,
    estimates: Any | None = None,
    ospa_order: float = 2.0,
    ospa_cutoff_m: float = 20.0,
) -> Evaluation:
    """Compare a table of estimates (or flags) with the ground truth in it, by method; see ``nlosctl evaluate``.

    With ``estimates``, the table is the flags of `identify_los` that belong to them. Raises DataError if the table is
    neither estimates nor flags, or has no ground truth.
    """
    evaluation, _ = evaluate_job.evaluate(
        [input_of_table(table)],
        InputOptions(),
        OutputOptions(),
        estimates=None if estimates is None else input_of_table(estimates),
        ospa_order=ospa_order,
        ospa_cutoff_m=ospa_cutoff_m,
        best_alternative=best_alternative,
    )
    return evaluation


class _TableSink:
    """A sink that keeps the tables of a job in memory."""

    def __init__(self) -> None:
        self._tables: list[Any] = []
        self._schema: Any = None
        self._metadata: Mapping[str, str] | None = None

    def start(self, schema: Any, metadata: Mapping[str, str] | None = None) -> _TableSink:
        """Set the schema of the following tables, and the metadata of the whole; return the sink."""
        self._schema, self._metadata = schema, metadata
        return self

    def write(self, table: Any) -> None:
        """Receive rows."""
        self._tables.append(table)

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Ignore the metadata that only files have."""

    def table(self) -> Any:
        """Return all rows as one table."""
        return gather(self._tables, self._schema, self._metadata)


def _solve(
    job: Job, table: Any, read: InputOptions, options: SolveOptions, write: OutputOptions, wanted: Sequence[str]
) -> tuple[dict[str, Any], RunReport]:
    sinks = {name: _TableSink() for name in wanted}
    destination = Destination(sinks={name: sink.start for name, sink in sinks.items()})
    run = solve(job, [input_of_table(table)], read, options, write, destination)
    return {name: sink.table() for name, sink in sinks.items()}, run.report


def _input_options(
    columns: Mapping[str, str] | None, constants: Mapping[str, float] | None, scene: SceneLike, **rest: Any
) -> InputOptions:
    scene = scene if scene is None or isinstance(scene, Scene) else fspath(scene)
    return InputOptions(columns=dict(columns or {}), constants=dict(constants or {}), scene=scene, **rest)


def _names(names: str | Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)
