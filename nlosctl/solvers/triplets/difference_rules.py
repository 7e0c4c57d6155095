"""Decision rules on triplets: the differences of the intersections against their own noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, ignoring_division, ignoring_invalid, ignoring_overflow
from nlosctl.geometry.directions import Vector, cross, direction_frame, dot, scaled, subtract
from nlosctl.geometry.triplets import AXES, DIFFERENCES, Quantity, TripletRays
from nlosctl.models.error_laws import ErrorLaw, exceedance, quantile
from nlosctl.models.triplets import PathRows, SpacePaths, distance_to_ellipse

__all__ = [
    "BLIND_WITHIN",
    "LINEAR_WITHIN",
    "Decision",
    "blind_rows",
    "decide",
    "decide_fusion",
    "rays_miss_by",
    "rule_quantity",
    "skew_rays_miss_by",
]


BLIND_WITHIN = 3.0
"""A rule counts as blind where its blind spot is within so many standard deviations of the measured triplet."""


LINEAR_WITHIN = 0.3
"""A rule counts as linear where its curvature, and the change of its standard deviation, are smaller shares."""


@dataclass(frozen=True)
class Decision:
    """The decision by one quantity (N,): its value and standard deviation in metres, and its p-value.

    ``weights_m`` are what one standard deviation of each measured value moves it by. All NaN where the quantity does
    not exist.
    """

    value_m: FloatArray
    std_m: FloatArray
    p_value: FloatArray
    weights_m: tuple[FloatArray, FloatArray, FloatArray]

    def threshold_m(self, law: ErrorLaw, false_alarm: float, eta_m: float) -> FloatArray:
        """Return the threshold (N,) in metres that the quantity exceeds with probability ``false_alarm``.

        Equation (27) for ``eta_m`` 0 (direct paths), else at a mean of ``eta_m``, the edge of the safe region (35).
        """
        with ignoring_division():
            shift = eta_m / self.std_m if eta_m > 0.0 else 0.0
            return quantile(law, false_alarm, self.weights_m, shift) * self.std_m


def rule_quantity(rays: TripletRays, rule: int | str) -> Quantity:
    """Return lambda 1 to 6, or for ``ellipse`` the distance of the crossing from the ellipse."""
    return distance_to_ellipse(rays) if rule == "ellipse" else rays.difference(int(rule))


def decide(rows: PathRows, quantity: Quantity, law: ErrorLaw, eta_m: float = 0.0) -> Decision:
    """Return how likely so large a quantity would be for a direct path, equations (19)-(27).

    With ``eta_m`` > 0: for a path whose noise-free quantity is ``eta_m``, the edge of the safe region (35).
    """
    weights = rows.weights_m(quantity)
    with ignoring_overflow():
        std = np.sqrt(weights[0] * weights[0] + weights[1] * weights[1] + weights[2] * weights[2])
        scaled = np.abs(quantity.value_m) / std
        p_value = exceedance(law, scaled, weights, eta_m / std if eta_m > 0.0 else 0.0)
    return Decision(quantity.value_m, std, p_value, weights)


def decide_fusion(p_values: list[FloatArray], more_than: int) -> FloatArray:
    """Return the p-value (N,) that more than so many rules decide for indirect: the (k+1)-th smallest.

    A rule whose difference does not exist (parallel rays) does not count; NaN if none of the six exists.
    """
    block = np.stack(p_values)
    unknown = np.isnan(block).all(axis=0)
    block[np.isnan(block)] = 1.0
    block.sort(axis=0)
    return np.where(unknown, np.nan, block[more_than])


def rays_miss_by(rows: PathRows) -> FloatArray:
    """Return by how many standard deviations (N,) of the two angles the rays miss each other; 0 where they meet.

    The least change of the two angles after which the rays meet: both turned until they are parallel, or, if they
    are on different sides of the baseline, also the departing one turned to the receiver or the arriving one to the
    transmitter. 0 where transmitter and receiver are one.
    """
    rays = rows.rays
    with ignoring_invalid():
        missing = rays.meets_behind & (rays.baseline_m > 0.0)
    apart = np.abs(np.arctan2(rays.crossing_sine, rays.crossing_cosine))
    parallel = apart / np.sqrt(rows.doa_std_rad**2 + rows.dod_std_rad**2)
    departing = np.arctan2(np.abs(rays.dod_sine), rays.dod_cosine) / rows.dod_std_rad
    arriving = np.arctan2(np.abs(rays.doa_sine), -rays.doa_cosine) / rows.doa_std_rad
    same_side = rays.dod_sine * rays.doa_sine > 0.0
    across = np.minimum(parallel, np.minimum(departing, arriving))
    return np.where(missing, np.where(same_side, parallel, across), 0.0)


def skew_rays_miss_by(rows: SpacePaths) -> FloatArray:
    """Return by how many standard deviations (N,) the rays of paths in space miss each other; 0 without elevations.

    Their distance over its standard deviation there; where they pass each other behind a node the angle between them.
    """
    batch = rows.batch
    if batch.dod_elevation_rad is None or batch.doa_elevation_rad is None:
        return np.zeros(rows.path_length_m.shape)
    ends = (
        (batch.dod_rad, batch.dod_std_rad, batch.dod_elevation_rad, batch.dod_elevation_std_rad),
        (batch.doa_rad, batch.doa_std_rad, batch.doa_elevation_rad, batch.doa_elevation_std_rad),
    )
    frames, stds = [], []
    for azimuth, std, elevation, elevation_std in ends:
        frames.append(direction_frame(azimuth[:, 0], elevation[:, 0]))
        stds.append((std[:, 0] * np.cos(elevation[:, 0]), np.asarray(elevation_std)[:, 0]))
    baseline, normal = scaled(rows.frame.axes[0], rows.frame.length_m), cross(frames[0][0], frames[1][0])
    with ignoring_division():
        # tx + s u = rx + r v, up to the common normal: s and r by the triple products.
        squared = dot(normal, normal)
        reach = [dot(cross(baseline, frames[end][0]), normal) / squared for end in (1, 0)]
        across = scaled(normal, 1.0 / np.sqrt(squared))
        spreads = [_angular_spread(across, frame, std) for frame, std in zip(frames, stds, strict=True)]
        miss = np.abs(dot(baseline, across)) / np.hypot(reach[0] * spreads[0], reach[1] * spreads[1])
        turn = subtract(frames[1][0], frames[0][0])
        aside = scaled(turn, 1.0 / np.sqrt(dot(turn, turn)))
        angle = np.arctan2(np.sqrt(squared), dot(frames[0][0], frames[1][0]))
        parallel = angle / np.hypot(
            *(_angular_spread(aside, frame, std) for frame, std in zip(frames, stds, strict=True))
        )
    ahead = (reach[0] > 0.0) & (reach[1] > 0.0)
    missing: FloatArray = np.nan_to_num(np.where(ahead, miss, np.fmin(miss, parallel)) * (rows.frame.length_m > 0.0))
    return missing


def _angular_spread(
    axis: Vector, frame: tuple[Vector, Vector, Vector], std_rad: tuple[FloatArray, FloatArray]
) -> FloatArray:
    """Return the standard deviation of a direction along an axis, radians."""
    return np.asarray(np.hypot(dot(axis, frame[1]) * std_rad[0], dot(axis, frame[2]) * std_rad[1]))


def blind_rows(rows: PathRows, rule: int | str) -> BoolArray:
    """Return where a rule is blind or its linearization breaks down (N,): Table I, and what it leaves out.

    lambda 1, 2 (3, 4): the difference slides along the departing (arriving) ray, and is blind where that is at right
    angles to the axis; 1 to 4 and ``ellipse``: nearly parallel rays (BS2). lambda 5 (6): points 2 and 3 mirror each
    other in the baseline (its perpendicular bisector); that holds for direct paths near the baseline (the
    bisector), too. Always where transmitter and receiver are one, and where the rule is curved.
    """
    rays = rows.rays
    single = ~(rays.baseline_m > 0.0) | _curved(rows, rule)
    if rule in (5, 6):
        return single | _mirrored(rows, int(rule))
    with ignoring_invalid():
        apart_std = np.sqrt(rows.doa_std_rad**2 + rows.dod_std_rad**2)
        parallel = np.abs(rays.crossing_sine) <= np.sin(np.minimum(BLIND_WITHIN * apart_std, 0.5 * np.pi))
    if rule == "ellipse":
        return single | parallel
    _, second, axis = DIFFERENCES[int(rule)]
    along = (rays.dod_cosine, rays.dod_sine) if second == 2 else (rays.doa_cosine, rays.doa_sine)
    std = rows.dod_std_rad if second == 2 else rows.doa_std_rad
    flat = np.abs(along[0] if axis == "x" else along[1])
    return single | parallel | (flat <= np.sin(np.minimum(BLIND_WITHIN * std, 0.5 * np.pi)))


def _curved(rows: PathRows, rule: int | str) -> BoolArray:
    """Return where a rule is not linear in the errors (N,), so that its p-value is wrong in the tails.

    Each of the three measured values is moved by three standard deviations to either side. The rule is curved where
    its quantity departs from the straight line, or its standard deviation changes, by more than `LINEAR_WITHIN`, as a
    share of what the linearization has for it.
    """
    quantity = rule_quantity(rows.rays, rule)
    zero = np.zeros(rows.dod_std_rad.shape)
    steps = [BLIND_WITHIN * std for std in (rows.doa_std_rad, rows.dod_std_rad, rows.path_length_std_m)]
    linear = np.isfinite(quantity.value_m)
    with ignoring_overflow():
        std = _spread(rows, quantity)
        for moved, step in enumerate(steps):
            ahead, back = (
                rule_quantity(rows.rays.moved(*(sign * step if k == moved else zero for k in range(3))), rule)
                for sign in (1.0, -1.0)
            )
            bend = np.abs(ahead.value_m + back.value_m - 2.0 * quantity.value_m)
            linear &= bend <= LINEAR_WITHIN * BLIND_WITHIN * std
            for side in (ahead, back):
                linear &= np.abs(_spread(rows, side) - std) <= LINEAR_WITHIN * std
    return np.isfinite(quantity.value_m) & ~linear


def _spread(rows: PathRows, quantity: Quantity) -> FloatArray:
    """Return the standard deviation (N,) of a quantity by linearization, metres."""
    w1, w2, w3 = rows.weights_m(quantity)
    return np.sqrt(w1 * w1 + w2 * w2 + w3 * w3)


def _mirrored(rows: PathRows, rule: int) -> BoolArray:
    """Return where points 2 and 3 are images of each other, within noise: in y for lambda 5, in x for lambda 6."""
    rays = rows.rays
    pairs = [
        rays.coordinate(2, axis) - rays.coordinate(3, axis)
        if (axis == "x") == (rule == 5)
        else rays.coordinate(2, axis) + rays.coordinate(3, axis)
        for axis in AXES
    ]
    blind = np.ones(rays.path_length_m.shape, dtype=bool)
    for quantity in pairs:
        w1, w2, w3 = rows.weights_m(quantity)
        with ignoring_overflow():
            square = quantity.value_m * quantity.value_m
            blind &= square <= BLIND_WITHIN**2 * (w1 * w1 + w2 * w2 + w3 * w3)
    return blind
