"""Kernels against a loop over scipy.optimize.least_squares: 8 sensors, direct bearings, positions random."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares
from timing import best_of

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import Scene
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield
from nlosctl.models.bearing_predictions import predict_bearings

SNAPSHOTS = 8192
"""A block as the command makes them."""

_LOOPED = 400
_SENSORS = 8
_STD_RAD = np.radians(1.0)


def make_batch(snapshots: int, seed: int) -> BearingBatch:
    """Return snapshots with 8 sensors in a 2 km square and sources in its middle."""
    generator = np.random.default_rng(seed)
    shape = (snapshots, _SENSORS)
    sensor_xy_m = np.asfortranarray(generator.uniform(-1000.0, 1000.0, (*shape, 2)))
    source_xy_m = generator.uniform(-500.0, 500.0, (snapshots, 1, 2))
    direct = np.full(shape, -1, order="F")
    bearing_rad = predict_bearings(sensor_xy_m, direct, Scene(), np.broadcast_to(source_xy_m, sensor_xy_m.shape))
    return BearingBatch(
        seed=np.zeros(snapshots, dtype=np.uint64),
        want_flags=False,
        sensor=np.asfortranarray(np.tile(np.arange(_SENSORS), (snapshots, 1))),
        sensor_xy_m=sensor_xy_m,
        bearing_rad=np.asfortranarray(bearing_rad + _STD_RAD * generator.normal(size=shape)),
        bearing_std_rad=np.full(shape, _STD_RAD, order="F"),
        path=direct,
        reflector=direct,
    )


def scipy_loop(batch: BearingBatch, snapshots: int) -> np.ndarray:
    """Return the ML fixes that a loop of ``least_squares(method="lm")`` finds, with covariances made on the way."""
    fixes = np.empty((snapshots, 2))
    for row in range(snapshots):
        x, y = np.ascontiguousarray(batch.sensor_xy_m[row, :, 0]), np.ascontiguousarray(batch.sensor_xy_m[row, :, 1])
        bearing, std = np.ascontiguousarray(batch.bearing_rad[row]), np.ascontiguousarray(batch.bearing_std_rad[row])
        normals = np.stack([np.sin(bearing), -np.cos(bearing)], axis=1)
        start = np.linalg.lstsq(normals, normals[:, 0] * x + normals[:, 1] * y, rcond=None)[0]

        def residual(point, x=x, y=y, bearing=bearing, std=std):
            error = bearing - np.arctan2(point[1] - y, point[0] - x)
            return (error - 2.0 * np.pi * np.round(error / (2.0 * np.pi))) / std

        def jacobian(point, x=x, y=y, std=std):
            dx, dy = point[0] - x, point[1] - y
            scale = 1.0 / (std * (dx * dx + dy * dy))
            return np.stack([dy * scale, -dx * scale], axis=1)

        fit = least_squares(residual, start, jacobian, method="lm")
        np.linalg.inv(fit.jac.T @ fit.jac)
        fixes[row] = fit.x
    return fixes


def report() -> list[str]:
    """Return the lines of the table: throughput ratios, after checking that both agree on the answers."""
    batch = make_batch(SNAPSHOTS, seed=1)
    ours = bearings_ml.solve(batch, bearings_ml.METHOD.options()).estimates
    answered = np.isfinite(ours.position_m[:_LOOPED, 0])
    apart = np.hypot(*(ours.position_m[:_LOOPED] - scipy_loop(batch, _LOOPED))[answered].T)
    assert np.median(apart) < 1e-3, "the loop and ml must agree before they are timed"
    methods = (bearings_ls, bearings_stansfield, bearings_ml)
    times = best_of(
        5,
        lambda: scipy_loop(batch, _LOOPED),
        *((lambda module=module: module.solve(batch, module.METHOD.options())) for module in methods),
    )
    per_snapshot = [times[0] / _LOOPED, *(time / SNAPSHOTS for time in times[1:])]
    lines = [
        '## Kernels against a loop of `least_squares(method="lm")` with analytic Jacobian, 8 sensors',
        "",
        f"Answers within 1e-3 m of each other in {np.mean(apart < 1e-3):.1%} of the snapshots "
        f"(worst {apart.max():.2g} m).",
        "",
        "| program | microseconds per snapshot | times the loop's throughput |",
        "|---|---|---|",
        f"| scipy loop | {per_snapshot[0] * 1e6:.1f} | 1 |",
    ]
    for module, seconds in zip(methods, per_snapshot[1:], strict=True):
        lines.append(f"| `{module.METHOD.name}` | {seconds * 1e6:.2f} | {per_snapshot[0] / seconds:.0f} |")
    return [*lines, ""]
