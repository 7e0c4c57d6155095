"""Theory of the difference rules, compared with Table III of the paper and Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.geometry.triplets import TripletRays
from nlosctl.reproduce.shen.detection_theory import (
    ORDERS,
    TABLE_I,
    DetectionScene,
    blind_spots,
    detection_probability,
    false_alarm_probability,
    mean_detection_probability,
    outage_probabilities,
    outage_probability,
    reflector_grid,
    rule_moments,
    scene_detection_probability,
)

TABLE_III = {
    1: (0.570, 0.689, 0.865, 0.931, 0.990, 0.995),
    3: (0.542, 0.663, 0.849, 0.921, 0.988, 0.994),
    5: (0.593, 0.709, 0.877, 0.938, 0.991, 0.995),
}


@pytest.mark.parametrize("rule", TABLE_III)
def test_table_iii(rule):
    """P_d by (33) in scenario 1 is that of Table III to its last digit."""
    scene = DetectionScene(target_m=(5.2, 10.0))
    reflector = np.array([[4.8, 9.8]])
    for false_alarm, printed in zip((0.05, 0.1, 0.3, 0.5, 0.9, 0.95), TABLE_III[rule], strict=True):
        found = scene_detection_probability(scene, reflector, rule, false_alarm, "reflector first")
        assert found[0] == pytest.approx(printed, abs=6e-4)


def test_false_alarms_and_thresholds_are_inverse():
    """P_f by (26) at the threshold of (27) is the nominal one, and P_d by (33) at a mean of zero is P_f."""
    std = np.array([0.2, 3.0])
    assert false_alarm_probability(1.959963984540054 * std, std) == pytest.approx([0.05, 0.05])
    assert detection_probability(np.zeros(2), std, 0.05) == pytest.approx([0.05, 0.05])


def test_outage_by_monte_carlo():
    """Both outage probabilities of (36) agree with lambda 5 at drawn triplets to 0.002."""
    generator = np.random.default_rng(1)
    scene = DetectionScene(target_m=(1.0, 5.0), power_dbm=25.0)
    rows = scene.indirect_rows(reflector_grid((-1.0, 3.0), (3.0, 7.0), 12), "target first")
    mean, std = rule_moments(rows, 5)
    eta = float(np.quantile(np.abs(mean), 0.5))
    threshold = 0.8 * eta
    draws = 3000
    rays = rows.rays
    noise = generator.normal(size=(3, draws, mean.shape[0]))
    mu2 = np.arctan2(rays.dod_sine, rays.dod_cosine) + rows.dod_std_rad * noise[0]
    mu1 = np.arctan2(rays.doa_sine, rays.doa_cosine) + rows.doa_std_rad * noise[1]
    length = rays.path_length_m + rows.path_length_std_m * noise[2]
    baseline = np.broadcast_to(rays.baseline_m, mu1.shape)
    drawn = TripletRays(baseline, np.cos(mu2), np.sin(mu2), np.cos(mu1), np.sin(mu1), length).difference(5).value_m
    out = np.abs(drawn) > threshold
    safe = np.abs(mean) <= eta
    inside, outside = outage_probabilities(mean, std, threshold, eta)
    assert 0.05 < inside < 0.95
    assert inside == pytest.approx(out[:, safe].mean(), abs=0.002)
    assert outside == pytest.approx(out[:, ~safe].mean(), abs=0.002)
    edge = outage_probability(np.array([0.2]), np.array([0.1]), 0.3)
    assert edge[0] == pytest.approx(0.158655 + 2.9e-7, abs=1e-6)


def test_mean_over_a_region_converges():
    """P_d averaged over reflectors is between no and certain detection, and converges with finer grids."""
    scene = DetectionScene(target_m=(5.2, 10.0))
    found = [
        mean_detection_probability(scene, 5, 0.05, x_m=(-8.0, 8.0), y_m=(0.0, 10.0), points=points)
        for points in (100, 200)
    ]
    assert 0.8 < found[0] < 0.97
    assert found[0] == pytest.approx(found[1], abs=0.003)


@pytest.mark.parametrize("rule", TABLE_I)
@pytest.mark.parametrize("order", ORDERS)
def test_reflectors_on_the_lines_are_blind_spots(rule, order):
    """BS1: for a reflector in front of the target on its own leg, or beyond it on the other line, lambda is zero."""
    scene = DetectionScene(target_m=(-1.0, 5.0))
    target = np.array(scene.target_m)
    nodes = [np.array(node) for node in (scene.tx_m, scene.rx_m)]
    own, other = nodes if order == "reflector first" else nodes[::-1]
    reflectors = np.stack([own + 0.3 * (target - own), own + 0.8 * (target - own), other + 1.5 * (target - other)])
    found = blind_spots(scene, reflectors, rule, order)
    lines = (found.off_dod_line_m, found.off_doa_line_m)
    mine, others = lines if order == "reflector first" else lines[::-1]
    np.testing.assert_allclose([*mine[:2], others[2]], 0.0, atol=1e-12)
    np.testing.assert_allclose(found.mean_m, 0.0, atol=1e-9)


def test_blind_spots_of_figure_4():
    """For the target at (-1, 5) lambda 5 is zero only on the two lines; lambda 1 also where mu2 = pi / 2."""
    scene = DetectionScene(target_m=(-1.0, 5.0))
    grid = reflector_grid((-8.0, 8.0), (0.0, 10.0), 60)
    for order in ORDERS:
        five = blind_spots(scene, grid, 5, order)
        sector = 2 * (five.off_dod_line_m > 0.0) + (five.off_doa_line_m > 0.0)
        for number in range(4):
            assert np.unique(np.sign(five.mean_m[sector == number])).size == 1
        assert (five.divisor > 0.0).all()
    above_tx = np.array([[-2.5, 2.0], [-2.5, 4.0]])
    assert np.abs(blind_spots(scene, above_tx, 1, "reflector first").mean_m).max() < 1e-9
    assert np.abs(blind_spots(scene, above_tx, 5, "reflector first").mean_m).min() > 0.1
