"""Ranges of one snapshot as circles about their sensors, styled by the target that ``identify-los`` assigned."""

from __future__ import annotations

import numpy as np

from nlosctl.io.results.plot_inputs import PlotSnapshot
from nlosctl.plotting.figures import figure_style, series_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors, legend_once
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.close_ups import draw_with_close_up
from nlosctl.plotting.views.measured_rows import first_measurements, horizontal_ranges, row_positions, sensor_positions
from nlosctl.plotting.views.scene import draw_range
from nlosctl.plotting.views.snapshot_rows import draw_estimates_of_snapshot, draw_truth, estimate_rows_of

__all__ = ["draw_echo_view"]

_MOST_TARGETS = 7


@figure_style()
def draw_echo_view(request: PlotRequest) -> Picture:
    """Draw the circles, the estimated targets with their ellipses, if any, and the truth."""
    measured = first_measurements(request)
    assert measured is not None  # noqa: S101 - only such files have this view
    _, estimates = estimate_rows_of(request.of("estimates"), measured.id)
    names, sensors = sensor_positions(measured)

    def draw(axes: Axes) -> tuple[Extent, Extent, list[str]]:
        extent = Extent()
        extent.include(sensors)
        draw_truth(axes, measured.file_columns, extent)
        notes = draw_estimates_of_snapshot(axes, estimates, extent)
        draw_reflectors(axes, measured.scene.reflectors)
        draw_sensors(axes, names, sensors)
        notes += _draw_circles(axes, measured, request.target_z_m, extent, whole=not estimates)
        return extent, Extent(), notes

    return draw_with_close_up(request, draw, f"Snapshot {measured.id}", measured.scene.frame)


def _draw_circles(
    axes: Axes, measured: PlotSnapshot, target_z_m: float | None, extent: Extent, *, whole: bool
) -> list[str]:
    """Draw each echo, direct ones in the style of their target; ``whole`` includes direct circles in the extent."""
    radii, notes = horizontal_ranges(measured, target_z_m)
    sensor = row_positions(measured)
    target = measured.file_columns.get("target", np.full(sensor.shape[0], np.nan))
    direct = (measured.file_columns.get("los", np.zeros(sensor.shape[0])) == 1) & ~np.isnan(target)
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
        draw_range(axes, measured, row, radius, label=legend_once(labels, label), **style)
        if whole and direct[row]:
            extent.include(sensor[row][None], radius)
    return notes if direct.any() else [*notes, "no echo is assigned to a target"]
