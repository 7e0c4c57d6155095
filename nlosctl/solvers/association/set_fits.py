"""Fits of sets of rows: the maximum-likelihood position of each set, by the models of a single source."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.contract.batches import BearingBatch
from nlosctl.geometry.blocks import RowBlock
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.sight import bearing_lines
from nlosctl.solvers.association.sensor_rows import gather_measurements
from nlosctl.solvers.bearings.circle_likelihood import bearing_problem
from nlosctl.solvers.optimization.levenberg_marquardt import minimize

__all__ = ["SourceSets", "fit_sets", "sets_by_size"]


@dataclass(frozen=True)
class SourceSets(RowBlock):
    """C sets of rows: snapshots (C,), rows (C, N) or -1 where a sensor has none, and their fits.

    ``point`` are D arrays (C,) about the local origins of the snapshots, ``chi_square`` (C,) is that of the residuals,
    ``information`` (C,) the Fisher information, ``valid`` (C,) false where there is no fit in front of all its rays.
    """

    snapshot: IntArray
    rows: IntArray
    point: Point
    chi_square: FloatArray
    information: SymmetricMatrix
    valid: BoolArray


def sets_by_size(batch: BearingBatch, snapshot: IntArray, rows: IntArray) -> Iterator[tuple[IntArray, BearingBatch]]:
    """Yield the indices (T,) of sets of n rows, and their batch (T, n): a snapshot for each set."""
    size = np.count_nonzero(rows >= 0, axis=1)
    for count in np.flatnonzero(np.bincount(size)):
        members = np.flatnonzero(size == count)
        own = rows[members]
        chosen = own[own >= 0].reshape(members.shape[0], count)
        yield members, gather_measurements(batch, snapshot[members], chosen)


def fit_sets(batch: BearingBatch, center: Point, snapshot: IntArray, rows: IntArray, point: Point) -> SourceSets:
    """Return the fits of sets of rows (C, N) from points about the snapshots' local origins ``center`` (B,)."""
    origin = tuple(middle[snapshot] for middle in center[: len(point)])
    fitted = tuple(np.full(snapshot.shape, np.nan) for _ in point)
    chi_square, valid = np.full(snapshot.shape, np.nan), np.zeros(snapshot.shape, dtype=bool)
    information = SymmetricMatrix.full(snapshot.shape, np.nan, len(point))
    for members, dense in sets_by_size(batch, snapshot, rows):
        lines = bearing_lines(dense)
        apart = [own[members] - middle for own, middle in zip(origin, lines.center, strict=False)]
        start = tuple(part[members] + shift for part, shift in zip(point, apart, strict=True))
        minimum = minimize(bearing_problem(lines), *lines.inside_circles(*start))
        with ignoring_overflow():
            rays = lines.ray_residuals(*minimum.point)
            information.put(members, lines.information(*minimum.point))
        for whole, part, shift in zip(fitted, minimum.point, apart, strict=True):
            whole[members] = part - shift
        chi_square[members] = rays.chi_square
        valid[members] = minimum.converged & ~rays.behind
    return SourceSets(snapshot, rows, fitted, chi_square, information, valid)
