"""Rows of a record batch chosen by index: their numbers, lines, original text and faults stay with them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa

from nlosctl.arrays import BoolArray
from nlosctl.io.readers.base import RecordBatch

__all__ = ["kept_rows", "normalized", "text_cells"]


def kept_rows(batch: RecordBatch, keep: BoolArray, setting: str) -> RecordBatch:
    """Return the rows where ``keep`` (N,) is true; the others are counted under ``setting``."""
    if keep.all():
        return batch
    mask = pa.array(keep)
    index = np.cumsum(keep) - 1
    dropped = int(keep.shape[0] - keep.sum())
    return replace(
        batch,
        table=batch.table.filter(mask),
        text=None if batch.text is None else batch.text.filter(mask),
        rows=batch.row_numbers()[keep],
        lines=None if batch.lines is None else batch.lines[keep],
        cell_faults=[replace(cell, index=int(index[cell.index])) for cell in batch.cell_faults if keep[cell.index]],
        origins={name: words[keep] for name, words in batch.origins.items()},
        left_out={**batch.left_out, setting: batch.left_out.get(setting, 0) + dropped},
    )


def text_cells(batch: RecordBatch, column: str) -> Any:
    """Return the original cells of a column, None if the reader did not convert text."""
    if batch.text is None or column not in batch.text.schema.names:
        return None
    return batch.text.column(column)


def normalized(text: str) -> str:
    """Return a value of an option without blanks and one pair of quotes around it."""
    text = text.strip()
    return text[1:-1] if len(text) > 1 and text[0] == text[-1] and text[0] in "'\"" else text
