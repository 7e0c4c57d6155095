"""One snapshot over its scene: sensors, mirrors, bearings and the ways their waves came, ranges, estimates, truth."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import Reflector, Scene
from nlosctl.errors import UsageError
from nlosctl.io.results.plot_inputs import DrawnSnapshot, read_snapshot
from nlosctl.models.traced_rays import trace_back
from nlosctl.plotting.figures import figure_style
from nlosctl.plotting.library import Axes, Circle, Polygon
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors, scene_sensors
from nlosctl.plotting.requests import Picture, Request
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.snapshot_rows import draw_estimates_of_snapshot, draw_truth, estimate_rows_of

__all__ = ["draw_range_circle", "draw_scene_view", "first_measurements", "sensor_positions"]


_WIDEST_WEDGE_RAD = 1.0
_BEYOND = 1.12


@dataclasses.dataclass(frozen=True)
class _RayLook:
    """How a kind of ray looks, and what the legend calls it."""

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
def draw_scene_view(request: Request) -> Picture:
    """Draw one snapshot: measurements, estimates, or both."""
    measured = first_measurements(request)
    snapshot = request.snapshot if measured is None else measured.id
    snapshot, found = estimate_rows_of(request.of("estimates"), snapshot)
    scene = request.files[0].scene if measured is None else measured.scene
    names, sensors = scene_sensors(scene) if measured is None else sensor_positions(measured)

    def draw(axes: Axes) -> tuple[Extent, Extent, list[str]]:
        extent, focus = Extent(), Extent()
        extent.include(sensors)
        draw_truth(axes, found[0][1] if measured is None else measured.file_columns, focus)
        notes = draw_estimates_of_snapshot(axes, found, focus)
        extent.include_all(focus)
        draw_reflectors(axes, scene.reflectors)
        if names:
            draw_sensors(axes, names, sensors)
        if measured is not None:
            _draw_measurements(axes, measured, extent, focus)
        return extent, focus if found else Extent(), notes

    return draw_with_close_up(request, draw, f"Snapshot {snapshot}")


def first_measurements(request: Request) -> DrawnSnapshot | None:
    """Return the snapshot of the one file of measurements or flags, if there is such a file."""
    files = request.of("measurements", "flags")
    if len(files) > 1:
        raise UsageError(
            f"{', '.join(file.name for file in files)}: one file of measurements makes a picture; name one"
        )
    if not files:
        return None
    return read_snapshot(files[0], request.read, request.snapshot)


def sensor_positions(measured: DrawnSnapshot) -> tuple[list[str], FloatArray]:
    """Return the names of a snapshot's sensors and their places (N, 2), each once."""
    places = np.stack([measured.columns["sensor_x_m"], measured.columns["sensor_y_m"]], axis=1)
    told = dict.fromkeys((str(name), *place) for name, place in zip(measured.sensor, places.tolist(), strict=True))
    return [str(key[0]) for key in told], np.array([key[1:] for key in told]).reshape(-1, 2)


def draw_range_circle(axes: Axes, center: FloatArray, radius: float, **look: Any) -> None:
    """Draw the circle of a range about its sensor."""
    label = look.pop("label")
    axes.add_patch(Circle((float(center[0]), float(center[1])), radius, fill=False, **look))
    axes.plot([], [], color=look["edgecolor"], linestyle=look["linestyle"], label=label)


def _draw_measurements(axes: Axes, measured: DrawnSnapshot, extent: Extent, focus: Extent) -> None:
    columns = measured.columns
    sensor = np.stack([columns["sensor_x_m"], columns["sensor_y_m"]], axis=1)
    kinds = _row_kinds(measured)
    told: set[str] = set()
    for row in range(sensor.shape[0]):
        look = _LOOKS[kinds[row]]
        if "bearing_rad" in columns:
            _draw_ray(axes, measured, row, look, told, (extent, focus))
        elif np.isfinite(columns["range_m"][row]):
            label = look.label.replace("bearing $\\pm 1$ std", "range").replace("bearing", "range")
            draw_range_circle(
                axes,
                sensor[row],
                float(columns["range_m"][row]),
                edgecolor=look.color,
                linestyle=look.line,
                linewidth=1.0,
                label=_once(told, label),
                zorder=2.0,
            )


def _row_kinds(measured: DrawnSnapshot) -> list[str]:
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
    axes: Axes, measured: DrawnSnapshot, row: int, look: _RayLook, told: set[str], views: tuple[Extent, Extent]
) -> None:
    """Draw a bearing as the way the wave came, to a little beyond the estimates, and its wedge of +-1 std."""
    columns = measured.columns
    sensor = np.array([[columns["sensor_x_m"][row], columns["sensor_y_m"][row]]])
    reflector = _reflector_of(measured.scene, columns, row)
    std = float(columns["bearing_std_rad"][row])
    goal = views[1] if views[1].is_known else views[0]
    ways = [_way(sensor, float(columns["bearing_rad"][row]) + turn, reflector, goal) for turn in (-std, 0.0, std)]
    label = _once(told, look.label)
    axes.plot(*ways[1].T, color=look.color, linestyle=look.line, linewidth=1.1, label=label, zorder=2.4)
    if len(ways[1]) > 2:
        views[0].include(ways[1][1:2])
    if look.wedge and std < _WIDEST_WEDGE_RAD and len(ways[0]) == len(ways[1]) == len(ways[2]):
        for leg in range(len(ways[1]) - 1):
            corners = [ways[0][leg], ways[0][leg + 1], ways[2][leg + 1], ways[2][leg]]
            axes.add_patch(
                Polygon(corners, closed=True, facecolor=look.color, alpha=0.13, edgecolor="none", zorder=1.8)
            )


def _way(sensor: FloatArray, bearing: float, reflector: Reflector | None, goal: Extent) -> FloatArray:
    """Return the corners (2 or 3, 2) of the way back: sensor, hit if there is one, end a little beyond ``goal``."""
    rays = trace_back(sensor, np.array([bearing]), reflector)
    if not np.isfinite(rays.hit_m).all():  # it never meets its mirror: drawn as it points
        rays, reflector = trace_back(sensor, np.array([bearing]), None), None
    corners = np.array(np.meshgrid(*zip(goal.low, goal.high, strict=True))).reshape(2, -1).T
    along = np.array([np.cos(rays.direction_rad[0]), np.sin(rays.direction_rad[0])])
    reach = float(np.max((corners - rays.hit_m[0]) @ along, initial=0.0))
    nearest = float(np.hypot(*(0.5 * (goal.low + goal.high) - rays.hit_m[0])))  # where it leads away from the goal
    end = rays.points_at(_BEYOND * max(reach, 0.5 * nearest))[0]
    return np.array([sensor[0], end]) if reflector is None else np.array([sensor[0], rays.hit_m[0], end])


def _reflector_of(scene: Scene, columns: dict[str, npt.NDArray[np.generic]], row: int) -> Reflector | None:
    place = int(columns["reflector"][row]) if "reflector" in columns else -1
    return scene.reflectors[place] if place >= 0 else None


def _once(told: set[str], label: str) -> str:
    new = "_nolegend_" if label in told else label
    told.add(label)
    return new
