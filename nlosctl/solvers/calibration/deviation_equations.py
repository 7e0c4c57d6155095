"""Normal equations of the deviations of arrays, the positions of the snapshots eliminated by the Schur complement.

As `nlosctl.solvers.calibration.elimination`, with several unknowns of each array: row i has the derivatives m_i by the
terms of its array's deviation, so that B of its equation (1) has the m_i in place of ones. A snapshot may have any
number of rows, such as those of a whole drive, since only sums over the rows are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.geometry.blocks import RowBlock
from nlosctl.models.scaled_residuals import ScaledResiduals, leverages

__all__ = ["DeviationEquations", "deviation_equations"]

_LEAST_DETERMINANT = 1e-12
"""An information whose determinant is at most this share of its diagonal's product is singular."""


@dataclass(frozen=True)
class DeviationEquations(RowBlock):
    """What snapshots add to the normal equations of the P unknowns, T of each array; zeros without a position.

    ``information`` (B, P, P), ``gradient`` (B, P), and ``alone`` (B, P), the diagonal of the information if the
    positions were known. ``squares`` and ``degrees`` (B, K) are the weighted squares of the residuals over std that a
    step of the position leaves, and their degrees of freedom. ``located`` (B,) are the snapshots that count,
    ``position_std_m`` (B,) the root of the trace of the position's covariance, 0 where it is known.
    """

    information: FloatArray
    gradient: FloatArray
    alone: FloatArray
    squares: FloatArray
    degrees: FloatArray
    located: BoolArray
    position_std_m: FloatArray


def deviation_equations(
    scalars: ScaledResiduals, terms: FloatArray, array: IntArray, arrays: int, weight: FloatArray, located: BoolArray
) -> DeviationEquations:
    """Return the equations of snapshots by the bearings of their rows and the derivatives (B, K, T) by their terms.

    ``array`` (B, K) is the number of each row's array, of ``arrays``; ``weight`` (B, K) the probability that the row is
    direct. ``scalars.per_offset`` is the derivative of the residual by the bearing's deviation. Snapshots that are not
    ``located`` (B,), and those whose information is singular, add nothing.
    """
    assert scalars.per_offset is not None  # noqa: S101 - bearings have it
    unknowns = len(scalars.slopes)
    with ignoring_division():
        shares, inverse = np.zeros(weight.shape), np.zeros((weight.shape[0], 0, 0))
        if unknowns:
            information, (shares,) = leverages((scalars,), weight)
            scale = np.prod(list(information.diagonal), axis=0)
            located = located & (information.determinant > _LEAST_DETERMINANT * scale)
            inverse = np.where(located[:, None, None], information.inverse().dense(), 0.0)
    weight = np.where(located[:, None], weight, 0.0)
    size, (rows, count) = arrays * terms.shape[2], (weight.shape[1], weight.shape[0])
    moments, across = np.zeros((count, size, size)), np.zeros((count, unknowns, size))
    gradient, pull = np.zeros((count, size)), np.zeros((count, unknowns))
    for k in range(rows):  # sums over rows do not depend on the block
        by_term = np.zeros((count, arrays, terms.shape[2]))
        by_term[np.arange(count), array[:, k]] = terms[:, k] * scalars.per_offset[:, k, None]
        own = by_term.reshape(count, size)
        weighted = weight[:, k, None] * own
        slopes = np.stack([slope[:, k] for slope in scalars.slopes], axis=1) if unknowns else np.zeros((count, 0))
        moments += weighted[:, :, None] * own[:, None, :]
        across += slopes[:, :, None] * weighted[:, None, :]
        gradient -= weighted * scalars.residual[:, k, None]
        pull += slopes * (weight[:, k] * scalars.residual[:, k])[:, None]
    alone = np.einsum("bii->bi", moments).copy()
    residual = scalars.residual
    for i in range(unknowns):
        back, step = np.zeros((count, size)), np.zeros(count)
        for j in range(unknowns):
            back += inverse[:, i, j, None] * across[:, j]
            step += inverse[:, i, j] * pull[:, j]
        moments -= across[:, i, :, None] * back[:, None, :]
        gradient += back * pull[:, i, None]
        residual = residual - scalars.slopes[i] * step[:, None]
    squares, degrees = weight * residual**2, weight * scalars.measured * (1.0 - shares)
    variance = np.einsum("bii->b", inverse[:, :2, :2])
    return DeviationEquations(
        moments, gradient, alone, squares, np.maximum(np.nan_to_num(degrees), 0.0), located, np.sqrt(variance)
    )
