"""Kernels in space against a loop over scipy.optimize.least_squares: 8 sensors on a ring, azimuths and elevations."""

from __future__ import annotations

import numpy as np
from kernels import SNAPSHOTS
from scipy.optimize import least_squares
from timing import best_of

from nlosctl.contract.batches import BearingBatch
from nlosctl.methods import bearings_ls, bearings_ml, bearings_stansfield
from nlosctl.pipeline.solve.solve_chunk import keep_freed_memory

_LOOPED = 400
_SENSORS = 8
_STD_RAD = np.radians(1.0)


def make_batch(snapshots: int, seed: int) -> BearingBatch:
    """Return snapshots with 8 sensors on a ring of 500 m at 0 to 60 m, and sources up to 200 m high."""
    generator = np.random.default_rng(seed)
    turn, shape = 2.0 * np.pi * np.arange(_SENSORS) / _SENSORS, (snapshots, _SENSORS)
    ring = np.stack([500.0 * np.cos(turn), 500.0 * np.sin(turn), np.linspace(0.0, 60.0, _SENSORS)], axis=1)
    sensor = np.broadcast_to(ring, (*shape, 3))
    source = generator.uniform((-300.0, -300.0, 0.0), (300.0, 300.0, 200.0), (snapshots, 1, 3))
    x, y, z = np.moveaxis(source - sensor, -1, 0)
    azimuth, elevation = np.arctan2(y, x), np.arctan2(z, np.hypot(x, y))
    noise = _STD_RAD * generator.normal(size=(2, *shape))
    return BearingBatch(
        dimension=3,
        seed=np.zeros(snapshots, dtype=np.uint64),
        want_flags=False,
        sensor=np.asfortranarray(np.tile(np.arange(_SENSORS), (snapshots, 1))),
        sensor_xy_m=np.asfortranarray(sensor[..., :2]),
        sensor_z_m=np.asfortranarray(sensor[..., 2]),
        bearing_rad=np.asfortranarray(azimuth + noise[0]),
        bearing_std_rad=np.full(shape, _STD_RAD, order="F"),
        elevation_rad=np.asfortranarray(elevation + noise[1]),
        elevation_std_rad=np.full(shape, _STD_RAD, order="F"),
        path=np.full(shape, -1, order="F"),
        reflector=np.full(shape, -1, order="F"),
    )


def scipy_loop(batch: BearingBatch, snapshots: int, method: str) -> np.ndarray:
    """Return the ML fixes that a loop of ``least_squares`` finds, with covariances made on the way."""
    assert batch.sensor_z_m is not None
    assert batch.elevation_rad is not None
    fixes = np.empty((snapshots, 3))
    for row in range(snapshots):
        x, y, z = (
            np.ascontiguousarray(part[row]) for part in (*np.moveaxis(batch.sensor_xy_m, -1, 0), batch.sensor_z_m)
        )
        azimuth, elevation = (
            np.ascontiguousarray(batch.bearing_rad[row]),
            np.ascontiguousarray(batch.elevation_rad[row]),
        )
        across = np.stack([-np.sin(azimuth), np.cos(azimuth), np.zeros(_SENSORS)], axis=1)
        rise = np.sin(elevation)
        above = np.stack([-rise * np.cos(azimuth), -rise * np.sin(azimuth), np.cos(elevation)], axis=1)
        normals, sensor = np.concatenate([across, above]), np.stack([x, y, z], axis=1)
        start = np.linalg.lstsq(normals, (normals * np.concatenate([sensor, sensor])).sum(axis=1), rcond=None)[0]

        def residual(point, x=x, y=y, z=z, azimuth=azimuth, elevation=elevation):
            dx, dy, dz = point[0] - x, point[1] - y, point[2] - z
            error = azimuth - np.arctan2(dy, dx)
            error -= 2.0 * np.pi * np.round(error / (2.0 * np.pi))
            return np.concatenate([error, elevation - np.arctan2(dz, np.hypot(dx, dy))]) / _STD_RAD

        def jacobian(point, x=x, y=y, z=z):
            dx, dy, dz = point[0] - x, point[1] - y, point[2] - z
            squared = dx * dx + dy * dy
            level, whole = np.sqrt(squared), squared + dz * dz
            turn = np.stack([dy / squared, -dx / squared, np.zeros(_SENSORS)], axis=1)
            lift = np.stack([dz * dx / level, dz * dy / level, -level], axis=1) / whole[:, None]
            return np.concatenate([turn, lift]) / _STD_RAD

        fit = least_squares(residual, start, jacobian, method=method)
        np.linalg.inv(fit.jac.T @ fit.jac)
        fixes[row] = fit.x
    return fixes


def report() -> list[str]:
    """Return the lines of the table: throughput ratios, after checking that both agree on the answers."""
    keep_freed_memory()
    batch = make_batch(SNAPSHOTS, seed=1)
    ours = bearings_ml.solve(batch, bearings_ml.METHOD.options()).estimates
    first = np.flatnonzero(ours.alternative == 0)[:_LOOPED]
    apart = np.linalg.norm(ours.position_m[first] - scipy_loop(batch, _LOOPED, "lm"), axis=1)
    assert np.median(apart) < 1e-3, "the loop and ml must agree before they are timed"
    methods = (bearings_ls, bearings_stansfield, bearings_ml)
    times = best_of(
        5,
        lambda: scipy_loop(batch, _LOOPED, "trf"),
        lambda: scipy_loop(batch, _LOOPED, "lm"),
        *((lambda module=module: module.solve(batch, module.METHOD.options())) for module in methods),
    )
    trf, lm = (time / _LOOPED for time in times[:2])
    lines = [
        "## Kernels in space against a loop of `least_squares` with analytic Jacobian, 8 sensors",
        "",
        f"Azimuths and elevations. Answers within 1e-3 m of each other in {np.mean(apart < 1e-3):.1%} of the snapshots "
        f"(worst {apart.max():.2g} m).",
        "",
        '| program | microseconds per snapshot | times the loop\'s throughput | that of its `method="lm"` |',
        "|---|---|---|---|",
        f"| scipy loop | {trf * 1e6:.1f} | 1 | {lm / trf:.2g} |",
        f'| the same, `method="lm"` | {lm * 1e6:.1f} | {trf / lm:.2g} | 1 |',
    ]
    for module, time in zip(methods, times[2:], strict=True):
        seconds = time / SNAPSHOTS
        lines.append(f"| `{module.METHOD.name}` | {seconds * 1e6:.2f} | {trf / seconds:.0f} | {lm / seconds:.0f} |")
    return [*lines, ""]
