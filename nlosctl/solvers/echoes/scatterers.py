"""Scatterers that explain echoes: from a target to a scatterer and on to the sensor, one for all targets and sensors.

A scattered range is the sum of three legs, |p - a| + |p - s| + |s - a|, equation (1) of Liang, Zeng, Li, or half of
that where ranges are delays times c / 2. With a known target each echo has its scatterer on an ellipse with foci target
and sensor; two of them cross in at most two points, which are the seeds.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division, ignoring_invalid
from nlosctl.solvers.echoes.echoes import Echoes

__all__ = ["scattered_density"]

_SCALES = (1.0, 0.5)
"""Ranges via a scatterer are this share of the sum of their legs."""

_MOST_SEEDS = 40_000
"""Crossings of two ellipses with the same target; with more, no scatterers are looked for."""

_MOST_SCATTERERS = 12
_REFINED = 24
"""Seeds of the highest score that are fitted to their echoes."""

_STEPS = 4
_SEED_STD = 4.0
"""How much the score of a seed widens the standard deviations: it has the errors of two echoes and of the target."""

_FITTED_STD = 1.5
"""The same once it is fitted to all its echoes: what is left is mostly the error of the target."""

_LATER_STD = 2.0
"""A scattered echo less than this many standard deviations behind the direct one cannot be distinguished from it;
without this limit, a scatterer at a target would explain its direct echoes."""

_DETECTION = 0.9
_LEAST_EVIDENCE = 12.0
"""Nats that a scatterer needs: a true one explains an echo of each sensor and target."""


class _Found(NamedTuple):
    """A scatterer: its evidence in nats, and the density (N, M) of its echoes at those of the snapshot."""

    score: float
    density: FloatArray


def scattered_density(
    echoes: Echoes, target_x: FloatArray, target_y: FloatArray, free: BoolArray, density: FloatArray, area_m2: float
) -> FloatArray:
    """Return the density (N, M) per metre and sensor, at each echo, of echoes of targets (T,) via scatterers.

    Scatterers are found one after the other, each the one that explains most of the echoes that none before
    explains, compared with the ``density`` (N, M) of clutter; zero without one. They are looked for where the
    ``free`` echoes (N, M), which no target takes, agree. Of the two laws of scattered ranges the one that explains more
    counts.
    """
    best_score, best = 0.0, np.zeros(density.shape)
    for scale in _SCALES:
        left, total, score = np.isfinite(echoes.range_m), np.zeros(density.shape), 0.0
        legs = _Legs(echoes, target_x, target_y, scale)
        for _ in range(_MOST_SCATTERERS):
            found = _best_scatterer(legs, left, free, density, area_m2)
            if found is None:
                break
            score += found.score
            total += found.density
            left &= ~(found.density > density)
        if score > best_score:
            best_score, best = score, total
    return best


class _Legs:
    """Ranges via scatterers: sensors (N,) and targets (T,) with the distance (T, N) between them."""

    def __init__(self, echoes: Echoes, target_x: FloatArray, target_y: FloatArray, scale: float) -> None:
        self.echoes, self.x, self.y, self.scale = echoes, target_x, target_y, scale
        self.direct = np.hypot(
            np.hypot(target_x[:, None] - echoes.sensor_x, target_y[:, None] - echoes.sensor_y), echoes.height
        )

    def predict(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the ranges (S, T, N) via scatterers (S,)."""
        to_target = np.hypot(x[:, None] - self.x, y[:, None] - self.y)
        to_sensor = np.hypot(
            np.hypot(x[:, None] - self.echoes.sensor_x, y[:, None] - self.echoes.sensor_y), self.echoes.height
        )
        return self.scale * (self.direct + to_target[:, :, None] + to_sensor[:, None, :])

    def gradient(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (S, T, N) of the ranges with respect to the scatterer."""
        parts = []
        for place, own, theirs in ((x, self.x, self.echoes.sensor_x), (y, self.y, self.echoes.sensor_y)):
            parts.append((place[:, None] - own, place[:, None] - theirs))
        with ignoring_division():
            to_target = np.hypot(parts[0][0], parts[1][0])
            to_sensor = np.hypot(parts[0][1], parts[1][1])
            one, two = (
                self.scale * ((away / to_target)[:, :, None] + (off / to_sensor)[:, None, :]) for away, off in parts
            )
        return one, two


def _best_scatterer(
    legs: _Legs, left: BoolArray, free: BoolArray, density: FloatArray, area_m2: float
) -> _Found | None:
    """Return the scatterer that explains most of the echoes left, None if none has the least evidence."""
    x, y = _seeds(legs, left & free, area_m2)
    if not x.size:
        return None
    _, _, score = _score(legs, x, y, left, density, _SEED_STD)
    top = np.argsort(-score, kind="stable")[:_REFINED]
    x, y = x[top], y[top]
    width = _SEED_STD
    for _ in range(_STEPS):
        index, residual, _ = _score(legs, x, y, left, density, width)
        x, y = _step(legs, x, y, index, residual, width)
        width = max(0.5 * width, _FITTED_STD)
    index, residual, score = _score(legs, x, y, left, density, _FITTED_STD)
    number = int(np.argmax(score))
    evidence = float(score[number]) + np.log(2.0 * np.pi / area_m2) + 2.0 * np.log(float(np.nanmean(legs.echoes.std_m)))
    if not evidence >= _LEAST_EVIDENCE:
        return None
    predicted = legs.predict(x[number : number + 1], y[number : number + 1])[0]
    std = _FITTED_STD * legs.echoes.std_m
    with ignoring_invalid():
        away = (legs.echoes.range_m - predicted[:, :, None]) / std
        peaks = np.exp(-0.5 * away * away) / (np.sqrt(2.0 * np.pi) * std)
        peaks[(predicted - legs.direct)[:, :, None] <= _LATER_STD * legs.echoes.std_m] = 0.0
    return _Found(evidence, np.nan_to_num(_DETECTION * peaks.sum(axis=0)))


def _seeds(legs: _Legs, left: BoolArray, area_m2: float) -> tuple[FloatArray, FloatArray]:
    """Return the crossings (S,) of the ellipses of one target and the echoes of two sensors; none if too many.

    With the target at the origin and the sum q of the last two legs, 2 a s - 2 q |s| = |a|^2 - q^2, linear in s and
    |s|.
    """
    echoes, parts = legs.echoes, []
    sensor, index = np.nonzero(left)
    of_sensor = np.bincount(sensor, minlength=echoes.sensors)
    crossings = int(of_sensor.sum() ** 2 - (of_sensor**2).sum())
    if not 0 < crossings <= _MOST_SEEDS:
        return np.empty(0), np.empty(0)
    first, second = np.nonzero(sensor[:, None] < sensor[None, :])
    for number in range(min(legs.x.size, _MOST_SEEDS // crossings)):
        ax, ay = echoes.sensor_x[sensor] - legs.x[number], echoes.sensor_y[sensor] - legs.y[number]
        q = echoes.range_m[sensor, index] / legs.scale - legs.direct[number, sensor]
        c = 0.5 * (ax * ax + ay * ay - q * q)
        with ignoring_division(), ignoring_invalid():
            det = ax[first] * ay[second] - ay[first] * ax[second]
            ux, vx = ((ay[second] * k[first] - ay[first] * k[second]) / det for k in (c, q))
            uy, vy = ((ax[first] * k[second] - ax[second] * k[first]) / det for k in (c, q))
            a, b, d = vx * vx + vy * vy - 1.0, ux * vx + uy * vy, ux * ux + uy * uy
            root = np.sqrt(np.maximum(b * b - a * d, 0.0))
            for sign in (-1.0, 1.0):
                away = (-b + sign * root) / a
                fine = (away > 0.0) & (away < q[first]) & (away < q[second]) & (away * away < 4.0 * area_m2)
                parts.append(((legs.x[number] + ux + vx * away)[fine], (legs.y[number] + uy + vy * away)[fine]))
    x, y = (np.concatenate(values) for values in zip(*parts, strict=True))
    return x, y


def _score(
    legs: _Legs, x: FloatArray, y: FloatArray, left: BoolArray, density: FloatArray, width: float
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Return the nearest echo left (S, T, N), how far it is in its std, and the evidence (S,) in nats."""
    predicted = legs.predict(x, y)
    index, residual = np.zeros(predicted.shape, dtype=np.int64), np.full(predicted.shape, np.inf)
    gain = np.zeros(predicted.shape)
    for sensor in range(legs.echoes.sensors):
        here = np.flatnonzero(left[sensor])
        if not here.size:
            continue
        ranges, std = legs.echoes.range_m[sensor, here], legs.echoes.std_m[sensor, here]
        above = np.searchsorted(ranges, predicted[:, :, sensor])
        low, high = np.maximum(above - 1, 0), np.minimum(above, ranges.shape[0] - 1)
        nearer = np.abs(ranges[high] - predicted[:, :, sensor]) < np.abs(ranges[low] - predicted[:, :, sensor])
        nearest = np.where(nearer, high, low)
        residual[:, :, sensor] = (ranges[nearest] - predicted[:, :, sensor]) / std[nearest]
        index[:, :, sensor] = here[nearest]
        peak = np.exp(-0.5 * (residual[:, :, sensor] / width) ** 2) / (np.sqrt(2.0 * np.pi) * width * std[nearest])
        later = predicted[:, :, sensor] - legs.direct[:, sensor] > _LATER_STD * std[nearest]
        gain[:, :, sensor] = np.where(
            later, np.log1p(-_DETECTION + _DETECTION * peak / density[sensor, here][nearest]), 0.0
        )
    return index, residual, gain.sum(axis=(1, 2))


def _step(
    legs: _Legs, x: FloatArray, y: FloatArray, index: IntArray, residual: FloatArray, width: float
) -> tuple[FloatArray, FloatArray]:
    """Return the scatterers (S,) moved by one Gauss-Newton step towards the echoes within the gate."""
    std = legs.echoes.std_m[np.arange(legs.echoes.sensors), index]
    gx, gy = legs.gradient(x, y)
    with ignoring_invalid(), ignoring_division():
        used = (np.abs(residual) <= 3.0 * width) & np.isfinite(gx) & np.isfinite(gy)
        gx, gy, left = (np.where(used, part, 0.0) for part in (gx / std, gy / std, residual))
        xx, xy, yy = ((one * two).sum(axis=(1, 2)) for one, two in ((gx, gx), (gx, gy), (gy, gy)))
        bx, by = ((one * left).sum(axis=(1, 2)) for one in (gx, gy))
        det = xx * yy - xy * xy
        dx, dy = (yy * bx - xy * by) / det, (xx * by - xy * bx) / det
        fine = np.isfinite(dx) & np.isfinite(dy)
    return np.where(fine, x + dx, x), np.where(fine, y + dy, y)
