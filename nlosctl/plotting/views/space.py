"""One snapshot over its scene; in space as two views side by side, the plan and an elevation, with equal scales."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.contract.scene import (
    CircleReflector,
    LineReflector,
    PlaneReflector,
    Reflector,
    Scene,
    SegmentReflector,
    SphereReflector,
)
from nlosctl.errors import UsageError
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.plotting.figures import figure_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors, finish_map, legend_once, scene_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.many_rows import MANY_ROWS, draw_faint_lines, draw_tracks
from nlosctl.plotting.views.scene import (
    ROW_LOOKS,
    draw_in_plane,
    draw_range,
    first_measurements,
    horizontal_ranges,
    range_label,
    reflector_of,
    row_kinds,
    row_sensors,
)
from nlosctl.plotting.views.snapshot_rows import Columns, draw_estimates_of_snapshot, draw_truth, estimate_rows_of

__all__ = ["draw_scene_view", "seen_reflectors", "trace_in_space"]

_BEYOND, _SMALL = 1.12, 0.16
_PANEL_IN = (5.2, 4.6)


@figure_style()
def draw_scene_view(request: PlotRequest) -> Picture:
    """Draw one snapshot, measurements, estimates, or both: in the plane, or in space by plan and elevation.

    Places on the ellipsoid are drawn in the plane.
    """
    measured = first_measurements(request)
    snapshot = request.snapshot if measured is None else measured.id
    snapshot, estimates = estimate_rows_of(request.of("estimates"), snapshot)
    scene = request.files[0].scene if measured is None else measured.scene
    curved = scene.frame is not None and scene.frame.on_ellipsoid
    heights = [prefix_rows for prefix_rows in estimates if "z_m" in prefix_rows[1]]
    in_space = bool(heights) if measured is None else "sensor_z_m" in measured.columns
    in_space &= bool(heights) or (measured is not None and measured.dimension == 3)
    if curved or not in_space or request.read.dimensions == 2:
        return draw_in_plane(request, measured, snapshot, estimates)
    return _draw_views(request, _Snapshot(scene, measured, heights), f"Snapshot {snapshot}")


@dataclass
class _Snapshot:
    """What both views show; ``rays`` are the kind and the corners (3, 3) of each drawn bearing."""

    scene: Scene
    measured: PlotSnapshot | None
    estimates: Sequence[tuple[str, Columns]]
    names: list[str] = field(init=False)
    sensors: FloatArray = field(init=False)
    kinds: list[str] = field(init=False)
    rays: list[tuple[str, FloatArray]] = field(init=False)

    def __post_init__(self) -> None:
        if self.measured is None:
            self.names, plan = scene_sensors(self.scene)
            height = np.array([sensor.z_m for sensor in self.scene.sensors], dtype=np.float64)
        else:
            self.names, plan = list(self.measured.sensor), row_sensors(self.measured)
            height = self.measured.columns["sensor_z_m"]
        self.sensors = np.column_stack([plan, height])
        self.kinds = [] if self.measured is None else row_kinds(self.measured)
        self.rays = []

    @property
    def truth(self) -> Columns:
        """The columns that may have the truth."""
        return self.estimates[0][1] if self.measured is None else self.measured.file_columns


def _draw_views(request: PlotRequest, shown: _Snapshot, title: str) -> Picture:
    focus = {seen: Extent() for seen in ("xy", "xz", "yz")}
    whole = {seen: Extent() for seen in focus}
    scratch = request.figure()[1][0]
    for seen in focus:
        draw_truth(scratch, shown.truth, focus[seen], seen)
        draw_estimates_of_snapshot(scratch, shown.estimates, focus[seen], seen)
        whole[seen].include(shown.sensors[:, _numbers_of(seen)])
        whole[seen].include_extent(focus[seen])
    notes = _trace_rays(shown, focus, whole)
    for seen, extent in whole.items():
        for _, corners in shown.rays:
            extent.include(corners[:, _numbers_of(seen)])
    side = "xz" if np.subtract(whole["xy"].high, whole["xy"].low).argmax() == 0 else "yz"
    close = focus["xy"].is_known and focus["xy"].span_m < _SMALL * whole["xy"].span_m
    size = (2 * _PANEL_IN[0] + 2.0, _PANEL_IN[1] * (1 + close))
    figure, panels = request.figure(1 + close, 2, size_in=size, title=title)
    for number, axes in enumerate(panels):
        seen = ("xy", side)[number % 2]
        drawn = _draw_panel(axes, shown, seen, request.target_z_m)
        notes += drawn if number < 2 else []
        extent = focus[seen] if number > 1 else whole[seen]
        finish_map(axes, extent, square=number > 1, frame=shown.scene.frame if seen == "xy" else None)
        if seen != "xy":
            axes.set_xlabel(axes.get_xlabel().replace("x", seen[0]))
            axes.set_ylabel(axes.get_ylabel().replace("y", "z"))
        axes.set_title(("plan", "elevation")[number % 2] + (", close-up" if number > 1 else ""), fontsize=9)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside right upper")
    return Picture(figure=figure, notes=list(dict.fromkeys(notes)))


def _numbers_of(seen: str) -> list[int]:
    return ["xyz".index(axis) for axis in seen]


def _draw_panel(axes: Axes, shown: _Snapshot, seen: str, target_z_m: float | None) -> list[str]:
    """Draw one view; return notes."""
    draw_truth(axes, shown.truth, Extent(), seen)
    notes = draw_estimates_of_snapshot(axes, shown.estimates, Extent(), seen)
    draw_reflectors(axes, seen_reflectors(shown.scene.reflectors, seen))
    sensors = shown.sensors[:, _numbers_of(seen)]
    if len(shown.kinds) > MANY_ROWS:
        draw_tracks(axes, shown.names, sensors)
    else:
        once = dict.fromkeys(zip(shown.names, map(tuple, sensors.tolist()), strict=True))
        draw_sensors(axes, [name for name, _ in once], np.array([point for _, point in once]).reshape(-1, 2))
    labels: set[str] = set()
    for kind, look in ROW_LOOKS.items():
        lines = [corners[:, _numbers_of(seen)] for own, corners in shown.rays if own == kind]
        label = look.label.replace(" $\\pm 1$ std", "")
        if len(shown.kinds) > MANY_ROWS and lines:
            draw_faint_lines(axes, lines, color=look.color, label=label, zorder=2.0)
            continue
        for line in lines:
            label_once = legend_once(labels, label)
            axes.plot(*line.T, color=look.color, linestyle=look.line, linewidth=1.1, label=label_once, zorder=2.4)
    if seen == "xy" and shown.measured is not None and "bearing_rad" not in shown.measured.columns:
        notes += _draw_ranges(axes, shown, shown.measured, target_z_m)
    return notes


def _draw_ranges(axes: Axes, shown: _Snapshot, measured: PlotSnapshot, target_z_m: float | None) -> list[str]:
    """Draw the circles of ranges at the height of the targets, by default that of the first estimate."""
    if target_z_m is None and shown.estimates:
        height = float(shown.estimates[0][1]["z_m"][0])
        target_z_m = height if np.isfinite(height) else None
    radius, notes = horizontal_ranges(measured, target_z_m)
    labels: set[str] = set()
    for row, kind in enumerate(shown.kinds):
        look = ROW_LOOKS[kind]
        if isinstance(reflector_of(measured.scene, measured.columns, row), PlaneReflector):
            notes.append("ranges by planes are not drawn")
        elif np.isfinite(radius[row]):
            line = {"edgecolor": look.color, "linestyle": look.line, "linewidth": 1.0, "zorder": 2.0}
            draw_range(axes, measured, row, float(radius[row]), label=legend_once(labels, range_label(look)), **line)
    return notes if target_z_m is None else [*notes, f"the circles of the ranges are at z = {target_z_m:.6g} m"]


def _trace_rays(shown: _Snapshot, focus: dict[str, Extent], whole: dict[str, Extent]) -> list[str]:
    """Trace the bearings to a little beyond the estimates, or as far as their range; return notes."""
    measured = shown.measured
    if measured is None:
        return []
    if "bearing_rad" not in measured.columns:
        if "range_m" not in measured.columns:
            raise UsageError(f"there is no picture of the rows of {measured.kind}; plot the estimates")
        return []
    views = focus if focus["xz"].is_known else whole
    low, high = (np.append(getattr(views["xy"], end), getattr(views["xz"], end)[1]) for end in ("low", "high"))
    goal, span = 0.5 * (low + high), whole["xy"].span_m
    bearing = measured.columns["bearing_rad"]
    elevation = measured.columns.get("elevation_rad", np.full(bearing.shape, np.nan))
    ranges = measured.columns.get("range_m", np.full(bearing.shape, np.nan))
    for row in np.flatnonzero(np.isfinite(elevation)):
        level = np.cos(elevation[row])
        along = np.array([level * np.cos(bearing[row]), level * np.sin(bearing[row]), np.sin(elevation[row])])
        sensor = shown.sensors[row]
        hit, along = trace_in_space(sensor, along, reflector_of(measured.scene, measured.columns, int(row)))
        away = float(np.linalg.norm(goal - hit))
        reach = _BEYOND * max(float((goal - hit) @ along), 0.5 * away) if views is focus else span
        if np.isfinite(ranges[row]):
            reach = max(float(ranges[row] - np.linalg.norm(hit - sensor)), 0.0)
        shown.rays.append((shown.kinds[row], np.stack([sensor, hit, hit + reach * along])))
    alone = int(np.count_nonzero(~np.isfinite(elevation)))
    return [f"{alone} rows without an elevation are half-planes, not drawn"] if alone else []


def trace_in_space(sensor: FloatArray, along: FloatArray, reflector: Reflector | None) -> tuple[FloatArray, FloatArray]:
    """Return where the ray from a sensor (3,) along a unit vector (3,) meets its mirror, and its direction from there.

    The sensor and the direction themselves without a mirror, or if the ray misses it.
    """
    if reflector is None:
        return sensor, along
    if isinstance(reflector, SphereReflector | CircleReflector):
        offset = sensor - np.append(reflector.center, 0.0)[:3]
        half = float(offset @ along)
        distance = -half + np.sqrt(half * half - float(offset @ offset) + reflector.radius**2)
        normal = (offset + distance * along) / reflector.radius
    else:
        point = np.append(reflector.point, 0.0)[:3]
        if isinstance(reflector, PlaneReflector):
            normal = np.array(reflector.normal)
        else:
            normal = np.array([-reflector.direction[1], reflector.direction[0], 0.0])
        normal = normal / np.linalg.norm(normal)
        with ignoring_division():
            distance = np.divide((point - sensor) @ normal, along @ normal)
    if not (np.isfinite(distance) and distance > 0.0):
        return sensor, along
    return sensor + distance * along, along - 2.0 * (along @ normal) * normal


def seen_reflectors(reflectors: Sequence[Reflector], seen: str) -> list[Reflector]:
    """Return the mirrors that are lines in a view, in its coordinates; spheres as their outline in an elevation."""
    right, up = _numbers_of(seen)
    shown: list[Reflector] = []
    for mirror in reflectors:
        if isinstance(mirror, PlaneReflector):
            point, normal = ((part[right], part[up]) for part in (mirror.point, mirror.normal))
            if mirror.normal[3 - right - up] == 0.0:
                shown.append(LineReflector(name=mirror.name, point=point, direction=(-normal[1], normal[0])))
        elif isinstance(mirror, SphereReflector):
            center, opaque = (mirror.center[right], mirror.center[up]), mirror.blocker_radius
            if seen != "xy":
                shown.append(
                    CircleReflector(name=mirror.name, center=center, radius=mirror.radius, blocker_radius=opaque)
                )
        elif seen == "xy":
            shown.append(mirror)
        elif isinstance(mirror, LineReflector | SegmentReflector) and mirror.direction[right] == 0.0:
            shown.append(LineReflector(name=mirror.name, point=(mirror.point[right], 0.0), direction=(0.0, 1.0)))
    return shown
