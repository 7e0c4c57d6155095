"""Wrapping of angles; cosines and sines."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlosctl.geometry.angles import cosine_sine, wrap_angle

ANGLES = st.floats(-1e4, 1e4)


@given(ANGLES)
def test_wrapped_angles_keep_their_direction(angle: float) -> None:
    """A wrapped angle is in (-pi, pi] and has the direction of the original."""
    wrapped = float(wrap_angle(np.array([angle]))[0])
    assert -math.pi - 1e-12 <= wrapped <= math.pi + 1e-12
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-11)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-11)


@given(st.floats(-math.pi, math.pi, exclude_min=True))
def test_wrapping_keeps_bits_of_angles_in_range(angle: float) -> None:
    """An angle in (-pi, pi] is returned unchanged to the bit, pi included."""
    assert wrap_angle(np.array([angle]))[0] == angle


def test_minus_pi_wraps_to_pi() -> None:
    """Minus pi becomes pi, and pi stays pi."""
    assert wrap_angle(np.array([-np.pi, np.pi, 3 * np.pi])).tolist() == [np.pi, np.pi, np.pi]


def test_nan_wraps_to_nan() -> None:
    """NaN is wrapped to NaN."""
    assert np.isnan(wrap_angle(np.array([np.nan]))).all()


@given(ANGLES)
def test_cosine_and_sine_agree_with_math(angle: float) -> None:
    """Cosine and sine agree with the math module within four units in the last place of one."""
    cosine, sine = (float(part[0]) for part in cosine_sine(np.array([angle])))
    assert cosine == pytest.approx(math.cos(angle), abs=4e-16 + 1e-16 * abs(angle))
    assert sine == pytest.approx(math.sin(angle), abs=4e-16 + 1e-16 * abs(angle))


def test_cosine_and_sine_do_not_depend_on_the_block() -> None:
    """Bits do not depend on the other angles of a block; half a turn and NaN included."""
    angles = np.array([*np.random.default_rng(2).uniform(-7.0, 7.0, 1000), np.pi, -np.pi, 0.0, np.nan])
    together = np.stack(cosine_sine(angles))
    alone = np.stack([np.concatenate(cosine_sine(np.array([angle]))) for angle in angles], axis=1)
    assert np.array_equal(together, alone, equal_nan=True)
    assert together[:, 1000].tolist() == pytest.approx([-1.0, 0.0], abs=1e-15)
    assert np.isnan(together[:, -1]).all()
