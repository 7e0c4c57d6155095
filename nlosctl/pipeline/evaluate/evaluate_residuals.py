"""Standardized residuals of flags by sensor, or by other columns, without a truth."""

from __future__ import annotations

from collections.abc import Sequence

from nlosctl.evaluation.residuals import ResidualScores
from nlosctl.io.results.evaluation_arrays import boolean_codes, group_codes
from nlosctl.io.results.standardized_residuals import StandardizedResiduals
from nlosctl.pipeline.evaluate.groups import Evaluation, Readers, grouping_columns, key_of, present, with_columns

__all__ = ["evaluate_residuals"]


def evaluate_residuals(readers: Readers, by: Sequence[str], speed_m_s: float) -> Evaluation:
    """Return mean, std, autocorrelation and share of outliers of the residuals over their stds, by the columns ``by``.

    ``speed_m_s`` makes lengths of standard deviations of arrival times. Raises DataError for a file without residuals
    or standard deviations.
    """
    scores = ResidualScores()
    grouping: list[str] = []
    for source, reader in readers:
        columns = StandardizedResiduals.of_columns(reader.schema.names, source.name, speed_m_s)
        own = grouping_columns(reader.schema.names)
        grouping = with_columns(own, by, reader.schema.names, source.name)
        for table in reader.batches():
            group, keys = group_codes(table, grouping)
            names = [key_of(readers, source, key, len(grouping) - len(own)) for key in keys]
            used = boolean_codes(table.column("used")) == 1
            scores.add(columns.read(table, source.name), used, group, names)
    return present("residuals", scores, readers, grouping, by)
