"""Rows of a snapshot for its picture: positions of their sensors, their kinds, differences of arrivals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.io.measurements.completion.exact_numbers import REST
from nlosctl.io.measurements.completion.references import FORM, Form
from nlosctl.io.results.plot_inputs import PlotSnapshot

__all__ = ["Differences", "differences_of", "kinds_of_rows", "row_kinds", "row_positions"]


def row_positions(measured: PlotSnapshot, of: str = "sensor", dimension: int = 2) -> FloatArray:
    """Return the position (K, D) of the sensor of each row, or ``of`` its reference; NaN if its own row has it."""
    return np.stack([measured.columns[f"{of}_{axis}_m"] for axis in "xyz"[:dimension]], axis=1)


def row_kinds(measured: PlotSnapshot) -> list[str]:
    """Return the kind of each row (K,) of a snapshot, as of `kinds_of_rows`."""
    kinds: list[str] = kinds_of_rows(measured.columns, measured.file_columns, measured.left_out).tolist()
    return kinds


def kinds_of_rows(
    columns: Mapping[str, npt.NDArray[Any]], flags: Mapping[str, npt.NDArray[Any]], left_out: BoolArray
) -> npt.NDArray[np.object_]:
    """Return the kind (N,) of rows: direct, reflected, flagged (by ``los`` or an earlier step) or unused.

    ``flags`` has the columns ``los`` and ``used`` of the file, if any, with 0 for false.
    """
    size = left_out.size
    reflected = np.asarray(columns.get("reflector", np.full(size, -1))) >= 0
    flagged = (np.asarray(flags.get("los", np.ones(size))) == 0) | left_out
    unused = np.asarray(flags.get("used", np.ones(size))) == 0
    kinds = np.where(flagged, "flagged", np.where(unused, "unused", np.where(reflected, "reflected", "direct")))
    return kinds.astype(object)


@dataclass(frozen=True, kw_only=True)
class Differences:
    """Differences (N,) of arrivals to those at references; positions (N, D), kinds as of `row_kinds`.

    ``std_m`` is the standard deviation of the difference.
    """

    sensor_m: FloatArray
    reference_m: FloatArray
    difference_m: FloatArray
    std_m: FloatArray
    kind: npt.NDArray[np.object_]

    @property
    def baseline_m(self) -> FloatArray:
        """The distances (N,) between sensor and reference."""
        return np.asarray(np.sqrt(np.sum((self.sensor_m - self.reference_m) ** 2, axis=1)))


def differences_of(measured: PlotSnapshot) -> Differences:
    """Return the differences of a snapshot: those of the file, or of its arrivals to one of them.

    The reference of arrivals is the direct row of the smallest standard deviation, of these the earliest. A difference
    is flagged, or not used, if one of its two rows is (independent differences are rows themselves). Rows of the
    reference, or at its position, are left out.
    """
    columns, kinds = measured.columns, np.array(row_kinds(measured), dtype=object)
    dimension = 3 if "sensor_z_m" in columns else 2
    sensor = row_positions(measured, "sensor", dimension)
    arrival = (columns["arrival_m"] - columns["arrival_m"].min()) + columns[REST]
    std = columns["arrival_std_m"]
    if FORM in columns and columns[FORM][0] == Form.OF_PAIRS:
        reference, difference = row_positions(measured, "reference", dimension), columns["arrival_m"] + columns[REST]
    elif "reference" in columns:
        own = _reference_rows(columns)
        reference = np.where((own >= 0)[:, None], sensor[own], row_positions(measured, "reference", dimension))
        difference = columns["arrival_m"] + columns[REST]
        std = np.hypot(std, np.where(own >= 0, std[own], columns["reference_std_m"]))
        kinds = np.where((own >= 0) & (kinds == "direct"), kinds[own], kinds)
    else:
        candidates = kinds == "direct" if (kinds == "direct").any() else np.full(kinds.shape, True)
        best = int(np.lexsort((arrival, std, ~candidates))[0])
        reference, difference = np.broadcast_to(sensor[best], sensor.shape), arrival - arrival[best]
        std = np.hypot(std, std[best])
    apart = np.flatnonzero((sensor != reference).any(axis=1))
    return Differences(
        sensor_m=sensor[apart],
        reference_m=reference[apart],
        difference_m=difference[apart],
        std_m=std[apart],
        kind=kinds[apart],
    )


def _reference_rows(columns: dict[str, npt.NDArray[Any]]) -> IntArray:
    """Return the row (N,) of each row's reference, -1 if it has none."""
    order = np.argsort(columns["sensor"], kind="stable")
    names = columns["sensor"][order]
    at = np.minimum(np.searchsorted(names, columns["reference"]), order.size - 1)
    return np.where(names[at] == columns["reference"], order[at], -1)
