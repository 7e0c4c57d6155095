"""Residuals of flags over the standard deviations of their rows, from the columns that a table of flags has."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.contract.tables import KINDS, ColumnType
from nlosctl.contract.tables.shared import LIGHT_M_S
from nlosctl.errors import DataError
from nlosctl.io.results.evaluation_arrays import numbers

__all__ = ["STD_TYPES", "StandardizedResiduals"]

_OF_ANGLES = {
    "residual_rad": ("bearing_std_rad", "direction_std_rad"),
    "residual_elevation_rad": ("elevation_std_rad", "direction_std_rad"),
    **{f"residual_{name}_rad": (f"{name}_std_rad",) for name in ("dod", "doa", "dod_elevation", "doa_elevation")},
}
_OF_LENGTHS = ("range_std_m", "arrival_std_m", "path_length_std_m")
_ACROSS = "direction_std_rad"
"""The std across a ray: that of its azimuth is this over the cosine of the elevation."""

_COLUMNS = {
    column.name: column
    for table in KINDS.values()
    for column in table.all_columns
    if column.name in {"elevation_rad", *_OF_LENGTHS, *(name for names in _OF_ANGLES.values() for name in names)}
}
STD_TYPES: Mapping[str, ColumnType] = {name: "number" for known in _COLUMNS.values() for name in known.accepted_names}
"""The types of the columns that standardized residuals take from the input's own: all their spellings."""


@dataclass(frozen=True, kw_only=True)
class _Values:
    """A column of the contract under the name that a file has for it, times ``scale`` to its unit."""

    name: str
    scale: float

    def read(self, table: Any) -> FloatArray:
        return numbers(table.column(self.name)) * self.scale


@dataclass(frozen=True, kw_only=True)
class _Residual:
    """A residual column, the std of its measurement, and the elevation where that std is across the ray.

    Without ``std`` the factor of the std is the std itself.
    """

    column: str
    std: _Values | None
    elevation: _Values | None = None


@dataclass(frozen=True, kw_only=True)
class StandardizedResiduals:
    """The residual columns of flags that can be standardized, by the names of their figures.

    A residual is ``residual``, but those of elevations, departures and arrivals, and ranges beside bearings, whose
    names have what they are of. ``std_factor``: the rows have a factor of their std.
    """

    of: Mapping[str, _Residual]
    std_factor: bool

    @classmethod
    def of_columns(cls, names: Collection[str], file: str, speed_m_s: float) -> StandardizedResiduals:
        """Return what flags with the columns ``names`` have; times are lengths by ``speed_m_s``.

        Raises DataError if there is no residual, or no standard deviation of one.
        """
        columns = {column: _figure_name(column, names) for column in (*_OF_ANGLES, "residual_m") if column in names}
        if not columns:
            raise DataError(
                f"{file}: no residual column, such as 'residual_rad' or 'residual_m'; localize with flags_out writes "
                "flags that have them"
            )
        factor = "std_factor" in names
        found = {figure: _residual(column, names, speed_m_s, factor) for column, figure in columns.items()}
        lacking = [figure for figure, residual in found.items() if residual is None]
        if lacking:
            column = next(column for column, figure in columns.items() if figure == lacking[0])
            known = _std_names(column)
            raise DataError(
                f"{file}: {column!r} has no standard deviation: no column {' or '.join(map(repr, known))}; localize "
                "with the standard deviation as a constant or a column, or with estimate_std sensor, and flags_out"
            )
        return cls(of={figure: residual for figure, residual in found.items() if residual}, std_factor=factor)

    def read(self, table: Any, file: str) -> dict[str, FloatArray]:
        """Return the standardized residuals (N,) of a table by the names of their figures, NaN for a missing one.

        Raises DataError for a standard deviation that is not positive.
        """
        factor = numbers(table.column("std_factor")) if self.std_factor else np.ones(table.num_rows)
        values = {}
        for figure, residual in self.of.items():
            std = np.ones(table.num_rows)
            if residual.std is not None:
                std = residual.std.read(table)
                if (std <= 0.0).any():
                    worst = f"{std[std <= 0.0][0] / residual.std.scale:g}"
                    raise DataError(f"{file}, column {residual.std.name!r}: got {worst}, expected a positive number")
            if residual.elevation is not None:
                std = std / np.cos(np.nan_to_num(residual.elevation.read(table)))
            with ignoring_division():
                ratio = numbers(table.column(residual.column)) / (std * factor)
            values[figure] = np.where(np.isfinite(ratio), ratio, np.nan)
        return values


def _figure_name(column: str, names: Collection[str]) -> str:
    if column == "residual_m":
        return "residual_range" if "residual_rad" in names else "residual"
    return column.removesuffix("_rad")


def _std_names(column: str) -> tuple[str, ...]:
    return _OF_ANGLES.get(column, _OF_LENGTHS)


def _residual(column: str, names: Collection[str], speed_m_s: float, factor: bool) -> _Residual | None:
    """Return the residual with its std; None without one."""
    wanted = ("range_std_m",) if column == "residual_m" and "residual_rad" in names else _std_names(column)
    for name in wanted:
        std = _find(name, names, speed_m_s)
        if std is not None:
            across = name == _ACROSS and column == "residual_rad"
            return _Residual(
                column=column, std=std, elevation=_find("elevation_rad", names, speed_m_s) if across else None
            )
    return _Residual(column=column, std=None) if factor else None


def _find(name: str, names: Collection[str], speed_m_s: float) -> _Values | None:
    """Return a column of the contract among the columns ``names``, in any of its spellings; None without it."""
    if name in names:
        return _Values(name=name, scale=1.0)
    for spelling in _COLUMNS[name].spellings:
        if spelling.name in names:
            return _Values(
                name=spelling.name, scale=spelling.scale * (speed_m_s / LIGHT_M_S if spelling.seconds else 1.0)
            )
    return None
