"""Estimated standard deviations against scipy, closed forms and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.stats import f as f_distribution

import nlosctl
from nlosctl.errors import DataError, UsageError
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.geometry.ellipses import ellipse_threshold

LENTH = np.array(
    [
        (9, 3.2, 234),
        (9.4, 5.5, 215),
        (9.95, 9.05, 196),
        (8.7, 8.7, 193),
        (8.07, 9.7, 188),
        (4.4, 8.9, 160),
        (1.85, 5.25, 118),
    ]
)
"""Bearings of Lenth (1981) without the outlier: x, y, degrees clockwise from north."""
QUESTION_33352 = np.array([(554045, 2813867, 300), (553355, 2813873, 20), (553207, 2814120, 90)])


def compass(rows):
    """Return a table of one snapshot of compass bearings without standard deviations."""
    x, y, azimuth = np.asarray(rows, dtype=float).T
    names = [f"s{number}" for number in range(len(x))]
    return {
        "snapshot": np.zeros(len(x), dtype=int),
        "sensor": names,
        "sensor_x_m": x,
        "sensor_y_m": y,
        "azimuth_deg": azimuth,
    }


def world(rows, snapshots, std, *, kind="bearings", relative=(1.0, 2.0, 4.0), seed=1, stated=True):
    """Return measurements of random sources by random sensors in a square kilometre, with std in radians or metres."""
    rng = np.random.default_rng(seed)
    sensors, sources = rng.uniform(0, 1000, (snapshots, rows, 2)), rng.uniform(0, 1000, (snapshots, 2))
    weight = np.resize(relative, rows)
    dx, dy = np.moveaxis(sources[:, None] - sensors, -1, 0)
    noise = rng.normal(size=(snapshots, rows)) * weight * std
    values = np.arctan2(dy, dx) + noise if kind == "bearings" else np.maximum(np.hypot(dx, dy) + noise, 1e-3)
    name, unit = ("bearing", "rad") if kind == "bearings" else ("range", "m")
    table = {
        "snapshot": np.repeat(np.arange(snapshots), rows),
        "sensor": np.tile([f"s{number}" for number in range(rows)], snapshots),
        "sensor_x_m": sensors[..., 0].ravel(),
        "sensor_y_m": sensors[..., 1].ravel(),
        f"{name}_{unit}": values.ravel(),
        "truth_x_m": np.repeat(sources[:, 0], rows),
        "truth_y_m": np.repeat(sources[:, 1], rows),
    }
    return table | ({f"{name}_std_{unit}": np.tile(weight, snapshots)} if stated else {})


def numbers(table, *names):
    """Return columns of a table as floats, null as NaN."""
    columns = [np.array([np.nan if value is None else value for value in table[name].to_pylist()]) for name in names]
    return columns[0] if len(names) == 1 else np.stack(columns, axis=1)


def coverage(estimates, probability=0.95):
    """Return the share of F ellipses that contain the truth, of the estimates with a covariance."""
    error = numbers(estimates, "x_m", "y_m") - numbers(estimates, "truth_x_m", "truth_y_m")
    squared = squared_mahalanobis(error, numbers(estimates, "cov_xx_m2", "cov_xy_m2", "cov_yy_m2"))
    known = np.isfinite(squared)
    degrees = numbers(estimates, "std_dof")[known]
    return float(np.mean(squared[known] <= 2.0 * f_distribution.ppf(probability, 2, degrees)))


def fit(table, snapshot, start, weight):
    """Return the weighted least-squares position of a snapshot by scipy, its chi-square and J'J."""
    mine = np.asarray(table["snapshot"]) == snapshot
    x, y = np.asarray(table["sensor_x_m"])[mine], np.asarray(table["sensor_y_m"])[mine]
    bearings = "bearing_rad" in table

    def residuals(point):
        if bearings:
            off = np.asarray(table["bearing_rad"])[mine] - np.arctan2(point[1] - y, point[0] - x)
            return np.angle(np.exp(1j * off)) / weight[mine]
        return (np.asarray(table["range_m"])[mine] - np.hypot(point[0] - x, point[1] - y)) / weight[mine]

    found = least_squares(residuals, start, method="lm", xtol=1e-13, ftol=1e-15, gtol=1e-15)
    return found.x, 2.0 * found.cost, found.jac.T @ found.jac


def test_lenths_seven_bearings_have_the_gaussian_figures_of_the_note():
    """Gaussian fit of Lenth's seven bearings: position (7.2286, 1.9809), std 3.41 deg, SE .1823 and .1815."""
    row = nlosctl.localize(compass(LENTH), estimate_std="snapshot").estimates.to_pylist()[0]
    assert (row["x_m"], row["y_m"]) == pytest.approx((7.2286, 1.9809), abs=5e-5)
    assert np.degrees(row["std_factor"]) == pytest.approx(3.41, abs=0.005)
    assert row["std_dof"] == 5
    assert np.sqrt([row["cov_xx_m2"], row["cov_yy_m2"]]) == pytest.approx([0.1823, 0.1815], abs=5e-5)
    assert row["fit_p_value"] is None


def test_lenths_eight_bearings_and_question_33352_have_the_gaussian_figures_of_the_note():
    """With the outlier, std 31.0 deg; of three bearings one degree of freedom, whose 95 % ellipse has 20.0 SE."""
    eight = nlosctl.localize(compass([*LENTH, (5.6, 9, 250)]), estimate_std="snapshot").estimates.to_pylist()[0]
    assert (eight["x_m"], eight["y_m"]) == pytest.approx((5.5247, 1.0029), abs=5e-5)
    assert np.degrees(eight["std_factor"]) == pytest.approx(31.0, abs=0.05)
    assert np.sqrt([eight["cov_xx_m2"], eight["cov_yy_m2"]]) == pytest.approx([1.739, 2.167], rel=1e-3)
    three = nlosctl.localize(compass(QUESTION_33352), estimate_std="snapshot", ellipse=0.95).estimates.to_pylist()[0]
    assert (three["x_m"], three["y_m"]) == pytest.approx((553455.15, 2814130.74), abs=0.01)
    assert np.degrees(three["std_factor"]) == pytest.approx(6.53, abs=0.005)
    assert np.sqrt([three["cov_xx_m2"], three["cov_yy_m2"]]) == pytest.approx([34.5, 26.6], abs=0.05)
    largest = np.linalg.eigvalsh([[three["cov_xx_m2"], three["cov_xy_m2"]], [three["cov_xy_m2"], three["cov_yy_m2"]]])
    assert three["semi_major_m"] / np.sqrt(largest[1]) == pytest.approx(20.0, abs=0.05)


@pytest.mark.parametrize(("kind", "std"), [("bearings", 0.02), ("ranges", 5.0)])
@pytest.mark.parametrize("stated", [True, False], ids=["weights", "none"])
def test_snapshot_and_file_factors_are_those_of_scipys_fits(kind, std, stated):
    """std_factor^2 is Q / (n - 2) of each fit, or the sums over the file; the covariance f^2 (J'J)^-1."""
    table = world(5, 30, std, kind=kind, stated=stated, seed=3)
    weight = np.tile(np.resize([1.0, 2.0, 4.0], 5), 30) if stated else np.ones(150)
    own = nlosctl.localize(table, estimate_std="snapshot").estimates
    pooled = nlosctl.localize(table, estimate_std="file").estimates
    truth = numbers(own, "truth_x_m", "truth_y_m")
    fits = [fit(table, number, truth[number], weight) for number in range(30)]
    usual = np.array(own["status"].to_pylist()) == "ok"
    assert usual.sum() >= 25
    assert np.array(pooled["status"].to_pylist())[usual].tolist() == ["ok"] * usual.sum()
    squares = np.array([square for _, square, _ in fits])
    assert numbers(own, "std_factor")[usual] == pytest.approx(np.sqrt(squares / 3.0)[usual], rel=1e-5)
    assert set(numbers(own, "std_dof")[usual]) == {3.0}
    sound = np.isin(pooled["status"].to_pylist(), ["ok", "ambiguous"])
    factor = np.sqrt(squares[sound].sum() / (3.0 * sound.sum()))
    assert numbers(pooled, "std_factor")[sound] == pytest.approx(factor, rel=1e-5)
    assert set(numbers(pooled, "std_dof")[sound]) == {3.0 * sound.sum()}
    for number in np.flatnonzero(usual)[:10]:
        covariance = factor**2 * np.linalg.inv(fits[number][2])
        found = numbers(pooled, "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")[number]
        assert found == pytest.approx(covariance[[0, 0, 1], [0, 1, 1]], abs=1e-3 * np.trace(covariance))


def test_stated_std_is_the_unit_of_the_factor():
    """A constant std scales std_factor and leaves positions and covariances as they are."""
    table = world(5, 20, 0.02, relative=(1.0,), stated=False)
    plain, in_degrees = (
        nlosctl.localize(table, estimate_std="file", **stds).estimates for stds in ({}, {"bearing_std_deg": 2.0})
    )
    assert numbers(plain, "std_factor") == pytest.approx(numbers(in_degrees, "std_factor") * np.radians(2.0), rel=1e-9)
    names = ("x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")
    assert numbers(plain, *names) == pytest.approx(numbers(in_degrees, *names), rel=1e-6)


def test_two_rows_alone_have_no_covariance_and_in_a_file_they_have_one():
    """Without spare rows a fix keeps its position: std_not_estimable; a pooled factor gives it a covariance."""
    two = world(2, 3, 0.01, seed=5)
    for pool in ("snapshot", "file", "sensor"):
        done = nlosctl.localize(two, estimate_std=pool)
        words = done.estimates["status"].to_pylist()
        assert words == ["std_not_estimable"] * 3
        assert np.isfinite(numbers(done.estimates, "x_m")).all()
        assert np.isnan(numbers(done.estimates, "cov_xx_m2", "std_factor", "std_dof", "fit_p_value")).all()
        assert sum("std_not_estimable" in line for line in done.report.notes) == 1
    more = world(5, 30, 0.01, seed=6)
    joined = {name: np.concatenate([two[name], more[name]]) for name in two}
    joined["snapshot"] = np.concatenate([two["snapshot"], more["snapshot"] + 3])
    for pool in ("file", "sensor"):
        estimates = nlosctl.localize(joined, estimate_std=pool).estimates
        assert np.isfinite(numbers(estimates, "cov_xx_m2")[:3]).all()


def test_exact_data_have_a_tiny_factor_or_none():
    """Residuals of rounding give a factor near 1e-10 or no covariance, never an error or NaN in a fix."""
    table = world(4, 20, 0.0, seed=2)
    for method in ("ls", "stansfield", "ml"):
        for pool in ("snapshot", "file", "sensor"):
            estimates = nlosctl.localize(table, method=method, estimate_std=pool).estimates
            assert np.isfinite(numbers(estimates, "x_m")).all()
            factor = numbers(estimates, "std_factor")
            assert (factor[np.isfinite(factor)] < 1e-8).all()


def test_sensor_factors_are_those_of_a_plain_iteration():
    """Factors of sensors are the fixed point of (Q_j + 5 F^2) / (D_j + 5) with scipy's fits; flags have the row's."""
    table = world(5, 25, 0.02, relative=(1.0, 1.0, 2.0, 4.0, 0.5), stated=False, seed=4)
    done = nlosctl.localize(table, estimate_std="sensor")
    truth = numbers(done.estimates, "truth_x_m", "truth_y_m")
    used = np.flatnonzero(np.array(done.estimates["status"].to_pylist()) == "ok")
    assert used.size == 25
    rows = np.arange(125).reshape(25, 5)
    first = sum(fit(table, number, truth[number], np.ones(125))[1] for number in used) / (3 * used.size)
    factor = np.full(5, np.sqrt(first))
    for _ in range(15):
        squares, degrees = np.zeros(5), np.zeros(5)
        weight = np.tile(factor, 25)
        for number in used:
            point, _, information = fit(table, number, truth[number], weight)
            x, y = (np.asarray(table[name])[rows[number]] for name in ("sensor_x_m", "sensor_y_m"))
            dx, dy = point[0] - x, point[1] - y
            off = np.angle(np.exp(1j * (np.asarray(table["bearing_rad"])[rows[number]] - np.arctan2(dy, dx))))
            slopes = np.stack([-dy, dx]) / (dx * dx + dy * dy) / factor
            squares += off**2
            degrees += 1.0 - np.einsum("ik,ij,jk->k", slopes, np.linalg.inv(information), slopes)
        factor = np.sqrt((squares + 5.0 * first) / (degrees + 5.0))
    by_row = dict(zip(done.flags["sensor"].to_pylist(), done.flags["std_factor"].to_pylist(), strict=True))
    assert [by_row[f"s{number}"] for number in range(5)] == pytest.approx(factor, rel=1e-3)
    assert set(np.round(numbers(done.estimates, "std_dof"), 2)) == {round(float(degrees.min()) + 5.0, 2)}
    size = numbers(done.estimates, "cov_xx_m2", "cov_xy_m2", "cov_yy_m2")[0]
    x, y = (numbers(done.estimates, name)[0] for name in ("x_m", "y_m"))
    dx, dy = x - np.asarray(table["sensor_x_m"])[:5], y - np.asarray(table["sensor_y_m"])[:5]
    slopes = np.stack([-dy, dx]) / (dx * dx + dy * dy)
    stated = 1.0 / np.linalg.det(slopes @ slopes.T)
    expected = ((size[0] * size[2] - size[1] ** 2) / stated) ** 0.25
    assert numbers(done.estimates, "std_factor")[0] == pytest.approx(expected, rel=1e-9)


def test_a_sensor_without_spare_rows_takes_the_files_factor_and_is_named():
    """A sensor that is only in snapshots of two rows has the file's factor; the summary names it."""
    more, two = world(5, 30, 0.02, seed=7, stated=False), world(2, 4, 0.02, seed=8, stated=False)
    two["sensor"] = np.tile(["lone", "s0"], 4)
    joined = {name: np.concatenate([more[name], two[name]]) for name in two}
    joined["snapshot"] = np.concatenate([more["snapshot"], two["snapshot"] + 30])
    done = nlosctl.localize(joined, estimate_std="sensor")
    flags = dict(zip(done.flags["sensor"].to_pylist(), done.flags["std_factor"].to_pylist(), strict=True))
    file = nlosctl.localize(joined, estimate_std="file").estimates["std_factor"].to_pylist()[0]
    assert flags["lone"] == pytest.approx(file, rel=1e-9)
    assert any(line.endswith("without spare rows: lone") for line in done.report.notes)


@pytest.mark.parametrize("pool", ["snapshot", "file", "sensor"])
def test_the_order_of_snapshots_and_the_blocks_do_not_matter(pool):
    """Estimates are the same to the bit for another order of the snapshots and another block size."""
    table = world(4, 50, 0.03, seed=9, stated=False)
    order = np.random.default_rng(0).permutation(50)
    rows = (order[:, None] * 4 + np.arange(4)).ravel()
    shuffled = {name: np.asarray(values)[rows] for name, values in table.items()}
    one = nlosctl.localize(table, estimate_std=pool).estimates.sort_by("snapshot")
    other = nlosctl.localize(shuffled, estimate_std=pool, block_size=7).estimates.sort_by("snapshot")
    assert one.equals(other)


def test_ellipse_thresholds_are_quantiles_of_f():
    """Squared radii are 2 F^-1(P; 2, dof): 399 for one degree of freedom, 38 for 2; chi-square where unknown."""
    degrees = np.array([1.0, 2.0, 3.0, 4.0, 20.0, 1e9, np.nan])
    for probability in (0.5, 0.9, 0.95, 0.99):
        expected = 2.0 * f_distribution.ppf(probability, 2, degrees[:-1])
        found = ellipse_threshold(probability, degrees)
        assert found[:-1] == pytest.approx(expected, rel=1e-6)
        assert found[-1] == ellipse_threshold(probability)


def test_evaluate_judges_coverage_by_f_and_leaves_out_nees():
    """Coverage of evaluate is that of the F ellipses; NEES is undefined."""
    estimates = nlosctl.localize(world(3, 400, 0.02, seed=11), estimate_std="snapshot").estimates
    score = nlosctl.evaluate(estimates).groups[0]
    assert score["coverage_95"] == pytest.approx(coverage(estimates), abs=1e-12)
    assert score["nees_rows"] > 350
    assert np.isnan([score["nees"], score["nees_low"], score["nees_high"]]).all()


@pytest.mark.parametrize("rows", [3, 4, 8])
@pytest.mark.parametrize("pool", ["snapshot", "file"])
def test_ellipses_of_unknown_std_contain_95_percent(rows, pool):
    """Bearings of 2 deg with relative weights: .93 to .97 of the 95 % ellipses contain the truth."""
    table = world(rows, 3000, np.radians(2.0), relative=(0.5, 1.0, 2.0), seed=rows)
    assert 0.93 <= coverage(nlosctl.localize(table, estimate_std=pool).estimates) <= 0.97


@pytest.mark.slow
@pytest.mark.parametrize("rows", [3, 4, 5, 6, 7, 8])
@pytest.mark.parametrize("pool", ["snapshot", "file"])
@pytest.mark.parametrize("method", ["stansfield", "ml"])
def test_ellipses_of_unknown_std_contain_95_percent_in_long_runs(rows, pool, method):
    """The same with 20,000 snapshots a cell."""
    table = world(rows, 20_000, np.radians(2.0), relative=(0.5, 1.0, 2.0), seed=rows)
    assert 0.93 <= coverage(nlosctl.localize(table, method=method, estimate_std=pool).estimates) <= 0.97


def test_ellipses_by_sensor_contain_95_percent_in_short_sessions():
    """Sessions of five snapshots of five unequal sensors: .92 to .995 of the ellipses contain the truth."""
    shares = [
        coverage(
            nlosctl.localize(
                world(5, 5, np.radians(2.0), relative=(1.0, 1.0, 2.0, 4.0, 0.5), stated=False, seed=seed),
                estimate_std="sensor",
            ).estimates
        )
        for seed in range(40)
    ]
    assert 0.92 <= np.mean(shares) <= 0.995


def test_missing_stds_name_the_setting_and_others_are_refused():
    """Without std the message names estimate_std; methods and kinds that can't estimate it list those that can."""
    table = world(4, 3, 0.02, stated=False)
    with pytest.raises(DataError, match=r"missing column 'bearing_std_rad'.*or estimate it by `estimate_std`"):
        nlosctl.localize(table)
    with pytest.raises(UsageError, match=r"not for suppress on bearings; it is for .*bearings: .*ml.*; ranges: .*r-ls"):
        nlosctl.localize(table, method="suppress", estimate_std="file")
    with pytest.raises(UsageError, match="must be one of snapshot, sensor, file"):
        nlosctl.localize(table, estimate_std="row")
    with pytest.raises(DataError, match="bearing_std_rad"):
        nlosctl.localize(table | {"bearing_std_rad": np.zeros(12)}, estimate_std="file")


def test_von_mises_fits_of_lenths_bearings_have_his_figures():
    """Positions to Lenth's digits; std of C' 3.41, 28.2 and 6.51 deg; SE of the expected form within .1 %."""
    figures = [
        (LENTH, (7.2285, 1.9808), 3.41, (0.1823, 0.1816), 5),
        ([*LENTH, (5.6, 9, 250)], (5.8706, 1.1337), 28.2, (1.660, 2.026), 6),
        (QUESTION_33352, (553455.14, 2814130.72), 6.51, (34.5, 26.6), 1),
    ]
    for rows, place, std_deg, errors, degrees in figures:
        row = nlosctl.localize(compass(rows), estimate_std="snapshot", law="vonmises").estimates.to_pylist()[0]
        assert (row["x_m"], row["y_m"]) == pytest.approx(place, abs=5e-5 if place[0] < 10 else 0.01)
        assert np.degrees(row["std_factor"]) == pytest.approx(std_deg, rel=2e-3)
        assert np.sqrt([row["cov_xx_m2"], row["cov_yy_m2"]]) == pytest.approx(errors, rel=2e-3)
        assert row["std_dof"] == degrees


def test_von_mises_estimates_the_concentration_of_stated_weights_too():
    """With stated std the factor is theirs, and std_factor and std_dof are there without estimate_std."""
    table = compass(LENTH)
    plain = nlosctl.localize(table, estimate_std="snapshot", law="vonmises").estimates.to_pylist()[0]
    stated = nlosctl.localize(table, bearing_std_deg=2.0, law="vonmises").estimates.to_pylist()[0]
    assert stated["std_factor"] * np.radians(2.0) == pytest.approx(plain["std_factor"], rel=1e-9)
    assert stated["cov_xx_m2"] == pytest.approx(plain["cov_xx_m2"], rel=1e-9)
    with pytest.raises(UsageError, match="set `estimate_std` to snapshot"):
        nlosctl.localize(table, estimate_std="file", law="vonmises")


@pytest.mark.parametrize("share", [0.0, 0.2])
def test_a_mixture_finds_the_std_of_its_direct_rows(share):
    """With outliers uniform over the circle the factor is within 8 % of the true one; ellipses hold .85 to .97."""
    rng = np.random.default_rng(1)
    table = world(8, 300, np.radians(4.0), relative=(1.0,), stated=False, seed=9)
    outlier = rng.uniform(size=2400) < share
    table["bearing_rad"] = np.where(outlier, rng.uniform(-np.pi, np.pi, 2400), table["bearing_rad"])
    done = nlosctl.localize(table, method="mixture-ml", estimate_std="file")
    factor = np.nanmedian(numbers(done.estimates, "std_factor"))
    assert factor == pytest.approx(np.radians(4.0), rel=0.08)
    assert 0.85 <= coverage(done.estimates) <= 0.97
    again = nlosctl.localize(table, method="mixture-ml", estimate_std="file", block_size=31).estimates
    assert again.equals(done.estimates)


@pytest.mark.parametrize("pool", ["snapshot", "file", "sensor"])
def test_a_mixture_finds_the_std_where_ml_has_no_fix(pool):
    """One drive with 30 % outliers, on which ``ml`` is ``behind``: the factor is within three of its stds."""
    rng = np.random.default_rng(2)
    turn = np.arange(60) * np.pi / 30
    x, y = 900.0 * np.cos(turn), 900.0 * np.sin(turn)
    bearing = np.arctan2(-700.0 - y, -x) + np.radians(6.0) * rng.normal(size=60)
    bearing = np.where(rng.uniform(size=60) < 0.3, rng.uniform(-np.pi, np.pi, 60), bearing)
    table = {"snapshot": np.zeros(60, dtype=np.int64), "sensor": ["van"] * 60, "sensor_x_m": x, "sensor_y_m": y}
    table |= {"bearing_rad": np.angle(np.exp(1j * bearing)), "path": np.arange(60)}
    assert nlosctl.localize(table, estimate_std=pool).estimates.column("status").to_pylist() == ["behind"]
    row = nlosctl.localize(table, method="mixture-ml", estimate_std=pool).estimates.to_pylist()[0]
    assert row["status"] == "ok"
    assert row["std_factor"] == pytest.approx(np.radians(6.0), rel=3.0 / np.sqrt(2.0 * row["std_dof"]))
    assert np.hypot(row["x_m"], row["y_m"] + 700.0) < 50.0


def test_a_mixture_finds_the_std_of_ranges():
    """With outliers among ranges the factor of the file is within 8 % of the true one."""
    rng = np.random.default_rng(2)
    table = world(8, 300, 5.0, kind="ranges", relative=(1.0,), stated=False, seed=10)
    outlier = rng.uniform(size=2400) < 0.15
    table["range_m"] = np.where(outlier, rng.uniform(1.0, 1400.0, 2400), table["range_m"])
    estimates = nlosctl.localize(table, method="mixture-ml", estimate_std="file").estimates
    assert np.nanmedian(numbers(estimates, "std_factor")) == pytest.approx(5.0, rel=0.08)


def test_unknown_stds_do_not_become_a_column(tmp_path):
    """Flags of a file without std have none either; files with and without them can't be mixed."""
    table = world(4, 5, 0.02, stated=False)
    done = nlosctl.localize(table, estimate_std="file")
    assert "bearing_std_rad" not in done.flags.column_names
    assert any("ml: std of the file" in line for line in done.report.notes)
    for name, part in {"a": table, "b": world(4, 5, 0.02, seed=2)}.items():
        (tmp_path / f"{name}.csv").write_text(
            "\n".join([",".join(part), *(",".join(map(str, row)) for row in zip(*part.values(), strict=True))])
        )
    with pytest.raises(DataError, match=r"b\.csv: some of the files have standard deviations and some don't"):
        nlosctl.localize([str(tmp_path / "a.csv"), str(tmp_path / "b.csv")], estimate_std="file")
