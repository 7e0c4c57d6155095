"""Errors against the truth: their distribution, and figures of an evaluation over a swept parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.statuses import Status
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.evaluation.estimates import EstimateRows
from nlosctl.io.results.plot_inputs import PlotInput, read_sampled
from nlosctl.pipeline.evaluate.evaluate import evaluate_inputs
from nlosctl.pipeline.evaluate.groups import group_title, is_label
from nlosctl.plotting.axis_labels import figure_label, parameter_label, std_error_of
from nlosctl.plotting.figures import axis_label, figure_style, styles_by_part
from nlosctl.plotting.library import Axes
from nlosctl.plotting.panels import Series
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.series import draw_cdf, draw_reference_lines, draw_series, label_log_axis, place_legend
from nlosctl.plotting.texts import plain
from nlosctl.plotting.views.estimates import thinning_note
from nlosctl.plotting.views.snapshot_rows import labels_of_rows, positions_of

__all__ = ["draw_error_cdf", "draw_sweep"]

Group = Mapping[str, Any]

_LOG_FROM = 20.0
_ERROR_COLUMNS = ("x_m", "y_m", "status", "alternative", "method", "source", "sweep_*", "truth_x_m", "truth_y_m")
_KILOMETRES_FROM_M = 20e3
_BOUND, _BOUND_LINE = "Cramér-Rao bound", (0, (1.0, 1.0))
_FIRST_CHOICES = ("rmse_m", "matched_rmse_m", "p_d", "recall")


@figure_style()
def draw_error_cdf(request: PlotRequest) -> Picture:
    """Draw the distribution function of the position error; an estimate without a fix has an infinite error."""
    errors: dict[str, FloatArray] = {}
    parts: dict[str, tuple[str, str]] = {}
    notes = []
    files = request.of("estimates")
    for file in files:
        rows = read_sampled(file, _ERROR_COLUMNS, request.max_rows)
        notes += thinning_note(file, rows)
        first = np.flatnonzero(rows.columns["alternative"] == 0.0)
        columns = {name: values[first] for name, values in rows.columns.items()}
        position = positions_of(columns, "x_m", "y_m")
        estimates = EstimateRows(
            position_m=position,
            covariance_m2=np.full((first.size, 3), np.nan),
            status=_status_codes(columns["status"]),
            truth_m=positions_of(columns, "truth_x_m", "truth_y_m"),
        )
        prefix = file.name if len(files) > 1 else ""
        labels = np.array(labels_of_rows(columns, first.size, prefix))
        unswept = {name: values for name, values in columns.items() if not name.startswith("sweep_")}
        methods = labels_of_rows(unswept, first.size, prefix)
        parts |= {
            str(label): (method, str(label).removeprefix(method)) for label, method in zip(labels, methods, strict=True)
        }
        known = ~np.isnan(estimates.error_m)
        for label in dict.fromkeys(labels[known].tolist()):
            errors[label or "estimates"] = estimates.error_m[known & (labels == label)]
    if not errors:
        raise DataError(f"{', '.join(file.name for file in files)}: no row has a truth to compare with")
    figure, (axes,) = request.figure()
    finite = np.concatenate([values[np.isfinite(values) & (values > 0.0)] for values in errors.values()])
    wide = finite.size and np.quantile(finite, 0.99) > _LOG_FROM * np.quantile(finite, 0.05)
    styles = styles_by_part([parts.get(label, (label, "")) for label in errors])
    draw_cdf(axes, errors, log_x=bool(wide) and not request.linear, styles=styles)
    axes.set_xlabel(axis_label("position error", "m"))
    axes.set_ylabel(axis_label("share of the estimates", ""))
    return Picture(figure=figure, notes=notes)


def _status_codes(words: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    known = {status.word: int(status) for status in Status}
    unknown = set(words.tolist()) - known.keys()
    if unknown:
        raise DataError(f"column 'status': got {sorted(unknown)[0]!r}, expected one of {', '.join(known)}")
    return np.array([known[word] for word in words], dtype=np.uint8)


@figure_style()
def draw_sweep(request: PlotRequest) -> Picture:
    """Draw a figure of an evaluation over a swept parameter, a line per method and combination of other sweeps."""
    groups = _groups(request)
    x_name = _swept_column(groups, request.x)
    relative = request.y == "efficiency"
    if relative and not request.of("bound"):
        raise UsageError("`y` efficiency is the RMSE over the bound; name a file of 'nlosctl bound' too")
    y_name = _figure_name(groups, "rmse_m" if relative else request.y)
    values = list(dict.fromkeys(group[x_name] for group in groups if group.get(x_name) is not None))
    ticks = {value: float(value if _are_numbers(values) else index) for index, value in enumerate(values)}
    lines = _lines(groups, x_name, y_name, ticks)
    flat = (
        {}
        if relative
        else {
            _title(group, x_name): float(group[y_name])
            for group in groups
            if group.get(x_name) is None and group[y_name] is not None
        }
    )
    bounds = [_bound_at(file, x_name, ticks) for file in request.of("bound")] if y_name == "rmse_m" else []
    if relative:
        lines, bounds = [_over(line, bounds[0], ticks) for line in lines], []
        flat = {"bound": 1.0}
    scale, unit = 1.0, figure_label("efficiency" if relative else y_name)
    if unit.endswith("[m]") and _largest([*(line.y for line in lines), *bounds]) >= _KILOMETRES_FROM_M:
        scale, unit = 1e-3, unit.replace("[m]", "[km]")
    lines, bounds = [_scaled(line, scale) for line in lines], [bound * scale for bound in bounds]
    flat = {label: level * scale for label, level in flat.items()}
    figure, (axes,) = request.figure()
    log_x = _are_numbers(values) and _is_wide(np.array(list(ticks.values()))) and not request.linear
    y = np.concatenate([*(line.y for line in lines), *bounds])
    log_y = not relative and y_name.endswith("_m") and _is_wide(y) and not request.linear
    draw_series(axes, lines, log_x=log_x, log_y=log_y, legend=False)
    for bound in bounds:
        axes.plot(
            sorted(ticks.values()),
            bound,
            color="#000000",
            linestyle=_BOUND_LINE,
            linewidth=1.8,
            label=_BOUND,
            zorder=3.0,
        )
    if log_y:
        label_log_axis(axes)
    draw_reference_lines(axes, flat)
    if len(lines) + len(bounds) > 1:
        place_legend(axes)
    axes.set_xlabel(parameter_label(x_name))
    axes.set_ylabel(unit)
    _label_values(axes, ticks, log_x)
    return Picture(figure=figure, notes=_unknown_note(groups, y_name))


def _groups(request: PlotRequest) -> list[dict[str, Any]]:
    """Return the figures of every group, read from scores or computed from estimates or flags."""
    groups: list[dict[str, Any]] = []
    scored = request.of("scores")
    for file in scored:
        columns = read_sampled(file, ("*",), None).columns
        for row in range(next(iter(columns.values())).shape[0]):
            group = {name: _plain(values[row]) for name, values in columns.items() if name != "of"}
            groups.append({"file": file.name, **group} if len(scored) > 1 else group)
    others = request.of("estimates", "flags")
    if others:
        evaluation = evaluate_inputs([file.input() for file in others], truth=None, best_alternative=False)
        groups += evaluation.groups
    return groups


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return value or None
    return None if np.isnan(value) else float(value)


def _swept_column(groups: Sequence[Group], wanted: str | None) -> str:
    swept = list(dict.fromkeys(name for group in groups for name in group if name.startswith("sweep_")))
    if wanted is not None:
        known = [name.removeprefix("sweep_") for name in swept]
        if wanted.removeprefix("sweep_") not in known:
            near = did_you_mean(wanted, known)
            raise UsageError(f"`x`: got {wanted!r}{near}, expected a swept parameter: {', '.join(known)}")
        return f"sweep_{wanted.removeprefix('sweep_')}"
    if not swept:
        raise DataError("no column sweep_KEY for the x axis; simulate or solve with `sweep` KEY=VALUE,VALUE")
    return max(swept, key=lambda name: len({group.get(name) for group in groups} - {None}))


def _figure_name(groups: Sequence[Group], wanted: str | None) -> str:
    known = [
        name
        for name in dict.fromkeys(name for group in groups for name in group)
        if not is_label(name) and any(isinstance(group.get(name), int | float) for group in groups)
    ]
    if wanted is None:
        return next((name for name in _FIRST_CHOICES if name in known), known[0])
    if wanted not in known:
        raise UsageError(f"`y`: got {wanted!r}{did_you_mean(wanted, known)}, expected a figure: {', '.join(known)}")
    return wanted


def _title(group: Group, x_name: str) -> str:
    return plain(group_title({name: value for name, value in group.items() if name != x_name and value is not None}))


def _lines(groups: Sequence[Group], x_name: str, y_name: str, ticks: Mapping[Any, float]) -> list[Series]:
    by_title: dict[str, list[Group]] = {}
    for group in groups:
        if group.get(x_name) is not None:
            by_title.setdefault(_title(group, x_name), []).append(group)
    lines = []
    for title, unsorted in by_title.items():
        line = sorted(unsorted, key=lambda group: ticks[group[x_name]])
        y = np.array([np.nan if group.get(y_name) is None else float(group[y_name]) for group in line])
        error = np.array([std_error_of(group, y_name) for group in line])
        x = np.array([ticks[group[x_name]] for group in line])
        lines.append(Series(label=title, x=x, y=y, error=np.nan_to_num(error) if np.isfinite(error).any() else None))
    return lines


def _over(line: Series, bound: FloatArray, ticks: Mapping[Any, float]) -> Series:
    """Return a line of RMSEs and their errors over the bound at the same swept values."""
    below = bound[np.searchsorted(sorted(ticks.values()), line.x)]
    return replace(line, y=line.y / below, error=None if line.error is None else line.error / below)


def _scaled(line: Series, scale: float) -> Series:
    return replace(line, y=line.y * scale, error=None if line.error is None else line.error * scale)


def _largest(values: Sequence[FloatArray]) -> float:
    finite = np.concatenate([part[np.isfinite(part)] for part in values]) if values else np.empty(0)
    return float(finite.max(initial=0.0))


def _bound_at(file: PlotInput, x_name: str, ticks: Mapping[Any, float]) -> FloatArray:
    """Return the root mean square of the bounds at each swept value in ascending order; without the column, of all."""
    columns = read_sampled(file, ("rms_m", x_name), None).columns
    square = columns["rms_m"] ** 2
    known = ~np.isnan(square)
    if x_name in columns:
        x = np.array([ticks.get(_plain(value), np.nan) for value in columns[x_name]])
        masks = [known & (x == tick) for tick in sorted(ticks.values())]
    else:
        masks = [known] * len(ticks)
    return np.array([np.sqrt(square[mask].mean()) if mask.any() else np.nan for mask in masks])


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _is_wide(values: FloatArray) -> bool:
    """Whether positive values span more than an order of magnitude, so that a logarithmic axis suits them."""
    good = values[np.isfinite(values)]
    return bool(good.size and good.min() > 0.0 and good.max() >= _LOG_FROM * good.min())


def _label_values(axes: Axes, ticks: Mapping[Any, float], log_x: bool) -> None:
    """Set the ticks at the swept values if they are few."""
    if len(ticks) <= 12 and (log_x or not _are_numbers(list(ticks))):
        labels = [f"{value:g}" if isinstance(value, float) else plain(value) for value in ticks]
        axes.set_xticks(list(ticks.values()), labels)
        axes.minorticks_off()


def _unknown_note(groups: Sequence[Group], y_name: str) -> list[str]:
    unknown = sum(group.get(y_name) is None or not np.isfinite(group[y_name]) for group in groups)
    return [f"{y_name} is unknown or infinite at {unknown} of {len(groups)} points"] if unknown else []
