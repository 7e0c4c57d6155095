"""All estimates of a file over its scene, one panel per method (in space two); a density map if there are many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.results.plot_inputs import PlotInput, SampledRows, read_sampled
from nlosctl.plotting.figures import SeriesStyle, axis_label, figure_style, series_style
from nlosctl.plotting.library import Axes, LogNorm
from nlosctl.plotting.plane import Extent, annotate_points, draw_ellipses, draw_reflectors, draw_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.series import place_legend
from nlosctl.plotting.texts import plain
from nlosctl.plotting.views.close_ups import map_size_in
from nlosctl.plotting.views.snapshot_rows import covariances_of, fixes_of, labels_of_rows, positions_of
from nlosctl.plotting.views.two_views import VIEWS, coordinates, finish_view, scene_positions, seen_reflectors, side_of

__all__ = ["draw_estimates_view", "thinning_note"]

_DENSE_FROM = 3000
_ELLIPSES_TO = 60
_MOST_PANELS, _MOST_IN_SPACE = 9, 4
_CELLS = 120
_MOST_TRUTHS = 200
_TIMES = ("time_s", "time", "timestamp")
_MOST_TAGS = 24
_COLUMNS = (
    "snapshot",
    *_TIMES,
    "x_m",
    "y_m",
    "z_m",
    "cov_*",
    "std_dof",
    "alternative",
    "status",
    "method",
    "source",
    "sweep_*",
    "truth_x_m",
    "truth_y_m",
    "truth_z_m",
)
_FAR_QUANTILES = (0.005, 0.995)


@figure_style()
def draw_estimates_view(request: PlotRequest) -> Picture:
    """Draw the best alternative of every fix; in space, where all files have heights, by plan and elevation."""
    files = request.of("estimates")
    curved = files[0].scene.frame is not None and files[0].scene.frame.on_ellipsoid
    in_space = not curved and all("z_m" in file.names for file in files)
    axes_of = "xyz" if in_space else "xy"
    clouds: dict[str, _Cloud] = {}
    truths, notes = [], []
    for file in files:
        rows = read_sampled(file, (*_COLUMNS, *([request.by] if request.by else [])), request.max_rows)
        if request.by is not None and request.by not in rows.columns:
            near = did_you_mean(request.by, file.names)
            raise UsageError(f"`by`: {file.name} has no column {request.by!r}{near}; carry it into the estimates")
        notes += thinning_note(file, rows)
        for label, chosen in _groups(rows, file.name if len(files) > 1 else "").items():
            own = {name: values[chosen] for name, values in rows.columns.items()}
            clouds[label] = _Cloud.of(own, request.by, axes_of)
        if {f"truth_{axis}_m" for axis in axes_of} <= rows.columns.keys():
            truths.append(np.unique(positions_of(rows.columns, *(f"truth_{axis}_m" for axis in axes_of)), axis=0))
    if not clouds:
        raise DataError(f"{', '.join(file.name for file in files)}: no estimate is a fix")
    labels = list(clouds)[: _MOST_IN_SPACE if in_space else _MOST_PANELS]
    if len(clouds) > len(labels):
        notes.append(f"only {len(labels)} of {len(clouds)} groups are shown")
    truth = np.concatenate(truths) if truths else np.empty((0, len(axes_of)))
    positions = [clouds[label].position for label in labels]
    extents = {seen: _extent(files[0], positions, truth, seen) for seen in (VIEWS if in_space else VIEWS[:1])}
    extent, far = extents["xy"]
    views = ["xy", side_of(extent)] if in_space else ["xy"]
    columns = 2 if in_space else min(len(labels), 3)
    lines = -(-len(labels) * len(views) // columns)
    figure, panels = request.figure(lines, columns, size_in=map_size_in(extent, columns, lines))
    shown = [(index, label, seen) for index, label in enumerate(labels) for seen in views]
    for axes, (index, label, seen) in zip(panels, shown, strict=False):
        _draw_cloud(axes, files[0], series_style(index + 1), label, clouds[label], truth, extents[seen][0], seen)
    for axes in panels[len(shown) :]:
        axes.set_visible(False)
    place_legend(panels[columns - 1], beside=True)
    tags = {tag for label in labels for tag in clouds[label].tags}
    if len(tags) > _MOST_TAGS:
        notes.append(f"the first {_MOST_TAGS} of {len(tags)} values of {request.by!r} have colours")
    if far:
        notes.append(f"{far} estimates are outside the picture")
    return Picture(figure=figure, notes=notes)


def thinning_note(file: PlotInput, rows: SampledRows) -> list[str]:
    """Return a note if only some snapshots are drawn."""
    if rows.step == 1:
        return []
    return [f"{file.name}: 1 of {rows.step} snapshots is drawn, {rows.count} of {rows.total} rows (`max_rows`)"]


def _groups(rows: SampledRows, prefix: str) -> dict[str, IntArray]:
    """Return the row indices of each label: best alternatives that are fixes."""
    position = positions_of(rows.columns, "x_m", "y_m")
    good = np.isfinite(position).all(axis=1) & (rows.columns["alternative"] == 0.0)
    good &= fixes_of(rows.columns)
    index = np.flatnonzero(good)
    labels = np.array(labels_of_rows({name: rows.columns[name][index] for name in rows.columns}, index.size, prefix))
    return {str(label): index[labels == label] for label in dict.fromkeys(labels.tolist())}


def _extent(file: PlotInput, clouds: list[FloatArray], truth: FloatArray, seen: str) -> tuple[Extent, int]:
    """Return the extent of a view, without the farthest points of large clouds, and the number of points outside it."""
    extent = Extent()
    extent.include(scene_positions(file.scene)[1][:, coordinates(seen)])
    extent.include(truth[:, coordinates(seen)])
    clouds = [cloud[:, coordinates(seen)] for cloud in clouds]
    for cloud in clouds:
        if cloud.shape[0] < 200:
            extent.include(cloud)
        else:
            extent.include(np.quantile(cloud, _FAR_QUANTILES, axis=0))
    low, high = extent.framed()
    return extent, sum(int(np.count_nonzero(((cloud < low) | (cloud > high)).any(axis=1))) for cloud in clouds)


@dataclass(frozen=True)
class _Cloud:
    """The fixes (N,) of one panel: positions (N, D), covariances (N, 3) by view, snapshot ids, rows of each tag.

    ``std_dof`` (N,) are the degrees of freedom of estimated standard deviations, None where they are stated.

    The rows of a tag are in the order of time where it is known, otherwise in that of the file; ``in_time`` if they
    form a track.
    """

    position: FloatArray
    covariance: Mapping[str, FloatArray]
    ids: list[str]
    tags: dict[str, IntArray]
    in_time: bool
    std_dof: FloatArray | None = None

    @classmethod
    def of(cls, columns: Mapping[str, npt.NDArray[Any]], by: str | None, axes_of: str) -> _Cloud:
        position = positions_of(columns, *(f"{axis}_m" for axis in axes_of))
        covariance = {seen: covariances_of(columns, seen) for seen in VIEWS[: 2 * len(axes_of) - 3]}
        ids = [plain(name) for name in columns.get("snapshot", np.empty(0))]
        time = next((columns[name] for name in _TIMES if name in columns), None)
        order = np.arange(position.shape[0]) if time is None else np.argsort(time, kind="stable")
        names = np.array([plain(value) for value in columns[by]], dtype=object)[order] if by else np.empty(0)
        tags = {str(name): order[names == name] for name in dict.fromkeys(names.tolist())}
        in_time = by is not None or time is not None
        return cls(position, covariance, ids, tags or {"": order}, in_time, columns.get("std_dof"))


def _draw_cloud(
    axes: Axes,
    file: PlotInput,
    look: SeriesStyle,
    label: str,
    cloud: _Cloud,
    truth: FloatArray,
    extent: Extent,
    seen: str,
) -> None:
    position, truth = cloud.position[:, coordinates(seen)], truth[:, coordinates(seen)]
    view = "" if cloud.position.shape[1] == 2 else ", plan" if seen == "xy" else ", elevation"
    axes.set_title(f"{label or 'estimates'} ({position.shape[0]}){view}")
    if position.shape[0] > _DENSE_FROM:
        _draw_density(axes, position, extent)
    else:
        _draw_tags(axes, look, cloud, extent, seen)
        annotate_points(axes, cloud.ids, position[: len(cloud.ids)])
    if 0 < truth.shape[0] <= _MOST_TRUTHS:
        few = truth.shape[0] <= 5
        axes.plot(
            *truth.T,
            linestyle="none",
            marker="*" if few else "+",
            markersize=9 if few else 4,
            color="black",
            markerfacecolor="white",
            label="truth",
            zorder=3.8 if few else 2.0,
        )
    reflectors = file.scene.reflectors
    draw_reflectors(axes, reflectors if cloud.position.shape[1] == 2 else seen_reflectors(reflectors, seen))
    names, sensors = scene_positions(file.scene)
    if names:
        draw_sensors(axes, names, sensors[:, coordinates(seen)])
    finish_view(axes, seen, extent, frame=file.scene.frame)


def _draw_tags(axes: Axes, look: SeriesStyle, cloud: _Cloud, extent: Extent, seen: str) -> None:
    """Draw the fixes of each tag in a style of its own, those of a track joined by a line."""
    count, position = cloud.position.shape[0], cloud.position[:, coordinates(seen)]
    for number, (tag, rows) in enumerate(list(cloud.tags.items())):
        own = series_style(min(number, _MOST_TAGS - 1) + 1) if tag else look
        if count <= _ELLIPSES_TO:
            degrees = None if cloud.std_dof is None else cloud.std_dof[rows]
            draw_ellipses(axes, position[rows], cloud.covariance[seen][rows], own, extent, degrees=degrees)
        axes.plot(
            *position[rows].T,
            linestyle="-" if cloud.in_time else "none",
            linewidth=0.6,
            marker=own.marker,
            markersize=4.0 if count < 200 else 2.0,
            color=own.color,
            markerfacecolor="none",
            markeredgewidth=0.7,
            label=tag if tag and number < _MOST_TAGS else "_nolegend_",
            zorder=2.5,
        )


def _draw_density(axes: Axes, position: FloatArray, extent: Extent) -> None:
    """Draw the number of estimates in each cell of a square grid, on a logarithmic colour scale."""
    low, high = extent.framed()
    side = float(np.max(high - low)) / _CELLS
    edges = [np.arange(low[axis], high[axis] + side, side) for axis in (0, 1)]
    counts, *_ = np.histogram2d(position[:, 0], position[:, 1], bins=(edges[0], edges[1]))
    shown = np.ma.masked_equal(counts.T, 0.0)
    mesh = axes.pcolormesh(
        *edges, shown, cmap="cividis_r", norm=LogNorm(1.0, max(float(counts.max()), 2.0)), rasterized=True
    )
    bar = axes.figure.colorbar(mesh, cax=axes.inset_axes((0.03, 0.035, 0.4, 0.025)), orientation="horizontal")
    bar.ax.tick_params(labelsize=6.5, length=2, top=True, labeltop=True, bottom=False, labelbottom=False)
    bar.ax.set_title(axis_label("estimates per cell", ""), fontsize=6.5, pad=12)
    bar.ax.grid(visible=False)
