"""Flat mirrors, compared with the paper's slope form and the definition of a mirror image."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlosctl.geometry.lines import reflect_direction, reflect_points, side_of_line

COORDINATE = st.floats(-1e4, 1e4)
ANGLE = st.floats(-math.pi, math.pi)


def image(x: float, y: float, point_x: float, point_y: float, angle: float) -> tuple[float, float]:
    """Return the image of one point."""
    arrays = (np.array([value]) for value in (x, y, point_x, point_y, angle))
    image_x, image_y = reflect_points(*arrays)
    return float(image_x[0]), float(image_y[0])


@given(COORDINATE, COORDINATE, st.floats(-50.0, 50.0), COORDINATE)
def test_the_image_agrees_with_equation_47(x: float, y: float, slope: float, intercept: float) -> None:
    """Equation (47) of Song et al.: the image in y = a x + b, written with the slope a."""
    denominator = 1.0 + slope**2
    expected_x = ((1.0 - slope**2) * x + 2.0 * slope * (y - intercept)) / denominator
    expected_y = (2.0 * slope * x + (slope**2 - 1.0) * y + 2.0 * intercept) / denominator
    assert image(x, y, 0.0, intercept, math.atan(slope)) == pytest.approx((expected_x, expected_y), abs=1e-8)


def test_a_vertical_mirror_changes_only_x() -> None:
    """In the mirror x = 3 the image of (5, 7) is (1, 7) for either direction of the mirror."""
    for angle in (math.pi / 2, -math.pi / 2):
        assert image(5.0, 7.0, 3.0, -100.0, angle) == pytest.approx((1.0, 7.0), abs=1e-12)


@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE, ANGLE)
def test_the_mirror_is_the_perpendicular_bisector(x: float, y: float, px: float, py: float, angle: float) -> None:
    """The midpoint of point and image is on the mirror, and the segment between them is perpendicular to it."""
    image_x, image_y = image(x, y, px, py, angle)
    along, across = (math.cos(angle), math.sin(angle)), (-math.sin(angle), math.cos(angle))
    assert (image_x - x) * along[0] + (image_y - y) * along[1] == pytest.approx(0.0, abs=1e-9)
    middle = ((image_x + x) / 2 - px, (image_y + y) / 2 - py)
    assert middle[0] * across[0] + middle[1] * across[1] == pytest.approx(0.0, abs=1e-9)


@given(ANGLE, ANGLE)
def test_a_direction_is_mirrored_like_the_points_along_it(direction: float, angle: float) -> None:
    """The image of a direction points to the images of the points along it; mirroring twice restores it."""
    mirrored = reflect_direction(np.array([direction]), np.array([angle]))
    image_x, image_y = image(math.cos(direction), math.sin(direction), 0.0, 0.0, angle)
    assert (math.cos(mirrored[0]), math.sin(mirrored[0])) == pytest.approx((image_x, image_y), abs=1e-12)
    assert reflect_direction(mirrored, np.array([angle]))[0] == pytest.approx(direction, abs=1e-12)


@given(COORDINATE, COORDINATE, COORDINATE, COORDINATE, ANGLE)
def test_a_point_and_its_image_are_on_opposite_sides(x: float, y: float, px: float, py: float, angle: float) -> None:
    """Signed distances of point and image are opposite; left of the line's direction is positive."""
    image_x, image_y = image(x, y, px, py, angle)
    points = np.array([x, image_x]), np.array([y, image_y])
    here, there = side_of_line(*points, np.array([px]), np.array([py]), np.array([angle]))
    assert there == pytest.approx(-here, abs=1e-9)
    assert abs(here) == pytest.approx(math.dist((x, y), (image_x, image_y)) / 2, abs=1e-9)


def test_the_left_side_is_positive() -> None:
    """For a line to the east, a point to the north has a positive distance."""
    zero = np.zeros(1)
    assert side_of_line(zero, np.array([2.0]), zero, zero, zero)[0] == 2.0
