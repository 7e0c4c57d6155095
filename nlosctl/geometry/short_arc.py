"""The reflection on the short arc between two points in a circle. Coordinates are about the circle's centre.

Song, Willett, Zhou 2013, Lemma 3 and equation (33) about the sensor's direction, solved by Newton's method.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.geometry.circular_reflection import ReflectedPath, reflect_at
from nlosctl.geometry.roots import bracketed_roots

__all__ = ["short_arc_point", "short_arc_reflection"]


_NEWTON_STEPS = 5
_SETTLED = 1e-8
"""Newton's method doubles its digits: after a step this short the root is exact. Other roots are bracketed."""


def short_arc_reflection(
    sensor_x: FloatArray, sensor_y: FloatArray, source_x: FloatArray, source_y: FloatArray, radius: FloatArray
) -> ReflectedPath:
    """Return the path by `short_arc_point`."""
    hit_x, hit_y = short_arc_point(sensor_x, sensor_y, source_x, source_y, radius)
    return reflect_at(hit_x, hit_y, sensor_x, sensor_y, source_x, source_y)


def short_arc_point(
    sensor_x: FloatArray, sensor_y: FloatArray, source_x: FloatArray, source_y: FloatArray, radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return x, y of the specular point on the short arc between sensor and source, shapes (N,) all alike.

    With an opaque concentric circle and a sensor on it, it is the only unblocked one (Lemma 3). The root in
    (0, delta), delta the angle between the two, of R s sin a - R rho sin(delta - a) - s rho sin(2 a - delta): (33)
    about the sensor's direction. NaN where one of the two is not inside the circle, or is its centre.
    """
    scale = 1.0 / radius
    sensor_r, source_r = (np.sqrt(x * x + y * y) * scale for x, y in ((sensor_x, sensor_y), (source_x, source_y)))
    inside = (sensor_r < 1.0) & (source_r < 1.0) & (sensor_r > 0.0) & (source_r > 0.0)
    with ignoring_division():
        toward = scale / sensor_r
        up_x, up_y = sensor_x * toward, sensor_y * toward
        cross = (up_x * source_y - up_y * source_x) * scale
        beside, along = np.abs(cross), (up_x * source_x + up_y * source_y) * scale
        arc = _ShortArc(sensor_r, beside, along)
        cosine, sine = arc.flat_guess(source_r)
        for _ in range(_NEWTON_STEPS):
            cosine, sine, step = arc.newton_step(cosine, sine)
        settled = (np.abs(step) <= _SETTLED) & (sine >= 0.0) & (beside * cosine >= along * sine)
    open_rows = np.flatnonzero(inside & ~settled)
    if open_rows.size:
        delta = np.arctan2(beside, along)[open_rows]
        rest = _ShortArc(sensor_r[open_rows], beside[open_rows], along[open_rows])
        angle = bracketed_roots(rest.condition, np.zeros_like(delta), delta, 0.5 * delta)
        cosine[open_rows], sine[open_rows] = np.cos(angle), np.sin(angle)
    cosine, sine = radius * cosine, np.copysign(radius, cross) * sine
    if not inside.all():
        cosine = np.where(inside, cosine, np.nan)
    return up_x * cosine - up_y * sine, up_y * cosine + up_x * sine


@dataclass(frozen=True)
class _ShortArc:
    """Equation (33) in the sensor's direction, over the radius squared, as a function of the angle from it.

    ``sensor_r`` is the sensor's distance from the centre, ``beside`` and ``along`` are the source across and along
    the sensor's direction, all over the radius.
    """

    sensor_r: FloatArray
    beside: FloatArray
    along: FloatArray

    def value_and_slope(self, cosine: FloatArray, sine: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the condition and its derivative at an angle, given by cosine and sine."""
        ahead_sine = self.beside * cosine - self.along * sine
        ahead_cosine = self.along * cosine + self.beside * sine
        value = self.sensor_r * (sine - sine * ahead_cosine + cosine * ahead_sine) - ahead_sine
        slope = self.sensor_r * (cosine - 2.0 * (cosine * ahead_cosine + sine * ahead_sine)) + ahead_cosine
        return value, slope

    def condition(self, angle: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the condition and its derivative at an angle."""
        return self.value_and_slope(np.cos(angle), np.sin(angle))

    def flat_guess(self, source_r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return cosine and sine of the angle at which a flat mirror would reflect: shared by the two depths."""
        depth = (1.0 - self.sensor_r) / source_r
        x, y = 1.0 - source_r + depth * self.along, depth * self.beside
        length = np.sqrt(x * x + y * y)
        return x / length, y / length

    def newton_step(self, cosine: FloatArray, sine: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return cosine and sine after a step of Newton's method, and the step; no trigonometric function.

        A turn by 2 atan(step / 2), which is the step up to its cube.
        """
        value, slope = self.value_and_slope(cosine, sine)
        step = value / slope
        half = 0.5 * step
        square = half * half
        inverse = 1.0 / (1.0 + square)
        turn_cosine, turn_sine = (1.0 - square) * inverse, step * inverse
        return cosine * turn_cosine + sine * turn_sine, sine * turn_cosine - cosine * turn_sine, step
