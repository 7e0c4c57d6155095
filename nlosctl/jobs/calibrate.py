"""Job: estimate the offsets of sensors, together with the positions of all snapshots."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from nlosctl.contract.calibration import OFFSETS, Calibration
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.contract.tables import TRUTH_HEIGHT
from nlosctl.errors import UsageError
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.layouts import TRUTH_NAMES
from nlosctl.io.results.tables import calibration_table
from nlosctl.io.results.truth_table import TruthTable
from nlosctl.io.writers.output_set import OutputSet, check_targets
from nlosctl.jobs.files import (
    Destination,
    naming_importer,
    open_inputs,
    open_measurements,
    open_output,
    require_columns,
    write_report,
)
from nlosctl.jobs.solve import input_passes, readable_again
from nlosctl.pipeline.calibrate.calibration_report import CalibrationReport
from nlosctl.pipeline.calibrate.deviation_passes import estimate_deviations
from nlosctl.pipeline.calibrate.deviation_report import DeviationReport
from nlosctl.pipeline.calibrate.deviation_sums import DeviationSums
from nlosctl.pipeline.calibrate.known_positions import OWN_COLUMNS, KnownPositions
from nlosctl.pipeline.calibrate.offset_passes import estimate_offsets
from nlosctl.pipeline.calibrate.offset_sums import OffsetSums
from nlosctl.pipeline.engine.workers import usable_jobs
from nlosctl.pipeline.solve.advice import advice, report_alone
from nlosctl.pipeline.solve.method_runs import MethodRun, method_runs, unused_columns
from nlosctl.pipeline.solve.target_heights import refuse_dimension, with_target_heights

__all__ = ["Prior", "calibrate"]

_MOST_HARMONICS = 8


@dataclasses.dataclass(frozen=True, kw_only=True)
class Prior:
    """Priors of mean zero on the offset of every sensor: their stds, None without one."""

    offset_prior_m: float | None = None
    offset_prior_deg: float | None = None

    def std(self, kind: str) -> float | None:
        """Return the std for a kind of measurement, in its unit; raise UsageError for one that is of another kind."""
        own, other = ("deg", "m") if OFFSETS[kind].unit == "deg" else ("m", "deg")
        if getattr(self, f"offset_prior_{other}") is not None:
            raise UsageError(f"`offset_prior_{other}` is not for {kind}; set `offset_prior_{own}`")
        std: float | None = getattr(self, f"offset_prior_{own}")
        if std is not None and not 0.0 < std < math.inf:
            raise UsageError(f"`offset_prior_{own}` must be a finite number larger than 0. Got {std:g} instead.")
        return None if std is None else std * OFFSETS[kind].scale


def calibrate(
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    options: SolveOptions,
    write: OutputOptions,
    destination: Destination,
    *,
    truth: str | Sequence[Input] | None = None,
    prior: Prior | None = None,
    harmonics: int = 0,
) -> CalibrationReport:
    """Estimate the offsets of the sensors of measurements, and write them; return the report.

    The columns ``by`` of ``read`` have offsets of their own for each value. ``truth`` is a table of true positions, or
    ``columns``: those of the input. The targets are ``calibration`` (TOML) and ``table``, with a row per sensor. With
    ``harmonics`` bearings have deviations that depend on the direction relative to the heading, up to that order.
    Raises DataError for faults of the data, UsageError for options that don't suit them.
    """
    options = dataclasses.replace(options, jobs=options.jobs or usable_jobs(0))
    by = tuple(read.by)
    used = (*by, *TRUTH_NAMES, TRUTH_HEIGHT.name) if truth == OWN_COLUMNS else by
    read = _read_options(read, options, used, harmonics)
    with naming_importer(inputs):
        given = open_inputs(inputs, read.input_format)
    table = _truth_table(truth)
    with (
        readable_again(given, read, options) as sources,
        open_measurements(sources, read, write, dataclasses.replace(destination, targets={})) as opened,
        OutputSet() as outputs,
    ):
        targets = [*destination.targets.values(), None if write.report == "-" else write.report]
        check_targets(targets, overwrite=write.overwrite, inputs=opened.protected)
        known = None if truth is None else KnownPositions.of(opened.reader, table)
        sums = _sums(opened.reader, options, by, known, harmonics)
        prior_std = (prior or Prior()).std(sums.kind)
        opened.set_bad_rows_aside(write, outputs)
        advised = _count_rows(opened.reader, options, sums, destination)
        passes, show = input_passes(opened, options, write), destination.console.detail
        columns = ("sensor", *used)
        report: CalibrationReport
        if isinstance(sums, DeviationSums):
            deviations = estimate_deviations(sums, prior_std, passes, columns, show)
            report = DeviationReport.of_deviations(deviations, sums, opened.reader, prior_std)
        else:
            estimate = estimate_offsets(sums, prior_std, passes, columns, show, opened.reader.report.snapshots)
            report = CalibrationReport.of(estimate, sums, opened.reader, prior_std)
            report.advice = advised
        _write(report, write, destination, outputs)
    return report


def _read_options(read: InputOptions, options: SolveOptions, used: tuple[str, ...], harmonics: int) -> InputOptions:
    """Return the options of reading with the columns ``used``; raise UsageError for an uncertain speed."""
    if not 0 <= harmonics <= _MOST_HARMONICS:
        raise UsageError(f"`harmonics` must be at most {_MOST_HARMONICS}. Got {harmonics} instead.")
    if read.speed_std_m_s:
        raise UsageError("a calibration takes the speed of the wave as exactly known; leave `speed_std_m_s` out")
    by = () if read.window is None else read.by
    headings = Calibration(kind="bearings", harmonics=harmonics) if harmonics else None
    return dataclasses.replace(read, use_threads=options.jobs != 1, by=by, extra_columns=used, calibration=headings)


def _sums(
    reader: MeasurementReader, options: SolveOptions, by: tuple[str, ...], known: KnownPositions | None, harmonics: int
) -> OffsetSums:
    """Return the statistic of the passes, from offsets of zero; raise the errors of groups and of the method."""
    require_columns(by, reader)
    if "sensor" in by:
        raise UsageError("`by` sensor: every sensor has an offset of its own; leave it out")
    given: dict[str, Any] = {
        "kind": reader.kind,
        "dimension": reader.dimension,
        "scene": reader.scene,
        "run": _method_run(reader, options),
        "options": options,
        "by": by,
        "current": {},
        "truth": known,
    }
    if not harmonics:
        return OffsetSums(**given)
    if reader.dimension != 2:
        raise UsageError("`harmonics` are of bearings in two dimensions; set `dimensions` to 2")
    return DeviationSums(**given, harmonics=harmonics)


def _count_rows(
    reader: MeasurementReader, options: SolveOptions, sums: OffsetSums, destination: Destination
) -> list[str]:
    """Read the input to its end, with progress: its report counts the rows, and bad ones are set aside.

    Returns the notes on columns without effect, and advice where most of the first snapshots have no position of
    their own, or one that does not fit.
    """
    unused = unused_columns([sums.run], reader.kind, [*reader.schema.names, *reader.constants])
    advised: list[str] | None = None if sums.truth is None else []
    with destination.console.progress("calibrate") as progress:
        for chunk in reader.chunks():
            if advised is None:
                chunk = with_target_heights(chunk, reader.dimension, options)
                alone = report_alone(chunk, reader, sums.run, options.field)
                advised = advice([sums.run], alone, reader)
            progress(reader.report.rows_in_all, None)
    return [*unused, *(advised or [])]


def _truth_table(truth: str | Sequence[Input] | None) -> TruthTable | None:
    if truth is None or truth == OWN_COLUMNS:
        return None
    return TruthTable(open_inputs([truth] if isinstance(truth, str) else truth, None))


def _method_run(reader: MeasurementReader, options: SolveOptions) -> MethodRun:
    """Return the method of a calibration; raise UsageError for one that can't calibrate these measurements."""
    if reader.kind not in OFFSETS:
        raise UsageError(f"{reader.kind} have no offsets to calibrate; {', '.join(OFFSETS)} have")
    runs = method_runs(options.method, reader.kind, "localize", options.parameters)
    if len(runs) != 1:
        raise UsageError(f"`method`: a calibration is made by one method. Got {len(runs)}.")
    run = runs[0]
    if run.spec.direct_rows is None and run.spec.cost != LEAST_HALF_CHI_SQUARE:
        raise UsageError(f"{run.spec.name} can't calibrate {reader.kind}; ml and mixture-ml can")
    if run.open_options:
        raise UsageError(f"`parameters` {run.open_options[0]}=estimate: set a number to calibrate with")
    if getattr(run.options, "law", "gaussian") != "gaussian":
        raise UsageError(f"`parameters` law={run.options.law} has no offsets; leave it out to calibrate")
    refuse_dimension(runs, reader.dimension, options.field)
    return run


def _write(report: CalibrationReport, write: OutputOptions, destination: Destination, outputs: OutputSet) -> None:
    """Write the calibration as TOML and as a table, as wanted."""
    wanted = destination.wanted
    if "calibration" in wanted:
        outputs.write_text(wanted["calibration"], report.toml(), overwrite=write.overwrite)
    if "table" in wanted:
        table = calibration_table(report.calibration)
        outputs.take(open_output(wanted["table"], table.schema, write)).write(table)
    write_report(write, report.as_dict(), outputs, destination.console)
