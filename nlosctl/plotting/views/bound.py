"""The Cramér-Rao bound over the plane."""

from __future__ import annotations

import numpy as np

from nlosctl.contract.tables import BOUND
from nlosctl.errors import DataError, UsageError, did_you_mean
from nlosctl.io.results.plot_inputs import read_sampled
from nlosctl.plotting.figures import axis_label, figure_style
from nlosctl.plotting.maps import draw_map, edges_of
from nlosctl.plotting.plane import Extent, draw_reflectors, draw_sensors_of_map, scene_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.views.close_ups import map_size_in
from nlosctl.plotting.views.measured_rows import first_measurements, sensor_positions

__all__ = ["draw_bound_map"]

_QUANTITIES = {
    "rms_m": "RMS error at least",
    "cep50_m": "CEP50 at least",
    "semi_major_m": "semi-major axis at least",
    "semi_minor_m": "semi-minor axis at least",
    "n_used": "rows that see the position",
}
_LOG_FROM = 10.0


@figure_style()
def draw_bound_map(request: PlotRequest) -> Picture:
    """Draw a map of ``bound --map``: the RMS, or the quantity that ``y`` names."""
    quantity = request.y or "rms_m"
    if quantity not in _QUANTITIES:
        near, known = did_you_mean(quantity, _QUANTITIES), ", ".join(_QUANTITIES)
        raise UsageError(f"`y`: a map shows one of {known}. Got {quantity!r} instead{near}.")
    file = request.of("bound")[0]
    columns = read_sampled(file, ("x_m", "y_m", quantity), None).columns
    x, column = np.unique(columns["x_m"], return_inverse=True)
    y, row = np.unique(columns["y_m"], return_inverse=True)
    if x.size * y.size > 4 * columns["x_m"].size:
        raise DataError(f"{file.name}: the positions are not on a grid; make a map with 'nlosctl bound --map'")
    values = np.full((y.size, x.size), np.nan)
    values[row, column] = columns[quantity]
    good = values[np.isfinite(values)]
    log = bool(good.size and good.min() > 0.0 and good.max() > _LOG_FROM * good.min()) and not request.linear
    extent = Extent()
    extent.include(np.array([[x[0], y[0]], [x[-1], y[-1]]]))
    figure, (axes,) = request.figure(size_in=map_size_in(extent))
    unit = BOUND.column(quantity).unit
    draw_map(axes, x, y, values, axis_label(_QUANTITIES[quantity], unit), log=log)
    draw_reflectors(axes, file.scene.reflectors)
    measured = first_measurements(request)
    names, sensors = scene_sensors(file.scene) if measured is None else sensor_positions(measured)
    draw_sensors_of_map(axes, names, sensors, (edges_of(x), edges_of(y)), file.scene.frame)
    notes = [] if np.isfinite(values).all() else ["white: no bound, because too few rows see the position"]
    return Picture(figure=figure, notes=notes)
