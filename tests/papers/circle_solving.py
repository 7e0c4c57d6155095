"""The circular sets of Song et al. at array level, and a scipy loop with the same gradient as a slow reference."""

from __future__ import annotations

import numpy as np
from flat_solving import dense_batch
from scipy.optimize import least_squares

from nlosctl.geometry.short_arc import short_arc_reflection
from nlosctl.methods import bearings_ls, bearings_ml, bearings_ml_grid, bearings_stansfield
from nlosctl.scenarios.catalogue import find_scenario
from nlosctl.scenarios.spec import draw_snapshots

EARTH_M, IONOSPHERE_M = 6371e3, 6671e3
TARGET_M = np.array([6421e3, 0.0])
METHODS = {
    spec.name: spec
    for spec in (
        bearings_ls.METHOD,
        bearings_stansfield.METHOD,
        bearings_stansfield.FOCUSED,
        bearings_ml.METHOD,
        bearings_ml_grid.METHOD,
    )
}


def circle_draw(parameter_set, sigma_deg, runs, seed=20130701):
    """Return the batch of the paper's set a or b."""
    spec = find_scenario("song-circle")
    options = spec.options(parameter_set=parameter_set, bearing_std_deg=sigma_deg)
    (columns,) = draw_snapshots(spec, options, seed, runs)
    return dense_batch(spec.scene(options), columns)


def solve(name, batch, **options):
    """Return the estimates of a method."""
    return METHODS[name].solve(batch, METHODS[name].options(**options)).estimates


def errors(estimates, usable=None):
    """Return the errors (R, 2) of the estimates that have a position."""
    answered = np.isfinite(estimates.position_m[:, 0]) if usable is None else usable
    return estimates.position_m[answered] - TARGET_M


def rms(error):
    """Return the root mean squared error."""
    return float(np.sqrt((error**2).sum(axis=1).mean()))


def nees(estimates):
    """Return the normalized squared errors of the estimates with a covariance."""
    there = np.isfinite(estimates.covariance_m2[:, 0])
    xx, xy, yy = estimates.covariance_m2[there].T
    dx, dy = errors(estimates, there).T
    return (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)


def scipy_ml(batch, row, start):
    """Return position and cost of one snapshot by scipy's Levenberg-Marquardt with the closed-form gradient."""
    sensor, bearing, std = batch.sensor_xy_m[row], batch.bearing_rad[row], batch.bearing_std_rad[row]
    radius = np.full(bearing.shape, IONOSPHERE_M)

    def path(point):
        x, y = (np.full(bearing.shape, part) for part in point * 1e6)
        return short_arc_reflection(sensor[:, 0].copy(), sensor[:, 1].copy(), x, y, radius)

    def residual(point):
        return np.angle(np.exp(1j * (bearing - path(point).bearing_rad))) / std

    def jacobian(point):
        return -1e6 * np.stack(path(point).bearing_gradient(), axis=1) / std[:, None]

    found = least_squares(residual, start / 1e6, jacobian, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    return found.x * 1e6, found.cost
