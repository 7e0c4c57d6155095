"""Ranges of the values in the columns of a file, and columns whose values are suspicious."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.contract.tables import KINDS, measured_names
from nlosctl.pipeline.describe.suspicions import Suspicion

__all__ = ["ValueRanges"]

_FEWEST_ROWS = 3
_TURNS_DEG = {"deg": 360.0, "mdeg": 360e3}


@dataclass
class ValueRanges:
    """Least and largest value of each column of numbers; ``add`` takes the columns of a chunk as arrays (N,)."""

    rows: int = 0
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    counts: dict[str, int] = field(default_factory=dict)
    beyond_turn: dict[str, int] = field(default_factory=dict)

    def add(self, columns: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take the rows of a chunk; text and truth values are passed over."""
        self.rows += next((values.shape[0] for values in columns.values()), 0)
        for name, values in columns.items():
            if values.dtype.kind != "f":
                continue
            finite = values[np.isfinite(values)]
            self.counts[name] = self.counts.get(name, 0) + finite.size
            if not finite.size:
                continue
            low, high = float(finite.min()), float(finite.max())
            least, most = self.limits.get(name, (low, high))
            self.limits[name] = min(low, least), max(high, most)
            turn = _TURNS_DEG.get(name.rpartition("_")[2])
            if turn is not None and name in measured_names():
                self.beyond_turn[name] = self.beyond_turn.get(name, 0) + int(np.count_nonzero(np.abs(finite) > turn))

    def as_dict(self) -> dict[str, dict[str, float]]:
        """Return the ranges as plain values."""
        return {name: {"min": low, "max": high} for name, (low, high) in self.limits.items()}

    def suspicions(self, kind: str, sensors: int) -> Iterator[Suspicion]:
        """Yield columns of zeros, constant measured values, and angles beyond a turn."""
        places = {
            name
            for column in KINDS[kind].all_columns
            if column.earth_place not in ("", "truth", "prior")
            for name in column.accepted_names
        }
        for name, (low, high) in self.limits.items():
            count = self.counts[name]
            if low != high or count < _FEWEST_ROWS:
                continue
            if low == 0.0 and (name in measured_names() or (name in places and sensors > 1)):
                text = f"all {count} values of column {name!r} are 0: is it filled?"
                yield Suspicion(what="all_zeros", column=name, rows=count, text=text)
            elif name in measured_names():
                text = f"all {count} values of column {name!r} are {low:g}: do they come from a measurement?"
                yield Suspicion(what="constant", column=name, rows=count, text=text)
        for name, count in self.beyond_turn.items():
            if count:
                text = f"{count} values of column {name!r} are beyond a turn (360 degrees): is the unit right?"
                yield Suspicion(what="beyond_360", column=name, rows=count, text=text)
