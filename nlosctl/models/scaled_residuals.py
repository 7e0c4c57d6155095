"""Residuals of measurements over their standard deviations with their derivatives by the position, by kind."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
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
    """One scalar of each row: residuals (B, K) over std and the D derivatives (B, K); 0 in rows without the scalar.

    ``per_offset`` (B, K) is the derivative by the offset of the row's sensor, by which its measurement is too large;
    None for scalars that an offset does not change.
    """

    residual: FloatArray
    slopes: tuple[FloatArray, ...]
    measured: FloatArray
    per_offset: FloatArray | None = None

    @classmethod
    def of(cls, residual: FloatArray, *slopes: FloatArray, per_offset: FloatArray | None = None) -> ScaledResiduals:
        """Return scalars, those that are not finite as not measured."""
        measured = np.isfinite(residual) & np.logical_and.reduce([np.isfinite(slope) for slope in slopes])
        parts = tuple(np.where(measured, part, 0.0) for part in (residual, *slopes))
        offset = None if per_offset is None else np.where(measured, per_offset, 0.0)
        return cls(parts[0], parts[1:], measured.astype(np.float64), offset)

    def at_known_position(self, dimension: int) -> ScaledResiduals:
        """Return the scalars without the derivatives by the coordinates of the position."""
        return replace(self, slopes=self.slopes[dimension:])


def _bearings(batch: BearingBatch, position_m: FloatArray, *, with_ranges: bool) -> tuple[ScaledResiduals, ...]:
    lines = sight_lines(batch)
    x, y = position_m[:, 0] - lines.center_x, position_m[:, 1] - lines.center_y
    paths = lines.paths_from(x, y)
    with ignoring_division():
        residual = lines.residual_rad(x, y, paths) / lines.std_rad
        per_offset = (-1.0 if lines.handedness is None else -lines.handedness) / lines.std_rad
        bearings = ScaledResiduals.of(residual, *lines.slopes(x, y, paths), per_offset=per_offset)
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
        residual, per_offset = rows.residual_m(*point) / rows.std_m, -1.0 / rows.std_m
        return (ScaledResiduals.of(residual, *(slopes / rows.std_m), per_offset=per_offset),)


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
