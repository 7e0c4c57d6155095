"""Squared residuals of the rows of dense batches over their stated std, with their degrees of freedom."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from nlosctl import registry
from nlosctl.arrays import BoolArray, FloatArray, ignoring_division, ignoring_invalid
from nlosctl.contract.batches import Batch
from nlosctl.contract.methods import MethodSpec
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS, leverages

__all__ = ["row_squares", "snapshot_factors", "uses_ranges", "weighted_rows", "with_std_factors"]

_MOST_ROUNDS = 40
_SETTLED = 1e-4
_LEAST_DEGREES = 0.5
"""A snapshot of a robust method with fewer degrees of freedom than this determines no factor."""

_UNKNOWNS = 2


def with_std_factors(batch: Batch, factors: FloatArray | float) -> Any:
    """Return the batch with its standard deviations times factors, (B, K) or one."""
    arrays = {name: getattr(batch, name) for name in batch.STDS}
    scaled = {name: np.asfortranarray(array * factors) for name, array in arrays.items() if array is not None}
    return dataclasses.replace(batch, std="estimated", **scaled)  # type: ignore[arg-type]


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
    first = trusting.solve(dataclasses.replace(batch, std="unknown", want_flags=False), trusting.options()).estimates
    factors, degrees = np.ones(batch.size), np.zeros(batch.size)
    best = (first.alternative == 0) & np.isfinite(first.columns["std_factor"])
    factors[first.row[best]] = first.columns["std_factor"][best]
    determined = np.full(batch.size, getattr(batch, batch.STDS[0]).shape[1] > _UNKNOWNS)
    moving = determined.copy()
    for _ in range(_MOST_ROUNDS):
        if not moving.any():
            break
        each = np.broadcast_to(factors[:, None], getattr(batch, batch.STDS[0]).shape)
        squares, weight, _ = weighted_rows(spec, options, batch, each)
        spare = sum_measurements(weight) - _UNKNOWNS
        with ignoring_division():
            after = np.sqrt(sum_measurements(squares) / spare)
        known = (spare >= _LEAST_DEGREES) & (after > 0.0) & np.isfinite(after)
        change = np.where(known, np.abs(np.log(np.where(known, after, 1.0) / factors)), 0.0)
        degrees, determined = np.where(moving, spare, degrees), np.where(moving, known, determined)
        factors = np.where(moving & known, after, factors)
        moving &= known & (change > _SETTLED)
    return factors, degrees, determined


def weighted_rows(
    spec: MethodSpec, options: Any, batch: Any, factors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the weighted squares, the weights and the degrees of freedom (B, K) of the rows of a robust method."""
    assert spec.direct_rows is not None  # noqa: S101 - the caller's case
    scaled = with_std_factors(batch, factors)
    position, weight = spec.direct_rows(scaled, options)
    weight = np.asfortranarray(np.where(np.isfinite(position[:, :1]), weight, 0.0))
    return row_squares(spec, options, scaled, position, weight, factors)


def row_squares(
    spec: MethodSpec, options: Any, scaled: Any, position: FloatArray, weight: FloatArray, factors: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return weighted squares over stated std, weights and degrees of freedom of rows (B, K), over their scalars."""
    scalars = SCALED_RESIDUALS[spec.kind](scaled, position, with_ranges=uses_ranges(spec, options))
    _, shares = leverages(scalars, weight)
    squares, weights, degrees = (np.zeros(weight.shape, order="F") for _ in range(3))
    with ignoring_invalid():
        for scalar, leverage in zip(scalars, shares, strict=True):
            squares += weight * (scalar.residual * factors) ** 2
            weights += weight * scalar.measured
            degrees += weight * scalar.measured * (1.0 - leverage)
    sound = np.isfinite(degrees) & np.isfinite(squares)
    return np.where(sound, squares, 0.0), weights, np.where(sound, np.maximum(degrees, 0.0), 0.0)
