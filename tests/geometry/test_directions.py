"""Directions in space, compared with finite differences and the inverse functions."""

from __future__ import annotations

import numpy as np

from nlosctl.geometry.directions import angle_gradients, azimuth_elevation, cross, direction_frame, dot, length, scaled


def draw_angles(count, seed):
    """Return azimuths and elevations of directions that are uniform over the sphere."""
    generator = np.random.default_rng(seed)
    return generator.uniform(-np.pi, np.pi, count), np.arcsin(generator.uniform(-1.0, 1.0, count))


def test_the_frame_is_right_handed_and_the_inverse_gives_the_angles():
    """u, a, t are orthonormal with u x a = t, also straight up, and u has the angles that it was made of."""
    azimuth, elevation = draw_angles(2000, 1)
    elevation[:2] = np.pi / 2, -np.pi / 2
    u, a, t = direction_frame(azimuth, elevation)
    for left, right, value in ((u, u, 1.0), (a, a, 1.0), (t, t, 1.0), (u, a, 0.0), (u, t, 0.0), (a, t, 0.0)):
        np.testing.assert_allclose(dot(left, right), value, atol=2e-15)
    np.testing.assert_allclose(np.stack(cross(u, a)), np.stack(t), atol=2e-15)
    back = azimuth_elevation(*scaled(u, 1234.5))
    np.testing.assert_allclose(np.exp(1j * back[0][2:]), np.exp(1j * azimuth[2:]), atol=1e-13)
    np.testing.assert_allclose(back[1], elevation, atol=1e-12)
    assert [float(angle[0]) for angle in azimuth_elevation(*np.zeros((3, 1)))] == [0.0, 0.0]


def test_tangents_and_gradients_are_the_derivatives():
    """a cos(e) and t are du/dz and du/de; the gradients of the angles are central differences, and a / f and t / r."""
    azimuth, elevation = draw_angles(500, 2)
    elevation *= 0.95
    step = 1e-6
    _, a, t = direction_frame(azimuth, elevation)
    ahead, behind = (direction_frame(azimuth + turn, elevation)[0] for turn in (step, -step))
    np.testing.assert_allclose(
        (np.stack(ahead) - np.stack(behind)) / (2 * step), np.stack(a) * np.cos(elevation), atol=1e-9
    )
    ahead, behind = (direction_frame(azimuth, elevation + turn)[0] for turn in (step, -step))
    np.testing.assert_allclose((np.stack(ahead) - np.stack(behind)) / (2 * step), np.stack(t), atol=1e-9)
    vector = np.stack(direction_frame(azimuth, elevation)[0]) * 50.0
    of_azimuth, of_elevation = angle_gradients(*vector)
    np.testing.assert_allclose(np.stack(of_azimuth), np.stack(a) / (50.0 * np.cos(elevation)), rtol=1e-11, atol=1e-14)
    np.testing.assert_allclose(np.stack(of_elevation), np.stack(t) / 50.0, rtol=1e-11, atol=1e-14)
    for axis in range(3):
        shift = np.zeros((3, 1))
        shift[axis] = 1e-4
        ahead, behind = azimuth_elevation(*(vector + shift)), azimuth_elevation(*(vector - shift))
        turn = np.angle(np.exp(1j * (ahead[0] - behind[0]))) / 2e-4
        np.testing.assert_allclose(of_azimuth[axis], turn, rtol=1e-6, atol=1e-8)
        np.testing.assert_allclose(of_elevation[axis], (ahead[1] - behind[1]) / 2e-4, rtol=1e-6, atol=1e-8)


def test_products_are_those_of_numpy():
    """dot, cross and length agree with NumPy's on arrays of vectors."""
    left, right = np.random.default_rng(3).normal(size=(2, 3, 40))
    np.testing.assert_allclose(dot(left, right), np.einsum("cn,cn->n", left, right), rtol=1e-12)
    np.testing.assert_allclose(np.stack(cross(left, right)), np.cross(left.T, right.T).T, rtol=1e-12)
    np.testing.assert_allclose(length(left), np.linalg.norm(left, axis=0), rtol=1e-14)
