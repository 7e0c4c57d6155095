"""Long Parquet files as slices of whole row groups, which can be read separately."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

from nlosctl.io.paths.inputs import Input, Part
from nlosctl.io.paths.locations import FileFormat
from nlosctl.io.readers.parquet_arrow import parquet_metadata

__all__ = ["sliced"]


def sliced(inputs: Sequence[Input], rows: int) -> tuple[Input, ...]:
    """Return the inputs with every Parquet file cut into parts of at least ``rows`` rows, between row groups.

    Other files stay whole.
    """
    return tuple(
        replace(given, parts=tuple(piece for part in given.parts for piece in _slices(part, rows))) for given in inputs
    )


def _slices(part: Part, rows: int) -> Iterator[Part]:
    if part.format is not FileFormat.PARQUET or part.path is None or part.row_groups is not None:
        yield part
        return
    metadata = parquet_metadata(part.path)
    start, count = 0, 0
    for index in range(metadata.num_row_groups):
        count += metadata.row_group(index).num_rows
        if count >= rows or index == metadata.num_row_groups - 1:
            yield replace(part, row_groups=(start, index + 1))
            start, count = index + 1, 0
    if not metadata.num_row_groups:
        yield part
