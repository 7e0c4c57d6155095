"""The columns ``sweep_KEY`` of results: which value of a swept parameter each row is of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import pyarrow as pa

from nlosctl.arrays import IntArray

__all__ = ["SWEEP_PREFIX", "SweepColumns"]

SWEEP_PREFIX = "sweep_"


@dataclass(frozen=True)
class SweepColumns:
    """The swept values of each run (or scenario), by parameter; null in the rows of a run that has no such one."""

    points: Sequence[Mapping[str, Any]] = ()

    @property
    def fields(self) -> list[Any]:
        """The Arrow fields, in the order of the parameters."""
        keys = dict.fromkeys(key for point in self.points for key in point)
        return [pa.field(f"{SWEEP_PREFIX}{key}", self._values(key).type) for key in keys]

    @property
    def names(self) -> list[str]:
        """The names of the columns."""
        return [field.name for field in self.fields]

    def take(self, name: str, point: IntArray) -> Any:
        """Return the column ``name`` for rows (N,) of the given points."""
        return self._values(name.removeprefix(SWEEP_PREFIX)).take(pa.array(point))

    def values(self) -> dict[str, list[Any]]:
        """Return the values of each swept parameter as plain values, each once."""
        keys = dict.fromkeys(key for point in self.points for key in point)
        return {key: list(dict.fromkeys(point[key] for point in self.points if key in point)) for key in keys}

    def _values(self, key: str) -> Any:
        values = [point.get(key) for point in self.points]
        kinds = {type(value) for value in values if value is not None}
        if kinds <= {int, float} and float in kinds:
            return pa.array(values, pa.float64())
        if len(kinds) > 1:
            return pa.array([None if value is None else str(value) for value in values], pa.string())
        return pa.array(values)
