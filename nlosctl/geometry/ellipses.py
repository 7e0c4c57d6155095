"""Ellipses: the nearest point."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_invalid

__all__ = ["nearest_on_ellipse"]


_ITERATIONS = 60


def nearest_on_ellipse(
    x: FloatArray, y: FloatArray, semi_major_m: FloatArray, semi_minor_m: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the point of (x/a)^2 + (y/b)^2 = 1 nearest to each point x, y; shapes alike, a >= b > 0, metres.

    Newton's method on F(t) = (a x / (t + a^2))^2 + (b y / (t + b^2))^2 - 1 from the left of its only root with
    t > -b^2, where F falls and is convex, so that no step overshoots (Eberly, "Distance from a point to an ellipse").
    Of two nearest points (points of the major axis between the centres of curvature) the one above is returned, as it
    is of all points of a circle for its centre.
    NaN in, NaN out.
    """
    a2, b2 = semi_major_m * semi_major_m, semi_minor_m * semi_minor_m
    far_x, far_y = semi_major_m * np.abs(x), semi_minor_m * np.abs(y)
    with ignoring_invalid():
        t = np.maximum(far_x - a2, far_y - b2)
        for _ in range(_ITERATIONS):
            over_x, over_y = far_x / (t + a2), far_y / (t + b2)
            excess = over_x * over_x + over_y * over_y - 1.0
            slope = 2.0 * (over_x * over_x / (t + a2) + over_y * over_y / (t + b2))
            step = np.where(excess > 0.0, excess / slope, 0.0)
            moved = t + step
            if not (moved > t).any():
                break
            t = moved
        foot_x = np.where(t == -a2, 0.0, a2 * np.abs(x) / (t + a2))  # the centre of a circle, all points being nearest
        foot_y = b2 * np.abs(y) / (t + b2)
        # On the major axis inside the evolute the root is t = -b^2 itself, and the foot lies above or below.
        inside = (y == 0.0) & (t <= -b2)
        beside = semi_minor_m * np.sqrt(np.maximum(1.0 - (foot_x / semi_major_m) ** 2, 0.0))
        foot_y = np.where(inside, beside, foot_y)
    return np.copysign(foot_x, x), np.where(y == 0.0, foot_y, np.copysign(foot_y, y))
