"""Long Parquet files as slices of whole row groups: what can be read apart from the rest."""

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
        replace(given, parts=tuple(piece for part in given.parts for piece in _pieces(part, rows))) for given in inputs
    )


def _pieces(part: Part, rows: int) -> Iterator[Part]:
    if part.format is not FileFormat.PARQUET or part.path is None or part.row_groups is not None:
        yield part
        return
    told = parquet_metadata(part.path)
    begin, gathered = 0, 0
    for place in range(told.num_row_groups):
        gathered += told.row_group(place).num_rows
        if gathered >= rows or place == told.num_row_groups - 1:
            yield replace(part, row_groups=(begin, place + 1))
            begin, gathered = place + 1, 0
    if not told.num_row_groups:
        yield part
