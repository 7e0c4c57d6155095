"""Errors against the truth: their distribution, and the figures of an evaluation against a swept parameter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.statuses import Status
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.evaluation.estimates import EstimateRows
from nlosctl.io.results.plot_inputs import DrawnFile, read_sampled
from nlosctl.pipeline.evaluate.evaluate import evaluate_inputs, group_title, is_label
from nlosctl.plotting.figure_words import figure_label, parameter_label, std_error_of
from nlosctl.plotting.figures import axis_label, figure_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.requests import Picture, Request
from nlosctl.plotting.series import Series, draw_cdf, draw_reference_lines, draw_series, place_legend
from nlosctl.plotting.views.estimates import thinning_note
from nlosctl.plotting.views.snapshot_rows import labels_of_rows, positions_of

__all__ = ["draw_error_cdf", "draw_sweep"]

Group = Mapping[str, Any]

_LOG_FROM = 20.0
_ERROR_COLUMNS = ("x_m", "y_m", "status", "alternative", "method", "source", "sweep_*", "truth_x_m", "truth_y_m")
_FIRST_CHOICES = ("rmse_m", "matched_rmse_m", "p_d", "recall")


@figure_style()
def draw_error_cdf(request: Request) -> Picture:
    """Draw which share of the estimates lies within which distance of the truth; no fix counts as infinitely far."""
    errors: dict[str, FloatArray] = {}
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
        labels = np.array(labels_of_rows(columns, first.size, file.name if len(files) > 1 else ""))
        known = ~np.isnan(estimates.error_m)
        for label in dict.fromkeys(labels[known].tolist()):
            errors[label or "estimates"] = estimates.error_m[known & (labels == label)]
    if not errors:
        raise DataError(f"{', '.join(file.name for file in files)}: no row has a truth to be held against")
    figure, (axes,) = request.figure()
    finite = np.concatenate([some[np.isfinite(some) & (some > 0.0)] for some in errors.values()])
    spread = finite.size and np.quantile(finite, 0.99) > _LOG_FROM * np.quantile(finite, 0.05)
    draw_cdf(axes, errors, log_x=bool(spread) and not request.linear)
    axes.set_xlabel(axis_label("position error", "m"))
    axes.set_ylabel(axis_label("share of the estimates", ""))
    return Picture(figure=figure, notes=notes)


def _status_codes(words: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    known = {status.word: int(status) for status in Status}
    unknown = set(words.tolist()) - known.keys()
    if unknown:
        raise DataError(f"column 'status': {sorted(unknown)[0]!r} is no status; they are {', '.join(known)}")
    return np.array([known[word] for word in words], dtype=np.uint8)


@figure_style()
def draw_sweep(request: Request) -> Picture:
    """Draw a figure of an evaluation against a swept parameter, a line for each method and other swept values."""
    groups = _groups(request)
    x_name = _swept_column(groups, request.x)
    y_name = _figure_name(groups, request.y)
    values = list(dict.fromkeys(group[x_name] for group in groups if group.get(x_name) is not None))
    places = {value: float(value if _are_numbers(values) else place) for place, value in enumerate(values)}
    lines = _lines(groups, x_name, y_name, places)
    flat = {
        _title(group, x_name): float(group[y_name])
        for group in groups
        if group.get(x_name) is None and group[y_name] is not None
    }
    bounds = [_bound_at(file, x_name, places) for file in request.of("bound")] if y_name == "rmse_m" else []
    figure, (axes,) = request.figure()
    log_x = _are_numbers(values) and _spans(np.array(list(places.values()))) and not request.linear
    y = np.concatenate([*(line.y for line in lines), *bounds])
    log_y = y_name.endswith("_m") and _spans(y) and not request.linear
    draw_series(axes, lines, log_x=log_x, log_y=log_y, legend=False)
    for bound in bounds:
        axes.plot(sorted(places.values()), bound, color="#c0c0c0", linewidth=4.5, label="Cramér-Rao bound", zorder=1.6)
    draw_reference_lines(axes, flat)
    if len(lines) + len(bounds) > 1:
        place_legend(axes)
    axes.set_xlabel(parameter_label(x_name))
    axes.set_ylabel(figure_label(y_name))
    _label_values(axes, places, log_x)
    return Picture(figure=figure, notes=_unknown_note(groups, y_name))


def _groups(request: Request) -> list[dict[str, Any]]:
    """Return the figures of every group: read from scores, or worked out from estimates or flags."""
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
            raise UsageError(f"--x: no sweep of {wanted!r}{did_you_mean(wanted, known)}; there are: {', '.join(known)}")
        return f"sweep_{wanted.removeprefix('sweep_')}"
    if not swept:
        raise DataError("no column sweep_KEY to draw against; simulate or solve with --sweep KEY=VALUE,VALUE")
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
        raise UsageError(f"--y: no figure {wanted!r}{did_you_mean(wanted, known)}; there are: {', '.join(known)}")
    return wanted


def _title(group: Group, x_name: str) -> str:
    return group_title({name: value for name, value in group.items() if name != x_name and value is not None})


def _lines(groups: Sequence[Group], x_name: str, y_name: str, places: Mapping[Any, float]) -> list[Series]:
    by_title: dict[str, list[Group]] = {}
    for group in groups:
        if group.get(x_name) is not None:
            by_title.setdefault(_title(group, x_name), []).append(group)
    lines = []
    for title, mine in by_title.items():
        mine = sorted(mine, key=lambda group: places[group[x_name]])
        y = np.array([np.nan if group.get(y_name) is None else float(group[y_name]) for group in mine])
        error = np.array([std_error_of(group, y_name) for group in mine])
        x = np.array([places[group[x_name]] for group in mine])
        lines.append(Series(label=title, x=x, y=y, error=np.nan_to_num(error) if np.isfinite(error).any() else None))
    return lines


def _bound_at(file: DrawnFile, x_name: str, places: Mapping[Any, float]) -> FloatArray:
    """Return the root mean square of the bounds at each swept value, rising; without the column, over all."""
    columns = read_sampled(file, ("rms_m", x_name), None).columns
    square = columns["rms_m"] ** 2
    known = ~np.isnan(square)
    if x_name in columns:
        at = np.array([places.get(_plain(value), np.nan) for value in columns[x_name]])
        chosen = [known & (at == place) for place in sorted(places.values())]
    else:
        chosen = [known] * len(places)
    return np.array([np.sqrt(square[mine].mean()) if mine.any() else np.nan for mine in chosen])


def _are_numbers(values: Sequence[Any]) -> bool:
    return all(isinstance(value, int | float) and not isinstance(value, bool) for value in values)


def _spans(values: FloatArray) -> bool:
    good = values[np.isfinite(values)]
    return bool(good.size and good.min() > 0.0 and good.max() >= _LOG_FROM * good.min())


def _label_values(axes: Axes, places: Mapping[Any, float], log_x: bool) -> None:
    """Tick the swept values themselves where they are few."""
    if len(places) <= 12 and (log_x or not _are_numbers(list(places))):
        labels = [f"{value:g}" if isinstance(value, float) else str(value) for value in places]
        axes.set_xticks(list(places.values()), labels)
        axes.minorticks_off()


def _unknown_note(groups: Sequence[Group], y_name: str) -> list[str]:
    unknown = sum(group.get(y_name) is None or not np.isfinite(group[y_name]) for group in groups)
    return [f"{y_name} is not known (or infinite) at {unknown} of {len(groups)} points"] if unknown else []
