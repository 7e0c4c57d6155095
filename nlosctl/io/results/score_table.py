"""Figures of an evaluation as an Arrow table: a row per group."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import pyarrow as pa

from nlosctl.contract.tables import SCORES, SWEEP_PREFIX

__all__ = ["score_table"]

_TYPES = {"number": pa.float64(), "integer": pa.int64(), "text": pa.string()}


def score_table(of: str, groups: Sequence[Mapping[str, Any]]) -> Any:
    """Return the figures of ``groups`` with the columns of the contract that they have; NaN and infinity are null.

    Counts by status become columns ``status_WORD``; curves are left out.
    """
    words = dict.fromkeys(word for group in groups for word in group.get("statuses", {}))
    rows = [_flat(of, group, words) for group in groups]
    known = set().union(*rows)
    fields = [pa.field(column.name, _TYPES[column.type]) for column in SCORES.columns if column.name in known]
    labels = [field for field in fields if field.type == pa.string()]
    swept = [
        pa.field(name, pa.array([row.get(name) for row in rows]).type)
        for name in rows[0]
        if name.startswith(SWEEP_PREFIX)
    ]
    schema = pa.schema([*labels, *swept, *(field for field in fields if field.type != pa.string())])
    return pa.Table.from_pylist(rows, schema=schema)


def _flat(of: str, group: Mapping[str, Any], words: Iterable[str]) -> dict[str, Any]:
    row: dict[str, Any] = {"of": of}
    for name, value in group.items():
        if name == "statuses":
            row |= {f"status_{word}": value.get(word, 0) for word in words}
        elif not isinstance(value, Mapping):
            row[name] = None if isinstance(value, float) and not math.isfinite(value) else value
    return row
