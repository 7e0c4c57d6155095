"""Some rows of a block (B, K) as flat arrays (N,) with their indices, each about the centre of a circle or sphere."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, IntArray, ScalarT
from nlosctl.geometry.blocks import gather_rows, rows_of

__all__ = ["SelectedRows", "SpaceRows"]


@dataclass(frozen=True)
class SelectedRows:
    """N rows of a block. Sensors are given about the circle's centre, the centre about the snapshot's local origin.

    ``snapshot`` and ``measurement`` are the row's indices in the block of ``shape`` (B, K); rows are ordered by
    measurement, then by snapshot.
    """

    shape: tuple[int, int]
    snapshot: IntArray
    measurement: IntArray
    sensor_x: FloatArray
    sensor_y: FloatArray
    center_x: FloatArray
    center_y: FloatArray

    def place_in(self, block: npt.NDArray[ScalarT], values: npt.NDArray[ScalarT]) -> None:
        """Write ``values`` (N,) into a block (B, K)."""
        block[self.snapshot, self.measurement] = values

    def pick_from(self, block: npt.NDArray[ScalarT]) -> npt.NDArray[ScalarT]:
        """Return the values (N,) of a block (B, K)."""
        return block[self.snapshot, self.measurement]

    def whole_block(self, values: FloatArray, snapshots: int) -> FloatArray:
        """Return ``values`` (N,) as the block (B, K), without a copy; the rows must be all there are of it."""
        return values.reshape(-1 if snapshots else 0, snapshots).T

    def take(self, rows: IntArray) -> Self:
        """Return the rows of some snapshots of the block, in any order and with repetitions."""
        number = np.full(self.shape, -1, dtype=np.int64, order="F")
        self.place_in(number, np.arange(self.snapshot.shape[0]))
        taken = gather_rows(number, rows).T
        measurement, snapshot = np.nonzero(taken >= 0)
        part = self.picked(taken[measurement, snapshot])
        return replace(part, shape=(rows.shape[0], self.shape[1]), snapshot=snapshot, measurement=measurement)

    def picked(self, rows: IntArray) -> Self:
        """Return some of the N rows, in any order and with repetitions, with their indices in the block."""
        arrays: dict[str, Any] = {name: rows_of(value, rows) for name, value in vars(self).items() if name != "shape"}
        return replace(self, **arrays)

    def of_measurement(self, k: int) -> Self:
        """Return the rows of measurement ``k``."""
        return self.picked(self.span(k))

    def span(self, k: int) -> IntArray:
        """Return which of the N rows are of measurement ``k``: rows are ordered by measurement."""
        return np.arange(*np.searchsorted(self.measurement, (k, k + 1)))

    def one_of_each(self, chosen: IntArray) -> Self:
        """Return the rows of a block (B, 1) that consists of the measurement ``chosen`` (B,) of each snapshot."""
        rows = np.flatnonzero(self.measurement == chosen[self.snapshot])
        part = self.picked(rows[np.argsort(self.snapshot[rows], kind="stable")])
        return replace(part, shape=(self.shape[0], 1), measurement=np.zeros(rows.shape, dtype=np.int64))

    @property
    def sensor(self) -> tuple[FloatArray, ...]:
        """The coordinates (N,) of the sensors about the centres."""
        return self.sensor_x, self.sensor_y

    @property
    def center(self) -> tuple[FloatArray, ...]:
        """The coordinates (N,) of the centres."""
        return self.center_x, self.center_y

    def about(self, *origin: FloatArray) -> Self:
        """Return the same rows with their centres about local origins, D arrays (B,)."""
        shifted: dict[str, Any] = {
            f"center_{axis}": middle - part[self.snapshot]
            for axis, middle, part in zip("xyz"[: len(origin)], self.center, origin, strict=True)
        }
        return replace(self, **shifted)

    def about_center(self, *point: FloatArray) -> tuple[FloatArray, ...]:
        """Return points, D arrays (B,) about the local origins, about the centre of each row (N,)."""
        return tuple(part[self.snapshot] - middle for part, middle in zip(point, self.center, strict=True))


@dataclass(frozen=True)
class SpaceRows(SelectedRows):
    """Rows in space, about the centre of a sphere."""

    sensor_z: FloatArray
    center_z: FloatArray

    @property
    def sensor(self) -> tuple[FloatArray, ...]:
        """The coordinates (N,) of the sensors about the centres."""
        return self.sensor_x, self.sensor_y, self.sensor_z

    @property
    def center(self) -> tuple[FloatArray, ...]:
        """The coordinates (N,) of the centres."""
        return self.center_x, self.center_y, self.center_z
