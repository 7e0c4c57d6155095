"""Normal equations of the sensors' offsets, the positions of the snapshots eliminated by the Schur complement.

A row measures h(x) + b, b the offset of its sensor. With the weights W = w / s^2 of the errors, A the derivatives by
the unknowns of the snapshot (the position, and of arrivals the offset that they have in common) and B those by the
offsets of sensors, a snapshot adds to the normal equations N db = g of all offsets

    N = B'(W - W A (A'WA)^-1 A'W) B        g = B'(W - W A (A'WA)^-1 A'W) r                                   (1)

so that memory is that of the sensors' pairs, and time linear in the snapshots. w is the probability that a row is
direct, 1 where all rows are trusted. Where the position is known, A has no columns, or that of the common offset alone,
which takes a common offset of all sensors. A measured height of the source is a further row of A'WA.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.geometry.blocks import RowBlock, sum_measurements
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.scaled_residuals import ScaledResiduals, leverages

__all__ = ["OffsetEquations", "offset_equations", "row_pairs"]

_LEAST_DETERMINANT = 1e-12
"""An information whose determinant is at most this share of its diagonal's product is singular."""


@dataclass(frozen=True)
class OffsetEquations(RowBlock):
    """What snapshots of K rows add to the normal equations (1), zeros in a snapshot without a position.

    ``information`` (B, P) are the entries of N of the `row_pairs`, ``gradient`` (B, K) is g. ``alone`` (B, K) is the
    diagonal of N if the unknowns of the snapshots were known. ``squares`` and ``degrees`` (B, K) are the weighted
    squares of the residuals over std that a step of the unknowns leaves, and their degrees of freedom,
    w (1 - leverage). ``located`` (B,) are the snapshots that count, ``position_std_m`` (B,) the root of the trace of
    the position's covariance, 0 where it is known.
    """

    information: FloatArray
    gradient: FloatArray
    alone: FloatArray
    squares: FloatArray
    degrees: FloatArray
    located: BoolArray
    position_std_m: FloatArray


def row_pairs(rows: int) -> tuple[IntArray, IntArray]:
    """Return the indices (P,) of all pairs of rows, each once, with each row and itself among them."""
    return np.tril_indices(rows)


def offset_equations(
    scalars: Sequence[ScaledResiduals],
    weight: FloatArray,
    located: BoolArray,
    coordinates: int,
    height: ScaledResiduals | None = None,
) -> OffsetEquations:
    """Return the equations of snapshots by the scalars of their rows, with the probability (B, K) that a row is direct.

    Scalars that do not depend on offsets count for the unknowns alone, and so does a measured ``height`` (B, 1). The
    first ``coordinates`` unknowns are those of the position. Snapshots that are not ``located`` (B,), and those whose
    information is singular, add nothing.
    """
    with ignoring_division():
        information, shares = _information_of_unknowns(scalars, weight, height)
        located = located & _is_regular(information)
        weight = np.asfortranarray(np.where(located[:, None], weight, 0.0))
        degrees = np.zeros(weight.shape, order="F")
        for scalar, share in zip(scalars, shares, strict=True):
            degrees += np.where(located[:, None], weight * scalar.measured * (1.0 - share), 0.0)
    own = next(scalar for scalar in scalars if scalar.per_offset is not None)
    assert own.per_offset is not None  # noqa: S101 - chosen so
    per_offset = weight * own.per_offset
    alone = per_offset * own.per_offset
    later, earlier = row_pairs(weight.shape[1])
    entries = np.where(later == earlier, alone[:, later], 0.0)
    step: list[FloatArray] = []
    variance = np.zeros(weight.shape[0])
    if information is not None:
        inverse = information.inverse().map(lambda part: np.where(located, part, 0.0))
        variance = sum(inverse.diagonal[:coordinates], variance)
        across = [per_offset * slope for slope in own.slopes]
        for moved, other in zip(across, _products(inverse, across), strict=True):
            entries -= moved[:, later] * other[:, earlier]
        step = _products(inverse, _pulls(scalars, weight, height, located))
    gradient = -per_offset * _after_step(own, step)
    squares = sum((weight * _after_step(scalar, step) ** 2 for scalar in scalars), np.zeros(weight.shape))
    return OffsetEquations(entries, gradient, alone, squares, np.maximum(degrees, 0.0), located, np.sqrt(variance))


def _after_step(scalar: ScaledResiduals, step: Sequence[FloatArray]) -> FloatArray:
    """Return the residuals (B, K) after a Gauss-Newton step (B, 1) of each unknown, r - A (A'WA)^-1 A'W r."""
    residual = scalar.residual
    for slope, part in zip(scalar.slopes, step, strict=True):
        residual = residual - slope * part
    return residual


def _products(matrix: SymmetricMatrix, vectors: Sequence[FloatArray]) -> list[FloatArray]:
    """Return the products of matrices (B,) with the vectors of each row, given as arrays (B, K)."""
    indices = range(len(vectors))
    products = [[matrix.entry(i, j)[:, None] * vectors[j] for j in indices] for i in indices]
    return [np.asarray(sum(parts[1:], parts[0])) for parts in products]


def _pulls(
    scalars: Sequence[ScaledResiduals], weight: FloatArray, height: ScaledResiduals | None, located: BoolArray
) -> list[FloatArray]:
    """Return A'W r, an array (B, 1) for each unknown."""
    pulls = []
    for axis in range(len(scalars[0].slopes)):
        parts = [sum_measurements(weight * scalar.residual * scalar.slopes[axis]) for scalar in scalars]
        if height is not None:
            parts.append(np.where(located, (height.residual * height.slopes[axis])[:, 0], 0.0))
        pulls.append(np.asarray(sum(parts[1:], parts[0]))[:, None])
    return pulls


def _information_of_unknowns(
    scalars: Sequence[ScaledResiduals], weight: FloatArray, height: ScaledResiduals | None
) -> tuple[SymmetricMatrix | None, list[FloatArray]]:
    """Return A'WA (B,), None without unknowns, and the leverages (B, K) of each scalar's rows."""
    if not scalars[0].slopes:
        return None, [np.zeros(weight.shape) for _ in scalars]
    further = None if height is None else SymmetricMatrix.gram(*height.slopes)
    return leverages(tuple(scalars), weight, further)


def _is_regular(information: SymmetricMatrix | None) -> BoolArray | bool:
    """Return which matrices (B,) can be inverted."""
    if information is None:
        return True
    scale = np.ones(information.xx.shape)
    for entry in information.diagonal:
        scale = scale * entry
    return np.asarray(information.determinant > _LEAST_DETERMINANT * scale)
