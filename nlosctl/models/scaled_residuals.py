"""Residuals of measurements over their standard deviations with their derivatives by the unknowns, by kind."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, ignoring_division
from nlosctl.contract.batches import ArrivalBatch, Batch, BearingBatch, RangeBatch
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.arrivals import arrival_rows
from nlosctl.models.bearings import SightLines
from nlosctl.models.measured_height import GroundHeight, TargetHeight
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.models.sight import bearing_lines
from nlosctl.models.space.lines import SpaceLines

__all__ = ["SCALED_RESIDUALS", "ScaledResiduals", "at_minimum", "height_residual", "leverages"]


@dataclass(frozen=True)
class ScaledResiduals:
    """One scalar of each row: residuals (B, K) over std and the derivatives (B, K); 0 in rows without the scalar.

    The derivatives are by the coordinates of the position that are not known, and of arrivals by the offset, the last.
    ``per_offset`` (B, K) is the derivative by the offset of the row's sensor, by which its measurement is too large;
    None for scalars that an offset does not change. ``of_rows`` is false for a measured height (B, 1), which is no row.
    """

    residual: FloatArray
    slopes: tuple[FloatArray, ...]
    measured: FloatArray
    per_offset: FloatArray | None = None
    of_rows: bool = True

    @classmethod
    def of(cls, residual: FloatArray, *slopes: FloatArray, per_offset: FloatArray | None = None) -> ScaledResiduals:
        """Return scalars, those that are not finite as not measured."""
        measured = np.isfinite(residual) & np.logical_and.reduce([np.isfinite(slope) for slope in slopes])
        parts = tuple(np.where(measured, part, 0.0) for part in (residual, *slopes))
        offset = None if per_offset is None else np.where(measured, per_offset, 0.0)
        return cls(parts[0], parts[1:], measured.astype(np.float64), offset)

    def at_known_position(self, coordinates: int) -> ScaledResiduals:
        """Return the scalars without the derivatives by the unknown coordinates of the position, the first ones."""
        return replace(self, slopes=self.slopes[coordinates:])


def _bearings(
    batch: BearingBatch, position_m: FloatArray, *, with_ranges: bool, with_height: bool = False
) -> tuple[ScaledResiduals, ...]:
    lines = bearing_lines(batch)
    ranges = (batch.range_m, batch.range_std_m) if with_ranges else (None, None)
    if isinstance(lines, SpaceLines):
        return _directions(lines, position_m, *ranges, with_height=with_height)
    if not isinstance(lines, SightLines):
        raise UsageError("`estimate_std` of sensors is not for azimuths of geodesics; set it to snapshot or file")
    x, y = position_m[:, 0] - lines.center_x, position_m[:, 1] - lines.center_y
    paths = lines.paths_from(x, y)
    with ignoring_division():
        residual = lines.residual_rad(x, y, paths) / lines.std_rad
        per_offset = (-1.0 if lines.handedness is None else -lines.handedness) / lines.std_rad
        bearings = ScaledResiduals.of(residual, *lines.slopes(x, y, paths), per_offset=per_offset)
        if ranges[0] is None or ranges[1] is None:
            return (bearings,)
        range_m = lines.range_m(x, y)
        scale = 1.0 / (range_m * ranges[1])
        slopes = ((lines.origin_x - x[:, None]) * scale, (lines.origin_y - y[:, None]) * scale)
        return bearings, ScaledResiduals.of((ranges[0] - range_m) / ranges[1], *slopes)


def _directions(
    lines: SpaceLines,
    position_m: FloatArray,
    range_m: FloatArray | None,
    range_std_m: FloatArray | None,
    *,
    with_height: bool,
) -> tuple[ScaledResiduals, ...]:
    """Return azimuths, elevations and, if given, ranges (B, K), and any measured height (B, 1) if wanted.

    Raises UsageError for heights above a sphere where they are not wanted.
    """
    measured = [np.ones(lines.angles.has_elevation.shape), lines.angles.has_elevation]
    if range_m is not None and range_std_m is not None:
        known = np.isfinite(range_m) & np.isfinite(range_std_m)
        lines = lines.with_ranges(np.where(known, range_m, np.nan), range_std_m, lognormal=False)
        measured.append(known.astype(np.float64))
    if isinstance(lines.height, GroundHeight) and not with_height:
        raise UsageError("`estimate_std` of sensors is not for heights above a sphere; set it to snapshot or file")
    point = [position_m[:, axis] - lines.center[axis] for axis in range(lines.unknowns)]
    with ignoring_division():
        residual, slopes = lines.residual(*point) / lines.std, lines.slopes(*point)
    scalars = []
    for number, has in enumerate(measured):
        of = slice(number * lines.rows, (number + 1) * lines.rows)
        per_offset = None if number else -lines.angles.turned() / lines.std[:, of]
        scalar = ScaledResiduals.of(residual[:, of], *(slope[:, of] for slope in slopes), per_offset=per_offset)
        scalars.append(replace(scalar, measured=scalar.measured * has))
    return (*scalars, *_height(lines.height, point, wanted=with_height))


def _height(height: TargetHeight | None, point: Sequence[FloatArray], *, wanted: bool) -> tuple[ScaledResiduals, ...]:
    """Return the scalar (B, 1) of a measured height at points about the local origins, if there is one."""
    if height is None or not wanted:
        return ()
    slopes = (slope[:, None] for slope in height.scaled_slopes(*point))
    return (replace(ScaledResiduals.of(height.scaled_residual(*point)[:, None], *slopes), of_rows=False),)


def _ranges(
    batch: RangeBatch, position_m: FloatArray, *, with_ranges: bool, with_height: bool = False
) -> tuple[ScaledResiduals, ...]:
    rows = range_rows(batch)
    point = [position_m[:, axis] - middle for axis, middle in enumerate(rows.center)]
    slopes = np.empty((len(point), *rows.std_m.shape), order="F")
    with ignoring_division():
        for k in range(rows.std_m.shape[1]):
            for slope, along in zip(slopes, rows.path(k, *point).along, strict=True):
                slope[:, k] = -along
        residual, per_offset = rows.residual_m(*point) / rows.std_m, -1.0 / rows.std_m
        scalars = ScaledResiduals.of(residual, *(slopes / rows.std_m), per_offset=per_offset)
    return (scalars, *_height(rows.level, point, wanted=with_height))


def _arrivals(
    batch: ArrivalBatch, position_m: FloatArray, *, with_ranges: bool, with_height: bool = False
) -> tuple[ScaledResiduals, ...]:
    rows = arrival_rows(batch)
    point = [position_m[:, axis] - middle for axis, middle in enumerate(rows.center)]
    at = rows.compare(*point)
    inverse = 1.0 / rows.std_m
    if rows.of_pairs:
        scalars = ScaledResiduals.of(at.residual, *at.slopes)
        return (scalars, *_height(rows.level, point, wanted=with_height))
    slopes = (*(-part * inverse for part in at.along), -inverse)
    height = tuple(
        replace(part, slopes=(*part.slopes, np.zeros(part.residual.shape)))
        for part in _height(rows.level, point, wanted=with_height)
    )
    return (ScaledResiduals.of(at.residual, *slopes, per_offset=-inverse), *height)


SCALED_RESIDUALS: dict[str, Callable[..., tuple[ScaledResiduals, ...]]] = {
    "bearings": _bearings,
    "ranges": _ranges,
    "arrivals": _arrivals,
}
"""By kind: ``(batch, position_m (B, D), with_ranges=...)`` to the scalars of its rows, a block for each kind.

The offset of arrivals is the likeliest at the position; independent differences have none. With ``with_height=True``
a measured height of the target is one more scalar (B, 1), the last.
"""


_HEIGHTS: dict[str, Callable[[Any], tuple[Any, Any]]] = {
    "bearings": lambda batch: ((lines := bearing_lines(batch)).center, getattr(lines, "height", None)),
    "ranges": lambda batch: ((rows := range_rows(batch)).center, getattr(rows, "level", None)),
    "arrivals": lambda batch: ((rows := arrival_rows(batch)).center, rows.level),
}
"""By kind: a batch to its local origins and the measured height of its source about them."""


def height_residual(kind: str, batch: Batch, position_m: FloatArray) -> ScaledResiduals | None:
    """Return the measured heights (B, 1) of sources at positions (B, D) as scalars; None if none is measured."""
    if batch.target_z_m is None or batch.height_held:
        return None
    center, height = _HEIGHTS[kind](batch)
    point = [position_m[:, axis] - middle for axis, middle in enumerate(center)]
    slopes = [-slope[:, None] for slope in height.scaled_slopes(*point)]
    if kind == "arrivals":
        slopes.append(np.zeros((batch.size, 1)))
    return ScaledResiduals.of(-height.scaled_residual(*point)[:, None], *slopes)


def leverages(
    scalars: tuple[ScaledResiduals, ...], weight: FloatArray, further: SymmetricMatrix | None = None
) -> tuple[SymmetricMatrix, list[FloatArray]]:
    """Return the information J'WJ (B,) and leverages w g' (J'WJ)^-1 g (B, K) of each scalar of rows with a ``weight``.

    ``further`` is information (B,) from elsewhere. Leverages are not finite where the information is singular.
    """
    information: Any = further
    for scalar in scalars:
        part = SymmetricMatrix.gram(*scalar.slopes, weight=weight)
        information = part if information is None else information + part
    with ignoring_division():
        inverse = information.inverse()
        inverse = SymmetricMatrix(*(part[:, None] for part in inverse))
        return information, [weight * inverse.quadratic_form(*scalar.slopes) for scalar in scalars]


def at_minimum(
    scalars: tuple[ScaledResiduals, ...], weight: FloatArray, information: SymmetricMatrix
) -> tuple[ScaledResiduals, ...]:
    """Return the scalars with the residuals after a Gauss-Newton step by their information J'WJ (B,)."""
    unknowns = range(len(scalars[0].slopes))
    with ignoring_division():
        gradient = [
            sum(
                (sum_measurements(weight * part.slopes[axis] * part.residual) for part in scalars),
                np.zeros(len(weight)),
            )
            for axis in unknowns
        ]
        step = information.solve(*gradient)
        return tuple(
            replace(
                part,
                residual=part.residual - sum(slope * by[:, None] for slope, by in zip(part.slopes, step, strict=True)),
            )
            for part in scalars
        )
