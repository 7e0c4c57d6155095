"""Planes as mirrors, compared with distances and with mirrors of the plane."""

from __future__ import annotations

import numpy as np

from nlosctl.geometry.lines import reflect_points
from nlosctl.geometry.planes import reflect_in_plane, reflect_vector, side_of_plane


def draw_planes(count):
    """Return points, and planes by point and unit normal, (3, N) each."""
    generator = np.random.default_rng(1)
    point, on_plane, normal = generator.normal(scale=20.0, size=(3, 3, count))
    return point, on_plane, normal / np.linalg.norm(normal, axis=0)


def test_an_image_is_as_far_behind_the_plane():
    """The image is on the other side, as far from every point of the plane, and its image is the point."""
    point, on_plane, normal = draw_planes(300)
    image = np.stack(reflect_in_plane(point, on_plane, normal))
    np.testing.assert_allclose(
        side_of_plane(image, on_plane, normal), -side_of_plane(point, on_plane, normal), atol=1e-12
    )
    tangent = np.cross(normal.T, np.random.default_rng(2).normal(size=(300, 3))).T
    elsewhere = on_plane + 7.0 * tangent
    np.testing.assert_allclose(
        np.linalg.norm(image - elsewhere, axis=0), np.linalg.norm(point - elsewhere, axis=0), rtol=1e-12
    )
    np.testing.assert_allclose(np.stack(reflect_in_plane(image, on_plane, normal)), point, atol=1e-12)
    np.testing.assert_allclose(np.stack(reflect_in_plane(point, on_plane, -normal)), image, atol=1e-12)


def test_vectors_turn_as_the_points_do():
    """The image of a difference of points is the difference of their images."""
    point, on_plane, normal = draw_planes(50)
    other = point[:, ::-1]
    difference = np.stack(reflect_in_plane(point, on_plane, normal)) - np.stack(
        reflect_in_plane(other, on_plane, normal)
    )
    np.testing.assert_allclose(np.stack(reflect_vector(point - other, normal)), difference, atol=1e-12)


def test_a_vertical_plane_is_the_line_of_the_map():
    """Where the normal is horizontal, x and y are those of the mirror in two dimensions, and z stays."""
    point, on_plane, _ = draw_planes(50)
    angle = np.linspace(-4.0, 4.0, 50)
    normal = (-np.sin(angle), np.cos(angle), np.zeros(50))
    image = reflect_in_plane(point, on_plane, normal)
    expected = reflect_points(point[0], point[1], on_plane[0], on_plane[1], angle)
    np.testing.assert_allclose(np.stack(image), np.stack([*expected, point[2]]), atol=1e-12)
