"""Methods of detect-ip: flags, reasons, calibration, rows without a decision."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from scenario_draws import draw_columns
from scipy import stats
from triplet_worlds import batch_of, one_path

from nlosctl.contract.batches import TripletBatch
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.evaluation.detection import kolmogorov_smirnov
from nlosctl.methods import triplets_chi2, triplets_joint, triplets_ml, triplets_tdaj
from nlosctl.models.triplets import path_rows
from nlosctl.solvers.triplets.difference_rules import rays_miss_by


def direct_path(**changes):
    """Return a noise-free direct path over (1, 5)."""
    x, y = 1.0, 5.0
    values = {
        "dod": np.arctan2(y, x + 2.5),
        "doa": np.arctan2(y, x - 2.5),
        "length": np.hypot(x + 2.5, y) + np.hypot(x - 2.5, y),
    }
    return one_path(**{**values, **changes})


def snapshots_of(columns, snapshots, paths):
    """Return the batch of some snapshots of as many paths each."""
    fields = {}
    for name, parts in TripletBatch.SOURCES.items():
        values = [np.asfortranarray(columns[part].reshape(snapshots, paths)) for part in parts]
        fields[name] = values[0] if len(values) == 1 else np.asfortranarray(np.stack(values, axis=-1))
    return TripletBatch(seed=np.zeros(snapshots, dtype=np.uint64), **fields)


def first_flags(module, batch, **options):
    """Return the flag columns of the first row."""
    flags = module.solve(batch, module.METHOD.options(**options)).flags
    return {name: np.asarray(column)[0, 0] for name, column in flags.columns.items()}


@pytest.mark.parametrize("module", [triplets_tdaj, triplets_chi2, triplets_joint])
def test_a_direct_path_is_direct(module):
    """A noise-free direct path has no reason and p-value 1 (nearly 1 for the joint method)."""
    found = first_flags(module, direct_path())
    assert not found["ip"]
    assert found["reason"] == ""
    assert found["p_value"] == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("module", [triplets_tdaj, triplets_chi2, triplets_joint])
def test_a_longer_path_is_indirect(module):
    """The same angles with a path two metres longer are inconsistent."""
    found = first_flags(module, direct_path(length=13.0))
    assert found["ip"]
    assert found["reason"] == "inconsistent"
    assert found["p_value"] < 1e-6


def test_a_path_shorter_than_the_baseline():
    """A path shorter than its baseline has no ellipse: tdaj gives the reason, chi2 decides."""
    batch = direct_path(length=4.0)
    found = first_flags(triplets_tdaj, batch)
    assert (found["ip"], found["reason"]) == (False, "no_ellipse")
    assert np.isnan(found["p_value"])
    found = first_flags(triplets_chi2, batch)
    assert (found["ip"], found["reason"]) == (True, "inconsistent,no_ellipse")


def test_slightly_shorter_than_the_baseline_may_be_direct():
    """A target on the baseline with a path slightly shorter than it: chi2 accepts it."""
    batch = one_path(dod=0.0, doa=np.pi, length=4.96, std=(0.01, 0.01, 0.05))
    found = first_flags(triplets_chi2, batch)
    assert (found["ip"], found["reason"]) == (False, "no_ellipse")
    assert found["p_value"] == pytest.approx(2.0 * stats.norm.sf(0.8), abs=1e-3)


def test_parallel_rays():
    """Exactly parallel rays have no crossing: lambda 1 gives the reason, lambda 5 does not need it."""
    batch = one_path(dod=1.0, doa=1.0, length=9.0)
    found = first_flags(triplets_tdaj, batch, rule="lambda1")
    assert (found["ip"], found["reason"], found["blind"]) == (False, "parallel", True)
    assert not np.isnan(first_flags(triplets_tdaj, batch, rule="lambda5")["p_value"])


def test_monostatic():
    """Coincident transmitter and receiver: chi2 compares the angles at any length; tdaj has no frame."""
    batch = one_path(rx=(-2.5, 0.0), dod=1.0, doa=1.03, length=9.0, std=(0.01, 0.01, 0.05))
    assert first_flags(triplets_tdaj, batch)["reason"] == "monostatic"
    found = first_flags(triplets_chi2, batch)
    assert found["p_value"] == pytest.approx(2.0 * stats.norm.sf(0.03 / np.hypot(0.01, 0.01)), rel=1e-6)
    assert found["reason"] == "inconsistent,monostatic"


def test_diverging_rays():
    """Diverging rays: the simulator's rule flags them alone; chi2 reports and flags them with either option."""
    assert not first_flags(triplets_tdaj, direct_path(), behind_is_ip=True)["ip"]
    batch = one_path(dod=1.66, doa=1.57, length=30.0, std=(0.2, 0.2, 0.05))
    assert first_flags(triplets_tdaj, batch)["reason"] == ""
    found = first_flags(triplets_tdaj, batch, behind_is_ip=True)
    assert (found["ip"], found["reason"], found["p_value"]) == (True, "behind", 0.0)
    batch = one_path(dod=1.64, doa=1.57, length=30.0, std=(0.015, 0.015, 0.05))
    plain, asked = first_flags(triplets_chi2, batch), first_flags(triplets_chi2, batch, rays_miss=True)
    assert asked["ip"]
    assert "rays_miss" in plain["reason"]
    assert asked["p_value"] <= plain["p_value"]


@pytest.mark.parametrize("length", [30.0, 9.0])
@pytest.mark.parametrize("false_alarm", [1e-9, 1e-3, 0.2])
def test_chi2_with_rays_flags_if_either_test_flags(length, false_alarm):
    """The p-value is the smaller of both tests, and the reasons agree."""
    batch = one_path(dod=1.64, doa=1.57, length=length, std=(0.02, 0.015, 5.0))
    plain, asked = (
        first_flags(triplets_chi2, batch, rays_miss=asks, false_alarm=false_alarm) for asks in (False, True)
    )
    miss = 2.0 * stats.norm.sf(0.07 / np.hypot(0.02, 0.015))
    assert asked["p_value"] == pytest.approx(min(plain["p_value"], miss), rel=1e-9)
    assert plain["ip"] == (plain["p_value"] < false_alarm)
    assert asked["ip"] == (asked["p_value"] < false_alarm)
    words = [("inconsistent", plain["p_value"]), ("rays_miss", miss)]
    expected = ",".join(word for word, p_value in words if p_value < false_alarm)
    assert plain["reason"] == asked["reason"] == expected


def test_chi_square_includes_the_ray_test():
    """The rays meet at the fit, so no p-value of chi2 exceeds that of the rays, with either option."""
    batch = snapshots_of(draw_columns("shen", 2000, seed=9), 2000, 1)
    plain, asked = (
        triplets_chi2.solve(batch, triplets_chi2.ConsistencyOptions(rays_miss=asks)).flags.columns
        for asks in (False, True)
    )
    miss = 2.0 * stats.norm.sf(rays_miss_by(path_rows(batch)))
    assert (miss < 0.05).sum() > 20
    assert (plain["p_value"].ravel() <= miss * (1.0 + 1e-6)).all()
    np.testing.assert_allclose(asked["p_value"], plain["p_value"], rtol=1e-6)


def test_joint_p_values_are_those_of_chi2_times_the_probability_to_be_direct():
    """Each path in a group has a probability of being direct; one alone on its baseline has none."""
    columns = draw_columns("room", 40, seed=7, blocked_fraction=0.0)
    batch = snapshots_of(columns, 40, 12)
    ours, theirs = (
        module.solve(batch, module.METHOD.options()).flags.columns for module in (triplets_joint, triplets_chi2)
    )
    probability = ours["direct_probability"]
    assert ((probability >= 0.0) & (probability <= 1.0)).all()
    np.testing.assert_allclose(ours["p_value"], theirs["p_value"] * probability, rtol=1e-9, atol=1e-300)
    reason = np.where(ours["p_value"] < 0.05, "off_target", "")
    np.testing.assert_array_equal(
        np.asarray(ours["reason"]), np.where(theirs["p_value"] < 0.05, "inconsistent", reason)
    )
    assert (reason[theirs["p_value"] >= 0.05] == "off_target").any()
    indirect = columns["truth_ip"].reshape(40, 12)
    assert np.median(probability[~indirect]) > 0.9
    assert np.median(probability[indirect]) < 0.1
    alone = one_path(dod=0.0, doa=np.pi, length=5.0)
    found = first_flags(triplets_joint, alone)
    assert np.isnan(found["direct_probability"])
    assert found["p_value"] == first_flags(triplets_chi2, alone)["p_value"]
    assert 0.5 < first_flags(triplets_joint, direct_path())["direct_probability"] <= 1.0


@pytest.mark.parametrize("false_alarm", [0.01, 0.2])
def test_details_are_the_same_for_every_method(false_alarm):
    """chi2 and joint have the details of tdaj at equal false-alarm probability; none unless requested."""
    batch = batch_of(draw_columns("shen", 20, seed=3))
    detailed = dataclasses.replace(batch, want_details=True)
    expected = triplets_tdaj.solve(detailed, triplets_tdaj.TdajOptions(false_alarm=false_alarm)).flags.columns
    for module in (triplets_chi2, triplets_joint):
        options = module.METHOD.options(false_alarm=false_alarm)
        columns, without = (module.solve(part, options).flags.columns for part in (detailed, batch))
        names = [name for name in columns if name not in without]
        assert names == [name for name in expected if name in names]
        assert "threshold5_m" in names
        for name in names:
            np.testing.assert_array_equal(columns[name], expected[name])


def test_chi2_supports_only_gaussian_errors():
    """Another error law is a usage error that names the method which supports it."""
    with pytest.raises(UsageError, match="tdaj"):
        triplets_chi2.METHOD.options(noise="laplace")
    with pytest.raises(UsageError, match="student-t:NU"):
        triplets_tdaj.METHOD.options(noise="cauchy")


@pytest.mark.extensive
@pytest.mark.parametrize(
    ("rule", "noise"),
    [
        *((rule, "gaussian") for rule in ("lambda1", "lambda4", "lambda5", "lambda6", "ellipse")),
        *(("lambda5", noise) for noise in ("uniform", "laplace", "student-t:4")),
    ],
)
@pytest.mark.parametrize("eta_m", [0.0, 0.7])
def test_flags_agree_with_thresholds(rule, noise, eta_m):
    """A path is flagged exactly if its difference exceeds the threshold in the details."""
    batch = dataclasses.replace(batch_of(draw_columns("shen", 30, seed=1)), want_details=True)
    options = triplets_tdaj.TdajOptions(rule=rule, noise=noise, false_alarm=0.02, eta_m=eta_m)
    columns = triplets_tdaj.solve(batch, options).flags.columns
    assert 0.0 < columns["ip"].mean() < 1.0
    np.testing.assert_array_equal(columns["ip"], columns["p_value"] < 0.02)
    if rule == "ellipse":
        return
    number = rule[-1]
    beyond = np.abs(columns[f"lambda{number}_m"]) > columns[f"threshold{number}_m"]
    np.testing.assert_array_equal(columns["ip"], beyond)


@pytest.mark.parametrize("k", [0, 2, 5])
def test_fusion_counts_the_rules(k):
    """Fusion flags if more than k of the six differences exceed their thresholds, equation (4)."""
    batch = dataclasses.replace(batch_of(draw_columns("shen", 400, seed=2)), want_details=True)
    columns = triplets_tdaj.solve(batch, triplets_tdaj.TdajOptions(rule="fusion", k=k)).flags.columns
    beyond = sum((np.abs(columns[f"lambda{n}_m"]) > columns[f"threshold{n}_m"]).astype(int) for n in range(1, 7))
    np.testing.assert_array_equal(columns["ip"], beyond > k)


@pytest.mark.parametrize("k", [0, 1, 2, 4, 5])
def test_fusion_needs_enough_rules(k):
    """Fusion needs more than k defined differences, and rays that are not nearly parallel."""
    paths = [(1.0, 1.0, 9.0), (0.96, 1.86, 12.5), (0.0, np.pi, 8.0), (1.2, 1.2 + 1e-9, 9.0), (0.3, 2.9, 6.0)]
    paths.append((np.arctan2(5.0, 2.5), np.arctan2(5.0, -2.5), 2.0 * np.hypot(5.0, 2.5)))  # midway: mirrored points
    columns = [one_path(dod=dod, doa=doa, length=length) for dod, doa, length in paths]
    seen = []
    for batch in columns:
        blind = [bool(first_flags(triplets_tdaj, batch, rule=f"lambda{n}")["blind"]) for n in range(1, 7)]
        parallel = bool(first_flags(triplets_tdaj, batch, rule="ellipse")["blind"])
        assert first_flags(triplets_tdaj, batch, rule="fusion", k=k)["blind"] == (blind.count(False) <= k or parallel)
        seen.append(blind.count(False))
    assert len(set(seen)) > 1
    fields = {name: np.concatenate([getattr(one, name) for one in columns]) for name in ("seed", *TripletBatch.SOURCES)}
    together = dataclasses.replace(columns[0], **fields)
    flags = triplets_tdaj.solve(together, triplets_tdaj.TdajOptions(rule="fusion", k=k)).flags.columns["blind"]
    assert flags.ravel().tolist() == [
        bool(first_flags(triplets_tdaj, one, rule="fusion", k=k)["blind"]) for one in columns
    ]


@pytest.mark.parametrize("module", [triplets_tdaj, triplets_chi2, triplets_joint])
@pytest.mark.parametrize("scale", [1e-3, 0.1, 1e3])
def test_decisions_do_not_depend_on_the_scale(module, scale):
    """Scaling scene and errors by a thousand leaves p-values and reasons unchanged."""
    for length in (4.0, 11.0, 11.6):
        large, small = (
            first_flags(
                module,
                one_path(
                    (-2.5 * s, 0.0), (2.5 * s, 0.0), dod=0.96, doa=1.86, length=length * s, std=(0.01, 0.01, 0.05 * s)
                ),
            )
            for s in (1.0, scale)
        )
        np.testing.assert_allclose(small["p_value"], large["p_value"], rtol=1e-6)
        assert small["reason"] == large["reason"]


@pytest.mark.parametrize("eta_m", [0.0, 0.3, 2.0])
def test_the_columns_of_tdaj_are_those_it_declares(eta_m):
    """``outside_safe_region`` is declared and present with a safe region, and absent without."""
    options = triplets_tdaj.TdajOptions(eta_m=eta_m)
    columns = triplets_tdaj.solve(direct_path(), options).flags.columns
    spec = triplets_tdaj.METHOD
    assert set(columns) == {*spec.flags, *spec.flags_with(options)}
    assert ("outside_safe_region" in columns) == (eta_m > 0.0)


def test_details_are_points_in_global_coordinates():
    """The three points of a direct path are the target in the coordinates of the file, rotated or not."""
    turn = 0.8
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    tx, rx, target = (rotation @ np.array(p) + [100.0, -50.0] for p in ((-2.5, 0.0), (2.5, 0.0), (1.0, 5.0)))
    batch = one_path(
        tuple(tx),
        tuple(rx),
        dod=np.arctan2(*(target - tx)[::-1]),
        doa=np.arctan2(*(target - rx)[::-1]),
        length=np.hypot(*(target - tx)) + np.hypot(*(target - rx)),
    )
    found = first_flags(triplets_tdaj, dataclasses.replace(batch, want_details=True))
    for name in ("dod_doa", "dod_toa", "doa_toa"):
        assert [found[f"{name}_x_m"], found[f"{name}_y_m"]] == pytest.approx(list(target), abs=1e-9)
    assert found["lambda5_m"] == pytest.approx(0.0, abs=1e-9)


def test_safe_region():
    """On the edge of the safe region a path is flagged with the nominal probability; inside less often."""
    batch = one_path(dod=0.96, doa=1.86, length=12.5)
    rows_std = first_flags(triplets_tdaj, dataclasses.replace(batch, want_details=True))
    value = abs(rows_std["lambda5_m"])
    found = first_flags(triplets_tdaj, batch, eta_m=value)
    # |lambda| at its own mean: it is exceeded half the time, except for the far tail.
    assert found["p_value"] == pytest.approx(0.5, abs=1e-3)
    assert found["outside_safe_region"] == found["ip"]
    assert not first_flags(triplets_tdaj, batch, eta_m=2.0 * value)["ip"]
    assert "outside_safe_region" not in first_flags(triplets_tdaj, batch)


@pytest.mark.parametrize("number", [2, 3])
@pytest.mark.parametrize("module", [triplets_chi2, triplets_tdaj])
def test_false_alarms_are_nominal(number, module):
    """P_f is the nominal 5 % over direct paths of the paper's scenarios, and p-values are uniform."""
    batch = batch_of(draw_columns("shen", 20_000, seed=number, number=number, indirect_fraction=0.0))
    p_value = module.solve(batch, module.METHOD.options()).flags.columns["p_value"].ravel()
    assert np.mean(p_value < 0.05) == pytest.approx(0.05, abs=0.0047)
    assert kolmogorov_smirnov(p_value)[1] > 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("number", [2, 3])
@pytest.mark.parametrize("module", [triplets_chi2, triplets_tdaj])
def test_false_alarms_are_nominal_in_many_draws(number, module):
    """P_f is 5 +- 0.2 % over 100,000 direct paths."""
    batch = batch_of(draw_columns("shen", 100_000, seed=10 + number, number=number, indirect_fraction=0.0))
    ip = module.solve(batch, module.METHOD.options()).flags.columns["ip"]
    assert ip.mean() == pytest.approx(0.05, abs=0.002)


@pytest.mark.parametrize(
    ("target", "power_dbm"), [((0.0, 5.0), 1.0), ((-2.5, 6.0), 1.0), ((5.0, 0.1), 1.0), ((0.0, 40.0), 25.0)]
)
def test_chi2_is_calibrated_where_the_differences_are_blind(target, power_dbm):
    """P_f of chi2 is nominal for targets where a difference is blind or its linearization fails."""
    columns = draw_columns(
        "shen", 10_000, seed=3, number=3, indirect_fraction=0.0, target_m=target, power_dbm=power_dbm
    )
    batch = batch_of(columns)
    chi2 = triplets_chi2.solve(batch, triplets_chi2.METHOD.options()).flags.columns["ip"].mean()
    assert chi2 == pytest.approx(0.05, abs=0.0066)
    rates = [
        triplets_tdaj.solve(batch, triplets_tdaj.TdajOptions(rule=f"lambda{n}")).flags.columns["ip"].mean()
        for n in range(1, 7)
    ]
    assert max(abs(rate - 0.05) for rate in rates) > 0.03


def test_joint_detects_more_than_single_paths():
    """In rooms joint finds more indirect paths at equal false alarms; its p-values stay uniform."""
    columns = draw_columns("room", 400, seed=4, blocked_fraction=0.0)

    arrays = {}
    for name, parts in TripletBatch.SOURCES.items():
        values = [np.asfortranarray(columns[part].reshape(400, 12)) for part in parts]
        arrays[name] = values[0] if len(values) == 1 else np.asfortranarray(np.stack(values, axis=-1))
    batch = TripletBatch(seed=np.zeros(400, dtype=np.uint64), **arrays)
    indirect = columns["truth_ip"].reshape(400, 12)
    rates = {}
    for module in (triplets_chi2, triplets_joint):
        solution = module.solve(batch, module.METHOD.options())
        p_value = solution.flags.columns["p_value"]
        threshold = np.quantile(p_value[~indirect], 0.05)
        rates[module.METHOD.name] = np.mean(p_value[indirect] < threshold)
    assert rates["joint"] > 0.97 > 0.93 > rates["chi2"]
    assert np.mean(p_value[~indirect] < 0.05) == pytest.approx(0.05, abs=0.02)
    estimates = solution.estimates
    truth = np.stack([columns["truth_x_m"], columns["truth_y_m"]], axis=1)[::12]
    error = np.hypot(*(estimates.position_m - truth[estimates.row]).T)
    assert np.nanmedian(error) < 0.06


def test_joint_estimates_agree_with_ml():
    """If all paths support the target, position and covariance are those of ml; near rivals are ambiguous."""
    batch = snapshots_of(draw_columns("room", 40, seed=8, receivers=3, paths=1, blocked_fraction=0.0), 40, 3)
    solution = triplets_joint.solve(batch, triplets_joint.JointOptions())
    estimates = solution.estimates
    assert estimates.row.tolist() == list(range(40))
    np.testing.assert_array_equal(estimates.n_used, solution.flags.used.sum(axis=1))
    likely = triplets_ml.solve(batch, triplets_ml.MaximumLikelihoodOptions(joint=True)).estimates
    whole = (estimates.n_used == 3) & np.isfinite(likely.position_m[:, 0])
    assert whole.sum() > 20
    np.testing.assert_allclose(estimates.position_m[whole], likely.position_m[whole], atol=1e-3)
    np.testing.assert_allclose(estimates.covariance_m2[whole], likely.covariance_m2[whole], rtol=0.05, atol=1e-6)
    never, always = (
        triplets_joint.solve(batch, triplets_joint.JointOptions(ambiguous_within=within)).estimates.status
        for within in (0.0, 1e6)
    )
    assert set(never[whole]) == {Status.OK}
    rivalled = always == Status.AMBIGUOUS
    assert rivalled.any()
    assert (never[rivalled] == Status.OK).all()
    np.testing.assert_array_equal(always[~rivalled], never[~rivalled])


def test_snapshots_without_a_target_leave_others_unchanged():
    """Unexplained paths, or paths along their baseline, give one row without a position."""
    paths = [direct_path(), direct_path(length=13.0), one_path(dod=0.0, doa=np.pi, length=5.0), direct_path()]
    fields = {name: np.concatenate([getattr(one, name) for one in paths]) for name in ("seed", *TripletBatch.SOURCES)}
    solution = triplets_joint.solve(dataclasses.replace(paths[0], **fields), triplets_joint.JointOptions())
    estimates = solution.estimates
    assert estimates.row.tolist() == [0, 1, 2, 3]
    assert estimates.status[[0, 3]].tolist() == [Status.OK, Status.OK]
    assert estimates.status[1] == Status.NO_TARGET
    assert estimates.status[2] in {Status.DEGENERATE, Status.NO_TARGET}
    assert np.isfinite(estimates.position_m[:, 0]).tolist() == [True, False, False, True]
    assert solution.flags.used.ravel().tolist() == [True, False, False, True]


def test_joint_with_several_targets():
    """Paths over two targets are all direct with targets=2, and both targets are estimated."""
    generator = np.random.default_rng(5)
    from nlosctl.models.triplets import predict_triplets

    tx = np.tile(generator.uniform(-5.0, 5.0, (40, 1, 2)), (1, 8, 1))
    rx = np.repeat(generator.uniform(-5.0, 5.0, (40, 4, 2)), 2, axis=1)
    pair = generator.uniform(-5.0, 5.0, (40, 2, 2))
    target = np.tile(pair, (1, 4, 1))
    dod, doa, length = predict_triplets(tx, rx, target)
    noise = generator.normal(size=(3, 40, 8))
    fields = {
        "tx_xy_m": tx,
        "rx_xy_m": rx,
        "dod_rad": dod + 0.01 * noise[0],
        "doa_rad": doa + 0.01 * noise[1],
        "path_length_m": length + 0.02 * noise[2],
        "dod_std_rad": np.full((40, 8), 0.01),
        "doa_std_rad": np.full((40, 8), 0.01),
        "path_length_std_m": np.full((40, 8), 0.02),
    }
    batch = TripletBatch(
        seed=np.zeros(40, dtype=np.uint64), **{name: np.asfortranarray(value) for name, value in fields.items()}
    )
    solution = triplets_joint.solve(batch, triplets_joint.JointOptions(targets=2))
    assert solution.flags.columns["ip"].mean() < 0.08
    estimates = solution.estimates
    assert estimates.alternative.tolist() == [0] * estimates.row.size
    assert estimates.status.dtype == np.uint8
    both = np.bincount(estimates.row) == 2
    assert estimates.target.tolist() == [number for two in both for number in range(1 + two)]
    first, second = (estimates.cost[both[estimates.row] & (estimates.target == number)] for number in (0, 1))
    np.testing.assert_array_equal(first, second)
    assert np.isfinite(first).all()
    used = np.bincount(estimates.row, weights=estimates.n_used)
    np.testing.assert_array_equal(solution.flags.used.sum(axis=1), used)
    assert used.mean() > 7.0
    assert both.mean() > 0.9
    for row in np.flatnonzero(both):
        found = estimates.position_m[estimates.row == row]
        distance = np.hypot(*(found[:, None] - pair[row][None]).transpose(2, 0, 1))
        assert (distance.min(axis=0) < 0.3).all()


def test_quantity_of_the_ellipse_rule_agrees_with_lambda_for_direct_paths():
    """By Theorem 1 every rule has the same p-value for a direct path with little noise."""
    columns = draw_columns("shen", 300, seed=6, number=3, indirect_fraction=0.0, power_dbm=60.0)
    keep = np.abs(columns["truth_y_m"]) > 2.0
    batch = batch_of(columns, keep)
    p_values = {
        rule: triplets_tdaj.solve(batch, triplets_tdaj.TdajOptions(rule=rule)).flags.columns["p_value"].ravel()
        for rule in ("lambda1", "lambda2", "lambda5", "ellipse")
    }
    for rule in ("lambda1", "lambda2", "ellipse"):
        assert np.median(np.abs(p_values[rule] - p_values["lambda5"])) < 1e-3
