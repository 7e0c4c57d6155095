"""The flat part of Song, Willett, Zhou 2013 as printed, one problem at a time: the slow truth of these tests.

Shares no code with nlosctl. Equation numbers are the paper's; where the print is wrong, the name says so.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import least_squares

TARGET = (10000.0, 5000.0)
SENSORS = ((-3300.0, 0.0), (0.0, 0.0), (5000.0, -2500.0))
MIRRORS = ((0.5, 5000.0), (0.0, -2500.0), (1.0, -10000.0))


def image(point, mirror):
    """Return the image of a point in y = a x + b, equations (1), (4), (47) as printed."""
    (x, y), (a, b) = point, mirror
    return (
        (1 - a * a) / (1 + a * a) * x + 2 * a / (1 + a * a) * y - 2 * a * b / (1 + a * a),
        2 * a / (1 + a * a) * x + (a * a - 1) / (1 + a * a) * y + 2 * b / (1 + a * a),
    )


def image_by_foot(point, mirror):
    """Return the image of a point as twice the foot of its perpendicular minus the point."""
    (x, y), (a, b) = point, mirror
    foot_x = (x + a * (y - b)) / (1 + a * a)
    return 2 * foot_x - x, 2 * (a * foot_x + b) - y


def hit_by_fermat(target, sensor, mirror):
    """Return the point of the mirror on the shortest path from target to sensor, both on one side."""
    feet, heights = [], []
    for x, y in (target, sensor):
        a, b = mirror
        foot = np.array([(x + a * (y - b)) / (1 + a * a), 0.0])
        foot[1] = a * foot[0] + b
        feet.append(foot)
        heights.append(math.hypot(x - foot[0], y - foot[1]))
    return feet[1] + (feet[0] - feet[1]) * heights[1] / (heights[0] + heights[1])


def bearing_by_target_image(target, sensor, mirror):
    """Return (2) with atan2."""
    x, y = image(target, mirror)
    return math.atan2(y - sensor[1], x - sensor[0])


def bearing_by_sensor_image(target, sensor, mirror):
    """Return (3) with atan2, wrapped to (-pi, pi]."""
    x, y = image(sensor, mirror)
    return wrap(2 * math.atan(mirror[0]) - math.atan2(target[1] - y, target[0] - x))


def bearing_as_printed(target, sensor, mirror):
    """Return (3) as printed, with arctan of the quotient."""
    x, y = image(sensor, mirror)
    return 2 * math.atan(mirror[0]) - math.atan((target[1] - y) / (target[0] - x))


def wrap(angle):
    """Return the angle in (-pi, pi], by its sine and cosine."""
    return math.atan2(math.sin(angle), math.cos(angle))


def lines(bearings, sensors, mirrors):
    """Return U of (11) and v of (12)."""
    gamma = [phi - 2 * math.atan(a) for phi, (a, _) in zip(bearings, mirrors, strict=True)]
    U = np.array([[math.sin(g), math.cos(g)] for g in gamma])
    origins = np.array([image(s, m) for s, m in zip(sensors, mirrors, strict=True)])
    return U, (U * origins).sum(axis=1), origins


def least_squares_fix(bearings, sensors, mirrors):
    """Return (18) by an orthogonal decomposition."""
    U, v, _ = lines(bearings, sensors, mirrors)
    return np.linalg.lstsq(U, v, rcond=None)[0]


def stansfield_fix(bearings, sensors, mirrors, sigmas):
    """Return (15) with the distances of (14) from the least-squares fix, by an orthogonal decomposition."""
    U, v, origins = lines(bearings, sensors, mirrors)
    first = np.linalg.lstsq(U, v, rcond=None)[0]
    weight = 1 / (np.asarray(sigmas) * np.hypot(*(first - origins).T))
    return np.linalg.lstsq(weight[:, None] * U, weight * v, rcond=None)[0]


def maximum_likelihood_fix(bearings, sensors, mirrors, sigmas, start):
    """Return (6) by scipy, tight, in kilometres about the start; residuals wrapped, numeric Jacobian."""

    def residuals(offset_km):
        at = np.asarray(start) + 1000 * offset_km
        return [
            wrap(phi - bearing_by_target_image(at, s, m)) / sigma
            for phi, s, m, sigma in zip(bearings, sensors, mirrors, sigmas, strict=True)
        ]

    found = least_squares(residuals, [0.0, 0.0], jac="3-point", ftol=1e-15, xtol=1e-15, gtol=1e-15)
    return np.asarray(start) + 1000 * found.x


def information(target, sensors, mirrors, sigmas, step=0.01):
    """Return (27)-(29) with the derivatives taken numerically, from the target-image model."""
    total = np.zeros((2, 2))
    for sensor, mirror, sigma in zip(sensors, mirrors, sigmas, strict=True):
        slope = [
            wrap(
                bearing_by_target_image(target + shift, sensor, mirror)
                - bearing_by_target_image(target - shift, sensor, mirror)
            )
            / (2 * step)
            for shift in step * np.eye(2)
        ]
        total += np.outer(slope, slope) / sigma**2
    return total
