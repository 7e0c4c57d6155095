"""Dense batches of equal K from the flat columns of a chunk."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray, SeedArray
from nlosctl.contract.batches import Batch, batch_class
from nlosctl.contract.fields import Field, SensorsField
from nlosctl.contract.scene import Scene
from nlosctl.pipeline.solve.reference_rows import lacks_reference, with_reference_row

__all__ = ["dense_batch", "dense_blocks", "keep_freed_memory"]

Columns = Mapping[str, npt.NDArray[Any]]

_WHOLE_FIELD = SensorsField()

_LARGEST_KEPT = (32 << 20) - (64 << 10)
"""Just below the largest size to which glibc raises its thresholds."""


def dense_blocks(offsets: IntArray, kept: BoolArray, block_size: int) -> Iterator[tuple[IntArray, IntArray]]:
    """Yield the indices of snapshots (B,) and rows (B, K) of blocks that cover all snapshots of a chunk.

    ``offsets`` (S+1,) are row offsets, ``kept`` (N,) the rows that take part; K counts only those and may be 0. B is
    at most ``block_size``.
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
            row = first[snapshot][:, None] + within
            yield snapshot, kept_rows[row] if count else row


def dense_batch(
    kind: str,
    columns: Columns,
    row: IntArray,
    *,
    scene: Scene,
    dimension: int = 2,
    seed: SeedArray | None = None,
    field: Field = _WHOLE_FIELD,
    flags: bool = False,
    details: bool = False,
    trace: bool = False,
) -> Batch:
    """Return the dense batch of the rows (B, K) of flat ``columns``: read-only arrays in Fortran order.

    Only a batch in three dimensions has the heights and elevations among the columns.
    ``seed`` (B,) is the random seed of each snapshot, zeros by default; ``flags``, ``details`` and ``trace`` are what
    the batch asks of a method.
    """
    cls = batch_class(kind)
    arrays = {}
    sources = {**cls.SOURCES, **cls.OPTIONAL_SOURCES, **(cls.SPACE_SOURCES if dimension == 3 else {})}
    for name, parts in sources.items():
        if columns.keys() >= set(parts):
            arrays[name] = _gather(row, [columns[part] for part in parts])
        elif name in cls.ABSENT:
            arrays[name] = np.full(row.shape, cls.ABSENT[name], order="F")
            arrays[name].flags.writeable = False
    if dimension == 3 and "target_z_m" in columns and not np.isnan(columns["target_z_m"][row[:, 0]]).all():
        arrays |= {name: _gather(row[:, 0], [columns[name]]) for name in ("target_z_m", "target_z_std_m")}
    for name, (rest, origin) in cls.EXACT.items():
        arrays |= dict(zip((name, origin), _about_origin(columns[name][row], columns[rest][row]), strict=True))
    if lacks_reference(columns, row):
        arrays = with_reference_row(arrays, columns, row)
    batch: Batch = cls(
        scene=scene,
        field=field,
        dimension=dimension,
        seed=np.zeros(row.shape[0], dtype=np.uint64) if seed is None else seed,
        want_flags=flags,
        want_details=flags and details,
        want_trace=trace,
        **arrays,
    )
    return batch


@functools.cache
def keep_freed_memory() -> None:
    """Make glibc keep freed memory for the next block of snapshots; no effect with other C libraries.

    glibc returns a freed block to the system if it is larger than any block freed before, or if twice that size is free
    at the end of the heap: each block of snapshots would fault its pages in again, which takes a fifth of the time
    of the fast methods. Freeing one large array, whose pages are never touched, raises both thresholds for good.
    """
    np.empty(_LARGEST_KEPT, dtype=np.uint8)


def _gather(row: IntArray, parts: Sequence[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    dense = np.empty(row.shape if len(parts) == 1 else (*row.shape, len(parts)), dtype=parts[0].dtype, order="F")
    if len(parts) == 1:
        dense[...] = parts[0][row]
    else:
        for axis, part in enumerate(parts):
            dense[..., axis] = part[row]
    dense.flags.writeable = False
    return dense


def _about_origin(whole: FloatArray, rest: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return exact values (B, K), each a sum of two floats, about their least one, and that origin (B,)."""
    origin = whole.min(axis=1)
    about = np.asfortranarray((whole - origin[:, None]) + rest)
    about.flags.writeable = False
    return about, origin
