"""How the rows of tracks fit their paths, and the notes of a run on them."""

from __future__ import annotations

import dataclasses

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.fields import Field
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE
from nlosctl.contract.statuses import Status
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.pipeline.solve.advice import advice, report_alone
from nlosctl.pipeline.solve.method_runs import MethodRun, unused_columns
from nlosctl.pipeline.solve.report import RunReport, bad_fit_remarks, chi_square_p_value

__all__ = ["run_remarks", "with_p_values"]


def with_p_values(estimates: ChunkEstimates, run: MethodRun, cost: FloatArray, n_residuals: IntArray) -> ChunkEstimates:
    """Return the states (S,) with p-values of their rows, for the counts of the report alone.

    They are upper limits: the degrees of freedom are all residuals (S,), although the path follows them. NaN for a
    method whose cost (S,) is not half a chi-square.
    """
    tested = estimates.status == Status.OK
    if run.spec.cost != LEAST_HALF_CHI_SQUARE or getattr(run.options, "law", "gaussian") != "gaussian":
        tested = np.zeros_like(tested)
    p_value = np.where(tested, chi_square_p_value(2.0 * cost, n_residuals), np.nan)
    return dataclasses.replace(estimates, fit_p_value=p_value)


def run_remarks(
    reader: MeasurementReader, run: MethodRun, report: RunReport, first: Chunk | None, field: Field
) -> list[str]:
    """Return the notes on windows, columns without effect, and bad fits with their likely cause.

    The cause is that of the snapshots of the ``first`` chunk, each by itself.
    """
    remarks = [
        *(window_remarks(report.windows, reader.options.window) if report.windows else ()),
        *unused_columns([run], reader.kind, [*reader.schema.names, *reader.constants]),
        *bad_fit_remarks([run], report),
    ]
    if first is not None and report.methods[run.label].mostly_bad:
        remarks += advice([run], report_alone(first, reader, run, field), reader)
    return remarks
