"""Squared residuals of the rows of dense batches over their stated std, with their degrees of freedom."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl import registry
from nlosctl.arrays import BoolArray, FloatArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import Batch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.errors import UsageError
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, at_minimum, leverages
from nlosctl.solvers.optimization.unknown_std import HEIGHT_FAULT

__all__ = [
    "RowSquares",
    "row_squares",
    "snapshot_factors",
    "uses_ranges",
    "weighted_rows",
    "with_std_factors",
    "with_unknown_factor",
]

_MOST_ROUNDS = 40
_SETTLED = 1e-4
_LEAST_DEGREES = 0.5
"""A snapshot of a robust method with fewer degrees of freedom than this determines no factor."""


@dataclass(frozen=True)
class RowSquares:
    """Weighted squares over stated std, weights and degrees of freedom of rows (B, K), over their scalars.

    ``unknowns`` is their number in each snapshot: coordinates of the position, and the offset of arrivals.
    """

    squares: FloatArray
    weight: FloatArray
    degrees: FloatArray
    unknowns: int

    @property
    def spare(self) -> FloatArray:
        """The weights (B,) of the scalars beyond the unknowns; negative where there are fewer."""
        return sum_measurements(self.weight) - self.unknowns


def with_std_factors(batch: Batch, factors: FloatArray | float) -> Any:
    """Return the batch with its standard deviations times factors, (B, K) or one.

    Raises UsageError for a measured height: its standard deviation is stated.
    """
    if batch.target_z_m is not None and not batch.height_held:
        raise UsageError(HEIGHT_FAULT)
    arrays = {name: getattr(batch, name) for name in batch.STDS}
    scaled = {name: np.asfortranarray(array * factors) for name, array in arrays.items() if array is not None}
    return dataclasses.replace(batch, std="estimated", **scaled)  # type: ignore[arg-type]


def with_unknown_factor(batch: Batch, *, want_flags: bool | None = None) -> Any:
    """Return the batch with standard deviations that are relative weights; raises UsageError for a measured height."""
    if batch.target_z_m is not None and not batch.height_held:
        raise UsageError(HEIGHT_FAULT)
    return dataclasses.replace(batch, std="unknown", want_flags=batch.want_flags if want_flags is None else want_flags)


def uses_ranges(spec: MethodSpec, options: Any) -> bool:
    """Return whether a method uses the ranges beside bearings, where present."""
    return "range_m" in spec.reads and bool(getattr(options, "use_ranges", False))


def snapshot_factors(spec: MethodSpec, batch: Any, options: Any) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the factor of each snapshot (B,) of a robust method, its degrees of freedom, and whether it is determined.

    f^2 = sum w r^2 / (sum w - p) over the rows, with their probabilities w to be direct at that f: solved again until
    f stays, from the factor of ``ml``, which trusts all rows, or 1 if outliers leave ``ml`` without a fix. Where
    nothing determines it, the last that was.
    """
    trusting = registry.resolve("ml", spec.kind, "localize")
    first = trusting.solve(with_unknown_factor(batch, want_flags=False), trusting.options()).estimates
    factors, degrees = np.ones(batch.size), np.zeros(batch.size)
    best = (first.alternative == 0) & np.isfinite(first.columns["std_factor"])
    factors[first.row[best]] = first.columns["std_factor"][best]
    determined, moving = np.zeros(batch.size, dtype=bool), np.ones(batch.size, dtype=bool)
    for _ in range(_MOST_ROUNDS):
        if not moving.any():
            break
        each = np.broadcast_to(factors[:, None], getattr(batch, batch.STDS[0]).shape)
        rows = weighted_rows(spec, options, batch, each)
        spare = rows.spare
        with ignoring_division():
            after = np.sqrt(sum_measurements(rows.squares) / spare)
        known = (spare >= _LEAST_DEGREES) & (after > 0.0) & np.isfinite(after)
        change = np.where(known, np.abs(np.log(np.where(known, after, 1.0) / factors)), 0.0)
        degrees, determined = np.where(moving, spare, degrees), np.where(moving, known, determined)
        factors = np.where(moving & known, after, factors)
        moving &= known & (change > _SETTLED)
    return factors, degrees, determined


def weighted_rows(spec: MethodSpec, options: Any, batch: Any, factors: FloatArray) -> RowSquares:
    """Return the squares of the rows of a robust method, weighted by their probabilities to be direct."""
    assert spec.direct_rows is not None  # noqa: S101 - the caller's case
    scaled = with_std_factors(batch, factors)
    position, weight = spec.direct_rows(scaled, options)
    weight = np.asfortranarray(np.where(np.isfinite(position[:, :1]), weight, 0.0))
    return row_squares(spec, options, scaled, position, weight, factors)


def row_squares(
    spec: MethodSpec, options: Any, scaled: Any, position: FloatArray, weight: FloatArray, factors: FloatArray
) -> RowSquares:
    """Return the squares of rows (B, K) with a ``weight`` at positions (B, D), over the std without the factors.

    For a method that does not minimize the chi-square they are what a Gauss-Newton step to its minimum leaves.
    """
    scalars = SCALED_RESIDUALS[spec.kind](scaled, position, with_ranges=uses_ranges(spec, options))
    information, shares = leverages(scalars, weight)
    if spec.direct_rows is None and spec.cost != LEAST_HALF_CHI_SQUARE:
        scalars = at_minimum(scalars, weight, information)
    squares, weights, degrees = (np.zeros(weight.shape, order="F") for _ in range(3))
    with ignoring_invalid():
        for scalar, leverage in zip(scalars, shares, strict=True):
            squares += weight * (scalar.residual * factors) ** 2
            weights += weight * scalar.measured
            degrees += weight * scalar.measured * (1.0 - leverage)
    sound = np.isfinite(degrees) & np.isfinite(squares)
    squares, degrees = np.where(sound, squares, 0.0), np.where(sound, np.maximum(degrees, 0.0), 0.0)
    return RowSquares(squares, weights, degrees, len(scalars[0].slopes))
