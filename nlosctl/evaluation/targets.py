"""Scores of targets estimated from unlabelled echoes: their number, their echoes, their positions."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Hashable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.evaluation.error_statistics import ratio
from nlosctl.evaluation.estimates import FitTally
from nlosctl.evaluation.point_sets import SetDistance, set_distance
from nlosctl.evaluation.summaries import TargetSummary

__all__ = ["CASES", "EchoRows", "TargetScores", "case_of"]

CASES = ("i", "ii", "iii", "iv", "v", "vi")
"""The six cases of Liang, Zeng, Li, Fig. 2."""

_NO_TARGET = -1


@dataclass(frozen=True, kw_only=True)
class EchoRows:
    """The rows (R,) of one snapshot: estimated and true target (-1: none), whether flagged direct and truly direct.

    ``true_m`` (R, D) is the position of the row's true target in metres, NaN without one.
    """

    target: IntArray
    true_target: IntArray
    los: BoolArray
    true_los: BoolArray
    true_m: FloatArray


def case_of(true_target: IntArray, true_los: BoolArray) -> str:
    """Return the case of an estimated target from the truth of its rows: ``i`` is a true target, the others are false.

    A crossing of two direct echoes of the same target is a target intersection point (TIP). (i): only direct echoes
    of one target; (ii): at least one TIP, only direct echoes; (iii): at least one TIP, some indirect echoes; (iv),
    (v), (vi): no TIP, and all, some or no echoes are direct.
    """
    of_target = Counter(true_target[true_los].tolist())
    if not of_target:
        return "vi"
    all_direct = bool(true_los.all())
    if all_direct and len(of_target) == 1:
        return "i"
    if max(of_target.values()) >= 2:
        return "ii" if all_direct else "iii"
    return "iv" if all_direct else "v"


class TargetScores:
    """Estimated targets against true ones, snapshot by snapshot, by group."""

    def __init__(self, *, order: float = 2.0, cutoff_m: float = 20.0) -> None:
        self._order, self._cutoff_m = order, cutoff_m
        self._groups: dict[Hashable, _Tally] = {}

    def add(self, rows: EchoRows, estimated_m: FloatArray | None, key: Hashable = ("",)) -> None:
        """Add a snapshot: its rows, and the estimated targets (T, D), their positions.

        Further columns of them are the share of rows used, the p-value of the fit, and, of targets in tracks, the
        number of the track. With ``estimated_m`` None, targets are counted from the flags, and no distances are scored.
        """
        tally = self._groups.setdefault(key, _Tally())
        estimated = _sets(rows.target, rows.los)
        true = _sets(rows.true_target, rows.true_los)
        numbers = np.unique(rows.true_target[rows.true_target != _NO_TARGET])
        count = len(estimated) if estimated_m is None else estimated_m.shape[0]
        tally.snapshots += 1
        tally.true_targets += numbers.size
        tally.found_targets += count
        tally.number_right += count == numbers.size
        tally.exact += count == numbers.size and len(true) == numbers.size and set(estimated) == set(true)
        tally.confusion += np.bincount(2 * rows.true_los + rows.los, minlength=4)
        tally.cases.update(case_of(rows.true_target[[*echoes]], rows.true_los[[*echoes]]) for echoes in estimated)
        if estimated_m is not None:
            dimension = rows.true_m.shape[1]
            true_m = np.array([rows.true_m[rows.true_target == number][0] for number in numbers]).reshape(-1, dimension)
            estimated_m, fit, track = np.split(estimated_m, (dimension, dimension + 2), axis=1)
            if fit.shape[1]:
                tally.fit.add(np.isfinite(estimated_m[:, 0]), fit[:, 0], fit[:, 1])
            distance = set_distance(estimated_m, true_m, order=self._order, cutoff_m=self._cutoff_m)
            tally.add_distance(distance, estimated_m, true_m)
            if track.shape[1]:
                tally.add_tracks(numbers[distance.pairs[:, 1]], track[distance.pairs[:, 0], 0])

    def result(self) -> dict[Hashable, TargetSummary]:
        """Return the summary of each group, in order of first appearance."""
        return {key: tally.summary() for key, tally in self._groups.items()}

    def overall(self) -> TargetSummary:
        """Return the summary of all snapshots of all groups."""
        total = _Tally()
        for tally in self._groups.values():
            total.include(tally)
        return total.summary()


def _sets(target: IntArray, direct: BoolArray) -> list[tuple[int, ...]]:
    """Return the row indices of each target's direct echoes."""
    numbers = np.unique(target[(target != _NO_TARGET) & direct])
    return [tuple(np.flatnonzero((target == number) & direct).tolist()) for number in numbers]


_DISTANCES = (
    "ospa_m",
    "ospa_location_m",
    "ospa_number_m",
    "gospa_m",
    "gospa_location_m",
    "gospa_missed_m",
    "gospa_false_m",
)


@dataclass
class _Tally:
    """The running sums of one group."""

    snapshots: int = 0
    true_targets: int = 0
    found_targets: int = 0
    number_right: int = 0
    exact: int = 0
    matched: int = 0
    squared_error_m2: float = 0.0
    located: int = 0
    confusion: IntArray = field(default_factory=lambda: np.zeros(4, dtype=np.int64))
    cases: Counter[str] = field(default_factory=Counter)
    fit: FitTally = field(default_factory=FitTally)
    distances: FloatArray = field(default_factory=lambda: np.zeros(len(_DISTANCES)))
    switches: int | None = None
    last_track: dict[int, float] = field(default_factory=dict)

    def add_distance(self, distance: SetDistance, estimated_m: FloatArray, true_m: FloatArray) -> None:
        error = estimated_m[distance.pairs[:, 0]] - true_m[distance.pairs[:, 1]]
        self.located += 1
        self.matched += distance.pairs.shape[0]
        self.squared_error_m2 += float((error * error).sum())
        self.distances = self.distances + [getattr(distance, name) for name in _DISTANCES]

    def add_tracks(self, true_target: IntArray, track: FloatArray) -> None:
        """Count matched targets whose track is another one than when they were matched before."""
        now = dict(zip(true_target.tolist(), track.tolist(), strict=True))
        self.switches = (self.switches or 0) + sum(self.last_track.get(name, own) != own for name, own in now.items())
        self.last_track |= now

    def include(self, other: _Tally) -> None:
        self.fit.include(other.fit)
        if other.switches is not None:
            self.switches = (self.switches or 0) + other.switches
        for name in self.__dataclass_fields__.keys() - {"fit", "switches", "last_track"}:
            setattr(self, name, getattr(self, name) + getattr(other, name))

    def summary(self) -> TargetSummary:
        _, false_alarms, missed, hits = (int(number) for number in self.confusion)
        means: dict[str, Any] = {
            name: ratio(total, self.located) for name, total in zip(_DISTANCES, self.distances, strict=True)
        }
        return TargetSummary(
            snapshots=self.snapshots,
            true_targets=self.true_targets,
            found_targets=self.found_targets,
            number_right=ratio(self.number_right, self.snapshots),
            exact=ratio(self.exact, self.snapshots),
            los_precision=ratio(hits, hits + false_alarms),
            los_recall=ratio(hits, hits + missed),
            matched_targets=self.matched,
            matched_rmse_m=math.sqrt(ratio(self.squared_error_m2, self.matched)),
            mean_used_share=self.fit.mean_used_share,
            share_p_below_0001=self.fit.share_p_below_0001,
            identity_switches=self.switches,
            **means,
            **{f"case_{name}": self.cases[name] for name in CASES},
        )
