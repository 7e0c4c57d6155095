"""One snapshot over its scene: sensors, mirrors, bearings traced back over their mirrors, ranges, estimates, truth."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import Reflector, Scene
from nlosctl.errors import UsageError
from nlosctl.io.results.plot_inputs import PlotSnapshot, read_snapshot
from nlosctl.models.traced_rays import points_at_range
from nlosctl.plotting.library import Axes, Circle, Polygon
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors, legend_once, scene_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.many_rows import MANY_ROWS, circle_outlines, draw_faint_lines, draw_tracks, ray_paths
from nlosctl.plotting.views.snapshot_rows import Columns, draw_estimates_of_snapshot, draw_truth

__all__ = [
    "ROW_LOOKS",
    "RowLook",
    "draw_in_plane",
    "draw_range",
    "first_measurements",
    "horizontal_ranges",
    "range_label",
    "reflector_of",
    "row_kinds",
    "row_sensors",
    "sensor_positions",
]

_WIDEST_WEDGE_RAD = 1.0


@dataclasses.dataclass(frozen=True)
class RowLook:
    """Look of a kind of row, and its label in the legend."""

    label: str
    color: str
    line: str | tuple[int, tuple[float, ...]]
    wedge: bool


ROW_LOOKS = {
    "direct": RowLook("bearing $\\pm 1$ std, direct", "#0072b2", "-", wedge=True),
    "reflected": RowLook("bearing $\\pm 1$ std, by a mirror", "#b35900", (0, (5.0, 1.5)), wedge=True),
    "flagged": RowLook("bearing, flagged (los false)", "#808080", (0, (1.0, 2.0)), wedge=False),
    "unused": RowLook("bearing, not used", "#a8a8a8", (0, (3.0, 3.0)), wedge=False),
}


def draw_in_plane(
    request: PlotRequest, measured: PlotSnapshot | None, snapshot: str | None, estimates: Sequence[tuple[str, Columns]]
) -> Picture:
    """Draw one snapshot in the plane: measurements, estimates, or both."""
    scene = request.files[0].scene if measured is None else measured.scene
    names, sensors = scene_sensors(scene) if measured is None else sensor_positions(measured)

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
            draw_tracks(axes, measured.sensor, row_sensors(measured))
        if measured is not None:
            notes += _draw_measurements(axes, measured, extent, focus, request.target_z_m)
        return extent, focus if estimates else Extent(), notes

    return draw_with_close_up(request, draw, f"Snapshot {snapshot}", scene.frame)


def first_measurements(request: PlotRequest) -> PlotSnapshot | None:
    """Return the requested snapshot of the file of measurements or flags; None without such a file."""
    files = request.of("measurements", "flags")
    if len(files) > 1:
        raise UsageError(
            f"{', '.join(file.name for file in files)}: a picture takes one file of measurements; name only one"
        )
    if not files:
        return None
    return read_snapshot(files[0], request.read, request.snapshot)


def sensor_positions(measured: PlotSnapshot) -> tuple[list[str], FloatArray]:
    """Return the names of a snapshot's sensors and their positions (N, 2), each once."""
    points = row_sensors(measured).tolist()
    sensors = dict.fromkeys((str(name), *point) for name, point in zip(measured.sensor, points, strict=True))
    return [str(key[0]) for key in sensors], np.array([key[1:] for key in sensors]).reshape(-1, 2)


def row_sensors(measured: PlotSnapshot) -> FloatArray:
    """Return the sensor position (K, 2) of each row."""
    return np.stack([measured.columns["sensor_x_m"], measured.columns["sensor_y_m"]], axis=1)


def horizontal_ranges(measured: PlotSnapshot, target_z_m: float | None) -> tuple[FloatArray, list[str]]:
    """Return the radii (K,) of the circles of the ranges in the plane of the targets, and notes on them.

    With ``target_z_m`` a range is a slant one from the height of its sensor; NaN where it is shorter than the height.
    """
    slant, height = measured.columns["range_m"], measured.columns.get("sensor_z_m")
    if target_z_m is None:
        note = "ranges are drawn as horizontal; `target_z_m` takes the heights of the sensors into account"
        return slant, [] if height is None else [note]
    if height is None:
        raise UsageError("`target_z_m` needs the column 'sensor_z_m', the height of each sensor")
    squared = slant * slant - (height - target_z_m) ** 2
    short = int(np.count_nonzero(squared < 0.0))
    notes = [f"{short} of {slant.size} ranges are shorter than the height of their sensor: no circle"] if short else []
    return np.sqrt(np.where(squared < 0.0, np.nan, squared)), notes


def draw_range(axes: Axes, measured: PlotSnapshot, row: int, radius: float, **look: Any) -> None:
    """Draw the points at the range of a row: a circle about its sensor, or the curve that its reflector makes of it.

    ``radius`` is the range in the plane, from `horizontal_ranges`.
    """
    color, label = look["edgecolor"], look.pop("label")
    sensor = row_sensors(measured)[row]
    reflector = reflector_of(measured.scene, measured.columns, row)
    line = {"color": color, "linestyle": look["linestyle"], "label": label}
    if reflector is None:
        axes.add_patch(Circle((float(sensor[0]), float(sensor[1])), radius, fill=False, **look))
        axes.plot([], [], **line)
    else:
        points = points_at_range(sensor, radius, reflector)
        axes.plot(*points.T, linewidth=look["linewidth"], zorder=look["zorder"], scalex=False, scaley=False, **line)


def _draw_measurements(
    axes: Axes, measured: PlotSnapshot, extent: Extent, focus: Extent, target_z_m: float | None
) -> list[str]:
    """Draw every row, in an own style for each kind of row; return notes on what is not drawn."""
    kinds = row_kinds(measured)
    bearings = "bearing_rad" in measured.columns
    if target_z_m is not None and bearings and "range_m" not in measured.columns:
        raise UsageError("`target_z_m` needs ranges")
    if not bearings and "range_m" not in measured.columns:
        raise UsageError(f"there is no picture of the rows of {measured.kind}; plot the estimates")
    radius, notes = (None, []) if bearings else horizontal_ranges(measured, target_z_m)
    if len(kinds) > MANY_ROWS:
        _draw_many(axes, measured, np.array(kinds), radius, (extent, focus))
        return [*notes, f"{len(kinds)} rows: their lines are faint, without +-1 std"]
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


def range_label(look: RowLook) -> str:
    """Return the label of a kind of range in the legend."""
    return look.label.replace("bearing $\\pm 1$ std", "range").replace("bearing", "range")


def _draw_many(
    axes: Axes,
    measured: PlotSnapshot,
    kinds: npt.NDArray[np.generic],
    radius: FloatArray | None,
    views: tuple[Extent, Extent],
) -> None:
    """Draw the rays, or the circles of the ranges, of many rows: lines that fade with their number."""
    sensor = row_sensors(measured)
    goal = views[1] if views[1].is_known else views[0]
    reflector = measured.columns.get("reflector", np.full(kinds.shape, -1)).astype(np.int64)
    for kind, look in reversed(ROW_LOOKS.items()):
        rows = np.flatnonzero(kinds == kind)
        if not rows.size:
            continue
        if radius is None:
            bearing = measured.columns["bearing_rad"]
            lines = [
                ray_paths(sensor[own], bearing[own], reflector_of(measured.scene, measured.columns, own[0]), goal)
                for own in (rows[reflector[rows] == number] for number in np.unique(reflector[rows]))
            ]
            outlines, label = list(np.concatenate(lines)), look.label.replace(" $\\pm 1$ std", "")
        else:
            rows, label = rows[np.isfinite(radius[rows])], range_label(look)
            direct, mirrored = rows[reflector[rows] < 0], rows[reflector[rows] >= 0]
            outlines = list(circle_outlines(sensor[direct], radius[direct]))
            for row in mirrored:
                mirror = reflector_of(measured.scene, measured.columns, row)
                outlines += [] if mirror is None else [points_at_range(sensor[row], float(radius[row]), mirror)]
        draw_faint_lines(axes, outlines, color=look.color, label=label, zorder=2.0)


def row_kinds(measured: PlotSnapshot) -> list[str]:
    """Return the kind of each row (K,), a key of `ROW_LOOKS`."""
    columns, file = measured.columns, measured.file_columns
    size = len(measured.sensor)
    reflector = columns.get("reflector", np.full(size, -1))
    los, used = file.get("los", np.full(size, 1)), file.get("used", np.full(size, 1))
    kinds = []
    for row in range(size):
        if los[row] == 0 or measured.left_out[row]:
            kinds.append("flagged")
        elif used[row] == 0:
            kinds.append("unused")
        else:
            kinds.append("reflected" if reflector[row] >= 0 else "direct")
    return kinds


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
    low, middle, high = (ray_paths(sensor, np.array([bearing + part]), reflector, goal)[0] for part in (-std, 0.0, std))
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


def reflector_of(scene: Scene, columns: dict[str, npt.NDArray[np.generic]], row: int) -> Reflector | None:
    """Return the reflector of a row, None without one."""
    index = int(columns["reflector"][row]) if "reflector" in columns else -1
    return scene.reflectors[index] if index >= 0 else None
