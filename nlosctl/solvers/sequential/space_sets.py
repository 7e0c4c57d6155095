"""Outlier suppression in space and on the earth: sets of rows that grow by updates in information form.

A row with the gradient g and the Gauss-Newton matrix G of half its chi-square at a position of information J moves
it by -(J + G)^-1 g and adds G: the update (6)-(14) of Ananthasubramaniam and Madhow for rows of several scalars, in
Cartesian coordinates.
"""

from __future__ import annotations

import operator
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import reduce
from typing import Any

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.selected_rows import SelectedRows
from nlosctl.solvers.bearings.row_crossings import cross_rows
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.optimization.problem import RowDerivatives
from nlosctl.solvers.sequential.growing_sets import GrowingSets, may_pair

__all__ = ["SpaceSets", "SpaceState", "start_in_space"]


@dataclass(frozen=True)
class SpaceState:
    """Positions (B, M) about the local origin and their information; ``alive`` where there is one."""

    point: Point
    information: SymmetricMatrix
    alive: BoolArray

    def where(self, first: BoolArray, other: SpaceState) -> SpaceState:
        """Return these states where ``first``, the others elsewhere."""
        return SpaceState(
            tuple(np.where(first, *pair) for pair in zip(self.point, other.point, strict=True)),
            self.information.where(first, other.information),
            np.where(first, self.alive, other.alive),
        )


def start_in_space(model: OutlierModel, first: IntArray, second: IntArray) -> SpaceState:
    """Return the crossings of pairs of rows (B, M) that may both be direct; their information is not yet known."""
    crossings = cross_rows(model.lines, first, second)
    alive = crossings.valid & may_pair(model, first, second)
    return SpaceState(crossings.point, SymmetricMatrix.full(alive.shape, np.nan, model.mixture.dimension), alive)


@dataclass
class SpaceSets(GrowingSets):
    """Sets in space; a row's residual is the root of its chi-square, which is compared with that of an outlier."""

    log_obstructed: FloatArray | None = None

    @classmethod
    def start(cls, model: OutlierModel, first: IntArray, second: IntArray) -> SpaceSets:
        """Return sets that begin with pairs of rows ``first``, ``second`` (N, 1) of their models."""
        state = start_in_space(model, first, second)
        shape = model.leader.shape
        used, left = np.zeros(shape, dtype=bool), np.ones(shape, dtype=bool)
        sets = cls(model, state, used, left, np.full(shape, np.inf))
        with ignoring_overflow():
            information, gradient = sets._pair_terms(first, second)
            step = information.solve(*gradient)
            sets.state = replace(state, point=tuple(p - s[:, None] for p, s in zip(state.point, step, strict=True)))
            information, _ = sets._pair_terms(first, second)
        alive = state.alive & np.isfinite(information.determinant)[:, None]
        sets.state = SpaceState(sets.state.point, information.at(slice(None), None), alive)
        sets.prepare(first, second)
        return sets

    def _pair_terms(self, first: IntArray, second: IntArray) -> tuple[SymmetricMatrix, Point]:
        """Return the information (N,) of pairs of rows and a measured height at the states, and the gradient."""
        terms = [self.row_at(first), self.row_at(second)]
        if self.model.mixture.height is not None:
            terms.append(self.model.mixture.height_terms(*(part[:, 0] for part in self.state.point)))
        information = reduce(operator.add, [term.gauss for term in terms])
        return information, tuple(
            reduce(np.add, parts) for parts in zip(*(term.gradient for term in terms), strict=True)
        )

    def row_at(self, chosen: IntArray) -> RowDerivatives:
        """Return half the chi-square of the rows ``chosen`` (N, 1) at the states, and its derivatives."""
        row = _pick(self.model.direct, chosen, self.model.leader.shape)
        derivatives: RowDerivatives = row.derivatives(0, *(part[:, 0] for part in self.state.point))
        return derivatives

    def updated(self, chosen: IntArray) -> SpaceState:
        """Return the states updated by the rows ``chosen`` (N, 1); dead where a row can't be direct."""
        row, state = self.row_at(chosen), self.state
        with ignoring_overflow():
            information = state.information.at(slice(None), 0) + row.gauss
            step = information.solve(*row.gradient)
            point = tuple(part - move[:, None] for part, move in zip(state.point, step, strict=True))
            moved = np.isfinite(row.half_chi_square) & np.isfinite(step[0])
        return SpaceState(point, information.at(slice(None), None), state.alive & moved[:, None])

    def residuals(self, state: SpaceState) -> FloatArray:
        """Return half the chi-squares (N, K) of all rows."""
        rows = self.model.direct
        with ignoring_overflow():
            parts = [rows.half_chi_square(k, *state.point) for k in range(self.model.mixture.count)]
        return np.concatenate(parts, axis=1)

    def below_limits(self, residuals: FloatArray) -> BoolArray:
        """Return which rows (N, K) are likelier direct than outliers: (25) for all scalars of a row together."""
        mixture = self.model.mixture
        likelier: BoolArray = mixture.log_direct - residuals > np.log(mixture.obstructed)[:, None]
        return likelier

    def in_stds(self, residuals: FloatArray) -> FloatArray:
        """Return the roots (N, K) of the chi-squares."""
        return np.sqrt(2.0 * residuals)


def _pick(block: Any, chosen: IntArray, shape: tuple[int, ...]) -> Any:
    """Return the rows ``chosen`` (N, 1) of a block of rows of a shape (N, K) as a block of one row each.

    Standard deviations are beside each other, kind by kind: the row has one of each.
    """
    if isinstance(block, SelectedRows):
        return block.one_of_each(chosen[:, 0])
    if isinstance(block, np.ndarray) and block.ndim == 2:
        count = block.shape[1] // shape[1]
        kinds = [np.take_along_axis(block, chosen + number * shape[1], axis=1) for number in range(count)]
        return np.concatenate([*kinds, block[:, count * shape[1] :]], axis=1)
    if isinstance(block, tuple):
        return tuple(_pick(part, chosen, shape) for part in block)
    if is_dataclass(block) and not isinstance(block, type):
        parts = {field.name: _pick(getattr(block, field.name), chosen, shape) for field in fields(block)}
        return type(block)(**parts)
    return block
