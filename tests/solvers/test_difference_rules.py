"""Decision rules on triplets: statistics, blind spots, rays that do not meet."""

from __future__ import annotations

import numpy as np
import pytest
from scenario_draws import draw_columns
from triplet_worlds import batch_of, one_path

from nlosctl.methods import triplets_tdaj
from nlosctl.models.error_laws import GaussianErrors
from nlosctl.models.triplets import path_rows
from nlosctl.reproduce.shen.detection_theory import DetectionScene
from nlosctl.solvers.triplets.difference_rules import blind_rows, decide, decide_fusion, rays_miss_by, rule_quantity

RULES = (1, 2, 3, 4, 5, 6, "ellipse")


def test_standard_deviation_agrees_with_draws():
    """sigma (24) is the spread of a rule under small simulated errors, and the p-value is uniform."""
    generator = np.random.default_rng(1)
    scene = DetectionScene(target_m=(5.2, 10.0), power_dbm=30.0)
    rows = scene.direct_row()
    mu1 = np.arctan2(rows.rays.doa_sine, rows.rays.doa_cosine)[0]
    mu2 = np.arctan2(rows.rays.dod_sine, rows.rays.dod_cosine)[0]
    std = [float(part[0]) for part in (rows.dod_std_rad, rows.doa_std_rad, rows.path_length_std_m)]
    for rule in RULES:
        decision = decide(rows, rule_quantity(rows.rays, rule), GaussianErrors())
        values = []
        for _ in range(400):
            noise = generator.normal(size=3) * std
            batch = one_path(
                dod=mu2 + noise[0], doa=mu1 + noise[1], length=rows.rays.path_length_m[0] + noise[2], std=std
            )
            values.append(rule_quantity(path_rows(batch).rays, rule).value_m[0])
        assert np.std(values) == pytest.approx(decision.std_m[0], rel=0.12)


def test_fusion_uses_the_p_value_of_rank_k_plus_1():
    """ "More than k rules" has the (k+1)-th smallest p-value; undefined rules do not count."""
    p_values = [np.array([0.3, np.nan]), np.array([0.1, np.nan]), np.array([np.nan, np.nan]), np.array([0.02, np.nan])]
    np.testing.assert_array_equal(decide_fusion(p_values, 0), [0.02, np.nan])
    np.testing.assert_array_equal(decide_fusion(p_values, 2), [0.3, np.nan])
    np.testing.assert_array_equal(decide_fusion(p_values, 3), [1.0, np.nan])


@pytest.mark.parametrize(
    ("target", "blind"),
    [((1.0, 5.0), set()), ((0.0, 5.0), {6}), ((-2.5, 6.0), {1}), ((2.5, 6.0), {3}), ((5.0, 0.01), set(RULES))],
)
def test_blind_spots_of_direct_paths(target, blind):
    """Table I and omissions: lambda 6 at x = 0, 1 and 3 over a node, 2, 4 and 5 on the baseline."""
    rows = DetectionScene(target_m=target).direct_row()
    found = {rule for rule in RULES if blind_rows(rows, rule)[0]}
    # Near the baseline the rays are nearly parallel, which 1 to 4 and the ellipse rule can't bear, and all are curved.
    assert found == blind


@pytest.mark.parametrize(("rule", "blind_share"), [("lambda5", 0.35), ("lambda1", 0.65)])
def test_rows_that_are_not_blind_have_the_nominal_false_alarms(rule, blind_share):
    """In the room P_f of rows with ``blind`` false is nominal within 20 % (and three standard errors) to 1e-3."""
    columns = draw_columns("room", 60_000, seed=3, paths=1, receivers=2, blocked_fraction=0.0)
    batch = batch_of(columns, ~columns["truth_ip"])
    found = triplets_tdaj.solve(batch, triplets_tdaj.TdajOptions(rule=rule)).flags.columns
    p_value, blind = found["p_value"].ravel(), found["blind"].ravel()
    assert 0.1 < blind.mean() < blind_share
    for level in (0.05, 0.01, 0.001):
        error = 3.0 * np.sqrt(level / np.count_nonzero(~blind))
        assert np.mean(p_value[~blind] < level) == pytest.approx(level, abs=0.2 * level + error)
    assert np.mean(p_value[blind] < 0.001) > 0.005


@pytest.mark.parametrize("rule", RULES)
def test_a_rule_is_curved_where_its_values_leave_the_straight_line(rule):
    """Compared with finite steps of one value at a time, on random paths."""
    columns = draw_columns("shen", 300, seed=4)
    values = {name: columns[name] for name in ("dod_rad", "doa_rad", "path_length_m")}
    stds = {name: columns[name.replace("_rad", "_std_rad").replace("_length_m", "_length_std_m")] for name in values}

    def quantity(**changes):
        rows = path_rows(batch_of({**columns, **changes}))
        found = rule_quantity(rows.rays, rule)
        return found.value_m, np.sqrt(sum(weight * weight for weight in rows.weights_m(found)))

    value, spread = quantity()
    worst = np.zeros(value.shape)
    for name, std in stds.items():
        (ahead, wide), (back, narrow) = (quantity(**{name: values[name] + sign * 3.0 * std}) for sign in (1.0, -1.0))
        with np.errstate(invalid="ignore"):
            bend = np.abs(ahead + back - 2.0 * value) / (3.0 * spread)
            change = np.maximum(np.abs(wide - spread), np.abs(narrow - spread)) / spread
        worst = np.fmax(
            worst, np.fmax(np.where(np.isnan(bend), np.inf, bend), np.where(np.isnan(change), np.inf, change))
        )
    curved = blind_rows(path_rows(batch_of(columns)), rule)
    exists = np.isfinite(value)
    assert curved[exists & (worst > 0.3001)].all()
    assert (worst[exists & ~curved] < 0.3001).all()
    assert 0.02 < np.mean(worst[exists] > 0.3) < 0.9


@pytest.mark.parametrize("rule", RULES)
def test_zero_baselines_are_blind(rule):
    """Without a baseline there is no baseline frame: every rule is blind."""
    rows = path_rows(one_path(rx=(-2.5, 0.0), dod=1.0, doa=1.0, length=8.0))
    assert blind_rows(rows, rule)[0]


@pytest.mark.parametrize(
    ("dod", "doa", "expected"),
    [
        (0.5, 1.5, 0.0),
        (1.5, 0.5, 1.0 / np.hypot(0.02, 0.01)),
        (-0.1, 1.5, 0.1 / 0.02),
        (0.3, -3.0, (np.pi - 3.0) / 0.01),
        (-0.5, -1.5, 0.0),
    ],
)
def test_angle_between_rays_that_do_not_meet(dod, doa, expected):
    """The least rotation that makes rays meet: both to parallel, or one across the baseline."""
    rows = path_rows(one_path(dod=dod, doa=doa, length=9.0, std=(0.02, 0.01, 0.05)))
    assert rays_miss_by(rows)[0] == pytest.approx(expected, rel=1e-9)


@pytest.mark.extensive
def test_angle_between_rays_agrees_with_brute_force():
    """It is the smallest scaled distance to a pair of angles whose rays meet, over a fine grid."""
    std = (0.2, 0.3)
    grid = np.linspace(-np.pi, np.pi, 721)
    mu1, mu2 = (values.ravel() for values in np.meshgrid(grid, grid))
    meet = ((mu2 >= 0.0) & (mu1 >= mu2)) | ((mu2 <= 0.0) & (mu1 <= mu2))
    generator = np.random.default_rng(3)
    for dod, doa in generator.uniform(-3.0, 3.0, (60, 2)):
        rows = path_rows(one_path(dod=dod, doa=doa, length=9.0, std=(*std, 0.05)))
        turn_dod = np.abs((mu2 - dod + np.pi) % (2.0 * np.pi) - np.pi)
        turn_doa = np.abs((mu1 - doa + np.pi) % (2.0 * np.pi) - np.pi)
        nearest = np.hypot(turn_dod / std[0], turn_doa / std[1])[meet].min()
        assert rays_miss_by(rows)[0] == pytest.approx(nearest, abs=0.05)
