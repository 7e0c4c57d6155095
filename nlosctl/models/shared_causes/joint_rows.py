"""All scalars of rows side by side, over their own stds, with the covariance of the errors that they share.

An error that rows have in common changes the residual of each by a derivative times the error: R = I + the sum over
the causes of e e', e the change of each scalar per standard deviation of the cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.geometry.blocks import RowBlock
from nlosctl.models.arrivals import arrival_rows
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, ScaledResiduals
from nlosctl.models.shared_causes.causes import SharedCauses
from nlosctl.models.shared_causes.error_slopes import ErrorSlopes, mirror_errors, sensor_slopes

__all__ = ["JointRows", "joint_rows"]

_LOST = 1e10
"""A scalar whose shared errors have so many times its own variance has no information."""


@dataclass(frozen=True)
class JointRows(RowBlock):
    """Residuals (B, S) of all scalars over their own stds, derivatives by the unknowns, shared covariance (B, S, S).

    ``row`` (B, S) is the index of each scalar's row, K of a measured height. The last ``nuisances`` unknowns (the
    offset of arrivals) are not coordinates of the position.
    """

    residual: FloatArray
    slopes: tuple[FloatArray, ...]
    shared: FloatArray
    row: IntArray
    nuisances: int = 0

    @property
    def own_share(self) -> FloatArray:
        """Each scalar's own variance (B, S) as a share of that with the errors that it shares."""
        return np.asarray(1.0 / (1.0 + np.diagonal(self.shared, axis1=1, axis2=2)))

    def only(self, kept: BoolArray) -> JointRows:
        """Return the rows without information in the scalars (B, S) that are not ``kept``."""
        both = kept[:, :, None] & kept[:, None, :]
        slopes = tuple(np.where(kept, slope, 0.0) for slope in self.slopes)
        shared = np.where(both, self.shared, 0.0)
        return replace(self, residual=np.where(kept, self.residual, 0.0), slopes=slopes, shared=shared)

    def of_rows(self, values: FloatArray, of_height: float) -> FloatArray:
        """Return values (B, K) of rows for their scalars (B, S); that of a measured height is ``of_height``."""
        padded = np.concatenate([values, np.full((values.shape[0], 1), of_height)], axis=1)
        return np.asarray(np.take_along_axis(padded, self.row, axis=1))


def joint_rows(kind: str, batch: Any, causes: SharedCauses, position_m: FloatArray, *, with_ranges: bool) -> JointRows:
    """Return the scalars of a batch at positions (B, D) with the errors that they share by the causes.

    The speed of arrivals, if it is uncertain, is one more cause. Raises UsageError for azimuths of geodesics.
    """
    exact = replace(batch, speed_std=None) if kind == "arrivals" else batch
    scalars = SCALED_RESIDUALS[kind](exact, position_m, with_ranges=with_ranges, with_height=True)
    shared = _Shared.of(scalars)
    slopes = sensor_slopes(kind, exact, position_m, scalars, causes, with_ranges=with_ranges)
    _add_sensors(shared, slopes, causes)
    if causes.mirrors:
        for errors in mirror_errors(exact, kind, position_m, scalars, with_ranges=with_ranges):
            shared.add([(errors, batch.reflector)])
    if kind == "arrivals" and batch.speed_std is not None:
        speed = arrival_rows(batch).speed
        assert speed is not None  # noqa: S101 - it is uncertain
        shared.add([([speed.std[:, None] * speed.effect], np.zeros(batch.arrival_m.shape, dtype=np.int64))])
    nuisances = int(kind == "arrivals" and batch.reference_xy_m is None)
    residual = np.concatenate([scalar.residual for scalar in scalars], axis=1)
    unknowns = zip(*(scalar.slopes for scalar in scalars), strict=True)
    joined = tuple(np.concatenate(parts, axis=1) for parts in unknowns)
    row = np.broadcast_to(shared.row, residual.shape).copy()
    rows = JointRows(residual, joined, shared.total, row, nuisances)
    lost = ~(np.diagonal(shared.total, axis1=1, axis2=2) < _LOST)
    return rows.only(~lost) if lost.any() else rows


def _add_sensors(shared: _Shared, slopes: Sequence[ErrorSlopes], causes: SharedCauses) -> None:
    """Add the errors of sensors, and of the references of differences."""
    nodes = [causes.sensors, *([] if causes.reference is None else [causes.reference])]
    pairs = list(zip(nodes, slopes, strict=True))
    if any(node.any_position for node in nodes):
        for axis in range(len(slopes[0].by_position)):
            shared.add([(_times(of.by_position[axis], node.position_std_m), node.sensor) for node, of in pairs])
    if any(node.offset_std.any() for node in nodes):
        shared.add([(_times(of.by_offset, node.offset_std), node.sensor) for node, of in pairs])
    if any(node.range_offset_std_m.any() for node in nodes):
        shared.add([(_times(of.by_range_offset, node.range_offset_std_m), node.sensor) for node, of in pairs])
    if causes.covariance.any():
        shared.add([(of.by_offset, node.entry) for node, of in pairs], causes.covariance)


def _times(blocks: Sequence[FloatArray], std: FloatArray) -> list[FloatArray]:
    return [block * std for block in blocks]


@dataclass(frozen=True)
class _Shared:
    """The sum of shared covariances (B, S, S) so far, and the row (S,) of each scalar."""

    total: FloatArray
    row: IntArray

    @classmethod
    def of(cls, scalars: Sequence[ScaledResiduals]) -> _Shared:
        size, count = scalars[0].residual.shape
        row = [np.arange(count) if scalar.of_rows else np.array([count]) for scalar in scalars]
        joined = np.concatenate(row)
        return cls(np.zeros((size, joined.size, joined.size)), joined)

    def add(self, terms: Sequence[tuple[Sequence[FloatArray], IntArray]], covariance: FloatArray | None = None) -> None:
        """Add the errors of causes: derivatives (B, K) of each block, and the number (B, K) of each row's cause.

        Causes have the variance 1 and are independent unless their ``covariance`` is given; -1 is no cause.
        """
        spread = [(self._scalars(blocks), self._causes(number)) for blocks, number in terms]
        for error, cause in spread:
            for other, of_other in spread:
                product = error[:, :, None] * other[:, None, :]
                self.total[...] += product * _common(cause, of_other, covariance)

    def _scalars(self, blocks: Sequence[FloatArray]) -> FloatArray:
        whole = np.zeros(self.total.shape[:2])
        given = np.concatenate(blocks, axis=1)
        whole[:, : given.shape[1]] = given
        return whole

    def _causes(self, number: IntArray) -> IntArray:
        padded = np.concatenate([number, np.full((number.shape[0], 1), -1)], axis=1)
        return np.asarray(padded[:, self.row])


def _common(cause: IntArray, other: IntArray, covariance: FloatArray | None) -> FloatArray | BoolArray:
    """Return the covariances (B, S, S) of the causes of scalars."""
    one, two = cause[:, :, None], other[:, None, :]
    if covariance is None:
        return np.asarray((one == two) & (one >= 0))
    padded = np.pad(covariance, (0, 1))
    return np.asarray(padded[one, two])
