"""Robust methods against a loop over the Cauchy loss of scipy: 8 sensors on a ring, a quarter of the rows outliers."""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares
from timing import best_of

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField
from nlosctl.methods import bearings_mixture_ml, bearings_stansfield, bearings_suppress
from nlosctl.scenarios.catalogue import find_scenario

_SNAPSHOTS = 8192
_LOOPED = 300
_SENSORS = 8


def make_batch(blocked: dict[str, float] | None = None) -> tuple[BearingBatch, np.ndarray]:
    """Return snapshots with 2 of 8 bearings (default) uniform over the full circle, and the true positions."""
    spec = find_scenario("madhow-ring")
    options = spec.options(
        radius_m=500.0, sources="disc", bearing_std_deg=2.0, nlos_span_deg=360.0, **(blocked or {"nlos_receivers": 2})
    )
    columns = spec.generate(options, np.random.default_rng(5), _SNAPSHOTS)

    def dense(name: str) -> np.ndarray:
        return np.asfortranarray(np.asarray(columns[name], dtype=np.float64).reshape(_SNAPSHOTS, _SENSORS))

    nothing = np.full((_SNAPSHOTS, _SENSORS), -1, order="F")
    batch = BearingBatch(
        seed=np.arange(_SNAPSHOTS, dtype=np.uint64),
        want_flags=False,
        field=BoxField(xmin_m=-500.0, xmax_m=500.0, ymin_m=-500.0, ymax_m=500.0),
        sensor=np.asfortranarray(np.tile(np.arange(_SENSORS), (_SNAPSHOTS, 1))),
        sensor_xy_m=np.asfortranarray(np.stack([dense("sensor_x_m"), dense("sensor_y_m")], axis=-1)),
        bearing_rad=dense("bearing_rad"),
        bearing_std_rad=dense("bearing_std_rad"),
        path=nothing,
        reflector=nothing,
    )
    return batch, np.stack([dense("truth_x_m")[:, 0], dense("truth_y_m")[:, 0]], axis=1)


def cauchy_loop(batch: BearingBatch, starts: np.ndarray, x_scale: float) -> np.ndarray:
    """Return the fixes of a loop of ``least_squares(loss="cauchy")`` with analytic Jacobian from given starts."""
    fixes = np.empty_like(starts)
    for row, start in enumerate(starts):
        x, y = np.ascontiguousarray(batch.sensor_xy_m[row, :, 0]), np.ascontiguousarray(batch.sensor_xy_m[row, :, 1])
        bearing, std = np.ascontiguousarray(batch.bearing_rad[row]), np.ascontiguousarray(batch.bearing_std_rad[row])

        def residual(point, x=x, y=y, bearing=bearing, std=std):
            error = bearing - np.arctan2(point[1] - y, point[0] - x)
            return (error - 2.0 * np.pi * np.round(error / (2.0 * np.pi))) / std

        def jacobian(point, x=x, y=y, std=std):
            dx, dy = point[0] - x, point[1] - y
            scale = 1.0 / (std * (dx * dx + dy * dy))
            return np.stack([dy * scale, -dx * scale], axis=1)

        fixes[row] = least_squares(residual, start, jacobian, loss="cauchy", x_scale=x_scale).x
    return fixes


def report() -> list[str]:
    """Return the lines of the tables: throughput ratios and the 95th percentile of the error."""
    lines = []
    for words, blocked in (
        ("2 bearings of 8 uniform over the circle", {"nlos_receivers": 2}),
        ("each bearing uniform over the circle with probability .25", {"alpha": 0.25}),
    ):
        lines += [f"## Outliers: 8 sensors on a 500 m ring, 2 deg, {words}", "", *_table(*make_batch(blocked)), ""]
    return lines


def _table(batch: BearingBatch, truth: np.ndarray) -> list[str]:
    first = bearings_stansfield.solve(batch, bearings_stansfield.METHOD.options()).estimates.position_m[:_LOOPED]
    starts = np.where(np.isfinite(first), first, 0.0)
    robust = {"alpha": 0.25, "field_of_view_deg": 360.0}
    programs = {
        "scipy loop, Cauchy loss": lambda: cauchy_loop(batch, starts, 1.0),
        "the same with `x_scale` chosen by hand": lambda: cauchy_loop(batch, starts, 100.0),
        "`mixture-ml`": lambda: bearings_mixture_ml.solve(batch, bearings_mixture_ml.METHOD.options(**robust)),
        "`suppress`": lambda: bearings_suppress.solve(batch, bearings_suppress.METHOD.options(**robust)),
    }
    seconds = best_of(3, *programs.values())
    per_snapshot = [*(time / _LOOPED for time in seconds[:2]), *(time / _SNAPSHOTS for time in seconds[2:])]
    lines = [
        "| program | microseconds per snapshot | times the loop's throughput | 95 % of the errors below (m) |",
        "|---|---|---|---|",
    ]
    for (name, program), time in zip(programs.items(), per_snapshot, strict=True):
        result = program()
        found = result if isinstance(result, np.ndarray) else _best(result.estimates)
        error = np.hypot(*(found - truth[: len(found)]).T)
        ratio = per_snapshot[0] / time
        lines.append(f"| {name} | {time * 1e6:.1f} | {ratio:.0f} | {np.percentile(error, 95):.1f} |")
    return lines


def _best(estimates) -> np.ndarray:
    best = estimates.position_m[estimates.alternative == 0]
    return np.where(np.isfinite(best), best, np.inf)
