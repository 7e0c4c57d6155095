"""Unlabelled rows of one snapshot, styled by the target that ``identify-los`` assigned.

Ranges are circles about their sensors, bearings the rays of `sources`. In space plan and elevation have the circles in
which each sphere meets the plane through its target.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.io.results.plotted_rows import row_positions
from nlosctl.plotting.figures import figure_style, series_style
from nlosctl.plotting.library import Axes, Circle
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors, legend_once
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.measured_rows import (
    assigned_targets,
    first_measurements,
    horizontal_ranges,
    sensor_positions,
)
from nlosctl.plotting.views.scene import draw_range
from nlosctl.plotting.views.snapshot_rows import (
    Columns,
    draw_estimates_of_snapshot,
    draw_truth,
    estimate_rows_of,
    positions_of,
)
from nlosctl.plotting.views.sources import draw_source_rays
from nlosctl.plotting.views.two_views import across, coordinates, draw_plan_and_elevation, seen_reflectors

__all__ = ["draw_echo_view"]

_MOST_TARGETS = 7


@figure_style()
def draw_echo_view(request: PlotRequest) -> Picture:
    """Draw the circles (of bearings the rays), the estimated targets with their ellipses, if any, and the truth."""
    measured = first_measurements(request)
    assert measured is not None  # noqa: S101 - only such files have this view
    _, estimates = estimate_rows_of(request.of("estimates"), measured.id)
    scene, title = measured.scene, f"Snapshot {measured.id}"
    curved = scene.frame is not None and scene.frame.on_ellipsoid
    in_space = measured.dimension == 3 and not curved and all("z_m" in columns for _, columns in estimates)
    names, sensors = sensor_positions(measured, 3 if in_space else 2)

    def draw(axes: Axes, seen: str = "xy") -> tuple[Extent, Extent, list[str]]:
        extent = Extent()
        extent.include(sensors[:, coordinates(seen)])
        draw_truth(axes, measured.file_columns, extent, seen)
        notes = draw_estimates_of_snapshot(axes, estimates, extent, seen)
        draw_reflectors(axes, seen_reflectors(scene.reflectors, seen) if in_space else scene.reflectors)
        draw_sensors(axes, names, sensors[:, coordinates(seen)])
        if measured.kind == "bearings":
            return extent, Extent(), notes + draw_source_rays(axes, measured, sensors, extent, seen, in_space=in_space)
        if in_space:
            radii, more = _section_radii(measured, estimates, seen, request.target_z_m)
            draw_row = partial(_draw_section, axes, row_positions(measured, "sensor", 3)[:, coordinates(seen)])
        else:
            radii, more = horizontal_ranges(measured, request.target_z_m)
            draw_row = partial(draw_range, axes, measured)
        return extent, Extent(), notes + more + _draw_circles(measured, radii, draw_row, extent, whole=not estimates)

    if in_space:
        return draw_plan_and_elevation(request, draw, title, scene.frame)
    return draw_with_close_up(request, draw, title, scene.frame)


def _section_radii(
    measured: PlotSnapshot, estimates: Sequence[tuple[str, Columns]], seen: str, target_z_m: float | None
) -> tuple[FloatArray, list[str]]:
    """Return the radii (K,) of the circles of a view, NaN where an echo has none, and notes.

    A circle is at the third coordinate of the echo's target, else of the first one; in the plan at ``target_z_m``, if
    given.
    """
    axis, (target, _) = across(seen), assigned_targets(measured)
    depth = np.full(target.shape, np.nan if axis != "z" or target_z_m is None else target_z_m)
    for _, columns in estimates if np.isnan(depth).all() else ():
        (place,) = positions_of(columns, f"{axis}_m").T
        found = np.flatnonzero(np.isfinite(place))
        for row in found:
            depth = np.where(np.isnan(depth) & (target == columns["target"][row]), place[row], depth)
        depth = np.where(np.isnan(depth), place[found[0]], depth) if found.size else depth
    if np.isnan(depth).all():
        cure = ", or `target_z_m`" if axis == "z" else ""
        return depth, [f"no circles in the view of {seen[0]} and {seen[1]}: their {axis} is an estimate's{cure}"]
    squared = measured.columns["range_m"] ** 2 - (measured.columns[f"sensor_{axis}_m"] - depth) ** 2
    radii = np.sqrt(np.where(squared < 0.0, np.nan, squared))
    return radii, [f"the circles are sections at the {axis} of their targets, of other echoes at that of the first"]


def _draw_section(axes: Axes, sensor: FloatArray, row: int, radius: float, **look: Any) -> None:
    axes.add_patch(Circle((float(sensor[row, 0]), float(sensor[row, 1])), radius, fill=False, **look))


def _draw_circles(
    measured: PlotSnapshot, radii: FloatArray, draw_row: Any, extent: Extent, *, whole: bool
) -> list[str]:
    """Draw each echo, direct ones in the style of their target; ``whole`` includes direct circles in the extent."""
    sensor, (target, direct) = row_positions(measured), assigned_targets(measured)
    order = np.lexsort((np.where(direct, target, 0.0), direct))
    labels: set[str] = set()
    for row in order[np.isfinite(radii[order])]:
        radius = float(radii[row])
        if direct[row]:
            number = int(target[row])
            look, label = series_style(1 + number % _MOST_TARGETS), f"echo of target {number}"
            style = {"edgecolor": look.color, "linestyle": look.line, "linewidth": 1.2, "zorder": 2.2}
        else:
            label = "other echo"
            style = {"edgecolor": "#b8b8b8", "linestyle": (0, (1.0, 2.0)), "linewidth": 0.8, "zorder": 1.5}
        draw_row(row, radius, label=legend_once(labels, label), **style)
        if whole and direct[row]:
            extent.include(sensor[row][None], radius)
    return [] if direct.any() else ["no echo is assigned to a target"]
