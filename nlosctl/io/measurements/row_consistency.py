"""Checks of the values of a row against each other: groups of columns that belong together."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray, ignoring_overflow
from nlosctl.io.measurements.column_mapping import ColumnPlan
from nlosctl.io.measurements.row_checks import Fault, got, is_null

__all__ = ["half_filled_faults", "indefinite_faults", "missing_std_faults"]


def half_filled_faults(group: Sequence[str], plan: ColumnPlan, columns: Mapping[str, npt.NDArray[Any]]) -> list[Fault]:
    """Return the faults of rows with values in some, not all, of a group's ``columns`` (N,), NaN where missing."""
    absent = np.array([np.isnan(columns[name]) for name in group])
    half = absent.any(axis=0) & ~absent.all(axis=0)
    describe = is_null(f"all of {', '.join(group)} or none")
    return [
        Fault(mask=half & missing, column=plan.mapped[name].name, describe=describe)
        for name, missing in zip(group, absent, strict=True)
        if (half & missing).any()
    ]


def indefinite_faults(entries: Sequence[str], plan: ColumnPlan, columns: Mapping[str, FloatArray]) -> list[Fault]:
    """Return the fault of rows whose covariance, columns xx, xy and yy (N,), is not positive definite."""
    xx, xy, yy = (columns[name] for name in entries)
    describe = got(xy, f"a covariance whose square is below {entries[0]} times {entries[2]}")
    with ignoring_overflow():
        indefinite = xy * xy >= xx * yy
    return [Fault(mask=indefinite, column=plan.mapped[entries[1]].name, describe=describe)] if indefinite.any() else []


def missing_std_faults(plan: ColumnPlan, columns: Mapping[str, npt.NDArray[Any]]) -> list[Fault]:
    """Return the faults of rows of bearings with a range whose std is empty: the range would not be used."""
    without = ~np.isnan(columns["range_m"]) & np.isnan(columns["range_std_m"])
    describe = is_null("the standard deviation of the row's range")
    return [Fault(mask=without, column=plan.mapped["range_std_m"].name, describe=describe)] if without.any() else []
