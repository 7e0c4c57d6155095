"""What a run says of its methods beside their counts: a column left unused, the field's edge, a bad fit."""

from __future__ import annotations

from collections.abc import Sequence

from nlosctl import registry
from nlosctl.contract.fields import Field
from nlosctl.contract.tables import KINDS
from nlosctl.pipeline.solve.report import RunReport
from nlosctl.pipeline.solve.solve_chunk import MethodRun

__all__ = ["method_remarks"]


def method_remarks(runs: Sequence[MethodRun], report: RunReport, columns: Sequence[str], field: Field) -> list[str]:
    """Return what to say of the methods after a run, a line each; ``columns`` are those of the input."""
    return [
        *_unused_ranges(runs, report, columns),
        *_edge_remarks(runs, report, field),
        *_hopeless(runs, report),
        *_advice(runs, report),
    ]


def _unused_ranges(runs: Sequence[MethodRun], report: RunReport, columns: Sequence[str]) -> list[str]:
    takers = dict.fromkeys(run.spec.name for run in runs if "range_m" not in run.spec.reads)
    if "range_m" not in columns or report.kind == "ranges" or not takers:
        return []
    return [f"the column 'range_m' is not used by {', '.join(takers)}"]


def _edge_remarks(runs: Sequence[MethodRun], report: RunReport, field: Field) -> list[str]:
    tallies = [(run.label, report.methods[run.label]) for run in runs if run.spec.searches]
    return [
        f"{name} searched {field}: {tally.on_edge} of {tally.answered} fixes touch the field's edge"
        for name, tally in tallies
    ]


def _hopeless(runs: Sequence[MethodRun], report: RunReport) -> list[str]:
    answered = any(tally.answered for tally in report.methods.values())
    answered |= not any(run.spec.job == "localize" for run in runs)
    senses = [spelling.name for column in KINDS[report.kind].columns for spelling in column.spellings]
    if answered or not report.snapshots:
        return []
    return [f"no snapshot got a position; check units and sense of the angles (there are also {', '.join(senses)})"]


def _advice(runs: Sequence[MethodRun], report: RunReport) -> list[str]:
    robust = {entry.name for entry in registry.entries() if entry.kind == report.kind}
    advised = "; try --method mixture-ml" if "mixture-ml" in robust - {run.spec.name for run in runs} else ""
    return [
        f"{name} fits badly: in {tally.badly_fitted} of {tally.tested} snapshots the residuals are larger than "
        f"their standard deviations explain{advised}"
        for name, tally in report.methods.items()
        if tally.fits_badly
    ]
