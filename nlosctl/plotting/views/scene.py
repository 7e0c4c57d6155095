"""One snapshot over its scene: sensors, mirrors, bearings traced back over their mirrors, ranges, estimates, truth."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import Reflector, Scene
from nlosctl.errors import UsageError
from nlosctl.io.results.plot_inputs import PlotSnapshot, read_snapshot
from nlosctl.models.traced_rays import points_at_range, trace_back
from nlosctl.plotting.figures import figure_style
from nlosctl.plotting.library import Axes, Circle, Polygon
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors, legend_once, scene_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.snapshot_rows import draw_estimates_of_snapshot, draw_truth, estimate_rows_of

__all__ = ["draw_range", "draw_scene_view", "first_measurements", "sensor_positions"]

_WIDEST_WEDGE_RAD = 1.0
_BEYOND = 1.12


@dataclasses.dataclass(frozen=True)
class _RayLook:
    """Look of a kind of ray, and its label in the legend."""

    label: str
    color: str
    line: str | tuple[int, tuple[float, ...]]
    wedge: bool


_LOOKS = {
    "direct": _RayLook("bearing $\\pm 1$ std, direct", "#0072b2", "-", wedge=True),
    "reflected": _RayLook("bearing $\\pm 1$ std, by a mirror", "#b35900", (0, (5.0, 1.5)), wedge=True),
    "flagged": _RayLook("bearing, flagged (los false)", "#808080", (0, (1.0, 2.0)), wedge=False),
    "unused": _RayLook("bearing, not used", "#a8a8a8", (0, (3.0, 3.0)), wedge=False),
}


@figure_style()
def draw_scene_view(request: PlotRequest) -> Picture:
    """Draw one snapshot: measurements, estimates, or both."""
    measured = first_measurements(request)
    snapshot = request.snapshot if measured is None else measured.id
    snapshot, estimates = estimate_rows_of(request.of("estimates"), snapshot)
    scene = request.files[0].scene if measured is None else measured.scene
    names, sensors = scene_sensors(scene) if measured is None else sensor_positions(measured)

    def draw(axes: Axes) -> tuple[Extent, Extent, list[str]]:
        extent, focus = Extent(), Extent()
        extent.include(sensors)
        draw_truth(axes, estimates[0][1] if measured is None else measured.file_columns, focus)
        notes = draw_estimates_of_snapshot(axes, estimates, focus)
        extent.include_extent(focus)
        draw_reflectors(axes, scene.reflectors)
        if names:
            draw_sensors(axes, names, sensors)
        if measured is not None:
            _draw_measurements(axes, measured, extent, focus)
        return extent, focus if estimates else Extent(), notes

    return draw_with_close_up(request, draw, f"Snapshot {snapshot}")


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
    xy = np.stack([measured.columns["sensor_x_m"], measured.columns["sensor_y_m"]], axis=1)
    sensors = dict.fromkeys((str(name), *point) for name, point in zip(measured.sensor, xy.tolist(), strict=True))
    return [str(key[0]) for key in sensors], np.array([key[1:] for key in sensors]).reshape(-1, 2)


def draw_range(axes: Axes, measured: PlotSnapshot, row: int, **look: Any) -> None:
    """Draw the points at the range of a row: a circle about its sensor, or the curve that its reflector makes of it."""
    columns, color, label = measured.columns, look["edgecolor"], look.pop("label")
    sensor = np.array([columns["sensor_x_m"][row], columns["sensor_y_m"][row]])
    reflector = _reflector_of(measured.scene, columns, row)
    line = {"color": color, "linestyle": look["linestyle"], "label": label}
    if reflector is None:
        axes.add_patch(Circle((float(sensor[0]), float(sensor[1])), float(columns["range_m"][row]), fill=False, **look))
        axes.plot([], [], **line)
    else:
        points = points_at_range(sensor, float(columns["range_m"][row]), reflector)
        axes.plot(*points.T, linewidth=look["linewidth"], zorder=look["zorder"], scalex=False, scaley=False, **line)


def _draw_measurements(axes: Axes, measured: PlotSnapshot, extent: Extent, focus: Extent) -> None:
    columns = measured.columns
    sensor = np.stack([columns["sensor_x_m"], columns["sensor_y_m"]], axis=1)
    kinds = _row_kinds(measured)
    labels: set[str] = set()
    for row in range(sensor.shape[0]):
        look = _LOOKS[kinds[row]]
        if "bearing_rad" in columns:
            _draw_ray(axes, measured, row, look, legend_once(labels, look.label), (extent, focus))
        elif np.isfinite(columns["range_m"][row]):
            label = look.label.replace("bearing $\\pm 1$ std", "range").replace("bearing", "range")
            draw_range(
                axes,
                measured,
                row,
                edgecolor=look.color,
                linestyle=look.line,
                linewidth=1.0,
                label=legend_once(labels, label),
                zorder=2.0,
            )


def _row_kinds(measured: PlotSnapshot) -> list[str]:
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
    axes: Axes, measured: PlotSnapshot, row: int, look: _RayLook, label: str, views: tuple[Extent, Extent]
) -> None:
    """Draw a bearing as the path of its wave, to a little beyond the estimates, and its wedge of +-1 std."""
    columns = measured.columns
    sensor = np.array([[columns["sensor_x_m"][row], columns["sensor_y_m"][row]]])
    reflector = _reflector_of(measured.scene, columns, row)
    std = float(columns["bearing_std_rad"][row])
    goal = views[1] if views[1].is_known else views[0]
    bearing = float(columns["bearing_rad"][row])
    low, middle, high = (_ray_path(sensor, bearing + offset, reflector, goal) for offset in (-std, 0.0, std))
    axes.plot(*middle.T, color=look.color, linestyle=look.line, linewidth=1.1, label=label, zorder=2.4)
    if len(middle) > 2:
        views[0].include(middle[1:2])
    if look.wedge and std < _WIDEST_WEDGE_RAD and len(low) == len(middle) == len(high):
        for leg in range(len(middle) - 1):
            corners = [low[leg], low[leg + 1], high[leg + 1], high[leg]]
            axes.add_patch(
                Polygon(corners, closed=True, facecolor=look.color, alpha=0.13, edgecolor="none", zorder=1.8)
            )


def _ray_path(sensor: FloatArray, bearing: float, reflector: Reflector | None, goal: Extent) -> FloatArray:
    """Return the corners (2 or 3, 2) of a ray: sensor, reflection point if any, end a little beyond ``goal``."""
    rays = trace_back(sensor, np.array([bearing]), reflector)
    if not np.isfinite(rays.hit_m).all():  # a ray that misses its mirror is drawn straight
        rays, reflector = trace_back(sensor, np.array([bearing]), None), None
    corners = np.array(np.meshgrid(*zip(goal.low, goal.high, strict=True))).reshape(2, -1).T
    along = np.array([np.cos(rays.direction_rad[0]), np.sin(rays.direction_rad[0])])
    reach = float(np.max((corners - rays.hit_m[0]) @ along, initial=0.0))
    distance = float(np.hypot(*(0.5 * (goal.low + goal.high) - rays.hit_m[0])))  # for rays that lead away from the goal
    end = rays.points_at(_BEYOND * max(reach, 0.5 * distance))[0]
    return np.array([sensor[0], end]) if reflector is None else np.array([sensor[0], rays.hit_m[0], end])


def _reflector_of(scene: Scene, columns: dict[str, npt.NDArray[np.generic]], row: int) -> Reflector | None:
    index = int(columns["reflector"][row]) if "reflector" in columns else -1
    return scene.reflectors[index] if index >= 0 else None
