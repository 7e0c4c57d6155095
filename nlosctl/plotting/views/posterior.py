"""The posterior of a position over the plane."""

from __future__ import annotations

import numpy as np

from nlosctl.errors import DataError
from nlosctl.io.results.plot_inputs import read_rows_of_snapshot, read_sampled
from nlosctl.plotting.figures import figure_style
from nlosctl.plotting.maps import draw_map, edges_of
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors_of_map, scene_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.close_ups import map_size_in
from nlosctl.plotting.views.measured_rows import first_measurements, sensor_positions

__all__ = ["draw_posterior_map"]

_LEVELS = (0.5, 0.9, 0.95)


@figure_style()
def draw_posterior_map(request: PlotRequest) -> Picture:
    """Draw the probability of each cell, and lines about the regions of 50, 90 and 95 %."""
    file = request.of("posterior")[0]
    title = None
    if "snapshot" in file.names:
        name, columns = read_rows_of_snapshot(file, request.snapshot)
        title = f"snapshot {name}"
    else:
        columns = read_sampled(file, ("x_m", "y_m", "probability", "hpd"), None).columns
    x, column = np.unique(columns["x_m"], return_inverse=True)
    y, row = np.unique(columns["y_m"], return_inverse=True)
    if x.size * y.size != columns["x_m"].size:
        raise DataError(f"{file.name}: the cells are not a complete grid; make a map with 'nlosctl posterior'")
    probability, hpd = np.empty((y.size, x.size)), np.empty((y.size, x.size))
    probability[row, column], hpd[row, column] = columns["probability"], columns["hpd"]
    extent = Extent()
    extent.include(np.array([[x[0], y[0]], [x[-1], y[-1]]]))
    figure, (axes,) = request.figure(size_in=map_size_in(extent), title=title)
    draw_map(axes, x, y, probability, "probability of a cell", contours=False)
    if min(hpd.shape) > 1:
        axes.contour(x, y, hpd, levels=_LEVELS, colors="white", linewidths=(1.4, 0.9, 0.6))
    draw_reflectors(axes, file.scene.reflectors)
    measured = first_measurements(request)
    names, sensors = scene_sensors(file.scene) if measured is None else sensor_positions(measured)
    draw_sensors_of_map(axes, names, sensors, (edges_of(x), edges_of(y)), file.scene.frame)
    return Picture(figure=figure, notes=["white lines: the smallest regions of 50, 90 and 95 %"])
