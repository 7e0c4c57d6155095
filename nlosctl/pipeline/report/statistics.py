"""Tables of the page: statuses, errors and coverage where the truth is known, residuals by sensor, scores."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.errors import DataError, UsageError
from nlosctl.io.results.plot_inputs import PlotInput, SampledRows
from nlosctl.io.results.status_counts import StatusCounts
from nlosctl.pipeline.evaluate.evaluate import evaluate_inputs
from nlosctl.pipeline.evaluate.groups import group_title, is_label
from nlosctl.pipeline.report.numbers import significant

__all__ = ["error_table", "flag_table", "residual_table", "score_table", "status_table"]

Content = dict[str, Any]

_TRUTH = {"truth_x_m", "truth_y_m"}
_ERRORS = {
    "rows": "rows",
    "fix_rate": "share with a fix",
    "rmse_m": "RMSE, m",
    "median_m": "median error, m",
    "p95_m": "95 % of errors within, m",
    "bias_x_m": "bias x, m",
    "bias_y_m": "bias y, m",
    "nees": "NEES",
    "coverage_50": "coverage of 50 % ellipses",
    "coverage_95": "coverage of 95 % ellipses",
}
_OUTLIERS = ("outlier_share", "share of outliers")


def status_table(counts: Mapping[str, StatusCounts]) -> Content:
    """Return how many estimates have each status, by file and method."""
    several = len(counts) > 1
    rows = [
        [*([name] if several else []), method, status, number]
        for name, of in counts.items()
        for method, words in of.by_method.items()
        for status, number in words.most_common()
    ]
    head = [*(["file"] if several else []), "method", "status", "count"]
    return {"title": "Statuses", "note": "Of the best alternative of each target.", "head": head, "rows": rows}


def error_table(files: Sequence[PlotInput]) -> Content | None:
    """Return RMSE, bias, percentiles, NEES and coverage of estimates with their truth; None without any."""
    known = [file for file in files if set(file.names) >= _TRUTH]
    if not known:
        return None
    groups: list[dict[str, Any]] = []
    for file in known:
        found = evaluate_inputs([file.input()], truth=None, best_alternative=False).groups
        groups += [({"file": file.name} if len(known) > 1 else {}) | group for group in found]
    names = [name for name in _ERRORS if any(name in group for group in groups)]
    rows = [[group_title(group) or "all", *(_cell(group.get(name)) for name in names)] for group in groups]
    note = "Of the best alternatives. Coverage is the share of truths within the ellipses, which should be as named."
    return {"title": "Errors", "note": note, "head": ["estimates", *(_ERRORS[name] for name in names)], "rows": rows}


def residual_table(file: PlotInput, speed_m_s: float = LIGHT_M_S) -> tuple[Content | None, str]:
    """Return mean, spread and share of outliers of the residuals of flags by sensor, or a note on what is missing."""
    by = tuple(name for name in ("sensor", "path") if name in file.names)[:1]
    if not by:
        return None, f"{file.name}: no residuals by sensor: the flags have no column 'sensor'"
    try:
        found = evaluate_inputs([file.input()], truth=None, best_alternative=False, by=by, speed_m_s=speed_m_s)
    except (DataError, UsageError) as error:
        return None, f"no residuals by {by[0]}: {error}"
    kinds = [name.removesuffix("_mean") for name in found.groups[0] if name.endswith("_mean")]
    head, names = [by[0], "rows", "rows used"], ["rows", "rows_used"]
    for kind in kinds:
        head += [f"{kind}: mean", f"{kind}: std"]
        names += [f"{kind}_mean", f"{kind}_std"]
    head, names = [*head, _OUTLIERS[1]], [*names, _OUTLIERS[0]]
    labels = [name for name in found.groups[0] if is_label(name) and name not in by]
    rows = [
        [str(group[by[0]]), *(str(group[label]) for label in labels), *(_cell(group.get(name)) for name in names)]
        for group in found.groups
    ]
    note = (
        "Measured minus predicted, over the standard deviation: means near 0 and stds near 1 are good. A mean far from "
        "0 shows a bad compass or a biased anchor, an outlier is beyond 3 standard deviations."
    )
    title = f"Residuals by {by[0]}: {file.name}"
    return {"title": title, "note": note, "head": [head[0], *labels, *head[1:]], "rows": rows}, ""


def flag_table(file: PlotInput) -> Content | None:
    """Return the detection of indirect paths against the truth of flags; None without it."""
    if not any({flag, f"truth_{flag}"} <= set(file.names) for flag in ("ip", "los")):
        return None
    found = evaluate_inputs([file.input()], truth=None, best_alternative=False)
    names = [name for name, value in found.groups[0].items() if isinstance(value, int | float) and not is_label(name)]
    rows = [[group_title(group) or "all", *(_cell(group.get(name)) for name in names)] for group in found.groups]
    return {"title": f"Flags: {file.name}", "note": "Against their truth.", "head": ["flags", *names], "rows": rows}


def score_table(file: PlotInput, rows: SampledRows) -> Content:
    """Return a file of scores, or of bounds, as it is."""
    columns = [values.tolist() for values in rows.columns.values()]
    cells = [
        [_cell(value) if isinstance(value, float) else value for value in row] for row in zip(*columns, strict=True)
    ]
    return {"title": f"{file.content.capitalize()}: {file.name}", "note": "", "head": list(rows.columns), "rows": cells}


def _cell(value: Any) -> Any:
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, float):
        return "unbounded" if value == float("inf") else significant(value)
    return value
