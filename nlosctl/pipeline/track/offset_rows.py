"""Rows of measured tracks whose sensors have offsets that are not exactly known: of a calibration, or of the scene."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, ScaledResiduals
from nlosctl.models.shared_causes.causes import SharedCauses
from nlosctl.pipeline.solve.shared_causes.chunk_causes import Columns, batch_causes
from nlosctl.pipeline.solve.shared_causes.widened_rows import share_without_position, widened
from nlosctl.solvers.tracking.offset_factors import OffsetCauses
from nlosctl.solvers.tracking.path_rows import FollowedRows

__all__ = ["OffsetRows"]

_MEASURED = {"bearings": "bearing_rad", "ranges": "range_m", "arrivals": "arrival_m"}
_LEAST_SHARE = 1e-3
"""A range that is not longer than its offset becomes this share of its standard deviation: ranges are positive."""


@dataclass(frozen=True)
class OffsetRows:
    """Batches of B snapshots whose rows (B, K) of the ``columns`` (N,) have the indices ``row``.

    ``follow`` makes the rows that a path is compared with.
    ``with_ranges``: ranges beside bearings take part.
    """

    kind: str
    columns: Columns
    batches: Sequence[Any]
    row: Sequence[IntArray]
    calibration: Any
    follow: Callable[[Any], FollowedRows]
    with_ranges: bool

    @property
    def any_error(self) -> bool:
        """Whether an offset of some row is not exactly known."""
        return any(causes.std.any() for one in self.causes for causes in one)

    @cached_property
    def _shared(self) -> list[SharedCauses]:
        return [
            batch_causes(self.columns, row, batch, self.calibration)
            for row, batch in zip(self.row, self.batches, strict=True)
        ]

    @cached_property
    def causes(self) -> Sequence[Sequence[OffsetCauses]]:
        """The causes of the offsets of each block's rows, in the order of the file (B K, M), by quantity.

        Of differences two, of the sensor and of the reference.
        """
        sensors = 1 + max(int(shared.sensors.sensor.max(initial=0)) for shared in self._shared)
        return [self._of_block(shared, sensors) for shared in self._shared]

    def _of_block(self, shared: SharedCauses, sensors: int) -> list[OffsetCauses]:
        nodes, covariance = [shared.sensors], shared.covariance
        nodes += [] if shared.reference is None else [shared.reference]
        variance = np.append(np.diag(covariance), 0.0)
        number, std = [], []
        for sign, node in zip((1.0, -1.0), nodes, strict=False):
            own = np.where(node.entry >= 0, variance[node.entry] > 0.0, node.offset_std)
            std.append(sign * own.ravel())
            number.append(np.where(node.entry >= 0, node.entry, covariance.shape[0] + node.sensor).ravel())
        causes = [OffsetCauses(np.stack(number, axis=1), np.stack(std, axis=1), covariance)]
        if self.with_ranges:
            further = covariance.shape[0] + sensors + shared.sensors.sensor
            range_std = shared.sensors.range_offset_std_m
            causes.append(OffsetCauses(further.reshape(-1, 1), range_std.reshape(-1, 1), covariance))
        return causes

    def widened(self) -> Sequence[FollowedRows]:
        """Return the rows with the variances of the offsets added to their own."""
        rows = []
        for batch, shared in zip(self.batches, self._shared, strict=True):
            share = share_without_position(self.kind, batch, shared)
            rows.append(self.follow(widened(self.kind, batch, share)[0]))
        return rows

    def without(self, offset: Sequence[FloatArray]) -> Sequence[FollowedRows]:
        """Return the rows less offsets (Q, B, K) of each block."""
        return [self.follow(self._less(batch, one)) for batch, one in zip(self.batches, offset, strict=True)]

    def scalars(self, block: int, position_m: FloatArray, offset: FloatArray) -> Sequence[ScaledResiduals]:
        """Return the scalars that offsets change of a block's rows less offsets (Q, B, K), by quantity.

        Each row is compared with a position (B, K, D) of its own.
        """
        shape = position_m.shape[:2]
        batch = self._less(self._flat[block], offset.reshape(offset.shape[0], -1, 1))
        found = SCALED_RESIDUALS[self.kind](
            batch, position_m.reshape(-1, position_m.shape[2]), with_ranges=self.with_ranges, with_height=True
        )
        of_rows = [scalar for scalar in found if scalar.of_rows]
        if self.with_ranges:
            by_range = np.where(of_rows[-1].measured > 0.0, -1.0 / np.nan_to_num(batch.range_std_m, nan=1.0), 0.0)
            of_rows = [of_rows[0], dataclasses.replace(of_rows[-1], per_offset=by_range)]
        elif of_rows[0].per_offset is None:  # differences
            of_rows = [dataclasses.replace(of_rows[0], per_offset=-1.0 / batch.arrival_std_m)]
        return [_shaped(scalar, shape) for scalar in of_rows[: offset.shape[0]]]

    @cached_property
    def _flat(self) -> list[Any]:
        return [_apart(batch) for batch in self.batches]

    def _less(self, batch: Any, offset: FloatArray) -> Any:
        """Return a batch whose measurements are less offsets (Q, B, K); ranges stay positive."""
        name = _MEASURED[self.kind]
        changed = {name: getattr(batch, name) - offset[0]}
        if self.with_ranges:
            changed["range_m"] = batch.range_m - offset[1]
        if "range_m" in changed:
            given, std = batch.range_m, batch.range_std_m
            changed["range_m"] = np.maximum(changed["range_m"], np.minimum(given, _LEAST_SHARE * std))
        return dataclasses.replace(batch, **{key: np.asfortranarray(values) for key, values in changed.items()})


def _apart(batch: Any) -> Any:
    """Return the batch of the rows of B snapshots (B, K) one by one, (B K, 1)."""
    size, count = batch.sensor.shape
    changed = {}
    for field in dataclasses.fields(batch):
        values = getattr(batch, field.name)
        if not isinstance(values, np.ndarray):
            continue
        if values.shape[:2] == (size, count):
            changed[field.name] = np.asfortranarray(values.reshape(size * count, 1, *values.shape[2:]))
        elif values.shape == (size,):
            changed[field.name] = np.repeat(values, count)
    return dataclasses.replace(batch, **changed)


def _shaped(scalar: ScaledResiduals, shape: tuple[int, ...]) -> ScaledResiduals:
    """Return scalars of rows (N, 1) one by one as (B, K)."""
    assert scalar.per_offset is not None  # noqa: S101 - an offset changes it
    return ScaledResiduals(
        scalar.residual.reshape(shape),
        tuple(slope.reshape(shape) for slope in scalar.slopes),
        scalar.measured.reshape(shape),
        scalar.per_offset.reshape(shape),
    )
