"""Angles: radians, counter-clockwise from +x; and the deviation of an array, which depends on the direction.

With phi the true bearing less the heading of the array, a bearing is measured as

    true + b + sum over m = 1..H of c_m cos(m phi) + s_m sin(m phi)                                          (1)

b the offset of the heading, as in tables of the deviation of a compass. The T = 1 + 2 H terms are b, c_1, s_1, c_2, ...
"""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray

__all__ = ["cosine_sine", "deviation", "deviation_terms", "direction_without_deviation", "wrap_angle"]

_STEPS = 60
_SETTLED = 1e-15
_LONGEST_STEP, _LEAST_SLOPE = 0.5, 0.1


def cosine_sine(angle_rad: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return cosine and sine, of the same shape, to 4e-16; NaN where the angle is not finite.

    By the tangent of half the angle: where NumPy has a vector instruction for it, but none for cosine and sine, in an
    eighth of their time.
    """
    tangent = np.tan(0.5 * angle_rad)
    square = tangent * tangent
    scale = 1.0 / (1.0 + square)
    return (1.0 - square) * scale, 2.0 * tangent * scale


def wrap_angle(angle_rad: FloatArray) -> FloatArray:
    """Return the angles wrapped to (-pi, pi], same shape; NaN stays NaN.

    Angles already in that interval keep their bits.
    """
    turns = np.ceil((angle_rad - np.pi) / (2.0 * np.pi))
    wrapped = np.minimum(angle_rad - turns * (2.0 * np.pi), np.pi)
    return np.where(np.abs(angle_rad) < np.pi, angle_rad, wrapped)


def deviation_terms(direction_rad: FloatArray, terms: int) -> FloatArray:
    """Return the derivatives (..., T) of the deviation (1) by its terms, at directions (...) from the heading."""
    harmonics = [np.ones(direction_rad.shape)]
    for order in range(1, terms // 2 + 1):
        harmonics += [np.cos(order * direction_rad), np.sin(order * direction_rad)]
    return np.stack(harmonics, axis=-1)


def deviation(direction_rad: FloatArray, terms: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the deviation (1) at directions (...) relative to the heading, by its terms (..., T), and its slope."""
    value, slope = terms[..., 0] + np.zeros(direction_rad.shape), np.zeros(direction_rad.shape)
    for order in range(1, terms.shape[-1] // 2 + 1):
        cosine, sine = np.cos(order * direction_rad), np.sin(order * direction_rad)
        along, across = terms[..., 2 * order - 1], terms[..., 2 * order]
        value = value + along * cosine + across * sine
        slope = slope + order * (across * cosine - along * sine)
    return value, slope


def direction_without_deviation(measured_rad: FloatArray, terms: FloatArray) -> FloatArray:
    """Return the direction phi (...) that is measured as phi plus its deviation (1), by the terms (..., T).

    By Newton's iteration with limited steps; unique where the slope of the deviation stays above -1.
    """
    direction = measured_rad - deviation(measured_rad, terms)[0]
    for _ in range(_STEPS):
        value, slope = deviation(direction, terms)
        step = (measured_rad - value - direction) / np.maximum(1.0 + slope, _LEAST_SLOPE)
        step = np.clip(step, -_LONGEST_STEP, _LONGEST_STEP)
        direction = direction + step
        if not (np.abs(step) > _SETTLED * (1.0 + np.abs(direction))).any():
            break
    return direction
