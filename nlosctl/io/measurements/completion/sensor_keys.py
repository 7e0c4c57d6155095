"""The sensors of a chunk by name, and by the values of further columns."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.io.measurements.column_mapping import NameCodes
from nlosctl.io.measurements.reader import Chunk
from nlosctl.io.readers.base import plain

__all__ = ["group_texts", "numbered", "sensor_keys", "sensor_texts"]

_MOST_CODES = 1 << 22
"""Codes below this are numbered by a table, larger ones by sorting."""


def sensor_texts(chunk: Chunk, of: str = "sensor") -> tuple[IntArray, list[str]]:
    """Return the code (N,) of each row's sensor, and the names that the codes number; one for a file of one station.

    ``of`` is the column: that of the sensors, or of the references of differences.
    """
    if of not in chunk.table.column_names:
        return np.zeros(chunk.left_out.shape, dtype=np.int64), ["the station"]
    return _texts(chunk, of)


def group_texts(chunk: Chunk, by: Sequence[str]) -> tuple[IntArray, list[tuple[str, ...]]]:
    """Return the code (N,) of each row's group, and the values of the columns ``by`` that the codes number."""
    groups: list[tuple[str, ...]] = [()]
    codes = np.zeros(chunk.left_out.shape, dtype=np.int64)
    for name in by:
        codes, groups = _paired(codes, groups, *_texts(chunk, name))
    return codes, groups


def sensor_keys(chunk: Chunk, by: Sequence[str], of: str = "sensor") -> tuple[IntArray, list[tuple[str, ...]]]:
    """Return the code (N,) of each row's sensor and group, and what the codes number: name, then values of ``by``.

    ``of`` as in `sensor_texts`.
    """
    codes, names = sensor_texts(chunk, of)
    groups, values = group_texts(chunk, by)
    codes, keys = _paired(codes, [(name,) for name in names], groups, values)
    return codes, keys


def _texts(chunk: Chunk, column: str) -> tuple[IntArray, list[str]]:
    """Return codes (N,) of the texts of a column, and the texts; an empty cell is an empty text."""
    names = NameCodes()
    codes = names.encode(plain(chunk.table.column(column)).combine_chunks())
    return codes, [*names.names, *([""] if (codes < 0).any() else [])]


def _paired(
    codes: IntArray, keys: Sequence[tuple[str, ...]], other: IntArray, further: Sequence[str | tuple[str, ...]]
) -> tuple[IntArray, list[tuple[str, ...]]]:
    """Return codes (N,) of the pairs of two codes that occur, and their keys."""
    pair = codes % len(keys) * len(further) + other % len(further)
    pairs, together = numbered(pair, len(keys) * len(further))
    ends = [(text,) if isinstance(text, str) else text for text in further]
    return together, [keys[pair // len(further)] + ends[pair % len(further)] for pair in pairs.tolist()]


def numbered(codes: IntArray, count: int) -> tuple[IntArray, IntArray]:
    """Return the codes (n,) that occur in an array of codes below ``count``, rising, and the index of each of those."""
    if count > _MOST_CODES:
        found, index = np.unique(codes, return_inverse=True)
        return found, index.reshape(codes.shape)
    occurs = np.zeros(count, dtype=bool)
    occurs[codes] = True
    return np.flatnonzero(occurs), (np.cumsum(occurs) - 1)[codes]
