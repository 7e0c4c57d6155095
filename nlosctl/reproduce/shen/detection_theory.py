"""Theory of the difference rules: P_f, P_d, outage and blind spots of Shen, Molisch 2012, Section IV.

For one transmitter, receiver and target, and indirect paths via one of any number of reflectors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import ndtr, ndtri

from nlosctl.arrays import FloatArray
from nlosctl.geometry.triplets import baseline_frames
from nlosctl.models.object_paths import ObjectPaths, signal_to_noise, trace_over_objects, triplet_standard_deviations
from nlosctl.models.triplets import PathRows
from nlosctl.solvers.triplets.difference_rules import rule_quantity

__all__ = [
    "ORDERS",
    "TABLE_I",
    "BlindSpots",
    "DetectionScene",
    "blind_spots",
    "detection_probability",
    "false_alarm_probability",
    "mean_detection_probability",
    "outage_probabilities",
    "outage_probability",
    "reflector_grid",
    "rule_moments",
    "scene_detection_probability",
]

Order = Literal["reflector first", "target first"]
Rule = int | str

ORDERS: tuple[Order, Order] = ("reflector first", "target first")
"""Order in which a path meets the two."""

TABLE_I: dict[int, tuple[str, str, str]] = {
    1: ("reflector on the DOD or DOA line", "alpha -> 0 (DOD parallel to DOA), beta -> 0", "mu2 = pi/2"),
    2: ("reflector on the DOD or DOA line", "alpha -> 0 (DOD parallel to DOA), beta -> 0", "mu2 = 0 or pi"),
    3: ("reflector on the DOD or DOA line", "alpha -> 0 (DOD parallel to DOA), gamma -> 0", "mu1 = pi/2"),
    4: ("reflector on the DOD or DOA line", "alpha -> 0 (DOD parallel to DOA), gamma -> 0", "mu1 = 0 or pi"),
    5: ("reflector on the DOD or DOA line", "beta -> 0, gamma -> 0", "does not exist (above the baseline)"),
    6: ("reflector on the DOD or DOA line", "beta -> 0, gamma -> 0", "mu1 + mu2 = pi"),
}
"""Table I: the three kinds of blind spots of lambda 1 to 6."""


@dataclass(frozen=True, kw_only=True)
class DetectionScene:
    """Transmitter, receiver and target (x, y in metres), and the transmitted power, for the noise (37)-(40)."""

    tx_m: tuple[float, float] = (-2.5, 0.0)
    rx_m: tuple[float, float] = (2.5, 0.0)
    target_m: tuple[float, float]
    power_dbm: float = 1.0

    def indirect_rows(self, reflector_xy_m: FloatArray, order: Order) -> PathRows:
        """Return noise-free indirect paths via reflectors (N, 2), with the standard deviations of their noise."""
        target = np.broadcast_to(np.array(self.target_m), reflector_xy_m.shape)
        objects = (reflector_xy_m, target) if order == "reflector first" else (target, reflector_xy_m)
        return self._rows(trace_over_objects(*self._nodes(), np.stack(objects, axis=1)))

    def direct_row(self) -> PathRows:
        """Return the noise-free direct path as one row."""
        return self._rows(trace_over_objects(*self._nodes(), np.array([[self.target_m]])))

    def _nodes(self) -> tuple[FloatArray, FloatArray]:
        return np.array([self.tx_m]), np.array([self.rx_m])

    def _rows(self, paths: ObjectPaths) -> PathRows:
        size = paths.path_length_m.shape[0]
        nodes = [np.full(size, value) for value in (*self.tx_m, *self.rx_m)]
        frame = baseline_frames(*nodes)
        rays = frame.rays(paths.dod_rad, paths.doa_rad, paths.path_length_m)
        snr = signal_to_noise(self.power_dbm, paths.legs_m)
        dod_std, doa_std, length_std = triplet_standard_deviations(snr, rays.dod_sine, rays.doa_sine)
        return PathRows(
            frame=frame,
            rays=rays,
            dod_std_rad=dod_std,
            doa_std_rad=doa_std,
            path_length_std_m=length_std,
            shape=(size, 1),
        )


def rule_moments(rows: PathRows, rule: Rule) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation (N,) in metres of a rule's quantity at noise-free triplets; (19), (24)."""
    quantity = rule_quantity(rows.rays, rule)
    w1, w2, w3 = rows.weights_m(quantity)
    return quantity.value_m, np.sqrt(w1 * w1 + w2 * w2 + w3 * w3)


def false_alarm_probability(threshold_m: FloatArray | float, std_m: FloatArray | float) -> FloatArray:
    """Return P(|lambda| > threshold) for a direct path, equation (26) with Q normalized by sqrt(2 pi)."""
    return np.asarray(2.0 * ndtr(-np.asarray(threshold_m) / std_m))


def detection_probability(mean_m: FloatArray, std_m: FloatArray, false_alarm: float) -> FloatArray:
    """Return P(|lambda| > delta) for indirect paths with that mean, delta = Q^-1(P_f / 2) std; equations (27), (33)."""
    return outage_probability(mean_m, std_m, -float(ndtri(0.5 * false_alarm)) * std_m)


def outage_probability(mean_m: FloatArray, std_m: FloatArray, threshold_m: FloatArray | float) -> FloatArray:
    """Return P(|lambda| > threshold) for paths whose noise-free lambda is ``mean_m``; NaN where it is NaN."""
    return np.asarray(ndtr((mean_m - threshold_m) / std_m) + ndtr((-mean_m - threshold_m) / std_m))


def outage_probabilities(
    mean_m: FloatArray, std_m: FloatArray, threshold_m: float, eta_m: float
) -> tuple[float, float]:
    """Return both outage probabilities of (36) over paths (N,): inside the safe region |mean| <= eta, and outside.

    NaN without paths in the region.
    """
    outage = outage_probability(mean_m, std_m, threshold_m)
    inside = np.abs(mean_m) <= eta_m
    return _mean(outage[inside]), _mean(outage[~inside])


def scene_detection_probability(
    scene: DetectionScene, reflector_xy_m: FloatArray, rule: Rule, false_alarm: float, order: Order
) -> FloatArray:
    """Return P_d (N,) by (33) for paths via the target and each of the reflectors (N, 2)."""
    return detection_probability(*rule_moments(scene.indirect_rows(reflector_xy_m, order), rule), false_alarm)


def mean_detection_probability(
    scene: DetectionScene,
    rule: Rule,
    false_alarm: float,
    *,
    x_m: tuple[float, float],
    y_m: tuple[float, float],
    points: int = 200,
) -> float:
    """Return P_d by (33) averaged over reflectors uniform in a rectangle, both orders equally likely.

    By the midpoint rule on ``points`` squared reflectors; undefined P_d count as 0.
    """
    grid = reflector_grid(x_m, y_m, points)
    both = [scene_detection_probability(scene, grid, rule, false_alarm, order) for order in ORDERS]
    return _mean(np.nan_to_num(np.concatenate(both)))


def reflector_grid(x_m: tuple[float, float], y_m: tuple[float, float], points: int) -> FloatArray:
    """Return the midpoints (points^2, 2) of a rectangle's cells, y varying fastest."""
    share = (np.arange(points) + 0.5) / points
    x, y = x_m[0] + share * (x_m[1] - x_m[0]), y_m[0] + share * (y_m[1] - y_m[0])
    return np.stack([np.repeat(x, points), np.tile(y, points)], axis=1)


@dataclass(frozen=True)
class BlindSpots:
    """Fields (N,) over reflectors whose zero lines are a rule's blind spots in Fig. 4.

    ``off_dod_line_m``, ``off_doa_line_m`` (BS1): signed distances of the reflector from the lines from transmitter and
    receiver to the target; only the part of a line before or beyond the target is blind, depending on the path's order.
    ``divisor`` (BS2): the product of alpha, beta, gamma by which the rule divides, in sine form. ``mean_m`` (BS3, and
    BS1): the noise-free lambda.
    """

    off_dod_line_m: FloatArray
    off_doa_line_m: FloatArray
    divisor: FloatArray
    mean_m: FloatArray


def blind_spots(scene: DetectionScene, reflector_xy_m: FloatArray, rule: int, order: Order) -> BlindSpots:
    """Return the blind-spot fields of lambda 1 to 6 over reflectors (N, 2), equation (34) and Table I."""
    rows = scene.indirect_rows(reflector_xy_m, order)
    rays = rows.rays
    alpha = rays.crossing_sine
    # beta, gamma: sines of the angle between departing (arriving) ray and ellipse; never 0 from a focus inside it.
    beta, gamma = (
        1.0 - rays.baseline_m * cosine / rays.path_length_m for cosine in (rays.dod_cosine, -rays.doa_cosine)
    )
    divisor = {1: alpha * beta, 2: alpha * beta, 3: alpha * gamma, 4: alpha * gamma, 5: beta * gamma, 6: beta * gamma}
    target = np.array(scene.target_m)
    return BlindSpots(
        off_dod_line_m=_off_line(np.array(scene.tx_m), target, reflector_xy_m),
        off_doa_line_m=_off_line(np.array(scene.rx_m), target, reflector_xy_m),
        divisor=divisor[rule],
        mean_m=rays.difference(rule).value_m,
    )


def _off_line(node: FloatArray, target: FloatArray, xy_m: FloatArray) -> FloatArray:
    along, offset = target - node, xy_m - node
    return np.asarray((along[0] * offset[:, 1] - along[1] * offset[:, 0]) / np.hypot(along[0], along[1]))


def _mean(values: FloatArray) -> float:
    return float(np.mean(values)) if values.size else float("nan")
