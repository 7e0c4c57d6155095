"""Triplets of paths: noise model of the paper, paths over objects, distance to the ellipse."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.geometry.triplets import TripletRays
from nlosctl.models.object_paths import signal_to_noise, trace_over_objects, triplet_standard_deviations
from nlosctl.models.triplets import distance_to_ellipse, predict_triplets

TX, RX = np.array([[-2.5, 0.0]]), np.array([[2.5, 0.0]])


def test_signal_to_noise_of_the_paper():
    """The example of Section VI-A: 18.71 dB, 0.36 and 0.41 degrees, 4.4 mm."""
    paths = trace_over_objects(TX, RX, np.array([[[7.8, 14.0]]]))
    snr = signal_to_noise(1.0, paths.legs_m)
    dod, doa, length = triplet_standard_deviations(snr, np.sin(paths.dod_rad), np.sin(paths.doa_rad))
    assert 10.0 * np.log10(snr[0]) == pytest.approx(18.71, abs=0.01)
    assert np.degrees(doa[0]) == pytest.approx(0.36, abs=0.005)
    assert np.degrees(dod[0]) == pytest.approx(0.41, abs=0.005)
    assert length[0] == pytest.approx(0.0044, abs=5e-5)


def test_a_path_over_the_target_alone_is_direct():
    """A path over one object reads the predicted values; over more objects it is longer than the direct path."""
    generator = np.random.default_rng(1)
    target, other = generator.uniform(-8.0, 8.0, (2, 200, 2))
    direct = trace_over_objects(TX, RX, target[:, None])
    dod, doa, length = predict_triplets(TX, RX, target)
    np.testing.assert_allclose(direct.dod_rad, dod, atol=1e-14)
    np.testing.assert_allclose(direct.doa_rad, doa, atol=1e-14)
    np.testing.assert_allclose(direct.path_length_m, length, atol=1e-12)
    detour = trace_over_objects(TX, RX, np.stack([target, other], axis=1))
    assert (detour.path_length_m > length).all()
    np.testing.assert_allclose(detour.dod_rad, dod, atol=1e-14)
    np.testing.assert_allclose(detour.legs_m.sum(axis=1), detour.path_length_m, atol=1e-12)


def test_distance_to_ellipse_and_its_derivatives():
    """The distance is zero on a direct path; derivatives agree with finite differences on any path."""
    generator = np.random.default_rng(2)
    count = 500
    d = generator.uniform(1.0, 5.0, count)
    mu1, mu2 = generator.uniform(1.0, 2.5, count), generator.uniform(0.3, 0.8, count)
    length = d * generator.uniform(1.2, 4.0, count)

    def rays(mu1, mu2, length):
        return TripletRays(d, np.cos(mu2), np.sin(mu2), np.cos(mu1), np.sin(mu1), length)

    exact = distance_to_ellipse(rays(mu1, mu2, length))
    step = 1e-5
    for j, derivative in enumerate((exact.by_doa, exact.by_dod, exact.by_length)):
        moved = [[value + sign * step * (i == j) for i, value in enumerate((mu1, mu2, length))] for sign in (1.0, -1.0)]
        up, down = (distance_to_ellipse(rays(*values)).value_m for values in moved)
        np.testing.assert_allclose((up - down) / (2.0 * step), derivative, rtol=1e-5, atol=1e-6)
    x, y = generator.uniform(-5.0, 5.0, count), generator.uniform(0.5, 5.0, count)
    direct = rays(
        np.arctan2(y, x - 0.5 * d), np.arctan2(y, x + 0.5 * d), np.hypot(x + 0.5 * d, y) + np.hypot(x - 0.5 * d, y)
    )
    np.testing.assert_allclose(distance_to_ellipse(direct).value_m, 0.0, atol=1e-11)
