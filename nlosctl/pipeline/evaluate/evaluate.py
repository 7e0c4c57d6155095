"""Compare estimates or flags with the truth, file by file; the memory grows by one error per row only."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from contextlib import ExitStack, closing

import numpy as np

from nlosctl.contract.tables import ESTIMATES, FLAGS
from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.errors import DataError, UsageError
from nlosctl.evaluation.detection import DetectionScores
from nlosctl.evaluation.estimates import EstimateRows, EstimateScores, nearest_alternatives
from nlosctl.evaluation.flags import FlagScores
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.evaluation_arrays import (
    boolean_codes,
    estimate_arrays,
    group_codes,
    has_heights,
    numbers,
    whole_snapshots,
)
from nlosctl.io.results.reader import PlainReader
from nlosctl.io.results.standardized_residuals import STD_TYPES
from nlosctl.io.results.truth_table import TruthTable
from nlosctl.pipeline.evaluate.evaluate_residuals import evaluate_residuals
from nlosctl.pipeline.evaluate.groups import Evaluation, Readers, grouping_columns, key_of, present, with_columns

__all__ = ["evaluate_inputs"]


def evaluate_inputs(
    inputs: Sequence[Input],
    *,
    truth: TruthTable | None,
    best_alternative: bool,
    by: Sequence[str] = (),
    speed_m_s: float = LIGHT_M_S,
) -> Evaluation:
    """Evaluate files of estimates (or of flags) by method, ``sweep_*`` column and, if there are several, by file.

    ``truth`` replaces the truth columns of estimates. Without ``best_alternative`` only alternative 0 counts. With
    ``by`` the values of these columns have figures of their own; those of flags are then of their residuals, without a
    truth (`evaluate_residuals`, with ``speed_m_s``). Raises DataError for a file of another kind or without truth.
    """
    types = STD_TYPES if by else {}
    with ExitStack() as opened:
        readers = [
            (source, opened.enter_context(closing(PlainReader(source, ESTIMATES, FLAGS, types=types))))
            for source in inputs
        ]
        tables = {reader.table.name for _, reader in readers}
        if len(tables) > 1:
            raise DataError("the inputs are estimates and flags; evaluate them one by one")
        if tables == {FLAGS.name} and truth is not None:
            raise UsageError("`truth` is for estimates; the input is flags, whose rows have their truth")
        if tables == {FLAGS.name}:
            return evaluate_residuals(readers, by, speed_m_s) if by else _evaluate_flags(readers)
        return _evaluate_estimates(readers, truth, best_alternative, by)


def _evaluate_estimates(
    readers: Readers, truth: TruthTable | None, best_alternative: bool, by: Sequence[str]
) -> Evaluation:
    scores = EstimateScores()
    grouping: list[str] = []
    _refuse_mixed_dimensions(readers)
    for source, reader in readers:
        own = grouping_columns(reader.schema.names)
        grouping = with_columns(own, by, reader.schema.names, source.name)
        for table in whole_snapshots(reader.batches()):
            arrays = estimate_arrays(table, truth, source.name)
            rows = EstimateRows(
                position_m=arrays.position_m,
                covariance_m2=arrays.covariance_m2,
                status=arrays.status,
                truth_m=arrays.truth_m,
                used_share=arrays.used_share,
                fit_p_value=arrays.fit_p_value,
                std_dof=arrays.std_dof,
                time_s=arrays.time_s,
            )
            group, keys = group_codes(table, grouping)
            if best_alternative:
                same = [group_codes(table, ["snapshot", "target"])[0], group]
                counted = nearest_alternatives(rows.error_m, arrays.alternative, *same)
            else:
                counted = np.flatnonzero(arrays.alternative == 0)
            names = [key_of(readers, source, key, len(grouping) - len(own)) for key in keys]
            scores.add(rows.take(counted), group[counted], names)
    evaluation = present("estimates", scores, readers, grouping, by)
    return evaluation if truth is None else dataclasses.replace(evaluation, notes=tuple(truth.remark()))


def _refuse_mixed_dimensions(readers: Readers) -> None:
    """Raise DataError for estimates with heights beside estimates without."""
    first, others = readers[0], readers[1:]
    for source, reader in others:
        if has_heights(reader.schema.names) != has_heights(first[1].schema.names):
            high, flat = (source, first[0]) if has_heights(reader.schema.names) else (first[0], source)
            raise DataError(
                f"{flat.name}: no column 'z_m', but {high.name} has one: estimates of two and of three dimensions; "
                "evaluate them one by one"
            )


def _evaluate_flags(readers: Readers) -> Evaluation:
    """Evaluate indirect-path flags if the first file has them with their truth, else line-of-sight flags."""
    if {"ip", "truth_ip"} <= set(readers[0][1].schema.names):
        return _evaluate_detection(readers)
    scores = FlagScores()
    grouping: list[str] = []
    for source, reader in readers:
        _require_columns(source, reader, "los", "truth_los")
        grouping = grouping_columns(reader.schema.names)
        for table in reader.batches():
            group, keys = group_codes(table, grouping)
            los, truth_los = boolean_codes(table.column("los")), boolean_codes(table.column("truth_los"))
            scores.add(los, truth_los, group, [key_of(readers, source, key) for key in keys])
    return present("flags", scores, readers, grouping)


def _evaluate_detection(readers: Readers) -> Evaluation:
    scores = DetectionScores()
    grouping: list[str] = []
    for source, reader in readers:
        _require_columns(source, reader, "ip", "truth_ip")
        grouping = grouping_columns(reader.schema.names)
        for table in reader.batches():
            group, keys = group_codes(table, grouping)
            ip, truth_ip = boolean_codes(table.column("ip")), boolean_codes(table.column("truth_ip"))
            p_value = numbers(table.column("p_value")) if "p_value" in table.column_names else None
            scores.add(ip, truth_ip, p_value, group, [key_of(readers, source, key) for key in keys])
    return present("flags", scores, readers, grouping)


def _require_columns(source: Input, reader: PlainReader, *names: str) -> None:
    for name in names:
        if name not in reader.schema.names:
            raise DataError(
                f"{source.name}: no column {name!r}: flags are evaluated by 'ip' against 'truth_ip', "
                "or by 'los' against 'truth_los'"
            )
