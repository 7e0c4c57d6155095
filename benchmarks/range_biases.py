"""Calibration of `mixture-ml` on ranges whose outliers are late, and its verdict on ranges without a source.

`python benchmarks/range_biases.py [TRIALS]` prints the tables of docs/outliers.md: six sensors and a source uniform
in a square of 100 standard deviations, a quarter of the rows late by an exponential bias.
"""

from __future__ import annotations

import sys

import numpy as np

from nlosctl import api
from nlosctl.evaluation.consistency import squared_mahalanobis

LAWS = {
    "both": {},
    "both, posterior": {"covariance": "posterior"},
    "positive": {"bias": "positive"},
    "positive, mean estimated": {"bias": "positive", "bias_mean_m": "estimate"},
    "positive, both estimated": {"bias": "positive", "bias_mean_m": "estimate", "alpha": "estimate"},
    "positive, mean given": {"bias": "positive"},
}


def table(sensors: np.ndarray, ranges: np.ndarray, std: float):
    """Return the rows of snapshots (B, K) as a table."""
    import pyarrow as pa

    size, count = ranges.shape
    columns = {"snapshot": np.repeat(np.arange(size), count), "sensor": np.tile(np.arange(count), size)}
    columns |= {"sensor_x_m": sensors[..., 0].ravel(), "sensor_y_m": sensors[..., 1].ravel()}
    return pa.table({**columns, "range_m": np.abs(ranges).ravel(), "range_std_m": np.full(size * count, std)})


def calibration_error(probability: np.ndarray, right: np.ndarray) -> float:
    """Return the expected calibration error in ten bins."""
    bins = np.minimum((10.0 * probability).astype(int), 9)
    return sum(abs(probability[bins == i].sum() - right[bins == i].sum()) for i in range(10)) / max(right.size, 1)


def late(trials: int, mean_std: float, seed: int = 0):
    """Return sensors, sources, ranges and which rows are direct; the standard deviation is 1 m."""
    generator = np.random.default_rng(seed)
    sensors, sources = generator.uniform(0.0, 100.0, (trials, 6, 2)), generator.uniform(0.0, 100.0, (trials, 2))
    away = np.hypot(*np.moveaxis(sources[:, None] - sensors, -1, 0))
    direct = generator.random(away.shape) >= 0.25
    bias = np.where(direct, 0.0, generator.exponential(mean_std, away.shape))
    return sensors, sources, away + bias + generator.normal(size=away.shape), direct


def main(trials: int) -> None:
    """Print both tables."""
    print("mean bias, law: ok, coverage of 95 %, NEES above 100, RMSE of ok, calibration error of los_probability")
    for mean_std in (1.0, 3.0, 10.0, 20.0):
        sensors, sources, ranges, direct = late(trials, mean_std)
        for name, options in LAWS.items():
            given = {"bias_mean_m": mean_std} if "given" in name else {}
            result = api.localize(table(sensors, ranges, 1.0), method="mixture-ml", **options, **given)
            columns = result.estimates.to_pydict()
            ok = np.array(columns["status"]) == "ok"
            number = np.array(columns["snapshot"], dtype=int)[ok]
            position = np.array([columns["x_m"], columns["y_m"]], dtype=float).T[ok]
            covariance = np.array([columns[f"cov_{part}_m2"] for part in ("xx", "xy", "yy")], dtype=float).T[ok]
            error = position - sources[number]
            nees = squared_mahalanobis(error, covariance)
            probability = np.array(result.flags["los_probability"].to_pylist(), dtype=float).reshape(ranges.shape)
            calibration = calibration_error(probability[number].ravel(), direct[number].ravel())
            numbers = ok.mean(), (nees < 5.991).mean(), (nees > 100.0).mean(), np.sqrt((error**2).sum(axis=1).mean())
            learned = result.report.learned
            values = {} if not learned else learned["mixture-ml"].values | {"passes": learned["mixture-ml"].passes}
            print(
                f"{mean_std:4g} {name:26}",
                *(f"{value:.3f}" for value in (*numbers, calibration)),
                values or "",
                flush=True,
            )
    print("rows, std: ok or ambiguous without a source, no_consensus with one (no outliers)")
    for count in (3, 4, 5, 6, 8, 12, 50):
        for std in (0.3, 1.0, 3.0):
            generator = np.random.default_rng(1)
            size = max(100, min(trials, 6000 // count))
            sensors = generator.uniform(0.0, 100.0, (size, count, 2))
            away = np.hypot(*np.moveaxis(generator.uniform(0.0, 100.0, (size, 1, 2)) - sensors, -1, 0))
            words = [
                np.array(api.localize(table(sensors, ranges, std), method="mixture-ml").estimates["status"].to_pylist())
                for ranges in (
                    generator.uniform(0.0, 100.0, away.shape),
                    away + std * generator.normal(size=away.shape),
                )
            ]
            lost = (words[1] == "no_consensus").mean()
            print(f"{count:4d} {std:4g} {np.isin(words[0], ['ok', 'ambiguous']).mean():.3f} {lost:.3f}", flush=True)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 1000)
