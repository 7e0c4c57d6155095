"""Axis labels of the figures of an evaluation and of swept parameters, and the figures' standard errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from nlosctl.evaluation.error_statistics import share_std_error
from nlosctl.plotting.figures import axis_label
from nlosctl.plotting.texts import plain

__all__ = ["figure_label", "parameter_label", "std_error_of"]

_UNITS = {"m": "m", "deg": "deg", "rad": "rad", "db": "dB", "dbm": "dBm", "s": "s", "ns": "ns", "hz": "Hz"}
_NAMES = {
    "rmse_m": "RMSE",
    "efficiency": "RMSE over the Cramér-Rao bound",
    "nees": "NEES",
    "p_fa": "$P_{fa}$",
    "p_d": "$P_d$",
    "p_d_at_5": "$P_d$ at $P_{fa}$ = 5 %",
    "p_d_at_1": "$P_d$ at $P_{fa}$ = 1 %",
    "auc": "area under the curve",
    "matched_rmse_m": "RMSE of matched targets",
    "exact": "share of snapshots identified exactly",
    "number_right": "share of snapshots with the right number",
    **{f"coverage_{share}": f"share inside the {share} % ellipse" for share in (50, 90, 95, 99)},
    **{f"p{share}_m": f"{share}th percentile of the error" for share in (90, 95, 99)},
    "median_m": "median error",
    "mean_m": "mean error",
    "ospa_m": "OSPA",
    "gospa_m": "GOSPA",
}
_SHARES_OF: dict[str, tuple[str, ...]] = {
    "fix_rate": ("rows",),
    "accuracy": ("rows",),
    "p_fa": ("direct_called_direct", "direct_called_indirect"),
    "p_d": ("indirect_called_direct", "indirect_called_indirect"),
    "precision": ("los_called_los", "nlos_called_los"),
    "recall": ("los_called_los", "los_called_nlos"),
    "false_alarm": ("nlos_called_los", "nlos_called_nlos"),
    "number_right": ("snapshots",),
    "exact": ("snapshots",),
    **{f"coverage_{share}": ("nees_rows",) for share in (50, 90, 95, 99)},
}
"""By share: the columns whose sum is its number of rows."""


def figure_label(name: str) -> str:
    """Return the axis label of a figure: its name in words and its unit."""
    return axis_label(_NAMES[name] if name in _NAMES else plain(_words(name)), _unit(name))


def parameter_label(column: str) -> str:
    """Return the axis label of a sweep column."""
    key = column.removeprefix("sweep_")
    return axis_label(plain(_words(key)), _unit(key))


def std_error_of(group: Mapping[str, Any], name: str) -> float:
    """Return the standard error of a figure of a group, NaN if unknown."""
    if f"{name.removesuffix('_m')}_std_error_m" in group:
        return _number(group[f"{name.removesuffix('_m')}_std_error_m"])
    if name in _SHARES_OF and all(count in group for count in _SHARES_OF[name]):
        return share_std_error(_number(group[name]), sum(_number(group[count]) for count in _SHARES_OF[name]))
    return float("nan")


def _number(value: Any) -> float:
    return float("nan") if value is None else float(value)


def _unit(name: str) -> str:
    return _UNITS.get(name.rpartition("_")[2], "") if "_" in name else ""


def _words(name: str) -> str:
    head, _, tail = name.rpartition("_")
    return (head if tail in _UNITS and head else name).replace("_", " ")
