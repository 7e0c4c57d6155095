"""Triplets in their baseline frame: points, differences and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.geometry.triplets import DIFFERENCES, TripletRays, baseline_frames

RULES = tuple(DIFFERENCES)


def _random_triplets(count, seed, *, direct):
    """Return d, mu1, mu2, l: of points in the plane (direct), or of anything (indirect)."""
    generator = np.random.default_rng(seed)
    d = generator.uniform(0.5, 8.0, count)
    x, y = generator.uniform(-10.0, 10.0, (2, count))
    y = np.copysign(np.abs(y) + 0.3, y)
    mu1, mu2 = np.arctan2(y, x - 0.5 * d), np.arctan2(y, x + 0.5 * d)
    length = np.hypot(x + 0.5 * d, y) + np.hypot(x - 0.5 * d, y)
    if not direct:
        mu1 = generator.uniform(-np.pi, np.pi, count)
        mu2 = generator.uniform(-np.pi, np.pi, count)
        length = d * generator.uniform(1.05, 5.0, count)
    return d, mu1, mu2, length


def _rays(d, mu1, mu2, length):
    return TripletRays(d, np.cos(mu2), np.sin(mu2), np.cos(mu1), np.sin(mu1), length)


def _matrix(rays):
    """Return W (N, 6, 3)."""
    zero = np.zeros_like(rays.path_length_m)
    rows = [rays.difference(which) for which in RULES]
    return np.stack([np.stack([q.by_doa + zero, q.by_dod + zero, q.by_length + zero], axis=1) for q in rows], axis=1)


def _paper_matrix(d, mu1, mu2, length, rays):
    """Return W (N, 6, 3) by (11), (12), (14) in the paper's tan form, its misprints corrected."""
    x, y = ([rays.coordinate(k, axis).value_m for k in (1, 2, 3)] for axis in ("x", "y"))
    a1, a2, b1, b2 = np.tan(mu1), np.tan(mu2), -1.0, -1.0
    c1 = [(x[k] - 0.5 * d) / np.cos(mu1) ** 2 for k in range(3)]
    c2 = [(x[k] + 0.5 * d) / np.cos(mu2) ** 2 for k in range(3)]
    a3 = [2.0 * x[k] / length**2 for k in range(3)]
    b3 = [2.0 * y[k] / (length**2 - d**2) for k in range(3)]
    # (11) prints a minus between the two terms of c3.
    c3 = [-2.0 * (x[k] ** 2 / length**3 + y[k] ** 2 * length / (length**2 - d**2) ** 2) for k in range(3)]
    alpha = a1 * b2 - a2 * b1
    beta = a2 * b3[1] - a3[1] * b2
    gamma = a3[2] * b1 - a1 * b3[2]
    rows = [
        (-b2 * c1[0] / alpha, b1 * c2[0] / alpha + b3[1] * c2[1] / beta, -b2 * c3[1] / beta),
        (a2 * c1[0] / alpha, -a1 * c2[0] / alpha - a3[1] * c2[1] / beta, a2 * c3[1] / beta),
        (-b2 * c1[0] / alpha - b3[2] * c1[2] / gamma, b1 * c2[0] / alpha, b1 * c3[2] / gamma),
        (a2 * c1[0] / alpha + a3[2] * c1[2] / gamma, -a1 * c2[0] / alpha, -a1 * c3[2] / gamma),
        (-b3[2] * c1[2] / gamma, -b3[1] * c2[1] / beta, b2 * c3[1] / beta + b1 * c3[2] / gamma),
        (a3[2] * c1[2] / gamma, a3[1] * c2[1] / beta, -a2 * c3[1] / beta - a1 * c3[2] / gamma),
    ]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1)


@pytest.mark.parametrize("direct", [True, False])
def test_points_satisfy_their_equations(direct):
    """Each point is on both curves that define it."""
    d, mu1, mu2, length = _random_triplets(2000, 1, direct=direct)
    rays = _rays(d, mu1, mu2, length)
    point = {k: [rays.coordinate(k, axis).value_m for axis in ("x", "y")] for k in (1, 2, 3)}

    def off_dod(k):
        return np.sin(mu2) * (point[k][0] + 0.5 * d) - np.cos(mu2) * point[k][1]

    def off_doa(k):
        return np.sin(mu1) * (point[k][0] - 0.5 * d) - np.cos(mu1) * point[k][1]

    def off_ellipse(k):
        x, y = point[k]
        return np.hypot(x + 0.5 * d, y) + np.hypot(x - 0.5 * d, y) - length

    scale = 1.0 + np.hypot(*point[1])
    np.testing.assert_allclose(off_dod(1) / scale, 0.0, atol=1e-13)
    np.testing.assert_allclose(off_doa(1) / scale, 0.0, atol=1e-11)
    np.testing.assert_allclose(off_dod(2), 0.0, atol=1e-12)
    np.testing.assert_allclose(off_ellipse(2), 0.0, atol=1e-11)
    np.testing.assert_allclose(off_doa(3), 0.0, atol=1e-12)
    np.testing.assert_allclose(off_ellipse(3), 0.0, atol=1e-11)


@pytest.mark.parametrize("direct", [True, False])
def test_derivatives_agree_with_finite_differences(direct):
    """W is the Jacobian of lambda at the measured triplet, direct or indirect, to 1e-7."""
    d, mu1, mu2, length = _random_triplets(10_000, 2, direct=direct)
    crossing = np.abs(np.sin(mu1 - mu2))
    keep = crossing > 0.05
    d, mu1, mu2, length = d[keep], mu1[keep], mu2[keep], length[keep]
    exact = _matrix(_rays(d, mu1, mu2, length))
    z = [mu1, mu2, length]
    for j in range(3):
        # Four-point central differences: error of order step^4.
        step = 1e-3 * crossing[keep] if j < 2 else 1e-3 * (length - d)

        def at(factor, j=j, step=step):
            moved = [value + factor * step if i == j else value for i, value in enumerate(z)]
            rays = _rays(d, *moved)
            return np.stack([rays.difference(which).value_m for which in RULES], axis=1)

        numeric = (8.0 * (at(0.5) - at(-0.5)) - (at(1.0) - at(-1.0))) / (6.0 * step[:, None])
        scale = 1.0 + np.abs(exact).max(axis=(1, 2))
        np.testing.assert_allclose(numeric / scale[:, None], exact[:, :, j] / scale[:, None], atol=1e-7)


@pytest.mark.parametrize("direct", [True, False])
def test_derivatives_agree_with_the_corrected_matrix_of_the_paper(direct):
    """The polar derivatives equal (14) with its misprints corrected, away from the poles of the tangent."""
    d, mu1, mu2, length = _random_triplets(5000, 3, direct=direct)
    keep = (np.abs(np.cos(mu1)) > 0.01) & (np.abs(np.cos(mu2)) > 0.01) & (np.abs(np.sin(mu1 - mu2)) > 0.01)
    d, mu1, mu2, length = d[keep], mu1[keep], mu2[keep], length[keep]
    rays = _rays(d, mu1, mu2, length)
    ours, paper = _matrix(rays), _paper_matrix(d, mu1, mu2, length, rays)
    scale = 1.0 + np.abs(ours).max(axis=(1, 2), keepdims=True)
    np.testing.assert_allclose(ours / scale, paper / scale, atol=1e-10)


def test_erratum_sign_of_c3():
    """Erratum of (11): with the printed minus in c3 the derivatives by the path length are wrong."""
    d, mu1, mu2, length = _random_triplets(500, 4, direct=True)
    rays = _rays(d, mu1, mu2, length)
    x, y = rays.coordinate(2, "x"), rays.coordinate(2, "y")
    a3, b3 = 2.0 * x.value_m / length**2, 2.0 * y.value_m / (length**2 - d**2)
    first, second = x.value_m**2 / length**3, y.value_m**2 * length / (length**2 - d**2) ** 2
    gradient = a3 * x.by_length + b3 * y.by_length
    np.testing.assert_allclose(gradient, 2.0 * (first + second), rtol=1e-9)
    heavy = second > 0.01 * first
    assert heavy.sum() > 400
    assert (np.abs(gradient / (2.0 * (first - second)) - 1.0) > 0.01)[heavy].all()


def test_sums_of_quantities_undo_differences():
    """A sum minus one of its terms has the values and derivatives of the other term."""
    rays = _rays(*_random_triplets(50, 9, direct=False))
    two = rays.coordinate(2, "x"), rays.coordinate(3, "y")
    for one, other in (two, two[::-1]):
        for part in ("value_m", "by_doa", "by_dod", "by_length"):
            np.testing.assert_allclose(getattr(one + other - other, part), getattr(one, part), rtol=1e-9, atol=1e-9)


@settings(max_examples=200, deadline=None)
@given(
    d=st.floats(0.5, 10.0),
    x=st.floats(-20.0, 20.0),
    y=st.floats(0.5, 20.0),
    errors=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
)
def test_differences_are_equal_on_a_direct_path(d, x, y, errors):
    """Theorem 1, equation (17): on a direct path all six omega_i lambda_i are equal."""
    mu1, mu2 = np.arctan2(y, x - 0.5 * d), np.arctan2(y, x + 0.5 * d)
    length = np.hypot(x + 0.5 * d, y) + np.hypot(x - 0.5 * d, y)
    matrix = _matrix(_rays(*(np.array([value]) for value in (d, mu1, mu2, length))))[0]
    moves = matrix * (np.array(errors) * [1e-3, 1e-3, 1e-2])
    linear = moves.sum(axis=1)
    # (17) cross-multiplied with the lines in sine form, so that no omega is infinite.
    a1, b1, a2, b2 = np.sin(mu1), -np.cos(mu1), np.sin(mu2), -np.cos(mu2)
    a3, b3 = np.cos(mu1) + np.cos(mu2), np.sin(mu1) + np.sin(mu2)
    alpha, beta, gamma = a1 * b2 - a2 * b1, a2 * b3 - a3 * b2, a3 * b1 - a1 * b3
    # lambda_i / share_i is one number: every pair is proportional.
    share = np.array([b2 * gamma, -a2 * gamma, -b1 * beta, a1 * beta, b3 * alpha, -a3 * alpha])
    scale = np.abs(moves).max() * np.abs(share).max() + 1e-300
    np.testing.assert_allclose((np.outer(linear, share) - np.outer(share, linear)) / scale, 0.0, atol=1e-9)


def test_the_baseline_frame_round_trips():
    """A point transformed by rays to the baseline frame and back is unchanged."""
    generator = np.random.default_rng(5)
    tx, rx, p = generator.uniform(-5.0, 5.0, (3, 2, 300))
    frames = baseline_frames(*tx, *rx)
    dod, doa = np.arctan2(*(p - tx)[::-1]), np.arctan2(*(p - rx)[::-1])
    rays = frames.rays(dod, doa, np.hypot(*(p - tx)) + np.hypot(*(p - rx)))
    for point, tolerance in ((2, 1e-9), (3, 1e-9)):
        back = frames.to_global(rays.coordinate(point, "x").value_m, rays.coordinate(point, "y").value_m)
        np.testing.assert_allclose(back, p, atol=tolerance)
    apart = np.abs(rays.crossing_sine) > 1e-3
    back = frames.to_global(rays.coordinate(1, "x").value_m, rays.coordinate(1, "y").value_m)
    np.testing.assert_allclose(np.array(back)[:, apart], p[:, apart], atol=1e-9)


def test_covariances_rotate_with_the_frame():
    """A covariance in the baseline frame is R C R' in the plane; R rotates the baseline to the plane."""
    generator = np.random.default_rng(6)
    tx, rx = generator.uniform(-5.0, 5.0, (2, 2, 50))
    factor = generator.normal(size=(50, 2, 2))
    dense = factor @ factor.transpose(0, 2, 1)
    turned = baseline_frames(*tx, *rx).matrix_to_global(Symmetric2x2(dense[:, 0, 0], dense[:, 0, 1], dense[:, 1, 1]))
    angle = np.arctan2(*(rx - tx)[::-1])
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]).transpose(2, 0, 1)
    expected = turn @ dense @ turn.transpose(0, 2, 1)
    for found, row, column in ((turned.xx, 0, 0), (turned.xy, 0, 1), (turned.yy, 1, 1)):
        np.testing.assert_allclose(found, expected[:, row, column], rtol=1e-12, atol=1e-12)


def test_infinite_covariances_stay_infinite():
    """Infinite entries, and sums beyond float64, are not finite when rotated, without a warning."""
    frames = baseline_frames(np.zeros(2), np.zeros(2), np.ones(2), np.ones(2))
    size = np.array([np.inf, 1.7e308])
    turned = frames.matrix_to_global(Symmetric2x2(size, -size, size))
    assert not np.isfinite(turned.xx).any()


def test_missing_ellipses_and_parallel_rays_give_nan():
    """Points that do not exist are NaN, without a warning; the others are computed."""
    d, length = np.full(5, 2.0), np.array([1.5, 2.0, 4.0, 2.0, 4.0])
    mu1, mu2 = np.array([1.2, 1.2, 1.0, 1.2, 0.0]), np.array([0.4, 0.4, 1.0, 0.0, 0.0])
    rays = _rays(d, mu1, mu2, length)
    assert np.isnan(rays.coordinate(2, "x").value_m).tolist() == [True, True, False, True, False]
    assert np.isnan(rays.coordinate(3, "y").value_m).tolist() == [True, True, False, True, False]
    assert np.isnan(rays.coordinate(1, "x").value_m).tolist() == [False, False, True, False, True]
    assert np.isnan(rays.difference(1).value_m).all()


def test_lines_that_meet_behind_a_node():
    """Lines that meet behind a node are distinguished from rays that meet."""
    d, length = np.full(3, 2.0), np.full(3, 6.0)
    mu1, mu2 = np.array([2.0, 1.0, 1.0]), np.array([1.0, 2.0, -0.5])
    assert _rays(d, mu1, mu2, length).meets_behind.tolist() == [False, True, True]


def test_zero_baselines_use_the_axes_of_the_plane():
    """If transmitter and receiver coincide the frame is that of the plane; other rows are unaffected."""
    frames = baseline_frames(*np.array([[3.0, 0.0], [4.0, 0.0]]), *np.array([[3.0, 0.0], [4.0, 2.0]]))
    x, y = frames.to_global(np.array([1.0, 1.0]), np.array([2.0, 0.0]))
    np.testing.assert_allclose(np.stack([x, y], axis=1), [[4.0, 6.0], [0.0, 2.0]], atol=1e-15)
    assert frames.length_m.tolist() == [0.0, 2.0]
