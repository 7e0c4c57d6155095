"""Metrics of a run without ground truth, for conditions such as ``fix_rate<0.95``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from nlosctl.contract.tables import SWEEP_PREFIX
from nlosctl.evaluation.error_statistics import ratio
from nlosctl.pipeline.solve.method_runs import MethodRun, MethodTally
from nlosctl.pipeline.solve.report import RunReport

__all__ = ["METRICS", "run_metrics"]

_OF_FIXES = ("fix_rate", "used_share", "share_p_below_0001")
METRICS = {"localize": _OF_FIXES, "identify-los": _OF_FIXES, "detect-ip": ("answered_rate",)}
"""The metrics of each job.

``fix_rate``: share of snapshots (and of paths that are localized one by one) with a fix, for ``identify-los`` of
snapshots with at least one target; ``used_share``: share of the rows used, of snapshots with a fix;
``share_p_below_0001``: share of fits with a p-value below 0.001, of those that have one; ``answered_rate``: share of
rows with a p-value. Snapshots of bad rows only count as without a fix.
"""


def run_metrics(job: str, runs: Sequence[MethodRun], report: RunReport) -> list[dict[str, Any]]:
    """Return the metrics of each method of a run that has ended, with its name and swept values; NaN: undefined."""
    groups = []
    for run in runs:
        values = _values(job, report.methods[run.label], report)
        swept = {f"{SWEEP_PREFIX}{key}": value for key, value in run.sweep.items()}
        groups.append({"method": run.spec.name, **swept, **{name: values[name] for name in METRICS[job]}})
    return groups


def _values(job: str, tally: MethodTally, report: RunReport) -> dict[str, float]:
    fixed, total = tally.answered, tally.total
    if job == "identify-los":
        fixed, total = tally.located, report.snapshots
    return {
        "fix_rate": ratio(fixed, total + report.snapshots_lost),
        "used_share": ratio(tally.rows_used, tally.rows_of_fixes),
        "share_p_below_0001": ratio(tally.badly_fitted, tally.tested),
        "answered_rate": ratio(tally.judged, report.rows - report.rows_left_out),
    }
