"""The best optimum of each snapshot and its alternative as estimates."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, StatusArray
from nlosctl.contract.results import Estimates, has_covariance
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.solvers.optimization.unknown_std import StdFactors

__all__ = ["RangeOptimum", "paired_estimates"]


@dataclass(frozen=True)
class RangeOptimum(RowBlock):
    """Points (B,) about the local origin, their covariance, what the search minimized there, and whether it settled."""

    point: tuple[FloatArray, ...]
    covariance: SymmetricMatrix
    cost: FloatArray
    converged: BoolArray


class Frame(Protocol):
    """Local origins of snapshots."""

    @property
    def absolute(self) -> Callable[..., tuple[FloatArray, ...]]:
        """Return points (B,), given about the local origins, in the frame, with a height that is exactly known."""
        ...

    def whole_covariance(self, covariance: SymmetricMatrix, *point: FloatArray) -> SymmetricMatrix:
        """Return the covariances of all coordinates; zeros for a height that is exactly known."""
        ...


def paired_estimates(
    second: IntArray,
    frame: Frame,
    optima: tuple[RangeOptimum, RangeOptimum],
    costs: tuple[FloatArray, FloatArray],
    statuses: tuple[StatusArray, StatusArray],
    chi_squares: tuple[FloatArray, FloatArray],
    measurements: int,
    degrees_of_freedom: IntArray,
    factors: StdFactors | None = None,
    columns: Sequence[Mapping[str, FloatArray]] = ({}, {}),
) -> Estimates:
    """Return a row per snapshot (B,), and one more for each of the ``second`` snapshots.

    ``frame`` has the positions of the optima about the local origins; ``factors`` are those of unknown standard
    deviations, ``columns`` further ones of the optima that have a covariance: (B,) of the best, of the others those of
    the ``second`` snapshots.
    """
    snapshots = np.arange(statuses[0].shape[0], dtype=np.int64)
    row = np.concatenate([snapshots, second])
    alternative = np.repeat([0, 1], [snapshots.shape[0], second.shape[0]])
    order = np.lexsort((alternative, row))
    row, alternative = row[order], alternative[order]

    def join(first: FloatArray, other: FloatArray) -> FloatArray:
        return np.concatenate([first, other[second]])[order]

    best, rest = optima
    status = np.concatenate([statuses[0], statuses[1][second]])[order]
    positions = zip(frame.absolute(*best.point), frame.absolute(*rest.point), strict=True)
    certain = has_covariance(status)
    further = {
        name: np.where(certain, np.concatenate([first, columns[1][name]])[order], np.nan)
        for name, first in columns[0].items()
    }
    covariances = (frame.whole_covariance(optimum.covariance, *optimum.point) for optimum in optima)
    return Estimates.of(
        status,
        tuple(join(*pair) for pair in positions),
        SymmetricMatrix(*(join(*pair) for pair in zip(*covariances, strict=True))),
        join(*costs),
        measurements,
        row=row,
        alternative=alternative,
        chi_square=join(*chi_squares),
        degrees_of_freedom=degrees_of_freedom[row],
        columns={**further, **({} if factors is None else factors.take(row).columns(status))},
    )
