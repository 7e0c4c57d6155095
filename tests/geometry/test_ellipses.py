"""The nearest point on an ellipse."""

from __future__ import annotations

import numpy as np

from nlosctl.geometry.ellipses import nearest_on_ellipse


def test_no_point_of_a_fine_polygon_is_nearer():
    """No point of a fine polygon is nearer, and the foot is on the ellipse."""
    generator = np.random.default_rng(1)
    a = generator.uniform(1.0, 5.0, 300)
    b = a * generator.uniform(0.05, 1.0, 300)
    x, y = generator.uniform(-8.0, 8.0, (2, 300))
    x[:100], y[:100] = 0.3 * x[:100], 0.05 * y[:100]
    foot_x, foot_y = nearest_on_ellipse(x, y, a, b)
    np.testing.assert_allclose((foot_x / a) ** 2 + (foot_y / b) ** 2, 1.0, atol=1e-10)
    angle = np.linspace(-np.pi, np.pi, 20_001)
    polygon = np.hypot(x[:, None] - a[:, None] * np.cos(angle), y[:, None] - b[:, None] * np.sin(angle)).min(axis=1)
    distance = np.hypot(x - foot_x, y - foot_y)
    assert (distance <= polygon + 1e-12).all()
    np.testing.assert_allclose(distance, polygon, atol=2e-3)


def test_points_on_the_axes():
    """Points on the axes, the centre and far points have a closed form; of two feet the upper is returned."""
    a, b = np.full(8, 2.0), np.full(8, 1.0)
    x, y = np.array([0.0, 0.0, 3.0, 0.3, 1e9, 1.6, 2.2, -0.3]), np.array([3.0, *np.zeros(6), -0.0])
    foot_x, foot_y = nearest_on_ellipse(x, y, a, b)
    np.testing.assert_allclose(foot_x, [0.0, 0.0, 2.0, 0.4, 2.0, 2.0, 2.0, -0.4], atol=1e-9)
    np.testing.assert_allclose(foot_y, [1.0, 1.0, 0.0, np.sqrt(0.96), 0.0, 0.0, 0.0, np.sqrt(0.96)], atol=1e-9)


def test_circles():
    """On a circle the foot is on the ray from the centre; for the centre it is the top, for NaN it is NaN."""
    x, y, radius = np.array([0.0, 0.5, -3.0, np.nan]), np.array([0.0, 0.5, 4.0, 0.0]), np.full(4, 2.0)
    foot_x, foot_y = nearest_on_ellipse(x, y, radius, radius)
    np.testing.assert_allclose(foot_x, [0.0, np.sqrt(2.0), -1.2, np.nan], atol=1e-9)
    np.testing.assert_allclose(foot_y, [2.0, np.sqrt(2.0), 1.6, np.nan], atol=1e-9)


def test_feet_do_not_depend_on_the_block():
    """The foot of a point does not depend on the other points of the call."""
    generator = np.random.default_rng(2)
    a = generator.uniform(1.0, 5.0, 50)
    b = a * generator.uniform(0.05, 1.0, 50)
    x, y = generator.uniform(-8.0, 8.0, (2, 50))
    together = np.array(nearest_on_ellipse(x, y, a, b))
    alone = np.array([nearest_on_ellipse(x[i : i + 1], y[i : i + 1], a[i : i + 1], b[i : i + 1]) for i in range(50)])
    np.testing.assert_array_equal(together, alone[:, :, 0].T)
