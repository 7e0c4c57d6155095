"""Solution of the normal equations of offsets: what the data determine, and what stays at zero.

With D the information if the positions were known, the eigenvalues of D^-1/2 N D^-1/2 are the shares of it that
survive the unknown positions: rounding where a combination of offsets can't be determined, 1 where the positions cost
nothing. A combination that can't be determined keeps zero mean: the step is that of the pseudo-inverse of N.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Combination", "OffsetSolution", "solve_offsets"]

LOST = 1e-9
"""A share of information below this is rounding."""

WEAK = 1e-3
"""A combination with a smaller share of information than this is worth a remark: misfit of every kind ends there."""

_PART = 0.3
"""A combination is named by the offsets whose coefficients are at least this part of the largest."""


@dataclass(frozen=True)
class Combination:
    """A combination of offsets: the indices of those it consists of, the ``share`` of information on it, and its std.

    The std is that of the combination whose coefficients have absolute values of sum 1. It is ``common`` if all
    coefficients have one sign.
    """

    offsets: tuple[int, ...]
    share: float
    std: float
    common: bool = True


@dataclass(frozen=True)
class OffsetSolution:
    """The step (J,) of the offsets and their covariance (J, J), zero for those that nothing determines.

    ``determined`` (J,) are the offsets with a covariance. ``lost`` are combinations that the measurements don't
    determine, single offsets first; a prior alone does. ``weak`` are those that they hardly determine. ``freedom`` is
    the number of degrees of freedom that the offsets take off the residuals.
    """

    step: FloatArray
    covariance: FloatArray
    determined: BoolArray
    lost: tuple[Combination, ...]
    weak: tuple[Combination, ...]
    freedom: float


def solve_offsets(
    information: FloatArray,
    gradient: FloatArray,
    alone: FloatArray,
    offsets: FloatArray,
    prior_std: float | None = None,
) -> OffsetSolution:
    """Return the solution of the normal equations N (J, J), g (J,), with D (J,) the information of known positions.

    A prior of mean zero and the same std for every offset adds 1 / std^2 to the diagonal of N and -b / std^2 to g, b
    the current ``offsets`` (J,). Without it, the covariance is the pseudo-inverse of N.
    """
    size, precision = alone.shape[0], 0.0 if prior_std is None else prior_std**-2.0
    own = np.divide(np.diag(information), alone, out=np.zeros(size), where=alone > 0.0)
    informed = own >= LOST
    gradient = np.where(informed, gradient - precision * offsets, 0.0)
    lost = [Combination((int(index),), 0.0, _std(precision)) for index in np.flatnonzero(~informed)]
    weak: list[Combination] = []
    covariance = np.zeros((size, size))
    if precision > 0.0:
        np.fill_diagonal(covariance, np.where(informed, 0.0, 1.0 / precision))
    for members in _components(information, informed):
        part = np.ix_(members, members)
        shares, vectors = _shares(information[part], alone[members])
        free = vectors[:, shares < LOST]
        covariance[part] = _inverse(information[part], precision, free)
        for share, vector in zip(shares, vectors.T, strict=True):
            if share < WEAK:
                (lost if share < LOST else weak).append(_combination(members, share, vector, covariance[part]))
    freedom = float(np.sum(information * covariance))
    step = covariance @ gradient
    return OffsetSolution(step, covariance, informed | (precision > 0.0), tuple(lost), tuple(weak), freedom)


def _std(precision: float) -> float:
    return 0.0 if precision == 0.0 else precision**-0.5


def _components(information: FloatArray, informed: BoolArray) -> list[IntArray]:
    """Return the indices of the informed offsets, those together that measurements connect."""
    index = np.flatnonzero(informed)
    count, labels = connected_components(csr_array(information[np.ix_(index, index)] != 0.0), directed=False)
    return [index[labels == label] for label in range(count)]


def _shares(information: FloatArray, alone: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the eigenvalues of D^-1/2 N D^-1/2, rising, and the combinations of offsets as columns, of unit length."""
    scale = 1.0 / np.sqrt(alone)
    shares, vectors = np.linalg.eigh(information * scale * scale[:, None])
    combinations = vectors * scale[:, None]
    return shares, combinations / np.sqrt(np.sum(combinations * combinations, axis=0))


def _inverse(information: FloatArray, precision: float, free: FloatArray) -> FloatArray:
    """Return the inverse of N + precision, without a prior the pseudo-inverse with the null space of columns ``free``.

    Symmetric to the last bit.
    """
    size = information.shape[0]
    if precision > 0.0:
        inverse = np.linalg.inv(information + precision * np.eye(size))
    else:
        basis = np.linalg.qr(free, mode="complete")[0][:, free.shape[1] :]
        inverse = basis @ np.linalg.inv(basis.T @ information @ basis) @ basis.T
    return np.asarray(0.5 * (inverse + inverse.T))


def _combination(members: IntArray, share: float, vector: FloatArray, covariance: FloatArray) -> Combination:
    size = np.abs(vector)
    coefficients = vector / size.sum()
    named = size >= _PART * size.max()
    variance = float(coefficients @ covariance @ coefficients)
    common = bool(np.all(vector[named] > 0.0) or np.all(vector[named] < 0.0))
    return Combination(tuple(members[named].tolist()), max(float(share), 0.0), max(variance, 0.0) ** 0.5, common)
