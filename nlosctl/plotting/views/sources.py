"""Unlabelled bearings of one snapshot as rays, styled by the source that ``identify-los`` assigned."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.io.results.plotted_rows import row_positions
from nlosctl.models.traced_rays import ray_paths
from nlosctl.plotting.figures import series_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent
from nlosctl.plotting.views.measured_rows import RowLook, assigned_targets, draw_row_curves, reflector_of
from nlosctl.plotting.views.space_rows import trace_rays
from nlosctl.plotting.views.two_views import coordinates

__all__ = ["draw_source_rays"]

_MOST_TARGETS = 7
_OTHER = RowLook("other bearing", "#b8b8b8", (0, (1.0, 2.0)), wedge=False)


def draw_source_rays(
    axes: Axes, measured: PlotSnapshot, sensors: FloatArray, extent: Extent, seen: str, *, in_space: bool
) -> list[str]:
    """Draw the ray of each row, from ``sensors`` (S, D) to a little beyond ``extent``, and return notes."""
    if not in_space:
        return _draw_rays(axes, measured, _rays_in_plane(measured, extent))
    plan = Extent()
    plan.include(sensors[:, :2])
    rays, notes = trace_rays(measured, plan, None)
    return notes + _draw_rays(axes, measured, rays[..., coordinates(seen)])


def _rays_in_plane(measured: PlotSnapshot, goal: Extent) -> FloatArray:
    """Return the corners (K, 3, 2) of the rays, to a little beyond ``goal``."""
    sensor, bearing = row_positions(measured), measured.columns["bearing_rad"]
    rays = [
        ray_paths(
            sensor[row : row + 1],
            bearing[row : row + 1],
            reflector_of(measured.scene, measured.columns, row),
            goal.low,
            goal.high,
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
