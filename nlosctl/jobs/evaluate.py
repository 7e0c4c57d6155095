"""Job: compare estimates or flags with ground truth."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.run_options import InputOptions, OutputOptions
from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.errors import UsageError
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.tables import score_table
from nlosctl.io.results.truth_table import TruthTable
from nlosctl.io.writers.output_set import OutputSet, check_targets
from nlosctl.jobs.console import Silent
from nlosctl.jobs.files import open_inputs, open_output, write_report
from nlosctl.pipeline.evaluate.evaluate import evaluate_inputs
from nlosctl.pipeline.evaluate.evaluate_targets import evaluate_targets
from nlosctl.pipeline.evaluate.fail_conditions import parse_condition
from nlosctl.pipeline.evaluate.groups import Evaluation

__all__ = ["evaluate", "evaluation_report"]

_LARGEST_EXPONENT = 300.0
_ORDER, _CUTOFF_M = 2.0, 20.0


def evaluate(
    inputs: Sequence[str] | Sequence[Input],
    read: InputOptions,
    write: OutputOptions,
    *,
    truth: str | Sequence[Input] | None = None,
    estimates: str | Input | None = None,
    ospa_order: float = _ORDER,
    ospa_cutoff_m: float = _CUTOFF_M,
    best_alternative: bool = False,
    by: Sequence[str] = (),
    fail_if: Sequence[str] = (),
    wants_table: bool = False,
) -> tuple[Evaluation, list[str]]:
    """Evaluate estimates, or flags with their ``estimates``; return the figures and the ``fail_if`` conditions met.

    Each value of the columns ``by`` has figures of its own; those of flags are of their residuals. With ``wants_table``
    the figures are written to the output as a table, a row per method and swept values. Raises DataError if the inputs
    are neither estimates nor flags, or have no ground truth.
    """
    conditions = [parse_condition(text) for text in fail_if]
    given = open_inputs(inputs, read.input_format)
    paths = [part.path for table in given for part in table.parts if part.path is not None]
    check_targets(
        [write.output, None if write.report == "-" else write.report], overwrite=write.overwrite, inputs=paths
    )
    if estimates is not None:
        if truth is not None:
            raise UsageError("`truth` is for estimates; flags with their `estimates` have the truth in their rows")
        if len(given) > 1:
            raise UsageError("`estimates` goes with one file of flags; evaluate several one by one")
        if by:
            raise UsageError("`by` is not for flags with their `estimates`; leave out one of them")
        _check_distance(ospa_order, ospa_cutoff_m)
        targets = [estimates] if isinstance(estimates, Input) else open_inputs([estimates], None)
        evaluation = evaluate_targets(given[0], targets, order=ospa_order, cutoff_m=ospa_cutoff_m)
    else:
        truth_table = (
            None if truth is None else TruthTable(open_inputs([truth] if isinstance(truth, str) else truth, None))
        )
        evaluation = evaluate_inputs(
            given, truth=truth_table, best_alternative=best_alternative, by=by, speed_m_s=read.speed_m_s
        )
    ineffective = [
        *(["`alternatives` best"] if best_alternative and evaluation.of != "estimates" else []),
        *(["`ospa_order`"] if ospa_order != _ORDER and estimates is None else []),
        *(["`speed_m_s`"] if read.speed_m_s != LIGHT_M_S and evaluation.of != "residuals" else []),
        *(["`ospa_cutoff_m`"] if ospa_cutoff_m != _CUTOFF_M and estimates is None else []),
    ]
    if ineffective:
        note = f"no effect on {evaluation.of}: {', '.join(ineffective)}"
        evaluation = dataclasses.replace(evaluation, notes=(*evaluation.notes, note))
    remarks = tuple(remark for table in given for remark in table.remarks)
    evaluation = dataclasses.replace(evaluation, notes=(*remarks, *evaluation.notes))
    reasons = [reason for condition in conditions for reason in condition.reasons(evaluation.groups)]
    with OutputSet() as outputs:
        if wants_table:
            table = score_table(evaluation.of, evaluation.groups, evaluation.by)
            outputs.take(open_output(write.output, table.schema, write, paths)).write(table)
        write_report(write, evaluation_report(evaluation, reasons), outputs, Silent())
    return evaluation, reasons


def _check_distance(order: float, cutoff_m: float) -> None:
    """Raise UsageError unless the p-th powers of OSPA and GOSPA are finite."""
    if not order >= 1.0 or math.isinf(order):
        raise UsageError(f"`ospa_order` must be a finite number of at least 1. Got {order:g} instead.")
    if not 0.0 < cutoff_m <= LARGEST_NUMBER:
        raise UsageError(f"`ospa_cutoff_m` must be larger than 0, up to {LARGEST_NUMBER:g}. Got {cutoff_m:g} instead.")
    if order * math.log10(cutoff_m) > _LARGEST_EXPONENT:
        raise UsageError(f"`ospa_cutoff_m` to the power of `ospa_order`, {cutoff_m:g}^{order:g}, is too large")


def evaluation_report(evaluation: Evaluation, failed: Sequence[str]) -> dict[str, Any]:
    """Return the figures and the conditions met as plain values; overall and notes where there are any."""
    report: dict[str, Any] = {"of": evaluation.of, "groups": evaluation.groups}
    if evaluation.overall is not None:
        report["overall"] = evaluation.overall
    report["failed"] = list(failed)
    return {**report, "notes": list(evaluation.notes)} if evaluation.notes else report
