"""The jobs of the command line as functions on Arrow tables: what ``import nlosctl`` offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any

from nlosctl.contract.fields import parse_field
from nlosctl.contract.scene import EarthFrame, Scene, parse_frame
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import MeasurementReader, ReadOptions
from nlosctl.io.results.in_memory import gather, input_of_table
from nlosctl.pipeline.bound.bounds import BoundSettings, bounds_at_truth, bounds_on_map, parse_map, result_schema
from nlosctl.pipeline.engine.workers import usable_jobs
from nlosctl.pipeline.evaluate.evaluate import Evaluation, evaluate_inputs
from nlosctl.pipeline.evaluate.evaluate_targets import evaluate_targets
from nlosctl.pipeline.simulate.simulation import Simulation
from nlosctl.pipeline.solve.method_runs import MethodRun, method_runs
from nlosctl.pipeline.solve.report import RunReport
from nlosctl.pipeline.solve.run import MeasurementRun
from nlosctl.pipeline.solve.settings import RunSettings

__all__ = ["Detection", "Localization", "bound", "detect_ip", "evaluate", "identify_los", "localize", "simulate"]


@dataclass(frozen=True, kw_only=True)
class Localization:
    """Estimates and flags as Arrow tables, as the command line writes them, and the report of the run."""

    estimates: Any
    flags: Any
    report: RunReport


def localize(
    table: Any,
    *,
    method: str | Sequence[str] = "ml",
    scene: Scene | str | PathLike[str] | None = None,
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
    add: Sequence[str] = (),
    carry: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Localization:
    """Estimate positions from a table of measurements; the same results to the bit as ``nlosctl localize``.

    ``table`` is a pyarrow Table (or anything that `pyarrow.table` takes). ``scene`` is a Scene or the path of a scene
    file; else the one in the table's metadata. ``columns`` reads a column under another name (the contract's name ->
    the table's), ``constants`` gives missing std columns, in radians or metres; ``field`` is in the
    words of ``--field``, ``target_z_m`` the height of the targets where ranges are slant. ``crs`` or ``origin``
    (latitude and longitude in degrees) tell how x and y lie on earth; ``ellipse`` and ``add`` (cep50, gdop) ask for
    further columns. ``sweep`` gives parameters in turn several values, told in columns ``sweep_KEY``;
    ``parameters`` are the method's.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    frame = _frame(crs, origin)
    reader = _reader(
        table, kind=kind, columns=columns, constants=constants, scene=scene, frame=frame, all_rows=all_rows
    )
    settings = RunSettings(
        seed=seed,
        jobs=usable_jobs(jobs),
        block_size=block_size,
        alternatives=alternatives,
        ellipse=ellipse,
        add=tuple(add),
        carry=tuple(carry),
        field=parse_field(field),
        target_z_m=target_z_m,
        want_flags=True,
    )
    return _localization(reader, method_runs(_names(method), reader.kind, "localize", parameters, sweep), settings)


def bound(
    table: Any,
    *,
    map: tuple[float, float, float, float, float] | None = None,
    scene: Scene | str | PathLike[str] | None = None,
    crs: str | None = None,
    origin: tuple[float, float] | None = None,
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    noise: str = "gaussian",
    use_ranges: bool = True,
) -> Any:
    """Return the Cramer-Rao bound of each snapshot at its truth as a table; see ``nlosctl bound``.

    With ``map`` (least x, largest x, least y, largest y, step, in metres) over a grid of positions instead, for the
    sensors, paths and stds of the first snapshot. ``noise`` is the errors' distribution, gaussian or
    laplace; without ``use_ranges`` the ranges beside bearings don't count. The other arguments are those of `localize`.

    Raises DataError for faults of the data, UsageError for a map that is none.
    """
    frame = _frame(crs, origin)
    reader = _reader(
        table, kind=kind, columns=columns, constants=constants, scene=scene, frame=frame, all_rows=all_rows
    )
    grid = None if map is None else parse_map(",".join(str(float(number)) for number in map))
    settings = BoundSettings(noise=noise, use_ranges=use_ranges)
    tables = bounds_at_truth(reader, settings) if grid is None else bounds_on_map(reader, grid, settings)
    return gather(list(tables), result_schema(reader, grid))


def _reader(
    table: Any,
    *,
    kind: str | None,
    columns: Mapping[str, str] | None,
    constants: Mapping[str, float] | None,
    all_rows: bool,
    scene: Scene | str | PathLike[str] | None = None,
    frame: EarthFrame | None = None,
) -> MeasurementReader:
    options = ReadOptions(
        kind=kind,
        renames=dict(columns or {}),
        constants=dict(constants or {}),
        scene=scene if isinstance(scene, Scene) else None,
        scene_file=None if scene is None or isinstance(scene, Scene) else fspath(scene),
        all_rows=all_rows,
        frame=frame,
    )
    return MeasurementReader([input_of_table(table)], options)


def _frame(crs: str | None, origin: tuple[float, float] | None) -> EarthFrame | None:
    if crs is not None and origin is not None:
        raise UsageError("crs and origin both say how the plane lies on earth; give one")
    if origin is not None:
        return parse_frame(f"{origin[0]!r} {origin[1]!r}", "origin")
    return None if crs is None else parse_frame(crs, "crs")


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Flags as an Arrow table, as the command line writes them, estimates or None, and the report of the run."""

    flags: Any
    estimates: Any | None
    report: RunReport


def detect_ip(
    table: Any,
    *,
    method: str | Sequence[str] = "chi2",
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    details: bool = False,
    carry: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Detection:
    """Flag indirect paths in a table of triplets; the same results to the bit as ``nlosctl detect-ip``.

    ``details`` adds what the flags were decided by; the estimates are None where no method makes any. The rest as in
    `localize`.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    reader = _reader(table, kind="triplets", columns=columns, constants=constants, all_rows=all_rows)
    runs = method_runs(_names(method), reader.kind, "detect-ip", parameters, sweep)
    settings = RunSettings(
        seed=seed,
        jobs=usable_jobs(jobs),
        block_size=block_size,
        carry=tuple(carry),
        want_estimates=any(run.spec.estimates for run in runs),
        want_flags=True,
        want_details=details,
    )
    run = MeasurementRun(reader, runs, settings)
    chunks = list(run.tables())
    estimates = None
    if settings.want_estimates:
        estimates = gather([chunk.estimates for chunk in chunks], run.schemas["estimates"])
    flags = gather([chunk.flags for chunk in chunks], run.schemas["flags"])
    return Detection(flags=flags, estimates=estimates, report=run.report)


def identify_los(
    table: Any,
    *,
    method: str | Sequence[str] = "assignment",
    field: str = "sensors:1",
    target_z_m: float | None = None,
    scene: Scene | str | PathLike[str] | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    alternatives: int = 1,
    carry: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 8192,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Localization:
    """Tell the direct echoes of several targets from all others; the same to the bit as ``nlosctl identify-los``.

    The table holds ranges, any number of each sensor, in any order. ``field`` says where targets may be, in the words
    of ``--field``. The rest as in `localize`.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    reader = _reader(table, kind="ranges", columns=columns, constants=constants, scene=scene, all_rows=all_rows)
    settings = RunSettings(
        seed=seed,
        jobs=usable_jobs(jobs),
        block_size=block_size,
        alternatives=alternatives,
        carry=tuple(carry),
        field=parse_field(field),
        target_z_m=target_z_m,
        want_flags=True,
    )
    return _localization(reader, method_runs(_names(method), reader.kind, "identify-los", parameters, sweep), settings)


def _names(method: str | Sequence[str]) -> list[str]:
    return [method] if isinstance(method, str) else list(method)


def _localization(reader: MeasurementReader, runs: Sequence[MethodRun], settings: RunSettings) -> Localization:
    run = MeasurementRun(reader, runs, settings)
    chunks = list(run.tables())
    return Localization(
        estimates=gather([chunk.estimates for chunk in chunks], run.schemas["estimates"]),
        flags=gather([chunk.flags for chunk in chunks], run.schemas["flags"]),
        report=run.report,
    )


def simulate(
    scenario: str,
    *,
    trials: int = 1000,
    seed: int = 0,
    sweep: Mapping[str, Sequence[Any]] | None = None,
    **parameters: Any,
) -> Any:
    """Draw a table of measurements with their truth; its metadata carries the scene.

    ``sweep`` gives parameters in turn several values, ``trials`` snapshots of each; see ``nlosctl simulate``. Raises
    UsageError for an unknown scenario or parameter.
    """
    simulation = Simulation(scenario, parameters, seed=seed, trials=trials, sweep=sweep)
    return gather(list(simulation.tables()), simulation.schema, simulation.metadata)


def evaluate(
    table: Any,
    *,
    best_alternative: bool = False,
    estimates: Any | None = None,
    ospa_order: float = 2.0,
    ospa_cutoff_m: float = 20.0,
) -> Evaluation:
    """Hold a table of estimates (or flags) against the truth in it, by method; see ``nlosctl evaluate``.

    With ``estimates`` the table is the flags of `identify_los` that belong to them. Raises DataError where the table
    is neither, or has no truth.
    """
    if estimates is not None:
        given = input_of_table(estimates)
        return evaluate_targets(input_of_table(table), given, order=ospa_order, cutoff_m=ospa_cutoff_m)
    return evaluate_inputs([input_of_table(table)], truth=None, best_alternative=best_alternative)
