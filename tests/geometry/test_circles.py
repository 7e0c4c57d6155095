"""The exit of a ray from a circle."""

from __future__ import annotations

import numpy as np
from circle_worlds import draw_disc, parts

from nlosctl.geometry.circles import leave_circle


def test_the_exit_is_on_the_circle_and_ahead():
    """The exit is on the circle, at the returned distance ahead; the normal part is R cos(incidence)."""
    generator = np.random.default_rng(1)
    start, turn = draw_disc(generator, 2000, 7.0), np.exp(2j * np.pi * generator.random(2000))
    found = leave_circle(*parts(start), *parts(turn), np.full(2000, 7.0))
    end = found.x + 1j * found.y
    np.testing.assert_allclose(np.abs(end), 7.0, rtol=1e-14)
    np.testing.assert_allclose(end, start + found.distance_m * turn, atol=1e-13)
    assert (found.distance_m > 0.0).all()
    np.testing.assert_allclose(found.normal_m, np.real(end * np.conj(turn)), atol=1e-13)


def test_the_exit_agrees_with_equations_42_and_43():
    """(42)-(43), where they are not singular, give the same point with the sign of cos(psi)."""
    generator = np.random.default_rng(2)
    start, bearing = draw_disc(generator, 500, 5.0), generator.uniform(-np.pi, np.pi, 500)
    x, y = parts(start)
    tangent, cosine = np.tan(bearing), np.cos(bearing)
    root = np.sign(cosine) * np.sqrt(25.0 / cosine**2 - (y - x * tangent) ** 2)  # (43)
    expected_x = cosine**2 * (tangent * (x * tangent - y) + root)  # (42)
    expected_y = cosine**2 * ((y - x * tangent) + root * tangent)
    found = leave_circle(x, y, cosine, np.sin(bearing), np.full(500, 5.0))
    usable = np.abs(cosine) > 0.01
    np.testing.assert_allclose(found.x[usable], expected_x[usable], atol=1e-9)
    np.testing.assert_allclose(found.y[usable], expected_y[usable], atol=1e-9)


def test_exits_near_the_circle_keep_their_digits():
    """A sensor a millimetre inside a circle of 6671 km, looking up, has a millimetre to go, not zero."""
    found = leave_circle(np.array([6671e3 - 1e-3]), np.zeros(1), np.ones(1), np.zeros(1), np.array([6671e3]))
    assert abs(found.distance_m[0] - 1e-3) < 1e-8


def test_exits_from_inside_are_ahead():
    """From the last floating-point numbers inside the circle the exit outwards is still ahead."""
    start = 6671e3 * np.exp(1j * np.linspace(-3.0, 3.0, 2000)) * (1.0 - 1e-15)
    x, y = parts(start)
    found = leave_circle(x, y, *parts(start / np.abs(start)), np.full(2000, 6671e3))
    assert np.count_nonzero(~np.isnan(found.distance_m)) > 1000
    assert np.nanmin(found.distance_m) > 0.0


def test_rays_from_outside_have_no_exit():
    """From outside or from the circle itself the exit is NaN."""
    found = leave_circle(np.array([1.0, 2.0]), np.zeros(2), -np.ones(2), np.zeros(2), np.ones(2))
    assert np.isnan(found.x).all()
    assert np.isnan(found.distance_m).all()
