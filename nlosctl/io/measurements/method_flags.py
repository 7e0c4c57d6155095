"""Flags of several methods, or of a method's sweep, in one file: every measurement is there once for each, so they
can't be solved together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow.compute as pc

from nlosctl.arrays import IntArray
from nlosctl.contract.tables import SWEEP_PREFIX
from nlosctl.errors import DataError
from nlosctl.io.readers.base import plain

__all__ = ["METHOD", "are_flags_by_method", "refuse_several_methods"]

METHOD = "method"


def are_flags_by_method(names: Iterable[str]) -> bool:
    """Whether a file with these columns holds flags of an earlier step that tells its methods apart."""
    return {METHOD, "used"} <= set(names)


def refuse_several_methods(table: Any, starts: IntArray, file: str) -> None:
    """Raise DataError where a snapshot (beginning at ``starts``) of flags tells several methods or swept values."""
    swept = [name for name in table.column_names if name.startswith(SWEEP_PREFIX)]
    for column, what, cure in [
        (METHOD, "methods", "run the earlier step with one --method, or keep the rows of one method"),
        *(
            (name, "values of a sweep", "run the earlier step without --sweep, or keep the rows of one")
            for name in swept
        ),
    ]:
        values = plain(table.column(column).combine_chunks())
        if _differ_within_snapshots(values, starts):
            told = ", ".join(str(value) for value in pc.unique(values).drop_null().to_pylist())
            raise DataError(
                f"{file}, column {column!r}: flags of several {what} ({told}), so every measurement is there more than "
                f"once, expected those of one; {cure}"
            )


def _differ_within_snapshots(values: Any, starts: IntArray) -> bool:
    codes = pc.fill_null(pc.dictionary_encode(values).indices, -1).to_numpy(zero_copy_only=False)
    return bool(codes.size and (np.maximum.reduceat(codes, starts) > np.minimum.reduceat(codes, starts)).any())
