"""Wrapping of angles."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlosctl.geometry.angles import wrap_angle

ANGLES = st.floats(-1e4, 1e4)


@given(ANGLES)
def test_a_wrapped_angle_is_the_same_direction_in_the_half_open_turn(angle: float) -> None:
    """A wrapped angle lies in (-pi, pi] and points where the angle did."""
    wrapped = float(wrap_angle(np.array([angle]))[0])
    assert -math.pi - 1e-12 <= wrapped <= math.pi + 1e-12
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-11)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-11)


@given(st.floats(-math.pi, math.pi, exclude_min=True))
def test_an_angle_within_the_turn_keeps_its_bits(angle: float) -> None:
    """An angle in (-pi, pi] comes back as it was, pi included."""
    assert wrap_angle(np.array([angle]))[0] == angle


def test_the_ends_of_the_turn() -> None:
    """Minus pi becomes pi, and pi stays."""
    assert wrap_angle(np.array([-np.pi, np.pi, 3 * np.pi])).tolist() == [np.pi, np.pi, np.pi]


def test_nan_stays_nan() -> None:
    """NaN is wrapped to NaN."""
    assert np.isnan(wrap_angle(np.array([np.nan]))).all()
