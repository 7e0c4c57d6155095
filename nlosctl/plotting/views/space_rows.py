"""Rows of measurements in a view of space: traced bearings, and sections of the surfaces of ranges and arrivals."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import LineReflector, PlaneReflector, Reflector, SphereReflector
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.io.results.plotted_rows import differences_of, row_positions
from nlosctl.models.sections import path_lengths_by_sphere, range_sections
from nlosctl.models.traced_rays import ray_paths, trace_in_space
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent, legend_once
from nlosctl.plotting.views.arrivals import draw_hyperbolas
from nlosctl.plotting.views.many_rows import MANY_ROWS
from nlosctl.plotting.views.measured_rows import ROW_LOOKS, draw_row_curves, range_label, reflector_of, without_std
from nlosctl.plotting.views.two_views import across, coordinates

__all__ = ["draw_rays", "draw_sections", "trace_rays"]

Kinds = npt.NDArray[np.object_]

_BEYOND, _REACH = 1.12, 4.0
_CELLS = 200
"""Cells along each side of a view in which curves of equal path length by a sphere are traced."""


def trace_rays(measured: PlotSnapshot, plan: Extent, goal_m: FloatArray | None) -> tuple[FloatArray, list[str]]:
    """Return the corners (K, 3, 3) of bearings: sensor, reflection point (or sensor again), end; and notes.

    The end is a little beyond ``goal_m`` (3,), at the range of the row if it has one, or without a goal after the span
    of the ``plan``. Rows of azimuth alone have corners in the plan alone, their heights NaN; all are NaN for a mirror
    that is not vertical.
    """
    columns, sensors = measured.columns, row_positions(measured, "sensor", 3)
    bearing = columns["bearing_rad"]
    elevation = columns.get("elevation_rad", np.full(bearing.shape, np.nan))
    ranges = columns.get("range_m", np.full(bearing.shape, np.nan))
    rays = np.full((bearing.size, 3, 3), np.nan)
    for row in range(bearing.size):
        sensor, mirror = sensors[row], reflector_of(measured.scene, columns, row)
        if not np.isfinite(elevation[row]):
            vertical, flat = _as_line(mirror)
            if vertical:
                rays[row, :, :2] = ray_paths(sensor[None, :2], bearing[row : row + 1], flat, plan.low, plan.high)[0]
            continue
        level = np.cos(elevation[row])
        along = np.array([level * np.cos(bearing[row]), level * np.sin(bearing[row]), np.sin(elevation[row])])
        hit, along = trace_in_space(sensor, along, mirror)
        reach = plan.span_m
        if goal_m is not None:
            reach = _BEYOND * max(float((goal_m - hit) @ along), 0.5 * float(np.linalg.norm(goal_m - hit)))
        if np.isfinite(ranges[row]):
            reach = max(float(ranges[row] - np.linalg.norm(hit - sensor)), 0.0)
        rays[row] = sensor, hit, hit + reach * along
    return rays, _notes_on_azimuths(np.isnan(elevation), np.isnan(rays[:, 0, 0]))


def _as_line(mirror: Reflector | None) -> tuple[bool, Reflector | None]:
    """Return whether a mirror reflects half-planes of one azimuth as half-planes, and as which line of the plan.

    Level planes leave azimuths as they are: None, as without a mirror.
    """
    if isinstance(mirror, PlaneReflector):
        x, y, z = mirror.normal
        if x == y == 0.0:
            return True, None
        return z == 0.0, LineReflector(name=mirror.name, point=mirror.point[:2], direction=(-y, x))
    return not isinstance(mirror, SphereReflector), mirror


def _notes_on_azimuths(alone: npt.NDArray[np.bool_], lost: npt.NDArray[np.bool_]) -> list[str]:
    notes = []
    if (alone & ~lost).any():
        notes.append(f"{np.count_nonzero(alone & ~lost)} rows without an elevation are half-planes: in the plan alone")
    if lost.any():
        notes.append(f"{np.count_nonzero(lost)} rows without an elevation by tilted planes or spheres are not drawn")
    return notes


def draw_rays(axes: Axes, rays: FloatArray, kinds: Kinds, seen: str) -> None:
    """Draw the bearings (K, 3, 3) of `trace_rays` in a view."""
    flat = rays[..., coordinates(seen)]
    there = np.asarray(np.isfinite(flat).all(axis=(1, 2)))
    for kind, look in ROW_LOOKS.items():
        lines = list(flat[there & (kinds == kind)])
        draw_row_curves(axes, lines, look, without_std(look.label), faint=kinds.size > MANY_ROWS)


def draw_sections(
    axes: Axes, measured: PlotSnapshot, kinds: Kinds, seen: str, depth_m: float | None, whole: Extent
) -> list[str]:
    """Draw where the surfaces of ranges or arrivals cross the plane of a view at ``depth_m``; return notes."""
    axis, what = across(seen), "hyperbolas" if measured.kind == "arrivals" else "curves of ranges"
    if depth_m is None:
        cure = ", or `target_z_m`" if axis == "z" else ""
        return [f"no {what} in the view of {seen[0]} and {seen[1]}: their {axis} is an estimate's{cure}"]
    if measured.kind == "arrivals":
        notes = draw_hyperbolas(axes, differences_of(measured), _REACH * whole.span_m, seen, depth_m, bands=False)
    else:
        notes = _draw_ranges(axes, measured, kinds, seen, depth_m, whole)
    return [*notes, f"the {what} are sections at {axis} = {depth_m:.6g} m"]


def _draw_ranges(
    axes: Axes, measured: PlotSnapshot, kinds: Kinds, seen: str, depth_m: float, whole: Extent
) -> list[str]:
    sensor, length = row_positions(measured, "sensor", 3), measured.columns["range_m"]
    reflector = np.array(measured.columns.get("reflector", np.full(length.shape, -1)), dtype=np.int64)
    spheres = [number for number, mirror in enumerate(measured.scene.reflectors) if isinstance(mirror, SphereReflector)]
    by_sphere = np.isin(reflector, spheres)
    own, axis = np.flatnonzero(~by_sphere), "xyz".index(across(seen))
    curves = range_sections(sensor[own], length[own], reflector[own], measured.scene, axis, depth_m)
    met = np.isfinite(curves).any(axis=(1, 2))
    for kind, look in ROW_LOOKS.items():
        lines = list(curves[(kinds[own] == kind) & met])
        draw_row_curves(axes, lines, look, range_label(look), faint=kinds.size > MANY_ROWS)
    for row in np.flatnonzero(by_sphere):
        _draw_range_by_sphere(axes, measured, int(row), kinds[row], seen, depth_m, whole)
    missed = int(np.count_nonzero(~met))
    return [f"{missed} of {length.size} ranges do not reach {across(seen)} = {depth_m:.6g} m"] if missed else []


def _draw_range_by_sphere(
    axes: Axes, measured: PlotSnapshot, row: int, kind: str, seen: str, depth_m: float, whole: Extent
) -> None:
    """Draw the points of a view whose path by a sphere has the length of a range: a contour of path lengths."""
    sphere = reflector_of(measured.scene, measured.columns, row)
    assert isinstance(sphere, SphereReflector)  # noqa: S101 - asked before
    low, high = whole.framed()
    right, up = np.meshgrid(*(np.linspace(low[part], high[part], _CELLS + 1) for part in (0, 1)))
    points = np.full((*right.shape, 3), depth_m)
    points[..., coordinates(seen)] = np.stack([right, up], axis=-1)
    length = path_lengths_by_sphere(row_positions(measured, "sensor", 3)[row], sphere, points)
    look, level = ROW_LOOKS[kind], float(measured.columns["range_m"][row])
    known = length[np.isfinite(length)]
    if known.size and known.min() < level < known.max():
        axes.contour(right, up, length, levels=[level], colors=look.color, linewidths=1.1, linestyles=[look.line])
    label = legend_once(set(axes.get_legend_handles_labels()[1]), range_label(look))
    axes.plot([], [], color=look.color, linestyle=look.line, linewidth=1.1, label=label)
