"""Residuals of measurements over their standard deviations with their derivatives by the position, by kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.contract.batches import BearingBatch, RangeBatch
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import sight_lines
from nlosctl.models.ranges.spheres import range_rows

__all__ = ["SCALED_RESIDUALS", "ScaledResiduals", "leverages"]


@dataclass(frozen=True)
class ScaledResiduals:
    """One scalar of each row: residuals (B, K) over std and the D derivatives (B, K); 0 in rows without the scalar."""

    residual: FloatArray
    slopes: tuple[FloatArray, ...]
    measured: FloatArray

    @classmethod
    def of(cls, residual: FloatArray, *slopes: FloatArray) -> ScaledResiduals:
        """Return scalars, those that are not finite as not measured."""
        measured = np.isfinite(residual) & np.logical_and.reduce([np.isfinite(slope) for slope in slopes])
        parts = tuple(np.where(measured, part, 0.0) for part in (residual, *slopes))
        return cls(parts[0], parts[1:], measured.astype(np.float64))


def _bearings(batch: BearingBatch, position_m: FloatArray, *, with_ranges: bool) -> tuple[ScaledResiduals, ...]:
    lines = sight_lines(batch)
    x, y = position_m[:, 0] - lines.center_x, position_m[:, 1] - lines.center_y
    paths = lines.paths_from(x, y)
    with ignoring_division():
        bearings = ScaledResiduals.of(lines.residual_rad(x, y, paths) / lines.std_rad, *lines.slopes(x, y, paths))
        if not with_ranges or batch.range_m is None or batch.range_std_m is None:
            return (bearings,)
        range_m = lines.range_m(x, y)
        scale = 1.0 / (range_m * batch.range_std_m)
        slopes = ((lines.origin_x - x[:, None]) * scale, (lines.origin_y - y[:, None]) * scale)
        return bearings, ScaledResiduals.of((batch.range_m - range_m) / batch.range_std_m, *slopes)


def _ranges(batch: RangeBatch, position_m: FloatArray, *, with_ranges: bool) -> tuple[ScaledResiduals, ...]:
    rows = range_rows(batch)
    point = [position_m[:, axis] - middle for axis, middle in enumerate(rows.center)]
    slopes = np.empty((len(point), *rows.std_m.shape), order="F")
    with ignoring_division():
        for k in range(rows.std_m.shape[1]):
            for slope, along in zip(slopes, rows.path(k, *point).along, strict=True):
                slope[:, k] = -along
        return (ScaledResiduals.of(rows.residual_m(*point) / rows.std_m, *(slopes / rows.std_m)),)


SCALED_RESIDUALS: dict[str, Callable[..., tuple[ScaledResiduals, ...]]] = {"bearings": _bearings, "ranges": _ranges}
"""By kind: ``(batch, position_m (B, D), with_ranges=...)`` to the scalars of its rows, a block for each kind."""


def leverages(scalars: tuple[ScaledResiduals, ...], weight: FloatArray) -> tuple[SymmetricMatrix, list[FloatArray]]:
    """Return the information J'WJ (B,) and leverages w g' (J'WJ)^-1 g (B, K) of each scalar of rows with a ``weight``.

    Leverages are not finite where the information is singular.
    """
    information: Any = None
    for scalar in scalars:
        part = SymmetricMatrix.gram(*scalar.slopes, weight=weight)
        information = part if information is None else information + part
    with ignoring_division():
        inverse = information.inverse()
        inverse = SymmetricMatrix(*(part[:, None] for part in inverse))
        return information, [weight * inverse.quadratic_form(*scalar.slopes) for scalar in scalars]
