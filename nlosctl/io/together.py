"""Columns that say something only together, such as a prior's x, y and std: all of them or none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.errors import DataError
from nlosctl.io.columns import ColumnPlan
from nlosctl.io.faults import Fault

__all__ = ["half_filled_faults", "require_together"]


def require_together(plan: ColumnPlan, file: str) -> None:
    """Raise DataError where a file has some, not all, of the columns that belong together."""
    for group in plan.table.together:
        there = [name for name in group if name in plan.found]
        if there and len(there) < len(group):
            absent = [name for name in group if name not in plan.found]
            raise DataError(
                f"{file}: column {plan.found[there[0]].name!r} says nothing without {_listed(absent)}; "
                f"give all of {', '.join(group)}, or drop {_listed(there)}"
            )


def half_filled_faults(plan: ColumnPlan, columns: Mapping[str, npt.NDArray[Any]]) -> list[Fault]:
    """Return the faults of rows that have some, not all, of the values that belong together.

    ``columns`` are the canonical columns (N,) of a record batch, NaN where a value is missing.
    """
    faults = []
    for group in plan.table.together:
        if all(name in plan.found for name in group):
            absent = np.array([np.isnan(columns[name]) for name in group])
            half = absent.any(axis=0) & ~absent.all(axis=0)
            for name, missing in zip(group, absent, strict=True):
                if (half & missing).any():
                    faults.append(_fault(half & missing, plan.found[name].name, group))
    return faults


def _fault(mask: npt.NDArray[np.bool_], column: str, group: Sequence[str]) -> Fault:
    told = f"empty (null), expected all of {', '.join(group)} or none"
    return Fault(mask=mask, column=column, describe=lambda _: told)


def _listed(names: Sequence[str]) -> str:
    return " and ".join(map(repr, names))
