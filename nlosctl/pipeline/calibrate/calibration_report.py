"""The calibration that an estimate of offsets makes, and what the summary states of it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl.contract.calibration import OFFSETS, Calibration, SensorOffset
from nlosctl.io.calibrations.calibration_file import calibration_to_toml
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.io.results.layouts import TRUTH_NAMES
from nlosctl.pipeline.calibrate.offset_passes import MOST_PASSES, OffsetEstimate
from nlosctl.pipeline.calibrate.offset_sums import OffsetSums
from nlosctl.solvers.calibration.offset_solution import Combination
from nlosctl.version import __version__

__all__ = ["CalibrationReport"]

_FEWEST_PLACES = 10
_MOST_NAMES = 10
_DIRECTIONS = "; a deviation that depends on the direction may be (`harmonics`)"

_OUTLIERS = "; if some rows are outliers, set `method` to mixture-ml"

_BAD_FIT = 3.0
"""Residuals this many times as large as the stated standard deviations are not those of an offset."""


def _calibration_of(estimate: OffsetEstimate, kind: str, by: Sequence[str]) -> Calibration:
    """Return the calibration of an estimate, in the unit of files."""
    scale, solution = OFFSETS[kind].scale, estimate.solution
    std = np.sqrt(np.diag(solution.covariance)) / scale
    entries = tuple(
        SensorOffset(
            name=key[0],
            group=key[1:],
            offset=float(estimate.offsets[index]) / scale if solution.determined[index] else 0.0,
            std=float(std[index]) if solution.determined[index] else None,
            std_scale=float(estimate.scale[index]),
            std_dof=None if np.isnan(estimate.degrees[index]) else float(estimate.degrees[index]),
        )
        for index, key in enumerate(estimate.keys)
    )
    order = np.flatnonzero(solution.determined)
    covariance = solution.covariance[np.ix_(order, order)] / scale**2
    return Calibration(kind=kind, entries=entries, by=tuple(by), order=tuple(map(int, order)), covariance=covariance)


@dataclass(kw_only=True)
class CalibrationReport:
    """The summary of a calibration: what was read, what was found, and remarks on it.

    ``prior`` is the std of the prior in the unit of files, None without one; ``truth`` is whether the positions are
    known. ``advice`` is on snapshots that do not fit by themselves.
    """

    calibration: Calibration
    estimate: OffsetEstimate
    reader: MeasurementReader
    method: str
    prior: float | None = None
    truth: bool = False
    advice: list[str] = field(default_factory=list)

    @classmethod
    def of(
        cls, estimate: OffsetEstimate, sums: OffsetSums, reader: MeasurementReader, prior_std: float | None
    ) -> CalibrationReport:
        """Return the report of the passes of ``sums``; ``prior_std`` is in the unit of the measurements."""
        return cls(
            calibration=_calibration_of(estimate, sums.kind, sums.by),
            estimate=estimate,
            reader=reader,
            method=sums.run.label,
            prior=None if prior_std is None else prior_std / OFFSETS[sums.kind].scale,
            truth=sums.truth is not None,
        )

    def toml(self) -> str:
        """Return the calibration as the text of its file."""
        return calibration_to_toml(self.calibration, self._facts())

    def _facts(self) -> dict[str, Any]:
        """Return what the file records beside the offsets."""
        estimate = self.estimate
        lost = [self._names(part) for part in estimate.solution.lost]
        return {
            "kind": self.calibration.kind,
            "method": self.method,
            "known_positions": "yes" if self.truth else "no",
            "snapshots": estimate.snapshots,
            "positions": sum(estimate.places.values()),
            "passes": estimate.passes,
            "prior_std": self.prior,
            "not_determined": lost or None,
            "version": __version__,
        }

    def lines(self) -> list[str]:
        """Return the summary."""
        read = self.reader.report
        names = list(read.rows_by_file)
        more = f" and {len(names) - 3} more" if len(names) > 3 else ""
        bad = f", {_counted(read.bad_rows, 'bad row')} set aside" if read.bad_rows else ""
        return [
            f"{', '.join(names[:3])}{more}: {_counted(read.snapshots, 'snapshot')} of {self.calibration.kind}, "
            f"{_counted(read.rows, 'row')}{bad}",
            f"{self.method}: {self._result()}",
            *(f"note: {note}" for note in self.notes()),
        ]

    def _result(self) -> str:
        estimate, unit = self.estimate, self.calibration.quantity.unit
        shown = [
            f"{' '.join(entry.key)} {entry.offset:.4g}{'' if entry.std is None else f' +- {entry.std:.2g}'} {unit}, "
            f"std x {entry.std_scale:.3g}"
            for entry in self.calibration.entries
        ]
        return (
            f"offsets by {_counted(estimate.snapshots, 'snapshot')} at "
            f"{_counted(sum(estimate.places.values()), 'different position')}, in {_counted(estimate.passes, 'pass')}: "
            f"{_listed(shown, '; ')}"
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        estimate = self.estimate
        read = self.reader.report
        return {
            "version": __version__,
            "kind": self.calibration.kind,
            "method": self.method,
            "rows": read.rows,
            "bad_rows": read.bad_rows,
            "snapshots": read.snapshots,
            "snapshots_used": estimate.snapshots,
            "positions": {" ".join(group): count for group, count in estimate.places.items()},
            "passes": estimate.passes,
            "settled": estimate.settled,
            "sensors": [dataclasses.asdict(entry) for entry in self.calibration.entries],
            "notes": self.notes(),
        }

    def notes(self) -> list[str]:
        """Return the remarks on the input, on what the data determine, and on how far to trust it."""
        return [
            *self.reader.report.remarks,
            *window_remarks(self.reader.report.windows, self.reader.options.window),
            *self._on_truth(),
            *self._on_combinations(),
            *self._on_places(),
            *self._on_fit(),
            *self.advice,
        ]

    def _on_truth(self) -> list[str]:
        total, known = self.reader.report.snapshots, self.estimate.known
        if self.truth and known < total:
            return [f"{total - known} of {total} snapshots have no true position: they are left out"]
        if not self.truth and set(TRUTH_NAMES) <= set(self.reader.column_names):
            return [
                f"the columns {' and '.join(TRUTH_NAMES)} are not used: `truth` columns takes them as known positions"
            ]
        return []

    def _on_combinations(self) -> list[str]:
        solution, prior = self.estimate.solution, self.prior is not None
        if not solution.determined.any():
            return ["no snapshot has a position with rows to spare: all offsets are 0, without a standard deviation"]
        alone = [self._label(part.offsets[0]) for part in solution.lost if len(part.offsets) == 1]
        lines = []
        if alone:
            held = "they have that of the prior" if prior else "they are 0, without a standard deviation"
            lines.append(f"the measurements don't determine the offsets of {_listed(alone, ', ')}: {held}")
        for part in (part for part in solution.lost if len(part.offsets) > 1):
            held = "it has that of the prior" if prior else "it is held at zero mean"
            lines.append(f"the measurements don't determine {self._named(part)}: {held}")
        unit = self.calibration.quantity.unit
        for part in solution.weak:
            std = part.std / self.calibration.quantity.scale
            lines.append(
                f"{self._named(part)} is weakly determined (std {std:.2g} {unit}): "
                f"misfit of every kind ends there{'' if prior else '; a prior holds it'}"
            )
        return lines

    def _on_places(self) -> list[str]:
        few = {group: count for group, count in self.estimate.places.items() if count < _FEWEST_PLACES}
        if not few or not self.estimate.solution.determined.any():
            return []
        named = [f"{count}{f' ({chr(32).join(group)})' if group else ''}" for group, count in few.items()]
        return [
            f"few different positions: {_listed(named, ', ')}; below about {_FEWEST_PLACES} errors of the places pass "
            "for offsets"
        ]

    def _on_fit(self) -> list[str]:
        estimate = self.estimate
        bad = [
            f"{' '.join(key)} {scale:.3g}"
            for key, scale in zip(estimate.keys, estimate.scale, strict=True)
            if scale > _BAD_FIT
        ]
        lines = []
        if bad:
            lines.append(
                f"residuals remain several times as large as the stated standard deviations: {_listed(bad, ', ')}; "
                f"offsets are not the cause{_DIRECTIONS if self._has_headings() else ''}"
                f"{'' if 'mixture-ml' in self.method else _OUTLIERS}"
            )
        if not estimate.settled:
            lines.append(f"the offsets had not settled after {MOST_PASSES} passes: they may be inaccurate")
        return lines

    def _has_headings(self) -> bool:
        """Whether bearings without harmonics have headings to refer them to."""
        known = self.reader.scene.sensors
        named = "heading_deg" in self.reader.column_names or any(sensor.heading_deg is not None for sensor in known)
        return self.calibration.kind == "bearings" and not self.calibration.harmonics and named

    def _named(self, combination: Combination) -> str:
        what = "a common offset" if combination.common else "a combination of the offsets"
        return f"{what} of {_listed(self._names(combination), ', ')}"

    def _names(self, combination: Combination) -> list[str]:
        return [self._label(index) for index in combination.offsets]

    def _label(self, index: int) -> str:
        return " ".join(self.estimate.keys[index])


def _counted(count: int, what: str) -> str:
    plural = "es" if what.endswith("s") else "s"
    return f"{count} {what}{'' if count == 1 else plural}"


def _listed(texts: Sequence[str], separator: str) -> str:
    more = len(texts) - _MOST_NAMES
    return separator.join(texts[:_MOST_NAMES]) + (f" and {more} more" if more > 0 else "")
