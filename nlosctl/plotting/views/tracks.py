"""Tracks: their paths with error ellipses at intervals, and each coordinate over time with its band."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.results.plot_inputs import PlotInput, read_sampled
from nlosctl.plotting.figures import SeriesStyle, axis_label, figure_style, series_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent, draw_ellipses, draw_reflectors, draw_sensors, finish_map
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.series import place_legend
from nlosctl.plotting.texts import plain
from nlosctl.plotting.views.estimates import thinning_note
from nlosctl.plotting.views.snapshot_rows import positions_of
from nlosctl.plotting.views.two_views import scene_positions

__all__ = ["draw_tracks_view"]

_MOST_TRACKS = 8
_ELLIPSES = 12
"""So many states of a track have an ellipse."""

_WITHIN_95 = 1.959964
_COLUMNS = ("time_s", "part", "method", "source", "x_m", "y_m", "z_m", "cov_*", "truth_x_m", "truth_y_m", "truth_z_m")
_KEYS = ("source", "method", "part")


@figure_style()
def draw_tracks_view(request: PlotRequest) -> Picture:
    """Draw the first tracks of a file, parted by ``by``, gaps, methods and sources."""
    file = request.of("estimates")[0]
    rows = read_sampled(file, (*_COLUMNS, *([request.by] if request.by else [])), request.max_rows)
    if request.by is not None and request.by not in rows.columns:
        raise UsageError(f"`by`: {file.name} has no column {request.by!r}{did_you_mean(request.by, file.names)}")
    tracks = _tracks(rows.columns, request.by)
    if not tracks:
        raise DataError(f"{file.name}: no state has a position")
    notes = [*thinning_note(file, rows)]
    if len(tracks) > _MOST_TRACKS:
        notes.append(f"the first {_MOST_TRACKS} of {len(tracks)} tracks are drawn")
    axes_of = "xyz" if "z_m" in rows.columns else "xy"
    figure, panels = request.figure(1, 1 + len(axes_of), size_in=(4.6 + 3.4 * len(axes_of), 4.4))
    extent = Extent()
    for number, (name, index) in enumerate(list(tracks.items())[:_MOST_TRACKS]):
        own = {column: values[index] for column, values in rows.columns.items()}
        look = series_style(number + 1)
        _draw_path(panels[0], own, look, name, extent)
        for axes, axis in zip(panels[1:], axes_of, strict=True):
            _draw_coordinate(axes, own, look, axis)
    _draw_scene(panels[0], file, extent)
    place_legend(panels[0])
    return Picture(figure=figure, notes=notes)


def _tracks(columns: Mapping[str, npt.NDArray[Any]], by: str | None) -> dict[str, IntArray]:
    """Return the rows of each track in order of time, those without a position left out."""
    known = np.isfinite(columns["x_m"]) & np.isfinite(columns["time_s"])
    names = [name for name in (*([by] if by else []), *_KEYS) if name in columns]
    varying = [name for name in names if name == by or len({plain(value) for value in columns[name]}) > 1]
    labels = [" ".join(plain(columns[name][row]) for name in varying) for row in range(known.size)]
    texts = np.array(labels, dtype=object)
    order = np.argsort(columns["time_s"], kind="stable")
    order = order[known[order]]
    return {str(label): order[texts[order] == label] for label in dict.fromkeys(texts[known].tolist())}


def _draw_path(axes: Axes, own: Mapping[str, npt.NDArray[Any]], look: SeriesStyle, name: str, extent: Extent) -> None:
    """Draw a path, ellipses at intervals, and the true path."""
    position = positions_of(own, "x_m", "y_m")
    extent.include(position)
    axes.plot(*position.T, color=look.color, linewidth=0.9, label=name or "path", zorder=2.5)
    some = np.unique(np.linspace(0, len(position) - 1, min(_ELLIPSES, len(position))).astype(int))
    covariance = np.stack([own[f"cov_{entry}_m2"] for entry in ("xx", "xy", "yy")], axis=1)
    draw_ellipses(axes, position[some], covariance[some], look, extent)
    if {"truth_x_m", "truth_y_m"} <= own.keys():
        truth = positions_of(own, "truth_x_m", "truth_y_m")
        extent.include(truth)
        axes.plot(*truth.T, color="black", linewidth=0.6, linestyle=":", label="_nolegend_", zorder=2.0)


def _draw_coordinate(axes: Axes, own: Mapping[str, npt.NDArray[Any]], look: SeriesStyle, axis: str) -> None:
    """Draw a coordinate over the time since the first state with its band of 95 %, and the truth."""
    time_s: FloatArray = own["time_s"] - own["time_s"].min()
    value, half = own[f"{axis}_m"], _WITHIN_95 * np.sqrt(np.maximum(own[f"cov_{axis}{axis}_m2"], 0.0))
    axes.fill_between(time_s, value - half, value + half, color=look.color, alpha=0.2, linewidth=0.0)
    axes.plot(time_s, value, color=look.color, linewidth=0.9)
    if f"truth_{axis}_m" in own:
        axes.plot(time_s, own[f"truth_{axis}_m"], color="black", linewidth=0.6, linestyle=":")
    axes.set_xlabel(axis_label("time since the first state", "s"))
    axes.set_ylabel(axis_label(axis, "m"))
    axes.set_title(f"{axis}, band of 95 %")


def _draw_scene(axes: Axes, file: PlotInput, extent: Extent) -> None:
    names, sensors = scene_positions(file.scene)
    if names:
        extent.include(sensors[:, :2])
        draw_sensors(axes, names, sensors[:, :2])
    if "z_m" not in file.names:
        draw_reflectors(axes, file.scene.reflectors)
    axes.set_title("paths, 95 % ellipses")
    finish_map(axes, extent, frame=file.scene.frame)
