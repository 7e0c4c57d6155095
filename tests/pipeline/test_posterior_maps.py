"""Posterior maps against likelihoods written out here and summed over fine grids, for every kind of measurement."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import pytest
from scipy.special import ndtr

import nlosctl
from nlosctl.arrays import FloatArray
from nlosctl.errors import DataError, UsageError

Likelihood = Callable[[Any, FloatArray, FloatArray], FloatArray]

SIDE = 1000.0
FIELD = "0,1000,0,1000"
ALPHA = 0.25


def world(kind: str, snapshots: int, rows: int, std: float, seed: int) -> tuple[dict[str, Any], FloatArray]:
    """Return measurements of sources uniform in a square by sensors anywhere in it, a quarter of them outliers."""
    draw = np.random.default_rng(seed)
    truth = draw.uniform(0.0, SIDE, (snapshots, 2))
    sensor = draw.uniform(0.0, SIDE, (snapshots, rows, 2))
    away, outlier = truth[:, None] - sensor, draw.random((snapshots, rows)) < ALPHA
    error = std * draw.standard_normal((snapshots, rows))
    table: dict[str, Any] = {
        "snapshot": np.repeat(np.arange(snapshots), rows),
        "sensor": np.tile([f"s{k}" for k in range(rows)], snapshots),
        "sensor_x_m": sensor[..., 0].ravel(),
        "sensor_y_m": sensor[..., 1].ravel(),
    }
    if kind == "bearings":
        bearing = np.arctan2(away[..., 1], away[..., 0]) + error
        bearing = np.where(outlier, draw.uniform(-np.pi, np.pi, outlier.shape), bearing)
        table |= {"bearing_rad": _wrapped(bearing).ravel(), "bearing_std_rad": np.full(truth.shape[0] * rows, std)}
    else:
        range_m = np.hypot(away[..., 0], away[..., 1]) + error
        range_m = np.where(outlier, draw.uniform(0.0, SIDE * 2**0.5, outlier.shape), range_m)
        table |= {"range_m": np.maximum(range_m, 0.1).ravel(), "range_std_m": np.full(truth.shape[0] * rows, std)}
    return table, truth


def _wrapped(angle: FloatArray) -> FloatArray:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def of_rows(table: dict[str, Any], snapshot: int) -> list[dict[str, float]]:
    """Return the rows of a snapshot."""
    picked = np.flatnonzero(table["snapshot"] == snapshot)
    return [{name: values[row] for name, values in table.items()} for row in picked]


def log_density(table: dict[str, Any], snapshot: int, x: FloatArray, y: FloatArray, alpha: float | None) -> FloatArray:
    """Return the log-likelihood of `mixture-ml`, equation (23), or of `ml` (``alpha`` None), at points."""
    total, rows = np.zeros(x.shape), of_rows(table, snapshot)
    least = 0.005 * max(np.ptp([row[f"sensor_{axis}_m"] for row in rows]) for axis in "xy")
    for row in rows:
        dx, dy = x - row["sensor_x_m"], y - row["sensor_y_m"]
        distance = np.hypot(dx, dy)
        if "range_m" in row:
            std, error = row["range_std_m"], distance - row["range_m"]
            outlier, possible, mass = 1.0 / (SIDE * 2**0.5), True, 1.0
        else:
            std, error = row["bearing_std_rad"], _wrapped(np.arctan2(dy, dx) - row["bearing_rad"])
            outlier, possible, mass = 1.0 / np.pi, (np.abs(error) < np.pi / 2.0) & (distance >= least), 1.0
        chi_square = (error / std) ** 2
        if alpha is None:
            total -= 0.5 * chi_square
        else:
            direct = (1.0 - alpha) * np.exp(-0.5 * chi_square) / (mass * std * np.sqrt(2.0 * np.pi))
            total += np.log(np.where(possible, direct, 0.0) + alpha * outlier)
    return total


def summed(log_density: Callable[[FloatArray, FloatArray], FloatArray], cell: float, parts: int) -> FloatArray:
    """Return the probabilities of the cells of the square from a grid with so many points along each cell."""
    count = round(SIDE / cell)
    ticks = (np.arange(count * parts) + 0.5) * cell / parts
    logarithm = log_density(*np.meshgrid(ticks, ticks))
    mass = np.exp(logarithm - logarithm.max()).reshape(count, parts, count, parts).sum(axis=(1, 3)).ravel()
    return np.asarray(mass / mass.sum())


def distance(one: FloatArray, other: FloatArray) -> float:
    """Return the largest difference between the probabilities of any region."""
    return float(0.5 * np.abs(one - other).sum())


@pytest.mark.parametrize(
    ("kind", "std", "parts"), [("ranges", 60.0, 6), ("ranges", 15.0, 16), ("bearings", 0.1, 12), ("bearings", 0.02, 60)]
)
@pytest.mark.parametrize("method", ["ml", "mixture-ml"])
def test_probabilities_are_integrals_over_cells(kind: str, std: float, parts: int, method: str) -> None:
    """Cells of 50 m are as probable as the likelihood summed over a fine grid, for wide posteriors and narrow ones."""
    table, _ = world(kind, 2, 5, std, seed=7)
    maps = nlosctl.posterior(table, all=True, method=method, field=FIELD, cell=50.0)
    found = maps["probability"].to_numpy().reshape(2, 400)
    assert np.abs(found.sum(axis=1) - 1.0).max() < 1e-6
    alpha = None if method == "ml" else ALPHA
    for snapshot in range(2):
        exact = summed(partial(log_density, table, snapshot, alpha=alpha), 50.0, parts)
        assert distance(found[snapshot], exact) < 0.01


def test_a_peak_of_a_millimetre_is_found_on_large_cells() -> None:
    """The cell of the source has all of the probability, although its centre is a thousand stds from every ring."""
    table, truth = world("ranges", 3, 6, 1e-3, seed=3)
    maps = nlosctl.posterior(table, all=True, method="mixture-ml", field=FIELD, cell=20.0, alpha=0.3)
    best = maps["probability"].to_numpy().reshape(3, 2500).argmax(axis=1)
    for snapshot, index in enumerate(best):
        x, y = (maps[name][int(index)].as_py() for name in ("x_m", "y_m"))
        fits = [abs(np.hypot(*(truth[snapshot] - [row["sensor_x_m"], row["sensor_y_m"]])) - row["range_m"]) < 0.01
                for row in of_rows(table, snapshot)]  # fmt: skip
        if sum(fits) >= 4:
            assert max(abs(x - truth[snapshot, 0]), abs(y - truth[snapshot, 1])) <= 10.0


def test_rows_that_agree_nowhere_have_the_cell_of_the_best_fit() -> None:
    """Three bearings of a hundredth of a degree, off by tens of degrees: the map is that of the least cost, at once."""
    table = {
        "snapshot": [0] * 4,
        "sensor": list("abcd"),
        "sensor_x_m": [0.0, 1000.0, 1000.0, 0.0],
        "sensor_y_m": [0.0, 0.0, 1000.0, 1000.0],
        "bearing_rad": [0.3, 2.6, -2.5, -0.2],
        "bearing_std_rad": [2e-4, 3e-4, 2e-4, 4e-4],
    }
    found = nlosctl.posterior(table, snapshot="0", field=FIELD, cell=40.0)
    arrays = {name: np.array(values) for name, values in table.items()}
    cost = partial(log_density, arrays, 0, alpha=None)
    x, y = np.meshgrid(np.arange(0.25, SIDE, 0.5), np.arange(0.25, SIDE, 0.5))
    best = int(cost(x.ravel(), y.ravel()).argmax())
    cell = int(np.argmax(found["probability"]))
    assert found["probability"][cell].as_py() > 0.99
    assert abs(found["x_m"][cell].as_py() - x.ravel()[best]) < 20.5
    assert abs(found["y_m"][cell].as_py() - y.ravel()[best]) < 20.5


@pytest.mark.parametrize("std", [1e-2, 1e-6])
def test_a_lone_bearing_is_a_fan_however_fine(std: float) -> None:
    """The mass of a ray grows with the square of the distance, also where it is a millimetre wide."""
    table = {
        "snapshot": [0],
        "sensor": ["a"],
        "sensor_x_m": [0.0],
        "sensor_y_m": [500.0],
        "bearing_rad": [0.01],
        "bearing_std_rad": [std],
    }
    found = nlosctl.posterior(table, snapshot="0", field=FIELD, cell=20.0)
    near = np.array(found["x_m"]) < 500.0
    assert np.array(found["probability"])[near].sum() == pytest.approx(0.25, abs=0.01)


def test_the_columns_of_a_map() -> None:
    """Centres row by row from the south-west, and shares that sum the probabilities of cells that are denser."""
    table, _ = world("ranges", 1, 5, 60.0, seed=1)
    cells = nlosctl.posterior(table, snapshot=0, method="mixture-ml", field="0,100,0,60", cell=20.0)
    assert cells.column_names == ["x_m", "y_m", "probability", "hpd"]
    assert cells["x_m"].to_pylist() == [10.0, 30.0, 50.0, 70.0, 90.0] * 3
    assert cells["y_m"].to_pylist() == [10.0] * 5 + [30.0] * 5 + [50.0] * 5
    probability, hpd = (cells[name].to_numpy() for name in ("probability", "hpd"))
    for own, share in zip(probability, hpd, strict=True):
        assert share == pytest.approx(probability[probability >= own].sum(), abs=1e-12)


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
def test_the_regions_cover_the_truth(kind: str) -> None:
    """Regions of 50, 90 and 95 % hold so many of 200 sources, within 3.5 standard deviations and a point."""
    table, truth = world(kind, 200, 5, {"bearings": 0.05, "ranges": 25.0}[kind], seed=11)
    options = {"field_of_view_deg": 360.0} if kind == "bearings" else {}
    maps = nlosctl.posterior(table, all=True, method="mixture-ml", field=FIELD, cell=12.5, **options)
    hpd, own = (maps[name].to_numpy().reshape(200, 6400) for name in ("hpd", "probability"))
    i, j = (truth / 12.5).astype(int).T
    at = np.arange(200), j * 80 + i
    middle = hpd[at] - 0.5 * own[at]
    for level in (0.5, 0.9, 0.95):
        allowed = 3.5 * np.sqrt(level * (1.0 - level) / 200) + 0.01
        assert abs(np.mean(middle <= level) - level) < allowed


@pytest.mark.parametrize("kind", ["bearings", "ranges"])
def test_the_mode_is_that_of_the_method(kind: str) -> None:
    """The most probable cell of a fix is that of the estimate or one beside it."""
    table, _ = world(kind, 60, 6, {"bearings": 0.05, "ranges": 25.0}[kind], seed=5)
    maps = nlosctl.posterior(table, all=True, method="mixture-ml", field=FIELD, cell=10.0)
    fixes = nlosctl.localize(table, method="mixture-ml", field=FIELD).estimates
    best = maps["probability"].to_numpy().reshape(60, 10_000).argmax(axis=1)
    x, y = (maps[name].to_numpy()[:10_000][best] for name in ("x_m", "y_m"))
    ok = np.array([word == "ok" for word in fixes["status"].to_pylist()])
    away = np.maximum(*(np.abs(own - fixes[name].to_numpy()) for own, name in ((x, "x_m"), (y, "y_m"))))
    assert ok.sum() >= 25
    assert np.mean(away[ok] <= 15.0) > 0.98


def test_arrivals_have_their_offset_integrated_out() -> None:
    """With a flat offset the density is the integral of the likelihood over offsets, of `ml` and of uniform delays."""
    draw = np.random.default_rng(2)
    sensor, truth, std = draw.uniform(0.0, SIDE, (5, 2)), np.array([400.0, 700.0]), np.array([30.0, 40, 30, 50, 40])
    arrival = np.hypot(*(truth - sensor).T) + std * draw.standard_normal(5) + 5000.0
    arrival[4] += 400.0
    table = {"snapshot": [1] * 5, "sensor": list("abcde"), "sensor_x_m": sensor[:, 0], "sensor_y_m": sensor[:, 1]}
    table |= {"arrival_m": arrival, "arrival_std_m": std}

    def likelihood(x: FloatArray, y: FloatArray, late: float) -> FloatArray:
        total = np.full(x.shape, -np.inf)
        for offset in np.arange(3500.0, 5600.0, 7.0):
            logarithm = np.zeros(x.shape)
            for k in range(5):
                scaled = (arrival[k] - np.hypot(x - sensor[k, 0], y - sensor[k, 1]) - offset) / std[k]
                direct = np.exp(-0.5 * scaled**2) / (std[k] * np.sqrt(2.0 * np.pi))
                with np.errstate(divide="ignore"):
                    logarithm += np.log((1.0 - late) * direct + late * ndtr(scaled) / 800.0)
            total = np.logaddexp(total, logarithm)
        return total

    for method, late, options in (("ml", 0.0, {}), ("mixture-ml", 0.25, {"late_m": 800.0})):
        maps = nlosctl.posterior(table, snapshot=1, method=method, field=FIELD, cell=40.0, **options)
        exact = summed(partial(likelihood, late=late), 40.0, 4)
        assert distance(maps["probability"].to_numpy(), exact) < 0.01


@pytest.mark.parametrize(("scale", "parts"), [(1.0, 5), (0.2, 12)])
def test_triplets_are_taken_together(scale: float, parts: int) -> None:
    """All paths of a snapshot are over one target: angles and lengths multiply, as by ``joint=true``."""
    draw = np.random.default_rng(4)
    node, truth = draw.uniform(0.0, SIDE, (2, 3, 2)), np.array([450.0, 600.0])
    away = truth - node
    std = {"dod_std_rad": 0.1 * scale, "doa_std_rad": 0.15 * scale, "path_length_std_m": 60.0 * scale}
    angle = np.arctan2(away[..., 1], away[..., 0]) + 0.05 * scale * draw.standard_normal((2, 3))
    length = np.hypot(away[..., 0], away[..., 1]).sum(axis=0) + 30.0 * scale * draw.standard_normal(3)
    table = {"snapshot": [1] * 3, "path": [0, 1, 2], "tx_x_m": node[0, :, 0], "tx_y_m": node[0, :, 1]}
    table |= {"rx_x_m": node[1, :, 0], "rx_y_m": node[1, :, 1], "dod_rad": angle[0], "doa_rad": angle[1]}
    table |= {"path_length_m": length, **{name: [value] * 3 for name, value in std.items()}}

    def likelihood(x: FloatArray, y: FloatArray) -> FloatArray:
        total = np.zeros(x.shape)
        for k in range(3):
            legs = [(x - node[end, k, 0], y - node[end, k, 1]) for end in range(2)]
            for end, name in ((0, "dod_std_rad"), (1, "doa_std_rad")):
                total -= 0.5 * (_wrapped(np.arctan2(*legs[end][::-1]) - angle[end, k]) / std[name]) ** 2
            path = np.hypot(*legs[0]) + np.hypot(*legs[1])
            total -= 0.5 * ((path - length[k]) / std["path_length_std_m"]) ** 2
        return total

    maps = nlosctl.posterior(table, snapshot=1, method="ml", field=FIELD, cell=25.0)
    assert distance(maps["probability"].to_numpy(), summed(likelihood, 25.0, parts)) < 0.01
    with pytest.raises(UsageError, match="leave out joint=false"):
        nlosctl.posterior(table, snapshot=1, method="ml", joint=False)


def test_a_combined_map_multiplies_those_of_the_snapshots() -> None:
    """Its logarithm is the sum of theirs, and its bits don't depend on the order of the snapshots."""
    table, _ = world("bearings", 12, 4, 0.5, seed=9)
    options: dict[str, Any] = {"method": "ml", "field": FIELD, "cell": 50.0}
    combined = nlosctl.posterior(table, combine=True, **options)["probability"].to_numpy()
    x, y = (part.ravel() for part in np.meshgrid(np.arange(25.0, SIDE, 50.0), np.arange(25.0, SIDE, 50.0)))
    logarithm = sum(log_density(table, own, x, y, None) for own in range(12))
    exact = np.exp(logarithm - np.max(logarithm))
    np.testing.assert_allclose(combined, exact / exact.sum(), rtol=1e-4, atol=1e-12)
    order = np.argsort(-table["snapshot"], kind="stable")
    turned = nlosctl.posterior({name: values[order] for name, values in table.items()}, combine=True, **options)
    assert turned["probability"].to_numpy().tobytes() == combined.tobytes()


def test_a_prior_counts_once() -> None:
    """A Gaussian prior multiplies the likelihood of a snapshot, and that of all together once, not per snapshot."""
    table, _ = world("bearings", 3, 3, 0.6, seed=6)
    prior = {"prior_x_m": 300.0, "prior_y_m": 500.0, "prior_std_m": 150.0}
    for choice in ({"snapshot": 1}, {"combine": True}):
        options: dict[str, Any] = {**choice, "method": "ml", "field": FIELD, "cell": 25.0}
        free = nlosctl.posterior(table, **options)
        with_prior = nlosctl.posterior(table, **options, **prior)["probability"].to_numpy()
        x, y = free["x_m"].to_numpy(), free["y_m"].to_numpy()
        expected = free["probability"].to_numpy() * np.exp(-((x - 300.0) ** 2 + (y - 500.0) ** 2) / (2.0 * 150.0**2))
        assert distance(with_prior, expected / expected.sum()) < 5e-3
    columns = {**table, **{name: np.full(9, value) for name, value in prior.items()}}
    assert nlosctl.posterior(columns, **options)["probability"].to_numpy().tobytes() == with_prior.tobytes()
    columns["prior_x_m"] = np.repeat([300.0, 310.0, 300.0], 3)
    with pytest.raises(DataError, match="different priors"):
        nlosctl.posterior(columns, **options)


def test_a_round_region_has_no_probability_outside() -> None:
    """Cells beyond a circle have none; those that it cuts have the share that is inside."""
    table, _ = world("bearings", 1, 2, 3.0, seed=8)
    cells = nlosctl.posterior(
        table, snapshot=0, method="mixture-ml", field="circle:500,500,300", cell=100.0, alpha=0.99
    )
    away = np.hypot(cells["x_m"].to_numpy() - 500.0, cells["y_m"].to_numpy() - 500.0)
    probability = cells["probability"].to_numpy()
    assert cells.num_rows == 36
    assert (probability[away > 371.0] == 0.0).all()
    corner = probability[np.argmin(np.abs(away - np.hypot(250.0, 150.0)))]
    assert 0.3 < corner / probability[away < 100.0].mean() < 0.8


def test_a_height_is_needed_in_space() -> None:
    """In three dimensions a map needs a height; at an exact one slant ranges make the map of the plane."""
    table, _ = world("ranges", 1, 4, 40.0, seed=2)
    table["sensor_z_m"] = np.full(4, 30.0)
    options: dict[str, Any] = {"snapshot": 0, "method": "ml", "field": FIELD, "cell": 50.0}
    with pytest.raises(UsageError, match="target_z_m"):
        nlosctl.posterior(table, dimensions=3, **options)
    exact = nlosctl.posterior(table, dimensions=3, target_z_m=0.0, **options)["probability"].to_numpy()
    plane = nlosctl.posterior(table, dimensions=2, target_z_m=0.0, **options)["probability"].to_numpy()
    np.testing.assert_allclose(exact, plane, rtol=1e-9)
    loose = nlosctl.posterior(table, dimensions=3, target_z_m=0.0, target_z_std_m=5.0, **options)
    assert distance(loose["probability"].to_numpy(), plane) < 0.05
