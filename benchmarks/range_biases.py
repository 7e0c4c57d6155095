"""Calibration of `mixture-ml` on ranges whose outliers are late, and its verdict on ranges without a source.

`python benchmarks/range_biases.py [TRIALS] [laws|shares|verdicts|optimum|absurd]` prints the tables of
docs/outliers.md, all of them without a name. Sensors and a source are uniform in a square of 100 m. `laws`: six
sensors, 1 m, a quarter of the rows late by an exponential bias. `shares`: another share of them, so that `alpha` is
wrong. `verdicts`: ranges without a source, and without outliers. `optimum`: what the best test between these two loses.
`absurd`: how many `ok` fixes are far outside of their ellipse.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import numpy as np

from nlosctl import api
from nlosctl.evaluation.consistency import squared_mahalanobis

_SIDE_M = 100.0
_FALSE_ALARM = 0.02
"""Share of snapshots without a source that may have a fix."""

LAWS: dict[str, dict[str, Any]] = {
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


def late(trials: int, mean_std: float, share: float = 0.25, seed: int = 0):
    """Return sensors, sources, ranges and which rows are direct; the standard deviation is 1 m."""
    generator = np.random.default_rng(seed)
    sensors = generator.uniform(0.0, _SIDE_M, (trials, 6, 2))
    sources = generator.uniform(0.0, _SIDE_M, (trials, 2))
    away = np.hypot(*np.moveaxis(sources[:, None] - sensors, -1, 0))
    direct = generator.random(away.shape) >= share
    bias = np.where(direct, 0.0, generator.exponential(mean_std, away.shape))
    return sensors, sources, away + bias + generator.normal(size=away.shape), direct


def ok_fixes(estimates, sources: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return which best fixes are ok; the snapshot, the error and the covariance of each of these."""
    columns = estimates.to_pydict()
    ok = np.array(columns["status"]) == "ok"
    number = np.array(columns["snapshot"], dtype=int)[ok]
    position = np.array([columns["x_m"], columns["y_m"]], dtype=float).T[ok]
    covariance = np.array([columns[f"cov_{part}_m2"] for part in ("xx", "xy", "yy")], dtype=float).T[ok]
    return ok, number, position - sources[number], covariance


def law_line(trials: int, mean_std: float, share: float, name: str) -> str:
    """Return the figures of the `ok` fixes by one law."""
    sensors, sources, ranges, direct = late(trials, mean_std, share)
    given = {"bias_mean_m": mean_std} if "given" in name else {}
    result = api.localize(table(sensors, ranges, 1.0), method="mixture-ml", **LAWS[name], **given)
    ok, number, error, covariance = ok_fixes(result.estimates, sources)
    nees = squared_mahalanobis(error, covariance)
    probability = np.array(result.flags["los_probability"].to_pylist(), dtype=float).reshape(ranges.shape)
    calibration = calibration_error(probability[number].ravel(), direct[number].ravel())
    numbers = ok.mean(), (nees < 5.991).mean(), (nees > 100.0).mean(), np.sqrt((error**2).sum(axis=1).mean())
    learned = result.report.learned
    values = {} if not learned else learned["mixture-ml"].values | {"passes": learned["mixture-ml"].passes}
    figures = " ".join(f"{value:.3f}" for value in (*numbers, calibration))
    return f"{share:4g} {mean_std:4g} {name:26} {figures} {values or ''}"


def laws(trials: int) -> Iterator[str]:
    """Yield the lines of every law, with a quarter of the rows late."""
    yield "share late, mean bias, law: ok, coverage of 95 %, NEES above 100, RMSE of ok, calibration error"
    for mean_std in (1.0, 3.0, 10.0, 20.0):
        for name in LAWS:
            yield law_line(trials, mean_std, 0.25, name)


def shares(trials: int) -> Iterator[str]:
    """Yield the lines of other shares of late rows than `alpha`, a quarter."""
    yield "share late, mean bias, law: ok, coverage of 95 %, NEES above 100, RMSE of ok, calibration error"
    for share, mean_std in ((0.0, 1.0), *((share, mean) for share in (0.1, 0.25, 0.4) for mean in (1.0, 3.0, 10.0))):
        for name in ("positive", "positive, mean estimated", "positive, both estimated"):
            yield law_line(trials, mean_std, share, name)


def two_worlds(trials: int, count: int, std: float, longest_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return sensors, ranges without a source (uniform up to ``longest_m``), and those of a source, none an outlier."""
    generator = np.random.default_rng(1)
    sensors = generator.uniform(0.0, _SIDE_M, (trials, count, 2))
    away = np.hypot(*np.moveaxis(generator.uniform(0.0, _SIDE_M, (trials, 1, 2)) - sensors, -1, 0))
    noise = generator.uniform(0.0, longest_m, away.shape)
    return sensors, noise, np.abs(away + std * generator.normal(size=away.shape))


def verdict(sensors: np.ndarray, ranges: np.ndarray, std: float, field: str = "sensors:1") -> np.ndarray:
    """Return the statuses of the best fixes."""
    estimates = api.localize(table(sensors, ranges, std), method="mixture-ml", field=field).estimates
    return np.array(estimates["status"].to_pylist())


def verdicts(trials: int) -> Iterator[str]:
    """Yield the share of snapshots with a fix without a source, and without a fix with one."""
    yield "rows, std, longest range without a source: ok or ambiguous without a source, no_consensus with one"
    for count in (3, 4, 5, 6, 8, 12, 50):
        for std in (0.3, 1.0, 3.0, 10.0):
            size = max(100, min(10 * trials, 16_000 // count))
            for longest_m in (_SIDE_M, 1.4 * _SIDE_M):
                sensors, noise, clean = two_worlds(size, count, std, longest_m)
                fixed = np.isin(verdict(sensors, noise, std), ["ok", "ambiguous"]).mean()
                lost = (verdict(sensors, clean, std) == "no_consensus").mean()
                yield f"{count:4d} {std:4g} {longest_m:4g} {fixed:.4f} {lost:.4f}"


def log_likelihood_ratios(sensors: np.ndarray, ranges: np.ndarray, std: float, density: np.ndarray) -> np.ndarray:
    """Return the log of the evidence of a source in the square over that of none, (2, B), by sums over a grid.

    First with no outliers, then with a quarter. ``density`` (B,): that of ranges without a source, or of outliers.
    """
    cells = int(np.ceil(2.0 * _SIDE_M / std))
    axis = (np.arange(cells) + 0.5) * _SIDE_M / cells
    ratios = np.empty((2, len(ranges)))
    for number, (places, read) in enumerate(zip(sensors, ranges, strict=True)):
        peak = 1.0 / (std * np.sqrt(2.0 * np.pi) * density[number])
        exponent, mixed = np.zeros((cells, cells)), np.ones((cells, cells))
        for (x, y), range_m in zip(places, read, strict=True):
            error = np.hypot(axis[:, None] - x, axis[None, :] - y) - range_m
            row = -0.5 * (error / std) ** 2
            exponent += row
            mixed *= 0.25 + 0.75 * peak * np.exp(row)
        highest = exponent.max()
        ratios[0, number] = highest + np.log(np.exp(exponent - highest).mean()) + len(read) * np.log(peak)
        ratios[1, number] = np.log(mixed.mean())
    return ratios


def optimum(trials: int) -> Iterator[str]:
    """Yield what tests at 2 % of false alarms lose of the snapshots with a source (Neyman and Pearson).

    The likelihood ratio is the best test if all is known: the square, the density of ranges without a source, and that
    no row is an outlier. The second expects a quarter of outliers, the third knows no density either: it takes the
    longest range of the snapshot for the longest of all.
    """
    yield "rows, std, longest: lost by the best tests (all known, outliers, no density); mixture-ml: false alarms, lost"
    yield "(default region, then the square)"
    for count, std in ((3, 1.0), (4, 1.0), (5, 1.0), (6, 1.0), (3, 3.0), (4, 3.0), (5, 3.0), (6, 3.0), (8, 3.0)):
        for longest_m in (_SIDE_M, 1.4 * _SIDE_M):
            sensors, *worlds = two_worlds(trials, count, std, longest_m)
            tests = []
            for ranges in worlds:
                known = log_likelihood_ratios(sensors, ranges, std, np.full(trials, 1.0 / longest_m))
                known[0, ranges.max(axis=1) > longest_m] = np.inf  # not without a source
                unknown = log_likelihood_ratios(sensors, ranges, std, 1.0 / ranges.max(axis=1))
                tests.append((*known, unknown[1]))
            lost = [
                np.mean(with_source < np.quantile(none, 1.0 - _FALSE_ALARM))
                for none, with_source in zip(*tests, strict=True)
            ]
            ours = []
            for field in ("sensors:1", f"0,{_SIDE_M:g},0,{_SIDE_M:g}"):
                noise, clean = (verdict(sensors, ranges, std, field) for ranges in worlds)
                ours += [np.isin(noise, ["ok", "ambiguous"]).mean(), (clean == "no_consensus").mean()]
            yield f"{count:4d} {std:4g} {longest_m:4g} " + " ".join(f"{value:.3f}" for value in (*lost, *ours))


def absurd(trials: int) -> Iterator[str]:
    """Yield the share of `ok`, and of NEES above 100 among these; outliers read anything up to 140 m."""
    yield "rows, std, share of outliers: ok, NEES above 100"
    for count in (3, 4, 5, 6, 8):
        for std in (0.3, 1.0, 3.0):
            for share in (0.0, 0.1, 0.25):
                generator = np.random.default_rng(5)
                size = 50 * trials // count
                sensors = generator.uniform(0.0, _SIDE_M, (size, count, 2))
                sources = generator.uniform(0.0, _SIDE_M, (size, 2))
                away = np.hypot(*np.moveaxis(sources[:, None] - sensors, -1, 0))
                ranges = away + std * generator.normal(size=away.shape)
                outlier = generator.random(away.shape) < share
                ranges = np.where(outlier, generator.uniform(0.0, 1.4 * _SIDE_M, away.shape), ranges)
                result = api.localize(table(sensors, ranges, std), method="mixture-ml", alpha=share or 0.25)
                ok, _, error, covariance = ok_fixes(result.estimates, sources)
                far = np.mean(~(squared_mahalanobis(error, covariance) <= 100.0))
                yield f"{count:4d} {std:4g} {share:4g} {ok.mean():.3f} {far:.4f}"


TABLES = {"laws": laws, "shares": shares, "verdicts": verdicts, "optimum": optimum, "absurd": absurd}


if __name__ == "__main__":
    number = next((int(word) for word in sys.argv[1:] if word.isdigit()), 1000)
    for name in [word for word in sys.argv[1:] if word in TABLES] or TABLES:
        for line in TABLES[name](number):
            print(line, flush=True)
