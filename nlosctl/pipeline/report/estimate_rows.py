"""Estimates as the page lists and draws them: positions, 95 % ellipses, errors, statuses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import EarthFrame
from nlosctl.errors import DataError
from nlosctl.geometry.ellipses import ellipse_threshold, error_ellipse
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.io.results.plot_inputs import SampledRows
from nlosctl.io.scenes.places import errors_in
from nlosctl.pipeline.evaluate.groups import group_title, grouping_columns
from nlosctl.pipeline.report.numbers import decimals_of, places_for, rounded
from nlosctl.pipeline.report.plane_map import PlaneMap

__all__ = ["ESTIMATE_COLUMNS", "EstimateRows"]

ESTIMATE_COLUMNS = (
    "snapshot",
    "target",
    "alternative",
    "source",
    "method",
    "sweep_*",
    "status",
    "x_m",
    "y_m",
    "z_m",
    "cov_xx_m2",
    "cov_xy_m2",
    "cov_yy_m2",
    "std_dof",
    "fit_p_value",
    "lat_deg",
    "lon_deg",
    "frame",
    "truth_x_m",
    "truth_y_m",
    "truth_z_m",
)
_SHARE = 0.95

Columns = Mapping[str, npt.NDArray[Any]]


class EstimateRows:
    """The estimates of one file, or a sample of them.

    Create it before the map is settled, which includes fixes and truths; `content` is for a map that is settled.
    """

    def __init__(self, name: str, sample: SampledRows, plane: PlaneMap, *, named: bool) -> None:
        self._columns, self._named, self.name = sample.columns, named, name
        self.position_m = np.stack([self._numbers(f"{axis}_m") for axis in "xy"], axis=1)
        plane.include(self.position_m)
        self.ids = [_id(value) for value in self._columns["snapshot"].tolist()]
        self._truth = self._truths()
        if self._truth is not None:
            plane.include(self._truth[:, :2])

    def content(self, snapshot: Sequence[int], plane: PlaneMap, frame: EarthFrame | None) -> dict[str, Any]:
        """Return the estimates as plain columns; ``snapshot`` (N,) is the index of each row's snapshot on the page."""
        columns = self._columns
        covariance = [self._numbers(f"cov_{pair}_m2") for pair in ("xx", "xy", "yy")]
        ellipse = error_ellipse(Symmetric2x2(*covariance))
        degrees = self._numbers("std_dof") if "std_dof" in columns else None
        scale = np.broadcast_to(np.sqrt(ellipse_threshold(_SHARE, degrees)), ellipse.semi_major_m.shape)
        major, minor = scale * ellipse.semi_major_m, scale * ellipse.semi_minor_m
        places = places_for(ellipse.semi_minor_m, plane.span_m)
        groups, group = self._groups()
        words, status = np.unique(columns["status"].astype(str), return_inverse=True)
        content: dict[str, Any] = {
            "groups": groups,
            "group": group,
            "statuses": words.tolist(),
            "status": status.tolist(),
            "snapshot": list(snapshot),
            "x": plane.coordinates(self.position_m[:, 0], 0, places),
            "y": plane.coordinates(self.position_m[:, 1], 1, places),
            "decimals": places,
            "major": _by_size(major),
            "minor": _by_size(minor),
            "turn": rounded(ellipse.orientation_rad, 3),
        }
        content |= {
            name: columns[name].astype(int).tolist() for name in ("target", "alternative") if columns[name].any()
        }
        for name, decimals in (("z_m", places), ("lat_deg", 7), ("lon_deg", 7), ("fit_p_value", 4)):
            if name in columns:
                content[name] = rounded(self._numbers(name), decimals)
        return content | self._compared(plane, frame, places)

    def _compared(self, plane: PlaneMap, frame: EarthFrame | None, places: int) -> dict[str, Any]:
        """Return the truths and the distances of the estimates from them, if there are truths."""
        if self._truth is None:
            return {}
        place = self.position_m
        if self._truth.shape[1] == 3:
            place = np.column_stack([place, self._numbers("z_m")])
        curved = frame is not None and frame.on_ellipsoid and place.shape[1] == 3
        error = errors_in(frame, place, self._truth) if curved and frame is not None else place - self._truth
        return {
            "truth_x": plane.coordinates(self._truth[:, 0], 0, places),
            "truth_y": plane.coordinates(self._truth[:, 1], 1, places),
            "error": rounded(np.sqrt(np.sum(error * error, axis=1)), places),
        }

    def _truths(self) -> FloatArray | None:
        """Return the true positions (N, D), of as many coordinates as both estimates and truths have."""
        axes = "xyz" if {"z_m", "truth_z_m"} <= self._columns.keys() else "xy"
        names = [f"truth_{axis}_m" for axis in axes]
        if not set(names) <= self._columns.keys():
            return None
        truth = np.stack([self._numbers(name) for name in names], axis=1)
        return truth if np.isfinite(truth).all(axis=1).any() else None

    def _groups(self) -> tuple[list[str], list[int]]:
        """Return the titles of the groups by file, source, method and sweep, and the index of each row's."""
        names = grouping_columns(list(self._columns))
        keys = list(zip(*(self._columns[name].tolist() for name in names), strict=True))
        index: dict[Any, int] = {}
        codes = [index.setdefault(tuple(map(str, key)), len(index)) for key in keys]
        first = {code: key for key, code in zip(reversed(keys), reversed(codes), strict=True)}
        file = {"file": self.name} if self._named else {}
        titles = [group_title({**file, **dict(zip(names, first[code], strict=True))}) for code in index.values()]
        return [title or "estimates" for title in titles], codes

    def _numbers(self, name: str) -> FloatArray:
        values = self._columns[name]
        if values.dtype.kind == "O" and not any(values):
            return np.full(values.shape, np.nan)
        if values.dtype.kind not in "fiu":
            raise DataError(f"{self.name}, column {name!r}: got text, expected numbers")
        return values.astype(np.float64)


def _by_size(length_m: FloatArray) -> list[Any]:
    """Return lengths (N,) with about four digits of the typical one."""
    known = length_m[np.isfinite(length_m) & (length_m > 0.0)]
    return rounded(length_m, decimals_of(float(np.median(known)) if known.size else 1.0, 4))


def _id(value: Any) -> str:
    return str(int(value)) if isinstance(value, float) and value.is_integer() else str(value)
