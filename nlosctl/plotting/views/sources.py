"""Unlabelled bearings of one snapshot as rays, styled by the source that ``identify-los`` assigned."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.plotting.figures import series_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.many_rows import ray_paths
from nlosctl.plotting.views.measured_rows import (
    RowLook,
    assigned_targets,
    draw_row_curves,
    reflector_of,
    row_positions,
    sensor_positions,
)
from nlosctl.plotting.views.snapshot_rows import draw_estimates_of_snapshot, draw_truth, estimate_rows_of
from nlosctl.plotting.views.space_rows import trace_rays
from nlosctl.plotting.views.two_views import coordinates, draw_plan_and_elevation, seen_reflectors

__all__ = ["draw_source_view"]

_MOST_TARGETS = 7
_OTHER = RowLook("other bearing", "#b8b8b8", (0, (1.0, 2.0)), wedge=False)


def draw_source_view(request: PlotRequest, measured: PlotSnapshot) -> Picture:
    """Draw the rays, the estimated sources with their ellipses, if any, and the truth."""
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
        if in_space:
            plan = Extent()
            plan.include(sensors[:, :2])
            rays, more = trace_rays(measured, plan, None)
            return extent, Extent(), notes + more + _draw_rays(axes, measured, rays[..., coordinates(seen)])
        return extent, Extent(), notes + _draw_rays(axes, measured, _rays_in_plane(measured, extent))

    if in_space:
        return draw_plan_and_elevation(request, draw, title, scene.frame)
    return draw_with_close_up(request, draw, title, scene.frame)


def _rays_in_plane(measured: PlotSnapshot, goal: Extent) -> FloatArray:
    """Return the corners (K, 3, 2) of the rays, to a little beyond ``goal``."""
    sensor, bearing = row_positions(measured), measured.columns["bearing_rad"]
    rays = [
        ray_paths(
            sensor[row : row + 1], bearing[row : row + 1], reflector_of(measured.scene, measured.columns, row), goal
        )
        for row in range(bearing.size)
    ]
    return np.concatenate(rays)


def _draw_rays(axes: Axes, measured: PlotSnapshot, rays: FloatArray) -> list[str]:
    """Draw each row (K, 3, 2), direct ones in the style of their source."""
    target, direct = assigned_targets(measured)
    there = np.isfinite(rays).all(axis=(1, 2))
    draw_row_curves(axes, list(rays[there & ~direct]), _OTHER, _OTHER.label, faint=False)
    for number in np.unique(target[direct]).astype(np.int64):
        style = series_style(1 + int(number) % _MOST_TARGETS)
        look = RowLook(f"bearing of target {number}", style.color, style.line, wedge=False)
        draw_row_curves(axes, list(rays[there & direct & (target == number)]), look, look.label, faint=False)
    return [] if direct.any() else ["no bearing is assigned to a target"]
