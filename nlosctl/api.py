"""The jobs of the command line as functions on Arrow tables: what ``import nlosctl`` offers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import Any

from nlosctl.contract.scene import Scene
from nlosctl.io.in_memory import gather, input_of_table
from nlosctl.io.measurements import MeasurementReader, ReadOptions
from nlosctl.pipeline.bounding import bounds_at_truth, bounds_on_map, parse_map, result_schema
from nlosctl.pipeline.evaluating import Evaluation, evaluate_inputs
from nlosctl.pipeline.parameters import method_runs
from nlosctl.pipeline.report import RunReport
from nlosctl.pipeline.run import MeasurementRun, RunSettings
from nlosctl.pipeline.simulation import Simulation
from nlosctl.pipeline.workers import usable_jobs

__all__ = ["Localization", "bound", "evaluate", "localize", "simulate"]


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
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
    alternatives: int = 1,
    carry: Sequence[str] = (),
    seed: int = 0,
    jobs: int = 1,
    block_size: int = 4096,
    **parameters: Any,
) -> Localization:
    """Estimate positions from a table of measurements; the same results to the bit as ``nlosctl localize``.

    ``table`` is a pyarrow Table (or anything that `pyarrow.table` takes). ``scene`` is a Scene or the path of a scene
    file; else the one in the table's metadata. ``columns`` reads a column under another name (the contract's name ->
    the table's), ``constants`` gives missing std columns, in radians or metres. ``parameters`` are the method's.

    Raises DataError for faults of the data, UsageError for an unknown method or parameter.
    """
    options = ReadOptions(
        kind=kind,
        renames=dict(columns or {}),
        constants=dict(constants or {}),
        scene=scene if isinstance(scene, Scene) else None,
        scene_file=None if scene is None or isinstance(scene, Scene) else fspath(scene),
        all_rows=all_rows,
    )
    reader = MeasurementReader([input_of_table(table)], options)
    names = [method] if isinstance(method, str) else list(method)
    settings = RunSettings(
        seed=seed,
        jobs=usable_jobs(jobs),
        block_size=block_size,
        alternatives=alternatives,
        carry=tuple(carry),
        want_flags=True,
    )
    run = MeasurementRun(reader, method_runs(names, reader.kind, "localize", parameters), settings)
    chunks = list(run.tables())
    return Localization(
        estimates=gather([chunk.estimates for chunk in chunks], run.estimates_schema),
        flags=gather([chunk.flags for chunk in chunks], run.flags_schema),
        report=run.report,
    )


def bound(
    table: Any,
    *,
    map: tuple[float, float, float, float, float] | None = None,
    scene: Scene | str | PathLike[str] | None = None,
    kind: str | None = None,
    columns: Mapping[str, str] | None = None,
    constants: Mapping[str, float] | None = None,
    all_rows: bool = False,
) -> Any:
    """Return the Cramer-Rao bound of each snapshot at its truth as a table; see ``nlosctl bound``.

    With ``map`` (least x, largest x, least y, largest y, step, in metres) over a grid of positions instead, for the
    sensors, paths and stds of the first snapshot. The other arguments are those of `localize`.

    Raises DataError for faults of the data, UsageError for a map that is none.
    """
    options = ReadOptions(
        kind=kind,
        renames=dict(columns or {}),
        constants=dict(constants or {}),
        scene=scene if isinstance(scene, Scene) else None,
        scene_file=None if scene is None or isinstance(scene, Scene) else fspath(scene),
        all_rows=all_rows,
    )
    reader = MeasurementReader([input_of_table(table)], options)
    grid = None if map is None else parse_map(",".join(str(float(number)) for number in map))
    tables = bounds_at_truth(reader) if grid is None else bounds_on_map(reader, grid)
    return gather(list(tables), result_schema(reader, grid))


def simulate(scenario: str, *, trials: int = 1000, seed: int = 0, **parameters: Any) -> Any:
    """Draw a table of measurements with their truth; its metadata carries the scene.

    Raises UsageError for an unknown scenario or parameter.
    """
    simulation = Simulation(scenario, parameters, seed=seed, trials=trials)
    return gather(list(simulation.tables()), simulation.schema, simulation.metadata)


def evaluate(table: Any, *, best_alternative: bool = False) -> Evaluation:
    """Hold a table of estimates (or flags) against the truth in it, by method; see ``nlosctl evaluate``.

    Raises DataError where the table is neither, or has no truth.
    """
    return evaluate_inputs([input_of_table(table)], truth=None, best_alternative=best_alternative)
