"""One snapshot over its scene: sensors, mirrors, bearings traced back over their mirrors, ranges, estimates, truth."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import PlaneReflector, SphereReflector
from nlosctl.errors import UsageError
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.io.results.plotted_rows import differences_of, row_kinds, row_positions
from nlosctl.models.traced_rays import points_at_range, ray_paths
from nlosctl.plotting.library import Axes, Circle, Polygon
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors, legend_once, scene_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.arrivals import draw_hyperbolas, draw_hyperbolas_on_earth
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.many_rows import MANY_ROWS, circle_outlines, draw_faint_lines, draw_tracks
from nlosctl.plotting.views.measured_rows import (
    ROW_LOOKS,
    RowLook,
    horizontal_ranges,
    range_label,
    reflector_of,
    sensor_positions,
    without_std,
)
from nlosctl.plotting.views.snapshot_rows import Columns, draw_estimates_of_snapshot, draw_truth

__all__ = ["draw_in_plane", "draw_range"]

_WIDEST_WEDGE_RAD = 1.0
_AROUND, _REACH = 0.5, 4.0
"""Shares of the span: the surroundings of sensors without an estimate, and how far hyperbolas go."""


def draw_in_plane(
    request: PlotRequest, measured: PlotSnapshot | None, snapshot: str | None, estimates: Sequence[tuple[str, Columns]]
) -> Picture:
    """Draw one snapshot in the plane: measurements, estimates, or both."""
    scene = request.files[0].scene if measured is None else measured.scene
    names, sensors = scene_sensors(scene) if measured is None else sensor_positions(measured)
    if measured is not None:
        _refuse_reflectors_of_space(measured)
    heights = [columns for _, columns in estimates if "z_m" in columns and np.isfinite(columns["z_m"][0])]
    place = np.array([heights[0][f"{axis}_m"][0] for axis in "xyz"], dtype=np.float64) if heights else None

    def draw(axes: Axes) -> tuple[Extent, Extent, list[str]]:
        extent, focus = Extent(), Extent()
        extent.include(sensors)
        draw_truth(axes, estimates[0][1] if measured is None else measured.file_columns, focus)
        notes = draw_estimates_of_snapshot(axes, estimates, focus)
        extent.include_extent(focus)
        draw_reflectors(axes, scene.reflectors)
        if measured is None or len(measured.sensor) <= MANY_ROWS:
            draw_sensors(axes, names, sensors)
        else:
            draw_tracks(axes, measured.sensor, row_positions(measured))
        if measured is not None:
            notes += _draw_measurements(axes, measured, extent, focus, request.target_z_m, place)
        return extent, focus if estimates else Extent(), notes

    return draw_with_close_up(request, draw, f"Snapshot {snapshot}", scene.frame)


def _refuse_reflectors_of_space(measured: PlotSnapshot) -> None:
    """Raise UsageError for rows by planes or spheres, which have no picture among places on earth."""
    for number in np.unique(measured.columns.get("reflector", np.empty(0))):
        mirror = measured.scene.reflectors[int(number)] if number >= 0 else None
        if isinstance(mirror, PlaneReflector | SphereReflector):
            raise UsageError(
                f"reflector {mirror.name!r}: places on earth in three dimensions are drawn in the plane, where rows by "
                "planes and spheres have no picture; give x, y, z in metres"
            )


def draw_range(axes: Axes, measured: PlotSnapshot, row: int, radius: float, **look: Any) -> None:
    """Draw the points at the range of a row: a circle about its sensor, or the curve that its reflector makes of it.

    ``radius`` is the range in the plane, from `horizontal_ranges`.
    """
    color, label = look["edgecolor"], look.pop("label")
    sensor = row_positions(measured)[row]
    reflector = reflector_of(measured.scene, measured.columns, row)
    line = {"color": color, "linestyle": look["linestyle"], "label": label}
    if reflector is None:
        axes.add_patch(Circle((float(sensor[0]), float(sensor[1])), radius, fill=False, **look))
        axes.plot([], [], **line)
    else:
        points = points_at_range(sensor, radius, reflector)
        axes.plot(*points.T, linewidth=look["linewidth"], zorder=look["zorder"], scalex=False, scaley=False, **line)


def _draw_measurements(
    axes: Axes,
    measured: PlotSnapshot,
    extent: Extent,
    focus: Extent,
    target_z_m: float | None,
    place_m: FloatArray | None,
) -> list[str]:
    """Draw every row, in an own style for each kind of row; return notes on what is not drawn.

    ``place_m`` (3,) is the first estimate in space, if any, of places on the ellipsoid.
    """
    kinds = row_kinds(measured)
    bearings = "bearing_rad" in measured.columns
    if target_z_m is not None and "range_m" not in measured.columns:
        raise UsageError("`target_z_m` needs ranges, or three dimensions")
    faint = [f"{len(kinds)} rows: their lines are faint, without +-1 std"] if len(kinds) > MANY_ROWS else []
    if measured.kind == "arrivals":
        if not focus.is_known:
            extent.include(row_positions(measured), _AROUND * extent.span_m)
        return _draw_arrivals(axes, measured, extent, place_m) + faint
    radius, notes = (None, []) if bearings else horizontal_ranges(measured, target_z_m)
    if faint:
        _draw_many(axes, measured, np.array(kinds), radius, (extent, focus))
        return [*notes, *faint]
    labels: set[str] = set()
    for row, kind in enumerate(kinds):
        look = ROW_LOOKS[kind]
        if radius is None:
            _draw_ray(axes, measured, row, look, legend_once(labels, look.label), (extent, focus))
        elif np.isfinite(radius[row]):
            draw_range(
                axes,
                measured,
                row,
                float(radius[row]),
                edgecolor=look.color,
                linestyle=look.line,
                linewidth=1.0,
                label=legend_once(labels, range_label(look)),
                zorder=2.0,
            )
    return notes


def _draw_arrivals(axes: Axes, measured: PlotSnapshot, extent: Extent, place_m: FloatArray | None) -> list[str]:
    frame, reach = measured.scene.frame, _REACH * extent.span_m
    if frame is None or not frame.on_ellipsoid:
        return draw_hyperbolas(axes, differences_of(measured), reach)
    if place_m is None:
        return ["no hyperbolas: their height is that of an estimate"]
    return draw_hyperbolas_on_earth(axes, differences_of(measured), reach, frame, place_m)


def _draw_many(
    axes: Axes,
    measured: PlotSnapshot,
    kinds: npt.NDArray[np.generic],
    radius: FloatArray | None,
    views: tuple[Extent, Extent],
) -> None:
    """Draw the rays, or the circles of the ranges, of many rows: lines that fade with their number."""
    sensor = row_positions(measured)
    goal = views[1] if views[1].is_known else views[0]
    reflector = measured.columns.get("reflector", np.full(kinds.shape, -1)).astype(np.int64)
    for kind, look in reversed(ROW_LOOKS.items()):
        rows = np.flatnonzero(kinds == kind)
        if not rows.size:
            continue
        if radius is None:
            bearing = measured.columns["bearing_rad"]
            lines = [
                ray_paths(
                    sensor[own],
                    bearing[own],
                    reflector_of(measured.scene, measured.columns, own[0]),
                    goal.low,
                    goal.high,
                )
                for own in (rows[reflector[rows] == number] for number in np.unique(reflector[rows]))
            ]
            outlines, label = list(np.concatenate(lines)), without_std(look.label)
        else:
            rows, label = rows[np.isfinite(radius[rows])], range_label(look)
            direct, mirrored = rows[reflector[rows] < 0], rows[reflector[rows] >= 0]
            outlines = list(circle_outlines(sensor[direct], radius[direct]))
            for row in mirrored:
                mirror = reflector_of(measured.scene, measured.columns, row)
                outlines += [] if mirror is None else [points_at_range(sensor[row], float(radius[row]), mirror)]
        draw_faint_lines(axes, outlines, color=look.color, label=label, zorder=2.0)


def _draw_ray(
    axes: Axes, measured: PlotSnapshot, row: int, look: RowLook, label: str, views: tuple[Extent, Extent]
) -> None:
    """Draw a bearing as the path of its wave, to a little beyond the estimates, and its wedge of +-1 std."""
    columns = measured.columns
    sensor = np.array([[columns["sensor_x_m"][row], columns["sensor_y_m"][row]]])
    reflector = reflector_of(measured.scene, columns, row)
    std = float(columns["bearing_std_rad"][row])
    goal = views[1] if views[1].is_known else views[0]
    bearing = float(columns["bearing_rad"][row])
    low, middle, high = (
        ray_paths(sensor, np.array([bearing + part]), reflector, goal.low, goal.high)[0] for part in (-std, 0.0, std)
    )
    reflected = [bool((path[1] != path[0]).any()) for path in (low, middle, high)]
    axes.plot(
        *middle[not reflected[1] :].T, color=look.color, linestyle=look.line, linewidth=1.1, label=label, zorder=2.4
    )
    if reflected[1]:
        views[0].include(middle[1:2])
    if not _leads_to(middle, goal):
        views[0].include(middle[2:])
    if look.wedge and std < _WIDEST_WEDGE_RAD and len(set(reflected)) == 1:
        for leg in range(not reflected[1], 2):
            corners = [low[leg], low[leg + 1], high[leg + 1], high[leg]]
            axes.add_patch(
                Polygon(corners, closed=True, facecolor=look.color, alpha=0.13, edgecolor="none", zorder=1.8)
            )


def _leads_to(path: FloatArray, goal: Extent) -> bool:
    """Return whether the last leg of a ray (3, 2) points towards the middle of ``goal``, not away from it."""
    along = path[2] - path[1]
    return bool((0.5 * (goal.low + goal.high) - path[1]) @ along > 0.0)
