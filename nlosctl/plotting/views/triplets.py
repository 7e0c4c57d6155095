"""Triplets of one snapshot: both rays, the ellipse of equal path length, and their three intersections.

In space plan and elevation have the rays, the outline of the spheroid, and the three points.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.errors import DataError
from nlosctl.geometry.ellipses import error_ellipse
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.geometry.triplets import AXES, baseline_frames
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.models.traced_rays import path_points_in_space, path_spheroid
from nlosctl.plotting.figures import SeriesStyle, figure_style, series_style
from nlosctl.plotting.library import Axes, Ellipse
from nlosctl.plotting.plane import Extent
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.texts import plain
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.measured_rows import first_measurements
from nlosctl.plotting.views.snapshot_rows import draw_estimates_of_snapshot, draw_truth, estimate_rows_of
from nlosctl.plotting.views.two_views import coordinates, draw_plan_and_elevation

__all__ = ["draw_triplet_view"]

Columns = Mapping[str, npt.NDArray[Any]]

_MOST_PATHS = 4
_POINT_MARKERS = ("o", "v", "<")
_POINT_LABELS = ("1: the rays cross", "2: departing ray on the ellipse", "3: arriving ray on the ellipse")
_FARTHEST = 4.0
"""A crossing this many path lengths away (nearly parallel rays) is a note, not drawn."""


@figure_style()
def draw_triplet_view(request: PlotRequest) -> Picture:
    """Draw the first few paths of a snapshot, or the named ones."""
    measured = first_measurements(request)
    assert measured is not None  # noqa: S101 - only such files have this view
    names = _path_names(measured)
    rows, notes = _chosen(names, request.paths)
    _, estimates = estimate_rows_of(request.of("estimates"), measured.id)
    estimates = _of_paths(estimates, [names[row] for row in rows])
    frame, title = measured.scene.frame, f"Snapshot {measured.id}"
    curved = frame is not None and frame.on_ellipsoid
    in_space = measured.dimension == 3 and not curved and all("z_m" in columns for _, columns in estimates)

    def draw(axes: Axes, seen: str = "xy") -> tuple[Extent, Extent, list[str]]:
        extent, focus, all_notes = Extent(), Extent(), list(notes)
        draw_truth(axes, {name: values[rows] for name, values in measured.file_columns.items()}, focus, seen)
        all_notes += draw_estimates_of_snapshot(axes, estimates, focus, seen)
        for node, label, marker in (("tx", "transmitter", "D"), ("rx", "receiver", "^")):
            _draw_node(axes, measured, rows, node, label, marker, extent, seen)
        for index, row in enumerate(rows):
            look, views = series_style(index + 2), (extent, focus)
            if in_space:
                all_notes += _draw_path_in_space(axes, measured, row, names[row], look, views, seen)
            else:
                all_notes += _draw_path(axes, measured, row, names[row], look, views)
        extent.include_extent(focus)
        for marker, label in zip(_POINT_MARKERS, _POINT_LABELS, strict=True):
            axes.plot([], [], linestyle="none", marker=marker, color="black", markerfacecolor="white", label=label)
        return extent, focus, all_notes

    if in_space:
        return draw_plan_and_elevation(request, draw, title, frame)
    return draw_with_close_up(request, draw, title, frame)


def _path_names(measured: PlotSnapshot) -> list[str]:
    return _as_names(measured.file_columns.get("path", np.arange(measured.left_out.size, dtype=np.float64)))


def _as_names(paths: npt.NDArray[Any]) -> list[str]:
    return [f"{path:g}" if isinstance(path, float) else str(path) for path in paths]


def _chosen(names: Sequence[str], wanted: Sequence[str]) -> tuple[list[int], list[str]]:
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise DataError(f"`path` {unknown[0]}: the snapshot has no such path; it has {', '.join(names)}")
    rows = [row for row, name in enumerate(names) if not wanted or name in wanted]
    if wanted or len(rows) <= _MOST_PATHS:
        return rows, []
    return rows[:_MOST_PATHS], [f"only the first {_MOST_PATHS} of {len(rows)} paths are shown; `path` selects others"]


def _of_paths(estimates: Sequence[tuple[str, Columns]], names: Sequence[str]) -> list[tuple[str, Columns]]:
    """Return the estimates of the named paths, and those of no single path."""
    selected = []
    for prefix, columns in estimates:
        if "path" in columns:
            own = np.array([name in names or name == "nan" for name in _as_names(columns["path"])])
            columns = {name: values[own] for name, values in columns.items()}
        if next(iter(columns.values())).size:
            selected.append((prefix, columns))
    return selected


def _draw_node(
    axes: Axes,
    measured: PlotSnapshot,
    rows: Sequence[int],
    node: str,
    label: str,
    marker: str,
    extent: Extent,
    seen: str,
) -> None:
    xy = np.unique(np.stack([measured.columns[f"{node}_{axis}_m"][rows] for axis in seen], axis=1), axis=0)
    axes.plot(*xy.T, linestyle="none", marker=marker, markersize=7, color="black", label=label, zorder=4.0)
    extent.include(xy)


def _draw_path(
    axes: Axes, measured: PlotSnapshot, row: int, name: str, look: SeriesStyle, views: tuple[Extent, Extent]
) -> list[str]:
    extent, focus = views
    columns = {key: values[[row]] for key, values in measured.columns.items()}
    tx, rx = (np.array([columns[f"{node}_x_m"][0], columns[f"{node}_y_m"][0]]) for node in ("tx", "rx"))
    frame = baseline_frames(*(columns[f"{node}_{axis}_m"] for node in ("tx", "rx") for axis in AXES))
    length = float(columns["path_length_m"][0])
    rays = frame.rays(columns["dod_rad"], columns["doa_rad"], columns["path_length_m"])
    in_frame = [[rays.coordinate(number, axis).value_m for axis in AXES] for number in (1, 2, 3)]
    points = [np.array(frame.to_global(*point)).ravel() for point in in_frame]
    has_ellipse = bool(rays.has_ellipse[0])
    shown = [bool(np.isfinite(point).all()) and (number == 0 or has_ellipse) for number, point in enumerate(points)]
    shown[0] = shown[0] and float(np.hypot(*(points[0] - tx))) < _FARTHEST * length
    label = f"path {plain(name)}{_verdict(measured, row)}"
    for start, angle, on_ray in ((tx, "dod_rad", (0, 1)), (rx, "doa_rad", (0, 2))):
        along = np.array([np.cos(columns[angle][0]), np.sin(columns[angle][0])])
        reach = [float((points[number] - start) @ along) for number in on_ray if shown[number]]
        end = start + along * 1.06 * max([*reach, 0.5 * length])
        behind = start + along * 1.06 * min([*reach, 0.0])
        axes.plot(
            *np.stack([start, end]).T, color=look.color, linestyle=look.line, linewidth=1.2, label=label, zorder=2.4
        )
        axes.plot(*np.stack([start, behind]).T, color=look.color, linestyle=":", linewidth=0.8, zorder=2.3)
        extent.include(np.stack([end, behind]))
        label = "_nolegend_"
    if has_ellipse:
        _draw_path_ellipse(axes, 0.5 * (tx + rx), rx - tx, length, look, extent)
    _draw_points(axes, points, shown, look, focus)
    notes = [] if shown[0] else [f"path {name}: the rays are nearly parallel and cross far away, if at all"]
    return notes if has_ellipse else [*notes, f"path {name}: no ellipse, because it is not longer than the baseline"]


def _draw_points(
    axes: Axes, points: Sequence[FloatArray], shown: Sequence[bool], look: SeriesStyle, focus: Extent
) -> None:
    for number, point in enumerate(points):
        if shown[number]:
            axes.plot(
                *point,
                marker=_POINT_MARKERS[number],
                markersize=7.5 - number,
                color=look.color,
                markerfacecolor="white",
                markeredgewidth=1.3,
                linestyle="none",
                zorder=3.4,
            )
            focus.include(point[None])


def _draw_path_in_space(
    axes: Axes, measured: PlotSnapshot, row: int, name: str, look: SeriesStyle, views: tuple[Extent, Extent], seen: str
) -> list[str]:
    """Draw a path in a view of space; a direction without an elevation has no ray."""
    extent, focus = views
    columns = {key: float(values[row]) for key, values in measured.columns.items() if values.dtype.kind in "fiu"}
    tx, rx = (np.array([columns[f"{node}_{axis}_m"] for axis in "xyz"]) for node in ("tx", "rx"))
    rays = [_direction(columns, "dod"), _direction(columns, "doa")]
    length, view = columns["path_length_m"], coordinates(seen)
    points = path_points_in_space(tx, rx, rays[0], rays[1], length)
    shown = [bool(np.isfinite(point).all()) for point in points]
    shown[0] = shown[0] and float(np.linalg.norm(points[0] - tx)) < _FARTHEST * length
    label = f"path {plain(name)}{_verdict(measured, row)}"
    for start, ray, own in ((tx, rays[0], 1), (rx, rays[1], 2)):
        if not np.isfinite(ray).all():
            continue
        reach = [float((points[number] - start) @ ray) for number in (0, own) if shown[number]]
        line = np.stack([start, start + 1.06 * max([*reach, 0.5 * length]) * ray])[:, view]
        axes.plot(*line.T, color=look.color, linestyle=look.line, linewidth=1.2, label=label, zorder=2.4)
        extent.include(line)
        label = "_nolegend_"
    part = path_spheroid(tx, rx, length)[np.ix_(view, view)]
    outline = error_ellipse(Symmetric2x2(*(np.array([value]) for value in (part[0, 0], part[0, 1], part[1, 1]))))
    if np.isfinite(part).all():
        center, sizes = 0.5 * (tx + rx)[view], (float(outline.semi_major_m[0]), float(outline.semi_minor_m[0]))
        turn = float(np.degrees(outline.orientation_rad[0]))
        _add_ellipse(axes, center, 2.0 * sizes[0], 2.0 * sizes[1], turn, look)
        extent.include(center[None], np.sqrt(np.diag(part))[None])
    _draw_points(axes, list(points[:, view]), shown, look, focus)
    lacking = not np.isfinite(rays).all()
    notes = [f"path {name}: a direction without an elevation is not drawn"] if lacking else []
    if not (lacking or shown[0]):
        notes.append(f"path {name}: the rays are nearly parallel and cross far away, if at all")
    if not np.isfinite(part).all():
        notes.append(f"path {name}: no ellipse, because it is not longer than the baseline")
    return notes


def _direction(columns: Mapping[str, float], side: str) -> FloatArray:
    """Return the unit vector (3,) of a departure or arrival, NaN without an elevation."""
    azimuth, elevation = columns[f"{side}_rad"], columns.get(f"{side}_elevation_rad", np.nan)
    level = np.cos(elevation)
    return np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])


def _verdict(measured: PlotSnapshot, row: int) -> str:
    if "ip" not in measured.file_columns:
        return ""
    return {1: ", called indirect", 0: ", called direct"}.get(int(measured.file_columns["ip"][row]), ", not judged")


def _draw_path_ellipse(
    axes: Axes, center: FloatArray, baseline: FloatArray, length: float, look: SeriesStyle, extent: Extent
) -> None:
    half_minor = 0.5 * np.sqrt(length**2 - float(baseline @ baseline))
    angle = float(np.arctan2(baseline[1], baseline[0]))
    _add_ellipse(axes, center, length, float(2.0 * half_minor), float(np.degrees(angle)), look)
    reach = np.hypot(
        0.5 * length * np.array([np.cos(angle), np.sin(angle)]), half_minor * np.array([np.sin(angle), np.cos(angle)])
    )
    extent.include(center[None], reach[None])


def _add_ellipse(
    axes: Axes, center: FloatArray, width: float, height: float, turn_deg: float, look: SeriesStyle
) -> None:
    axes.add_patch(
        Ellipse(
            (float(center[0]), float(center[1])),
            width,
            height,
            angle=turn_deg,
            fill=False,
            edgecolor=look.color,
            linestyle=look.line,
            linewidth=0.7,
            alpha=0.8,
            zorder=2.0,
        )
    )
