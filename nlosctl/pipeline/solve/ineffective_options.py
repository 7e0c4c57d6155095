"""Options of a run and path numbers that had no effect, since no method uses them: notes for the summary."""

from __future__ import annotations

from collections.abc import Sequence

from nlosctl.contract.fields import SensorsField
from nlosctl.contract.run_options import SolveOptions
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.report import RunReport

__all__ = ["competing_paths", "ineffective_options"]


def ineffective_options(runs: Sequence[MethodRun], report: RunReport, options: SolveOptions) -> list[str]:
    """Return a line for each option that is not at its default and that changed nothing."""
    names = ", ".join(dict.fromkeys(run.spec.name for run in runs))
    notes = []
    if options.field != SensorsField() and not any(run.spec.searches or run.spec.job == "identify-los" for run in runs):
        notes.append(f"`field` has no effect: {names} has no search region")
    if options.seed and not any(run.spec.randomized for run in runs):
        notes.append(f"`seed` has no effect: {names} draws no random numbers")
    if options.alternatives > 1 and report.snapshots and not any(report.methods[run.label].further for run in runs):
        notes.append(f"`alternatives` has no effect: no snapshot has a second estimate by {names}")
    if options.worker_timeout != SolveOptions().worker_timeout and options.engine != "dask":
        notes.append("`worker_timeout` has no effect: it is for the engine dask")
    return notes


def competing_paths(runs: Sequence[MethodRun], rows: int) -> list[str]:
    """Return a line if methods take all of ``rows`` competing paths as they are stated."""
    names = dict.fromkeys(run.spec.name for run in runs if run.spec.job == "localize" and "path" not in run.spec.reads)
    if not rows or not names:
        return []
    return [
        f"the column 'path' is not used by {', '.join(names)}: {rows} rows are several paths of one sensor, and all of "
        "them are taken as the stated path; mixture-ml takes at most one of them"
    ]
