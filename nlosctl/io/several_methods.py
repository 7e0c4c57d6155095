"""Flags of several methods in one file: every measurement is there once for each, so they can't be solved together."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
import pyarrow.compute as pc

from nlosctl.contract.batches import IntArray
from nlosctl.errors import DataError
from nlosctl.io.names import plain

__all__ = ["METHOD", "are_flags_by_method", "refuse_several_methods"]

METHOD = "method"


def are_flags_by_method(names: Iterable[str]) -> bool:
    """Whether a file with these columns holds flags of an earlier step that tells its methods apart."""
    return {METHOD, "used"} <= set(names)


def refuse_several_methods(table: Any, starts: IntArray, file: str) -> None:
    """Raise DataError where a snapshot (beginning at ``starts``) of flags has rows of several methods."""
    names = plain(table.column(METHOD).combine_chunks())
    codes = pc.fill_null(pc.dictionary_encode(names).indices, -1).to_numpy(zero_copy_only=False)
    if codes.shape[0] == 0 or not (np.maximum.reduceat(codes, starts) > np.minimum.reduceat(codes, starts)).any():
        return
    methods = [str(name) for name in pc.unique(names).drop_null().to_pylist()]
    raise DataError(
        f"{file}, column 'method': flags of several methods ({', '.join(methods)}), so every measurement is there more "
        f"than once, expected those of one; run the earlier step with one --method, or keep the rows of one method"
    )
