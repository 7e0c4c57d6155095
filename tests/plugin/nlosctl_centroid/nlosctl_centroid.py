"""The centroid of the crossings of all pairs of bearing lines, each crossing weighted by how square it is.

For direct paths alone: a snapshot with a mirrored row gets no answer. Written by the contract of nlosctl only.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Flags, Solution, single_estimates
from nlosctl.contract.statuses import Status


@dataclass(frozen=True, kw_only=True)
class CentroidOptions:
    """Parameters of ``crossings-centroid``."""

    min_crossing_deg: float = option(
        3.0, unit="deg", minimum=0.0, maximum=90.0, meaning="pairs of lines that cross more flatly are passed over"
    )


def solve(batch: BearingBatch, options: CentroidOptions) -> Solution:
    """Solve a batch; the covariance is the scatter of the crossings about their centroid."""
    size, measurements = batch.bearing_rad.shape
    # About the first sensor: squares of large coordinates would leave few digits.
    x = batch.sensor_xy_m[..., 0] - batch.sensor_xy_m[:, :1, 0]
    y = batch.sensor_xy_m[..., 1] - batch.sensor_xy_m[:, :1, 1]
    cosine, sine = np.cos(batch.bearing_rad), np.sin(batch.bearing_rad)
    total, total_x, total_y, total_xx, total_xy, total_yy = (np.zeros(size) for _ in range(6))
    crossings = np.zeros(size, dtype=np.int64)
    for i, j in combinations(range(measurements), 2):
        dx, dy = x[:, j] - x[:, i], y[:, j] - y[:, i]
        square = cosine[:, i] * sine[:, j] - sine[:, i] * cosine[:, j]
        good = np.abs(square) > max(np.sin(np.radians(options.min_crossing_deg)), 1e-9)
        divisor = np.where(good, square, 1.0)
        along = (dx * sine[:, j] - dy * cosine[:, j]) / divisor
        along_other = (dx * sine[:, i] - dy * cosine[:, i]) / divisor
        good &= (along > 0.0) & (along_other > 0.0)
        weight = np.where(good, square * square, 0.0)
        cross_x, cross_y = x[:, i] + along * cosine[:, i], y[:, i] + along * sine[:, i]
        crossings += good
        total += weight
        total_x += weight * cross_x
        total_y += weight * cross_y
        total_xx += weight * cross_x * cross_x
        total_xy += weight * cross_x * cross_y
        total_yy += weight * cross_y * cross_y
    divisor = np.where(total > 0.0, total, 1.0)
    mean_x, mean_y = total_x / divisor, total_y / divisor
    xx, xy, yy = total_xx / divisor - mean_x**2, total_xy / divisor - mean_x * mean_y, total_yy / divisor - mean_y**2
    scattered = (xx > 0.0) & (yy > 0.0) & (xx * yy - xy * xy > 1e-8 * xx * yy)
    status = np.full(size, Status.OK, dtype=np.uint8)
    status[(crossings < 3) | ~scattered] = Status.DEGENERATE
    status[_mirrored(batch)] = Status.NO_CANDIDATE
    if measurements < METHOD.minimum_measurements:
        status[:] = Status.TOO_FEW
    answered = status == Status.OK
    estimates = single_estimates(
        position_m=np.stack([mean_x, mean_y], axis=1) + batch.sensor_xy_m[:, 0] if measurements else np.zeros((size, 2)),
        covariance_m2=np.stack([xx, xy, yy], axis=1),
        cost=np.zeros(size),
        n_used=np.full(size, measurements, dtype=np.int64),
        status=status,
    )
    used = np.broadcast_to(answered[:, None], (size, measurements)).copy()
    return Solution(estimates=estimates, flags=Flags(used=used))


def _mirrored(batch: BearingBatch) -> np.ndarray:
    return (batch.reflector >= 0).any(axis=1)


METHOD = MethodSpec(
    name="crossings-centroid",
    kind="bearings",
    job="localize",
    summary="the centroid of the crossings of all pairs of lines, weighted by how square they cross",
    reference="folklore",
    options=CentroidOptions,
    solve=solve,
    cost="none (always 0)",
    minimum_measurements=3,
    contract_version=1,
)
