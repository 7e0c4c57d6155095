"""What to do where most snapshots of a run do not fit, or none has a fix: advice by kind and status."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl import registry
from nlosctl.contract.fields import Field
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.pipeline.solve.method_runs import MethodRun, MethodTally
from nlosctl.pipeline.solve.motion.moving_sources import estimates_velocity
from nlosctl.pipeline.solve.report import RunReport

__all__ = ["Measured", "advice", "offers_mixture", "report_alone"]

_FEWEST_WITH_OUTLIER = 4
_MOST_SNAPSHOTS = 200

_FEWEST_CONVINCING = 5
_LENGTHS = "are positions and measurements in the units of their columns (metres; range_km, range_cm, range_mm)?"
_ONE_SOURCE = "are the rows of a snapshot of one source, and are their standard deviations correct?"
_ADVICE = {
    ("bearings", Status.DEGENERATE): "the lines are nearly parallel for their errors, or meet at a sensor: "
    "are the bearings of one source, their standard deviations in the unit of the column, and the positions in metres?",
    (
        "ranges",
        Status.NO_CANDIDATE,
    ): f"no two circles meet within the search region: {_LENGTHS} Else enlarge it by `field`",
    ("ranges", Status.DEGENERATE): f"the circles do not determine a point: {_LENGTHS}",
    ("arrivals", Status.DEGENERATE): "the arrivals do not determine a point: are they in the unit of their column, the "
    "positions in metres, and `speed_m_s` that of the wave (light by default; sound: 343)?",
    ("triplets", Status.DEGENERATE): "the paths do not determine a point: are they longer than the way from "
    "transmitter to receiver, and the positions in metres?",
}
_OF_ALL_KINDS = {
    Status.BEHIND: f"the lines meet behind sensors: {_ONE_SOURCE}",
    Status.NOT_CONVERGED: _LENGTHS,
    Status.NO_CANDIDATE: "no two rows agree within the search region; enlarge it by `field`",
    Status.NO_TARGET: "no path is direct: are the standard deviations correct?",
    Status.NO_CONSENSUS: _ONE_SOURCE,
}


@dataclass(frozen=True, kw_only=True)
class Measured:
    """What the trials know of the input: kind, scene, columns after renaming, headers by new names, constants."""

    kind: str
    scene: Scene
    names: Collection[str]
    headers: Mapping[str, str]
    constants: Collection[str]

    @classmethod
    def of(cls, reader: MeasurementReader) -> Measured:
        """Return what a reader knows of its inputs."""
        return cls(
            kind=reader.kind,
            scene=reader.scene,
            names=reader.column_names,
            headers=reader.options.columns,
            constants=reader.constants,
        )

    def option(self, name: str, other: str) -> str:
        """Return the setting that reads the file's column for ``name`` as ``other``."""
        return f"`columns` {other}={self.headers.get(name, name)}"


def advice(runs: Sequence[MethodRun], report: RunReport, reader: MeasurementReader) -> list[str]:
    """Return the likely cause where most snapshots do not fit, else advice by the statuses if there is no fix."""
    measured = Measured.of(reader)
    if report.refits:
        from nlosctl.pipeline.solve.likely_causes import cause_remarks

        causes = cause_remarks(report.refits, measured)
        if causes:
            return causes
    return _no_fix(runs, report, measured)


def report_alone(chunk: Chunk, reader: MeasurementReader, run: MethodRun, field: Field) -> RunReport:
    """Return the counts of the first 200 snapshots of a chunk, each solved by itself, for `advice`.

    They are what a command can say of measurements that it does not localize snapshot by snapshot.
    """
    from nlosctl.pipeline.solve.likely_causes import fit_after_changes, some_snapshots
    from nlosctl.pipeline.solve.solve_chunk import ChunkSolver

    part = some_snapshots(chunk, np.arange(min(len(chunk.snapshot), _MOST_SNAPSHOTS)))
    made: dict[str, Any] = {"scene": reader.scene, "dimension": reader.dimension, "field": field}
    made["calibration"] = reader.options.calibration
    solver = ChunkSolver(kind=reader.kind, runs=(run,), **made)
    estimates = solver.solve(part, snapshot_seeds(0, part.snapshot_ids())).estimates
    assert estimates is not None  # noqa: S101 - the method estimates
    report = RunReport(reader.kind, inputs=[], snapshots=len(part.snapshot), methods={run.label: MethodTally()})
    report.largest_snapshot = int(np.add.reduceat(~part.left_out, part.offsets[:-1], dtype=np.int64).max())
    report.methods[run.label].add_estimates(estimates, 0)
    if report.methods[run.label].mostly_bad and reader.dimension == 2:
        report.refits.update(fit_after_changes(part, reader))
    return report


def _no_fix(runs: Sequence[MethodRun], report: RunReport, measured: Measured) -> list[str]:
    """Return a line of advice if no method of ``localize`` has a fix; it follows from the most frequent status."""
    tallies = [report.methods[run.label] for run in runs]
    located = any(tally.answered or tally.statuses[Status.OUTSIDE_FIELD.word] for tally in tallies)
    if not located and report.snapshots:
        unlabelled = [run for run in runs if (run.spec.job, run.spec.kind) == ("identify-los", "bearings")]
        if unlabelled:
            column = measured.headers.get("snapshot", "snapshot")
            lone = report.largest_snapshot == 1
            return [_few_rows([run], report, column) if lone else _no_target(run) for run in unlabelled]
    if located or not report.snapshots or all(run.spec.job != "localize" for run in runs):
        return []
    statuses: Counter[str] = sum((tally.statuses for tally in tallies), Counter())
    status = next(status for status in Status if status.word == statuses.most_common(1)[0][0])
    column = measured.headers.get("snapshot", "snapshot")
    few = status == Status.TOO_FEW
    advice = _few_rows(runs, report, column) if few else _of_status(runs, report, status)
    return [f"no snapshot has a fix ({statuses[status.word]} of {statuses.total()} are {status.word}): {advice}"]


def _no_target(run: MethodRun) -> str:
    least = getattr(run.options, "min_sensors", 1)
    return (
        f"{run.label}: no snapshot has a target: with min_sensors={least} the rows of so many sensors must meet in the "
        "search region; are there so many, and are the standard deviations correct?"
    )


def _few_rows(runs: Sequence[MethodRun], report: RunReport, snapshot_column: str) -> str:
    largest, least = report.largest_snapshot, min(run.spec.minimum_measurements for run in runs)
    if largest == 1 and report.snapshots > 1:
        return (
            f"every snapshot has one row, because no two rows have the same {snapshot_column!r}; give the rows of one "
            "position of the source the same value, or make snapshots of times: read them as 'time_s' (or 'time', ISO "
            "8601) instead of 'snapshot', and set `window`"
        )
    rows = "1 row" if largest == 1 else f"{largest} rows"
    if largest >= max(least, 2):
        return f"the largest snapshot has {rows}, but too few of them are of sensors at different positions"
    needed = f"at least {least} rows are needed" if least > 1 else "a fix needs at least two measured values"
    return f"the largest snapshot has {rows} that take part, and {needed}"


def _of_status(runs: Sequence[MethodRun], report: RunReport, status: Status) -> str:
    if status == Status.DEGENERATE and any(map(estimates_velocity, runs)):
        return (
            "positions and velocities are not observable: bearings of one moving sensor need a turn of it within each "
            "snapshot, and rows of sensors at rest those of two or more"
        )
    if status == Status.BEHIND and offers_mixture(runs, report):
        return "the lines meet behind sensors; if some bearings are outliers, try `method` mixture-ml"
    if status == Status.NO_CONSENSUS and report.largest_snapshot < _FEWEST_CONVINCING:
        return (
            f"what agrees in {report.largest_snapshot} rows may agree by chance; give more rows a snapshot, or use a "
            "method that trusts all rows (`method` ml)"
        )
    return _ADVICE.get((report.kind, status)) or _OF_ALL_KINDS.get(status, status.meaning)


def offers_mixture(runs: Sequence[MethodRun], report: RunReport) -> bool:
    """Return whether mixture-ml exists for the kind and job of the runs, did not run, and could find an outlier."""
    if any(map(estimates_velocity, runs)):
        return False
    if "mixture-ml" in {run.spec.name for run in runs} or report.largest_snapshot < _FEWEST_WITH_OUTLIER:
        return False
    known = [entry for entry in registry.entries() if entry.full_name == f"{report.kind}.mixture-ml"]
    return any(registry.load(entry).job in {run.spec.job for run in runs} for entry in known)
