"""Estimated standard deviations in space and of arrival times against scipy, closed forms and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pyproj
import pytest
from scipy.optimize import least_squares
from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

import nlosctl
from nlosctl.errors import DataError, UsageError
from nlosctl.geometry.ellipses import ellipsoid_threshold

RELATIVE = (1.0, 2.0, 4.0)
KINDS = [("bearings", 3), ("ranges", 3), ("arrivals", 3), ("arrivals", 2)]
METHODS = {"bearings": "ml", "ranges": "r-ls", "arrivals": "ml"}
STDS = {"bearings": np.radians(1.0), "ranges": 0.5, "arrivals": 0.3}


def world(kind, rows, snapshots, std, *, dimension=3, relative=RELATIVE, seed=1, stated=True, azimuth_only=0.0):
    """Return measurements of random sources by random sensors in a square or cube of a kilometre."""
    rng = np.random.default_rng(seed)
    sensors = rng.uniform(0, 1000, (snapshots, rows, dimension))
    sources = rng.uniform(0, 1000, (snapshots, dimension))
    weight = np.tile(np.resize(relative, rows), snapshots)
    away = (sources[:, None] - sensors).reshape(-1, dimension)
    noise = rng.normal(size=(2, away.shape[0])) * weight * std
    table = {
        "snapshot": np.repeat(np.arange(snapshots), rows),
        "sensor": np.tile([f"s{number}" for number in range(rows)], snapshots),
    }
    for axis, name in enumerate("xyz"[:dimension]):
        table[f"sensor_{name}_m"] = sensors[..., axis].ravel()
        table[f"truth_{name}_m"] = np.repeat(sources[:, axis], rows)
    if kind == "bearings":
        table["bearing_rad"] = np.arctan2(away[:, 1], away[:, 0]) + noise[0]
        elevation = np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1])) + noise[1]
        elevation = np.clip(elevation, -0.5 * np.pi, 0.5 * np.pi)
        table["elevation_rad"] = np.where(rng.random(weight.size) < azimuth_only, np.nan, elevation)
        stds = {
            "bearing_std_rad": weight,
            "elevation_std_rad": np.where(np.isnan(table["elevation_rad"]), np.nan, weight),
        }
    else:
        offset = np.repeat(rng.uniform(-1e4, 1e4, snapshots), rows) if kind == "arrivals" else 0.0
        name = kind.removesuffix("s")
        table[f"{name}_m"] = np.linalg.norm(away, axis=1) + offset + noise[0]
        stds = {f"{name}_std_m": weight}
    return table | (stds if stated else {})


def solved(table, pool, **options):
    """Return the estimates of a table with estimated standard deviations."""
    dimension = 3 if "sensor_z_m" in table else 2
    kind = "bearings" if "bearing_rad" in table else "arrivals" if "arrival_m" in table else "ranges"
    options = {"method": METHODS[kind], **options}
    return nlosctl.localize(table, estimate_std=pool, dimensions=dimension, **options)


def numbers(table, *names):
    """Return columns of a table as floats (N, n), null as NaN."""
    return np.stack([np.array(table[name].to_pylist(), dtype=float) for name in names], axis=1)


def axes_of(estimates):
    """Return the names of the axes of estimates."""
    return "xyz" if "z_m" in estimates.column_names else "xy"


def covariances(estimates):
    """Return the covariances (N, D, D)."""
    axes = axes_of(estimates)
    names = [f"cov_{min(a, b)}{max(a, b)}_m2" for a in axes for b in axes]
    return numbers(estimates, *names).reshape(-1, len(axes), len(axes))


def coverage(estimates, probability=0.95):
    """Return the share of F ellipsoids that contain the truth, of the estimates with a covariance."""
    axes = axes_of(estimates)
    error = numbers(estimates, *(f"{axis}_m" for axis in axes)) - numbers(
        estimates, *(f"truth_{axis}_m" for axis in axes)
    )
    covariance = covariances(estimates)
    known = np.isfinite(covariance).all(axis=(1, 2))
    squared = np.einsum("ni,nij,nj->n", error[known], np.linalg.inv(covariance[known]), error[known])
    degrees = numbers(estimates, "std_dof")[known, 0]
    return float(np.mean(squared <= len(axes) * f_distribution.ppf(probability, len(axes), degrees)))


def residuals_of(table, snapshot, weight):
    """Return the residuals over ``weight`` of a snapshot as a function of its unknowns: by rows, then scalars.

    The last unknown of arrivals is their offset.
    """
    mine = np.asarray(table["snapshot"]) == snapshot
    axes = "xyz" if "sensor_z_m" in table else "xy"
    sensor = np.stack([np.asarray(table[f"sensor_{axis}_m"])[mine] for axis in axes], axis=1)
    weight = weight[mine]
    values = {name: np.asarray(column)[mine] for name, column in table.items()}

    def residuals(unknowns):
        away = unknowns[: len(axes)] - sensor
        if "bearing_rad" in table:
            off = values["bearing_rad"] - np.arctan2(away[:, 1], away[:, 0])
            azimuth = np.angle(np.exp(1j * off)) / weight
            rise = (values["elevation_rad"] - np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1]))) / weight
            return np.concatenate([azimuth, np.nan_to_num(rise)])
        length = np.linalg.norm(away, axis=1)
        if "range_m" in table:
            return (values["range_m"] - length) / weight
        return (values["arrival_m"] - length - unknowns[-1]) / weight

    return residuals


def slopes_at(table, snapshot, position, weight):
    """Return the derivatives of the residuals by the unknowns at a position; the offset enters them linearly."""
    residuals = residuals_of(table, snapshot, weight)
    unknowns = np.array([*position, 0.0]) if "arrival_m" in table else np.array(position)
    steps = 1e-3 * np.eye(unknowns.size)
    return np.stack([(residuals(unknowns + step) - residuals(unknowns - step)) / 2e-3 for step in steps], axis=1)


def fit(table, snapshot, start, weight):
    """Return unknowns, residuals and derivatives of scipy's weighted least-squares fit of a snapshot."""
    residuals = residuals_of(table, snapshot, weight)
    if "arrival_m" in table:
        start = [*start, np.mean(residuals(np.append(start, 0.0)) * weight[np.asarray(table["snapshot"]) == snapshot])]
    found = least_squares(residuals, start, method="lm", xtol=1e-14, ftol=1e-15, gtol=1e-15)
    return found.x, found.fun, found.jac


def scalars_of(table, snapshots):
    """Return the number of measured scalars of each snapshot."""
    count = np.full(snapshots, len(table["snapshot"]) // snapshots)
    if "elevation_rad" in table:
        count = count + np.isfinite(table["elevation_rad"]).reshape(snapshots, -1).sum(axis=1)
    return count


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
@pytest.mark.parametrize("stated", [True, False], ids=["weights", "none"])
def test_factors_are_those_of_scipys_fits(kind, dimension, stated):
    """std_factor^2 is Q / (scalars - unknowns), or the sums over the file; the covariance that of the position."""
    azimuth_only = 0.3 if kind == "bearings" else 0.0
    table = world(kind, 6, 30, STDS[kind], dimension=dimension, stated=stated, seed=3, azimuth_only=azimuth_only)
    weight = np.tile(np.resize(RELATIVE, 6), 30) if stated else np.ones(180)
    own, pooled = (solved(table, pool).estimates for pool in ("snapshot", "file"))
    truth = numbers(own, *(f"truth_{axis}_m" for axis in axes_of(own)))
    fits = [fit(table, number, truth[number], weight) for number in range(30)]
    unknowns = len(fits[0][0])
    spare = scalars_of(table, 30) - unknowns
    squares = np.array([residuals @ residuals for _, residuals, _ in fits])
    usual = np.flatnonzero((np.array(own["status"].to_pylist()) == "ok") & (spare > 0))
    assert usual.size >= 22
    assert numbers(own, "std_factor")[usual, 0] == pytest.approx(np.sqrt(squares / spare)[usual], rel=1e-5)
    assert numbers(own, "std_dof")[usual, 0].tolist() == spare[usual].tolist()
    sound = np.flatnonzero(np.isin(pooled["status"].to_pylist(), ["ok", "ambiguous"]) & (spare > 0))
    factor = np.sqrt(squares[sound].sum() / spare[sound].sum())
    assert numbers(pooled, "std_factor")[sound, 0] == pytest.approx(factor, rel=1e-5)
    assert set(numbers(pooled, "std_dof")[sound, 0]) == {spare[sound].sum()}
    for number in usual[:10]:
        _, _, slopes = fits[number]
        covariance = np.linalg.inv(slopes.T @ slopes)[:dimension, :dimension]
        scaled = covariance * squares[number] / spare[number]
        assert covariances(own)[number] == pytest.approx(scaled, abs=1e-3 * np.trace(scaled))


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
def test_sensor_factors_are_those_of_a_plain_iteration(kind, dimension):
    """Factors of sensors are the fixed point of (Q_j + 5 F^2) / (D_j + 5) with the leverages of scipy's fits."""
    table = world(kind, 6, 12, STDS[kind], dimension=dimension, relative=(1, 1, 2, 4, 0.5, 1), stated=False, seed=4)
    done = solved(table, "sensor")
    estimates = done.estimates
    truth = numbers(estimates, *(f"truth_{axis}_m" for axis in axes_of(estimates)))
    used = np.flatnonzero(np.isin(estimates["status"].to_pylist(), ["ok", "ambiguous"])).tolist()
    assert len(used) >= 10
    first = [fit(table, number, truth[number], np.ones(72)) for number in used]
    unknowns, count = len(first[0][0]), len(first[0][1])
    squared = sum(residuals @ residuals for _, residuals, _ in first) / (len(used) * (count - unknowns))
    sensor = np.arange(count) % 6
    factor = np.full(6, np.sqrt(squared))
    for _ in range(25):
        squares, degrees = np.zeros(6), np.zeros(6)
        for number in used:
            _, residuals, slopes = fit(table, number, truth[number], np.tile(factor, 12))
            leverage = np.einsum("ki,ij,kj->k", slopes, np.linalg.inv(slopes.T @ slopes), slopes)
            squares += np.bincount(sensor, (residuals * factor[sensor]) ** 2, 6)
            degrees += np.bincount(sensor, 1.0 - leverage, 6)
        factor = np.sqrt((squares + 5.0 * squared) / (degrees + 5.0))
    by_row = dict(zip(done.flags["sensor"].to_pylist(), done.flags["std_factor"].to_pylist(), strict=True))
    assert [by_row[f"s{number}"] for number in range(6)] == pytest.approx(factor, rel=2e-3)
    assert numbers(estimates, "std_dof")[used, 0] == pytest.approx(degrees.min() + 5.0, rel=1e-2)
    position = numbers(estimates, *(f"{axis}_m" for axis in axes_of(estimates)))
    for number in used[:3]:
        slopes = slopes_at(table, number, position[number], np.ones(72))
        stated = np.linalg.inv(slopes.T @ slopes)[:dimension, :dimension]
        size = (np.linalg.det(covariances(estimates)[number]) / np.linalg.det(stated)) ** (0.5 / dimension)
        assert numbers(estimates, "std_factor")[number, 0] == pytest.approx(size, rel=1e-4)


@pytest.mark.parametrize(
    ("kind", "dimension", "methods"),
    [
        ("bearings", 3, ("ls", "stansfield", "mixture-ml")),
        ("ranges", 3, ("sr-ls", "mixture-ml")),
        ("arrivals", 3, ("srd-ls",)),
        ("arrivals", 2, ("srd-ls",)),
    ],
)
def test_all_methods_agree_on_the_factors_of_sensors(kind, dimension, methods):
    """Whatever the fix minimizes, the factors of the sensors are within 3 % of those of maximum likelihood."""
    table = world(kind, 7, 200, STDS[kind], dimension=dimension, relative=(1, 1, 2, 3, 1, 1, 2), stated=False, seed=6)

    def factors(method):
        flags = solved(table, "sensor", method=method).flags
        rows = zip(flags["sensor"].to_pylist(), flags["std_factor"].to_pylist(), strict=True)
        known = {sensor: factor for sensor, factor in rows if factor is not None}
        return np.array([known[f"s{number}"] for number in range(7)])

    likeliest = factors(METHODS[kind])
    assert likeliest / STDS[kind] == pytest.approx([1, 1, 2, 3, 1, 1, 2], rel=0.3)
    for method in methods:
        assert factors(method) == pytest.approx(likeliest, rel=0.03), method


@pytest.mark.parametrize("pool", ["snapshot", "file"])
@pytest.mark.parametrize(("kind", "dimension"), KINDS)
@pytest.mark.parametrize("rows", [6, 8])
def test_ellipsoids_of_unknown_std_contain_95_percent(rows, kind, dimension, pool):
    """With relative weights 1:2:4 .93 to .97 of the 95 % ellipsoids contain the truth, and evaluate counts the same."""
    estimates = solved(world(kind, rows, 2000, STDS[kind], dimension=dimension, seed=rows), pool).estimates
    assert 0.93 <= coverage(estimates) <= 0.97
    assert nlosctl.evaluate(estimates).groups[0]["coverage_95"] == pytest.approx(coverage(estimates), abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("pool", ["snapshot", "file"])
@pytest.mark.parametrize(("kind", "dimension"), KINDS)
@pytest.mark.parametrize("spare", [1, 2, 3, 4])
def test_ellipsoids_of_unknown_std_contain_95_percent_in_long_runs(spare, kind, dimension, pool):
    """The same with 10,000 snapshots a cell from two spare rows on, and with one or more of azimuths and elevations."""
    least = 1 if kind == "bearings" else dimension + (kind == "arrivals") + 1
    table = world(kind, least + spare, 10_000, STDS[kind], dimension=dimension, seed=spare)
    assert 0.93 <= coverage(solved(table, pool).estimates) <= 0.97


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
def test_ellipsoids_by_sensor_contain_95_percent(kind, dimension):
    """Of unequal sensors .93 to .99 of the ellipsoids by the sensors' factors contain the truth."""
    table = world(kind, 8, 300, STDS[kind], dimension=dimension, relative=(1, 1, 2, 4, 0.5), stated=False, seed=2)
    assert 0.93 <= coverage(solved(table, "sensor").estimates) <= 0.99


def test_outliers_do_not_enter_the_factor_of_a_mixture():
    """With a fifth of the directions anywhere the factors of mixture-ml are within 8 % of the true std, in space."""
    table = world("bearings", 8, 200, np.radians(1.0), relative=(1.0,), stated=False, seed=5)
    rng = np.random.default_rng(0)
    wrong = rng.random(1600) < 0.2
    table["bearing_rad"] = np.where(wrong, rng.uniform(-np.pi, np.pi, 1600), table["bearing_rad"])
    table["elevation_rad"] = np.where(wrong, rng.uniform(-0.5 * np.pi, 0.5 * np.pi, 1600), table["elevation_rad"])
    for pool in ("file", "sensor"):
        factor = numbers(solved(table, pool, method="mixture-ml").estimates, "std_factor")
        assert np.nanmedian(factor) == pytest.approx(np.radians(1.0), rel=0.08)


def test_thresholds_of_ellipsoids_are_quantiles_of_f():
    """Squared radii are D F^-1(P; D, dof) for D of 1 to 3, and those of chi-square where dof is unknown."""
    degrees = np.array([1.0, 2.0, 3.0, 20.0, 1e7, np.nan])
    for dimension in (1, 2, 3):
        each = np.full(degrees.size, dimension)
        for probability in (0.5, 0.95, 0.99):
            found = ellipsoid_threshold(probability, each, degrees)
            expected = dimension * f_distribution.ppf(probability, dimension, degrees[:-1])
            assert found[:-1] == pytest.approx(expected, rel=1e-6)
            assert found[-1] == ellipsoid_threshold(probability, each)[-1]


def test_half_heights_and_spheres_follow_the_degrees_of_freedom():
    """``half_height_m`` is the quantile of Student's t times the std of z, and sep50 grows by the F distribution."""
    table = world("bearings", 2, 50, np.radians(1.0), seed=8)
    added = {"ellipse": 0.9, "add": ["sep50"]}
    few = solved(table, "snapshot", **added).estimates
    pooled = solved(table, "file", **added).estimates
    for estimates in (few, pooled):
        std, degrees = np.sqrt(numbers(estimates, "cov_zz_m2")), numbers(estimates, "std_dof")
        assert numbers(estimates, "half_height_m") == pytest.approx(
            std * t_distribution.ppf(0.95, degrees), rel=1e-6, nan_ok=True
        )
    ratio = (
        numbers(few, "sep50_m")
        / numbers(few, "std_factor")
        / (numbers(pooled, "sep50_m") / numbers(pooled, "std_factor"))
    )
    wider = np.sqrt(f_distribution.ppf(0.5, 3, 1) / f_distribution.ppf(0.5, 3, np.nanmax(numbers(pooled, "std_dof"))))
    assert np.nanmedian(ratio) == pytest.approx(wider, rel=1e-3)


def test_exact_heights_leave_one_more_degree_of_freedom():
    """With the height held there are two unknown coordinates; one with a standard deviation is refused."""
    for kind, rest in (("bearings", 10), ("ranges", 4), ("arrivals", 3)):
        table = world(kind, 6, 20, STDS[kind], stated=False, seed=9)
        table["target_z_m"] = table["truth_z_m"]
        estimates = solved(table, "snapshot").estimates
        certain = np.isfinite(numbers(estimates, "std_factor")[:, 0])
        assert certain.sum() >= 15
        assert set(numbers(estimates, "std_dof")[certain, 0]) == {float(rest)}
        pooled = np.nanmedian(numbers(solved(table, "file").estimates, "std_factor"))
        assert pooled == pytest.approx(STDS[kind] * np.sqrt(7.0), rel=0.25)
        by_sensor = numbers(solved(table, "sensor").estimates, "std_factor")
        assert np.nanmedian(by_sensor) == pytest.approx(STDS[kind] * np.sqrt(7.0), rel=0.5)
        table["target_z_std_m"] = np.ones(120)
        for pool in ("snapshot", "file", "sensor"):
            with pytest.raises(UsageError, match="needs stated standard deviations of the other"):
                solved(table, pool)


def test_a_source_above_a_sensor_is_as_far_from_the_zenith_as_with_stated_std():
    """Statuses are those of a run with the estimated std as stated one, also above a sensor."""
    sensors = np.array([[0, 0, 0], [300, 0, 20], [0, 300, 5.0]])
    rng = np.random.default_rng(3)
    sources = np.stack([rng.uniform(-40, 40, 60), rng.uniform(-40, 40, 60), np.full(60, 200.0)], axis=1)
    away = (sources[:, None] - sensors).reshape(-1, 3)
    noise = np.radians(1.0) * rng.normal(size=(2, 180))
    table = {"snapshot": np.repeat(np.arange(60), 3), "sensor": np.tile(["a", "b", "c"], 60)}
    table |= {f"sensor_{axis}_m": np.tile(sensors[:, index], 60) for index, axis in enumerate("xyz")}
    table["bearing_rad"] = np.arctan2(away[:, 1], away[:, 0]) + noise[0]
    table["elevation_rad"] = np.minimum(
        np.arctan2(away[:, 2], np.hypot(away[:, 0], away[:, 1])) + noise[1], 0.5 * np.pi
    )
    own = solved(table, "snapshot").estimates
    stated = [
        nlosctl.localize(
            {name: values[3 * number : 3 * number + 3] for name, values in table.items()}
            | {"bearing_std_rad": np.full(3, factor), "elevation_std_rad": np.full(3, factor)},
            method="ml",
        )
        .estimates["status"][0]
        .as_py()
        for number, factor in enumerate(numbers(own, "std_factor")[:, 0])
        if np.isfinite(factor)
    ]
    known = np.isfinite(numbers(own, "std_factor")[:, 0])
    assert 10 < known.sum() < 60
    assert np.array(own["status"].to_pylist())[known].tolist() == stated


def test_files_without_stds_are_read_in_space():
    """Elevations and heights without any std are solved in space; one of two stds alone is an error that names both."""
    table = world("bearings", 4, 5, 0.01, stated=False)
    assert "z_m" in nlosctl.localize(table, estimate_std="file", method="ml").estimates.column_names
    assert "z_m" not in nlosctl.localize(table, estimate_std="file", method="ml", dimensions=2).estimates.column_names
    with pytest.raises(DataError, match=r"missing column 'bearing_std_rad'.*or estimate it by `estimate_std`"):
        nlosctl.localize(table, method="ml")
    with pytest.raises(DataError, match="'elevation_std_rad' needs 'bearing_std_rad'"):
        nlosctl.localize(table | {"elevation_std_rad": np.ones(20)}, estimate_std="file", method="ml")
    with pytest.raises(DataError, match="missing column 'elevation_std_rad'"):
        nlosctl.localize(table | {"bearing_std_rad": np.ones(20)}, estimate_std="file", method="ml")
    across, both = (
        nlosctl.localize(table, estimate_std="file", method="ml", **stds).estimates
        for stds in ({"direction_std_deg": 2.0}, {"bearing_std_deg": 2.0, "elevation_std_deg": 2.0})
    )
    assert np.nanmedian(numbers(both, "std_factor")) == pytest.approx(0.5 * np.degrees(0.01) * np.sqrt(5.5), rel=0.4)
    assert np.nanmedian(numbers(across, "std_factor")) < np.nanmedian(numbers(both, "std_factor"))


def test_differences_to_a_reference_have_the_factors_of_their_arrivals():
    """Snapshot and file factors of differences are those of the arrivals; sensors need the row of the reference."""
    table = world("arrivals", 5, 20, 0.3, relative=(1.0,), stated=False, seed=10)
    arrival = table["arrival_m"].reshape(20, 5)
    with_row = {name: values for name, values in table.items() if name != "arrival_m"}
    with_row |= {"tdoa_m": (arrival - arrival[:, :1]).ravel(), "reference": np.full(100, "s0")}
    kept = np.arange(100) % 5 > 0
    without = {name: values[kept] for name, values in with_row.items()}
    for axis in "xyz":
        without[f"reference_{axis}_m"] = np.repeat(table[f"sensor_{axis}_m"][::5], 4)
    options = {"method": "ml", "dimensions": 3}
    for pool in ("snapshot", "file"):
        factors = [
            numbers(nlosctl.localize(each, estimate_std=pool, **options).estimates, "std_factor")
            for each in (table, with_row, without)
        ]
        for other in factors[1:]:
            assert other == pytest.approx(factors[0], rel=1e-6, nan_ok=True)
    by_sensor = [
        nlosctl.localize(each, estimate_std="sensor", **options).flags["std_factor"] for each in (table, with_row)
    ]
    assert by_sensor[0].to_pylist() == pytest.approx(by_sensor[1].to_pylist(), rel=1e-6)
    with pytest.raises(UsageError, match="needs the row of each reference"):
        nlosctl.localize(without, estimate_std="sensor", **options)


def test_independent_differences_have_no_offset():
    """Of differences of pairs the std is that of the difference, and the offset is no unknown."""
    table = world("arrivals", 10, 200, 0.3, relative=(1.0,), stated=False, seed=12)
    even, odd = np.arange(0, 2000, 2), np.arange(1, 2000, 2)
    arrival = table.pop("arrival_m")
    pairs = {name: np.asarray(values)[odd] for name, values in table.items()}
    pairs |= {"tdoa_m": arrival[odd] - arrival[even], "reference": np.asarray(table["sensor"])[even]}
    pairs |= {f"reference_{axis}_m": table[f"sensor_{axis}_m"][even] for axis in "xyz"}
    options = {"dimensions": 3, "method": "ml"}
    for pool, degrees in (("snapshot", 2.0), ("file", 400.0)):
        estimates = nlosctl.localize(pairs, estimate_std=pool, **options).estimates
        assert np.nanmax(numbers(estimates, "std_dof")) == pytest.approx(degrees, rel=0.03)
        assert 0.9 <= coverage(estimates) <= 0.99
        mean_square = np.nanmean(numbers(estimates, "std_factor") ** 2)
        assert np.sqrt(mean_square) == pytest.approx(0.3 * np.sqrt(2.0), rel=0.15)
    flags = nlosctl.localize(pairs, estimate_std="sensor", **options).flags
    assert np.array(flags["std_factor"].to_pylist()) == pytest.approx(0.3 * np.sqrt(2.0), rel=0.3)
    with pytest.raises(UsageError, match="'srd-ls' needs one reference"):
        nlosctl.localize(pairs, estimate_std="file", dimensions=3, method="srd-ls")


def places(snapshots, std_deg, seed=0):
    """Return azimuths and elevations at four stations on earth, std by station, of aircraft between them."""
    rng = np.random.default_rng(seed)
    stations = {"a": (46.0, 8.0, 500.0), "b": (46.9, 8.2, 1500.0), "c": (45.9, 9.6, 200.0), "d": (46.6, 9.3, 900.0)}
    latitude, longitude, height = (
        rng.uniform(46.1, 46.7, snapshots),
        rng.uniform(8.2, 9.3, snapshots),
        9e3 + np.zeros(snapshots),
    )
    to_earth = pyproj.Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
    target = np.stack(to_earth.transform(longitude, latitude, height), axis=1)
    rows = {
        name: []
        for name in (
            "snapshot",
            "sensor",
            "sensor_lat_deg",
            "sensor_lon_deg",
            "sensor_height_m",
            "azimuth_deg",
            "elevation_deg",
        )
    }
    for number in range(snapshots):
        for (name, (lat, lon, up_m)), std in zip(stations.items(), std_deg, strict=True):
            away = target[number] - np.array(to_earth.transform(lon, lat, up_m))
            z, e = np.radians(lon), np.radians(lat)
            east = away @ [-np.sin(z), np.cos(z), 0.0]
            north = away @ [-np.sin(e) * np.cos(z), -np.sin(e) * np.sin(z), np.cos(e)]
            up = away @ [np.cos(e) * np.cos(z), np.cos(e) * np.sin(z), np.sin(e)]
            azimuth = np.degrees(np.arctan2(east, north)) + std * rng.normal()
            elevation = np.degrees(np.arctan2(up, np.hypot(east, north))) + std * rng.normal()
            for column, value in zip(rows, (number, name, lat, lon, up_m, azimuth, elevation), strict=True):
                rows[column].append(value)
    return rows


def test_places_on_earth_have_factors():
    """On earth the file's factor is the mean square of the snapshots', and stations have their own."""
    table = places(120, (0.05, 0.05, 0.2, 0.1))
    own = nlosctl.localize(table, estimate_std="snapshot", method="ml").estimates
    pooled = nlosctl.localize(table, estimate_std="file", method="ml").estimates
    assert pooled["status"].to_pylist() == ["ok"] * 120
    assert numbers(pooled, "std_factor")[0] == pytest.approx(
        np.sqrt(np.mean(numbers(own, "std_factor") ** 2)), rel=1e-6
    )
    flags = nlosctl.localize(table, estimate_std="sensor", method="ml").flags
    factors = dict(zip(flags["sensor"].to_pylist(), np.degrees(flags["std_factor"].to_pylist()), strict=True))
    assert [factors[name] for name in "abcd"] == pytest.approx([0.05, 0.05, 0.2, 0.1], rel=0.25)
    robust = nlosctl.localize(table, estimate_std="file", method="mixture-ml").estimates
    assert numbers(robust, "std_factor")[0] == pytest.approx(numbers(pooled, "std_factor")[0], rel=0.05)


@pytest.mark.parametrize("pool", ["snapshot", "file", "sensor"])
@pytest.mark.parametrize("kind", ["bearings", "arrivals"])
def test_the_order_of_snapshots_and_the_blocks_do_not_matter(kind, pool):
    """In space estimates are the same to the bit for another order of the snapshots and another block size."""
    table = world(kind, 6, 40, STDS[kind], stated=False, seed=11)
    order = np.random.default_rng(0).permutation(40)
    rows = (order[:, None] * 6 + np.arange(6)).ravel()
    shuffled = {name: np.asarray(values)[rows] for name, values in table.items()}
    one = solved(table, pool).estimates.sort_by("snapshot")
    other = solved(shuffled, pool, block_size=7).estimates.sort_by("snapshot")
    assert one.equals(other)
