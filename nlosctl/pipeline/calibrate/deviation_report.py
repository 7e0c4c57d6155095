"""The calibration that an estimate of deviations makes, and what the summary states of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees
from typing import Any

import numpy as np

from nlosctl.contract.calibration import OFFSETS, Calibration, Harmonic, SensorOffset
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.pipeline.calibrate.calibration_report import CalibrationReport
from nlosctl.pipeline.calibrate.deviation_passes import DeviationEstimate
from nlosctl.pipeline.calibrate.deviation_sums import SECTORS, DeviationSums
from nlosctl.solvers.calibration.offset_solution import Combination

__all__ = ["DeviationReport"]

_COVERED = 0.75
_SHOWN = 4
"""So many arrays have their harmonics in the summary."""


@dataclass(kw_only=True)
class DeviationReport(CalibrationReport):
    """The summary of a calibration of deviations."""

    estimate: DeviationEstimate

    @classmethod
    def of_deviations(
        cls, estimate: DeviationEstimate, sums: DeviationSums, reader: MeasurementReader, prior_std: float | None
    ) -> DeviationReport:
        """Return the report of the passes of ``sums``; ``prior_std`` is in radians."""
        return cls(
            calibration=_calibration_of(estimate, sums.harmonics, sums.by),
            estimate=estimate,
            reader=reader,
            method=sums.run.label,
            prior=None if prior_std is None else degrees(prior_std),
            truth=sums.truth is not None,
        )

    def _facts(self) -> dict[str, Any]:
        facts = super()._facts()
        del facts["positions"]
        return facts

    def _result(self) -> str:
        entries = [_shown(entry) for entry in self.calibration.entries[:_SHOWN]]
        more = len(self.calibration.entries) - _SHOWN
        entries += [f"and {more} more"] if more > 0 else []
        many = self.estimate.snapshots != 1
        passes = f"{self.estimate.passes} pass{'es' if self.estimate.passes != 1 else ''}"
        return (
            f"deviations by {self.estimate.snapshots} snapshot{'s' if many else ''}, in {passes}: {'; '.join(entries)}"
        )

    def _named(self, combination: Combination) -> str:
        names = self._names(combination)
        return names[0] if len(names) == 1 else f"a combination of the terms {', '.join(names)}"

    def _on_places(self) -> list[str]:
        narrow = {key: count for key, count in self.estimate.sectors.items() if 0 < count < _COVERED * SECTORS}
        return [
            f"{' '.join(key)}: bearings in {count} of {SECTORS} sectors of ten degrees relative to the heading; in the "
            "others the deviation is extrapolated"
            for key, count in narrow.items()
        ]


def _shown(entry: SensorOffset) -> str:
    std = "" if entry.std is None else f" +- {entry.std:.2g}"
    parts = [f"{part.cos:+.3g} cos {part.sin:+.3g} sin" for part in entry.harmonics]
    orders = ", ".join(f"order {number} {part}" for number, part in enumerate(parts, start=1))
    return f"{' '.join(entry.key)} {entry.offset:.4g}{std} deg, {orders}, std x {entry.std_scale:.3g}"


def _calibration_of(estimate: DeviationEstimate, harmonics: int, by: Sequence[str]) -> Calibration:
    """Return the calibration of an estimate, in degrees; what is not determined is 0, without a std."""
    scale, solution, size = OFFSETS["bearings"].scale, estimate.solution, 1 + 2 * harmonics
    value = np.where(solution.determined, estimate.offsets, 0.0) / scale
    std = np.where(solution.determined, np.sqrt(np.diag(solution.covariance)), np.nan) / scale
    entries = []
    for number, key in enumerate(estimate.arrays):
        own, own_std = (part[number * size : (number + 1) * size].tolist() for part in (value, std))
        stds = [None if np.isnan(one) else one for one in own_std]
        parts = tuple(
            Harmonic(order=m, cos=own[2 * m - 1], sin=own[2 * m], cos_std=stds[2 * m - 1], sin_std=stds[2 * m])
            for m in range(1, harmonics + 1)
        )
        factor, spare = float(estimate.scale[number * size]), float(estimate.degrees[number * size])
        entries.append(
            SensorOffset(
                name=key[0],
                group=key[1:],
                offset=own[0],
                std=stds[0],
                std_scale=factor,
                std_dof=None if np.isnan(spare) else spare,
                harmonics=parts,
            )
        )
    order = np.flatnonzero(solution.determined)
    return Calibration(
        kind="bearings",
        entries=tuple(entries),
        by=tuple(by),
        order=tuple(map(int, order)),
        covariance=solution.covariance[np.ix_(order, order)] / scale**2,
        harmonics=harmonics,
    )
