"""Arrow types of the declared columns, and the columns ``sweep_KEY`` of results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from nlosctl.arrays import IntArray
from nlosctl.contract.tables import SWEEP_PREFIX

__all__ = ["ARROW_TYPES", "SweepColumns"]

ARROW_TYPES = {
    "number": pa.float64(),
    "exact": pa.float64(),
    "integer": pa.int64(),
    "boolean": pa.bool_(),
    "text": pa.string(),
}
"""The Arrow type of each column type, except ``identifier``, which keeps the type of the file."""


@dataclass(frozen=True)
class SweepColumns:
    """The swept values of each run (or scenario), by parameter; null for a run without that parameter."""

    points: Sequence[Mapping[str, Any]] = ()

    @property
    def fields(self) -> list[Any]:
        """The Arrow fields, in the order of the parameters."""
        return [pa.field(f"{SWEEP_PREFIX}{key}", self._column(key).type) for key in self._keys()]

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return [f"{SWEEP_PREFIX}{key}" for key in self._keys()]

    def take(self, name: str, point: IntArray) -> Any:
        """Return the column ``name`` for rows (N,) whose runs have the indices ``point``."""
        return self._column(name.removeprefix(SWEEP_PREFIX)).take(pa.array(point))

    def values(self) -> dict[str, list[Any]]:
        """Return the distinct values of each swept parameter as plain values."""
        return {key: list(dict.fromkeys(point[key] for point in self.points if key in point)) for key in self._keys()}

    def _keys(self) -> list[str]:
        return list(dict.fromkeys(key for point in self.points for key in point))

    def _column(self, key: str) -> Any:
        values = [point.get(key) for point in self.points]
        types = {type(value) for value in values if value is not None}
        if types <= {int, float} and float in types:
            return pa.array(values, pa.float64())
        if len(types) > 1:
            return pa.array([None if value is None else str(value) for value in values], pa.string())
        return pa.array(values)
