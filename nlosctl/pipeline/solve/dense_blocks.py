"""Ragged to dense: the snapshots of a chunk, grouped by their number of measurements, as blocks for a method."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, SeedArray
from nlosctl.contract.batches import Batch, batch_class
from nlosctl.contract.fields import Field, SensorsField
from nlosctl.contract.scene import Scene

__all__ = ["Block", "dense_blocks"]

_WHOLE_FIELD = SensorsField()
Columns = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, kw_only=True)
class Block:
    """Snapshots of equal K: ``snapshot`` (B,) and ``row`` (B, K) are their places in the chunk."""

    snapshot: IntArray
    row: IntArray

    def batch(
        self,
        kind: str,
        columns: Columns,
        scene: Scene,
        seed: SeedArray,
        *,
        field: Field = _WHOLE_FIELD,
        flags: bool,
        details: bool = False,
        trace: bool = False,
    ) -> Batch:
        """Return the dense batch of this block, its arrays read-only and in Fortran order.

        ``seed`` (S,) is of all snapshots of the chunk, ``columns`` are flat. ``flags``, ``details`` and ``trace`` say
        what the batch wants.
        """
        cls = batch_class(kind)
        arrays = {
            name: _dense(self.row, [columns[part] for part in parts])
            if columns.keys() >= set(parts)
            else _constant(self.row.shape, cls.ABSENT[name])
            for name, parts in cls.SOURCES.items()
            if columns.keys() >= set(parts) or name in cls.ABSENT
        }
        batch: Batch = cls(
            scene=scene,
            field=field,
            seed=seed[self.snapshot],
            want_flags=flags,
            want_details=flags and details,
            want_trace=trace,
            **arrays,
        )
        return batch


def dense_blocks(offsets: IntArray, kept: BoolArray, block_size: int) -> Iterator[Block]:
    """Yield blocks of at most ``block_size`` snapshots that cover all snapshots of a chunk.

    ``offsets`` (S+1,) are row offsets, ``kept`` (N,) the rows that take part; K counts those alone and may be 0.
    """
    kept_rows = np.flatnonzero(kept)
    kept_before = np.concatenate([[0], np.cumsum(kept)])
    first = kept_before[offsets[:-1]]
    counts = kept_before[offsets[1:]] - first
    for count in np.flatnonzero(np.bincount(counts)):
        members = np.flatnonzero(counts == count)
        within = np.arange(count, dtype=np.int64)
        for start in range(0, members.shape[0], block_size):
            snapshot = members[start : start + block_size]
            places = first[snapshot][:, None] + within
            yield Block(snapshot=snapshot, row=kept_rows[places] if count else places)


def _constant(shape: tuple[int, ...], value: float) -> FloatArray:
    constant = np.full(shape, value, order="F")
    constant.flags.writeable = False
    return constant


def _dense(row: IntArray, parts: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    shape = row.shape if len(parts) == 1 else (*row.shape, len(parts))
    dense = np.empty(shape, dtype=parts[0].dtype, order="F")
    if len(parts) == 1:
        dense[...] = parts[0][row]
    else:
        for axis, part in enumerate(parts):
            dense[..., axis] = part[row]
    dense.flags.writeable = False
    return dense
