"""Sets of rows that agree while they grow: steps 2 to 5 of Section IV-B of Ananthasubramaniam and Madhow."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.contract.step_progress import note_step
from nlosctl.solvers.mixture.outlier_model import OutlierModel
from nlosctl.solvers.sequential.set_scores import SetScores

__all__ = ["GrowingSets", "SetState", "may_pair", "put_states"]


class SetState(Protocol):
    """Positions about the local origin, ``alive`` where there is one."""

    @property
    def point(self) -> Point:
        """The positions as D arrays (B, M)."""
        ...

    @property
    def alive(self) -> BoolArray:
        """Where (B, M) there is a position."""
        ...

    def where(self, first: BoolArray, other: Self) -> Self:
        """Return these states where ``first``, the others elsewhere."""
        ...


@dataclass
class GrowingSets(ABC):
    """N sets, each with a model of K rows of its own; the state's arrays are (N, 1), all others (N, K).

    ``misfit`` is the residual of a row that is left in standard deviations, infinite in rows that are not. How a row
    updates a state, and how residuals are compared, depends on the geometry.
    """

    model: OutlierModel
    state: Any
    used: BoolArray
    left: BoolArray
    misfit: FloatArray
    scores: SetScores | None = None
    cost: FloatArray | None = None

    @abstractmethod
    def updated(self, chosen: IntArray) -> Any:
        """Return the states updated by the rows ``chosen`` (N, 1)."""

    @abstractmethod
    def residuals(self, state: Any) -> Any:
        """Return the residuals of all rows at states."""

    @abstractmethod
    def below_limits(self, residuals: Any) -> BoolArray:
        """Return which rows (N, K) are below their thresholds (25)."""

    @abstractmethod
    def in_stds(self, residuals: Any) -> FloatArray:
        """Return the sizes (N, K) of residuals in standard deviations; NaN in rows without one."""

    def prepare(self, first: IntArray, second: IntArray) -> None:
        """Begin with the pairs ``first``, ``second`` (N, 1)."""
        leaders = [np.take_along_axis(self.model.leader, index, axis=1) for index in (first, second)]
        for index in (first, second):
            np.put_along_axis(self.used, index, True, axis=1)
        self.left &= (leaders[0] != self.model.leader) & (leaders[1] != self.model.leader) & (self.model.share > 0.0)
        self.note_misfits(self.residuals(self.state), np.True_)

    def run(self, *, by_likelihood: bool) -> None:
        """Take steps until no set has a row left."""
        for step in range(self.model.mixture.count - 2):
            note_step(step, self.model.mixture.count)
            if not self.step(by_likelihood):
                break

    def note_misfits(self, residuals: Any, where: BoolArray | np.bool_) -> None:
        """Keep the residuals of the rows that are left, in standard deviations, of the sets ``where`` (N, 1)."""
        misfit = self.in_stds(residuals)
        np.copyto(misfit, np.inf, where=np.isnan(misfit))
        np.copyto(self.misfit, misfit, where=where & self.left)

    def step(self, by_likelihood: bool) -> bool:
        """Combine the best of the rows left (steps 2-4), and take it from those left (step 5); False: none was left."""
        chosen = np.argmin(self.misfit, axis=1)[:, None]
        any_left = np.isfinite(np.take_along_axis(self.misfit, chosen, axis=1))
        if not any_left.any():
            return False
        trial = self.updated(chosen)
        residuals = self.residuals(trial)
        joined = self.used.copy()
        np.put_along_axis(joined, chosen, True, axis=1)
        accepted = any_left & trial.alive
        if by_likelihood:
            accepted = self._likelier(trial, accepted)
        else:
            accepted &= (self.below_limits(residuals) | ~joined).all(axis=1, keepdims=True)
        np.copyto(self.used, joined, where=accepted)
        np.put_along_axis(self.left, chosen, False, axis=1)
        np.put_along_axis(self.misfit, chosen, np.inf, axis=1)
        if self.model.mixture.last is not None:
            group = np.take_along_axis(self.model.leader, chosen, axis=1)
            rivals = accepted & (self.model.leader == group)
            self.left &= ~rivals
            np.copyto(self.misfit, np.inf, where=rivals)
        self.note_misfits(residuals, accepted)
        self.state = trial.where(accepted, self.state)
        return True

    def _likelier(self, trial: SetState, possible: BoolArray) -> BoolArray:
        """Return where, of the ``possible``, (23) at the trial state is not worse than at the present one."""
        with ignoring_overflow():
            if self.scores is None or self.cost is None:
                self.scores = SetScores.of(self.model.mixture)
                self.cost = _score(self.scores, self.state)
            cost = _score(self.scores, trial)
            better: BoolArray = possible & (cost <= self.cost)
        self.cost = np.where(better, cost, self.cost)
        return better


def may_pair(model: OutlierModel, first: IntArray, second: IntArray) -> BoolArray:
    """Return which pairs of rows (B, M) may both be direct: of different groups, each of positive share."""
    leaders = [np.take_along_axis(model.leader, index, axis=1) for index in (first, second)]
    share = [np.take_along_axis(model.share, index, axis=1) for index in (first, second)]
    return np.asarray((leaders[0] != leaders[1]) & (share[0] > 0.0) & (share[1] > 0.0))


def put_states(at: tuple[IntArray, IntArray], state: SetState, block: SetState) -> None:
    """Write the positions of states (N, 1) into those of a block (B, M)."""
    for mine, values in zip(block.point, state.point, strict=True):
        mine[at] = values[:, 0]
    block.alive[at] = state.alive[:, 0]


def _score(scores: SetScores, state: SetState) -> FloatArray:
    return np.where(state.alive, scores.at(*state.point), np.inf)
