"""What a run did: counted while it runs, told as a summary or as JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
from scipy.special import gammaincc

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.statuses import Status

__all__ = ["MethodTally", "RunReport"]

_BAD_FIT_P_VALUE = 1e-3
_BAD_FIT_SHARE = 0.05
_UNKNOWNS = 2
_VERDICTS = {"ip": ("direct", "indirect"), "los": ("not line of sight", "line of sight")}


@dataclass
class MethodTally:
    """Statuses of one method, and how often its residuals are larger than their stds explain."""

    statuses: Counter[str] = field(default_factory=Counter)
    tested: int = 0
    badly_fitted: int = 0
    on_edge: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)

    def add_verdicts(self, columns: Mapping[str, Any]) -> None:
        """Count what a detector's flag columns (N,) say."""
        for name, (false_word, true_word) in _VERDICTS.items():
            if name in columns:
                said = np.ma.MaskedArray(columns[name]).compressed().astype(bool)
                true = int(np.count_nonzero(said))
                self.verdicts.update({false_word: said.size - true, true_word: true})

    def add(self, status: npt.NDArray[np.uint8], cost: FloatArray, n_used: IntArray) -> None:
        """Count estimates (E,), best alternatives only; ``cost`` is half a chi-square, or NaN where it is not."""
        numbers = np.bincount(status, minlength=len(Status))
        self.statuses.update({Status(code).word: int(count) for code, count in enumerate(numbers) if count})
        testable = np.isfinite(cost) & (n_used > _UNKNOWNS)
        degrees = 0.5 * (n_used[testable] - _UNKNOWNS)
        self.tested += int(testable.sum())
        self.badly_fitted += int((gammaincc(degrees, cost[testable]) < _BAD_FIT_P_VALUE).sum())

    def counts(self) -> dict[str, Any]:
        """Return all counts as plain values, for `take`."""
        return {
            "statuses": dict(self.statuses),
            "tested": self.tested,
            "badly_fitted": self.badly_fitted,
            "on_edge": self.on_edge,
            "verdicts": dict(self.verdicts),
        }

    def take(self, counts: Mapping[str, Any]) -> None:
        """Add the counts of another part of the run."""
        self.statuses.update(counts["statuses"])
        self.verdicts.update(counts["verdicts"])
        self.tested += counts["tested"]
        self.badly_fitted += counts["badly_fitted"]
        self.on_edge += counts["on_edge"]

    @property
    def answered(self) -> int:
        """How many snapshots and targets got a position."""
        return sum(count for word, count in self.statuses.items() if Status[word.upper()].has_position)

    @property
    def fits_badly(self) -> bool:
        """Whether more than one in twenty estimates has residuals that chance explains once in a thousand times."""
        return self.badly_fitted > _BAD_FIT_SHARE * self.tested


@dataclass
class RunReport:
    """Counts of a run over measurements. ``snapshots_lost`` had bad rows only: they are not among ``snapshots``.

    ``flat_plane`` is the largest error of a plane on earth, by unit: see `nlosctl.pipeline.solve.flat_plane`.
    """

    kind: str
    inputs: list[dict[str, Any]]
    rows: int = 0
    rows_left_out: int = 0
    bad_rows: int = 0
    snapshots: int = 0
    snapshots_lost: int = 0
    methods: dict[str, MethodTally] = field(default_factory=dict)
    flat_plane: dict[str, tuple[float, ...]] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    _COUNTED: ClassVar[tuple[str, ...]] = ("rows", "rows_left_out", "bad_rows", "snapshots", "snapshots_lost")

    def counts(self) -> dict[str, Any]:
        """Return all counts as plain values, for `take`."""
        methods = {name: tally.counts() for name, tally in self.methods.items()}
        counted = {name: getattr(self, name) for name in self._COUNTED}
        return {**counted, "methods": methods, "inputs": self.inputs, "flat_plane": self.flat_plane}

    def take(self, counts: Mapping[str, Any]) -> None:
        """Add the counts of another part of the run, which follows those taken before."""
        for name in self._COUNTED:
            setattr(self, name, getattr(self, name) + counts[name])
        for name, tally in self.methods.items():
            tally.take(counts["methods"][name])
        for unit, worst in counts["flat_plane"].items():
            self.flat_plane[unit] = max(tuple(worst), self.flat_plane.get(unit, tuple(worst)))
        for given in counts["inputs"]:
            if self.inputs and self.inputs[-1]["name"] == given["name"]:
                self.inputs[-1] = {**given, "rows": self.inputs[-1]["rows"] + given["rows"]}
            else:
                self.inputs.append(dict(given))

    @property
    def unanswered(self) -> int:
        """How many estimates, over all methods, have no position; snapshots of bad rows alone count too."""
        return self.snapshots_lost + sum(
            sum(tally.statuses.values()) - tally.answered for tally in self.methods.values()
        )

    def lines(self) -> list[str]:
        """Return the summary, a line per input, method and note."""
        rows = f"{self.rows} rows"
        if self.rows_left_out:
            rows += f" ({self.rows_left_out} left out: flagged by an earlier step)"
        if self.bad_rows:
            rows += f", {self.bad_rows} bad rows set aside"
        names = ", ".join(str(given["name"]) for given in self.inputs[:3])
        more = f" and {len(self.inputs) - 3} more" if len(self.inputs) > 3 else ""
        snapshots = "1 snapshot" if self.snapshots == 1 else f"{self.snapshots} snapshots"
        lines = [f"{names}{more}: {snapshots} of {self.kind}, {rows}"]
        for name, tally in self.methods.items():
            told = [*tally.verdicts.items(), *sorted(tally.statuses.items(), key=_by_status)]
            lines.append(f"{name}: {', '.join(f'{count} {word}' for word, count in told) or 'nothing to solve'}")
        return [*lines, *(f"note: {note}" for note in self.notes)]

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        return {
            "kind": self.kind,
            "inputs": self.inputs,
            "rows": self.rows,
            "rows_left_out": self.rows_left_out,
            "bad_rows": self.bad_rows,
            "snapshots": self.snapshots,
            "snapshots_lost": self.snapshots_lost,
            "methods": {
                name: {
                    "statuses": dict(tally.statuses),
                    "answered": tally.answered,
                    "fits_badly": tally.fits_badly,
                    "verdicts": dict(tally.verdicts),
                }
                for name, tally in self.methods.items()
            },
            "notes": self.notes,
        }


def _by_status(item: tuple[str, int]) -> int:
    return Status[item[0].upper()]
