"""Nearly constant velocity: white acceleration of a density q between the states of independent tracks.

A state is (position, velocity), D coordinates each. With e = x_{k+1} - F x_k, per axis,

    F = [1 h; 0 1]    Q = q [h^3/3  h^2/2; h^2/2  h]    Q^-1 = (1/q) [12/h^3  -6/h^2; -6/h^2  4/h]        (1)

the cost of a path is the sum of e' Q^-1 e / 2 (Bar-Shalom, Li, Kirubarajan 2001, Section 6.2.2).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray

__all__ = ["Motion"]


@dataclass(frozen=True)
class Motion:
    """The motion of N states: ``within`` (N,) counts the states of each track from 0.

    ``step_s`` (N,) is the time to the next state of the track, 1 at the last; ``density`` (N,) is q in m2/s3.
    """

    within: IntArray
    step_s: FloatArray
    density: FloatArray

    @classmethod
    def of(cls, within: IntArray, time_s: FloatArray, density: FloatArray | float) -> Motion:
        """Return the motion of states at times (N,), rising within each track."""
        step_s = np.ones(within.shape)
        inner = np.flatnonzero(within[1:] > 0)
        step_s[inner] = time_s[inner + 1] - time_s[inner]
        return cls(within, step_s, np.broadcast_to(np.asarray(density, dtype=np.float64), within.shape))

    def with_density(self, density: FloatArray | float) -> Motion:
        """Return the same motion with another q."""
        return replace(self, density=np.broadcast_to(np.asarray(density, dtype=np.float64), self.within.shape))

    def take(self, kept: BoolArray) -> Motion:
        """Return the motion of whole tracks, whose states (N,) are ``kept``."""
        return Motion(self.within[kept], self.step_s[kept], self.density[kept])

    @cached_property
    def moves(self) -> BoolArray:
        """Which states (N,) have a state after them in their track."""
        return np.append(self.within[1:], 0) > 0

    @cached_property
    def alone(self) -> BoolArray:
        """Which states (N,) are the only one of their track."""
        alone: BoolArray = np.logical_and(self.within == 0, ~self.moves)
        return alone

    @cached_property
    def first(self) -> IntArray:
        """The index of the first state of each track (T,)."""
        return np.flatnonzero(self.within == 0)

    @cached_property
    def track(self) -> IntArray:
        """The track (N,) of each state."""
        return np.asarray(np.cumsum(self.within == 0) - 1)

    @cached_property
    def weights(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """The entries (N,) of Q^-1, (1): 12/h^3, 6/h^2 and 4/h over q; 0 at the last state of a track."""
        h, inverse = self.step_s, np.where(self.moves, 1.0 / self.density, 0.0)
        return 12.0 * inverse / (h * h * h), 6.0 * inverse / (h * h), 4.0 * inverse / h

    def blocks(self, dimension: int) -> tuple[FloatArray, FloatArray]:
        """Return the blocks (N, 2D, 2D) of the matrix of the cost: diagonal, and coupling to the state after."""
        stiff, cross, slow = self.weights
        size = self.within.shape[0]
        diagonal, coupling = np.zeros((2, size, 2 * dimension, 2 * dimension))
        for axis in range(dimension):
            p, v = axis, dimension + axis
            diagonal[:, p, p] += stiff
            diagonal[:, p, v] += cross
            diagonal[:, v, v] += slow
            diagonal[1:, p, p] += stiff[:-1]
            diagonal[1:, p, v] -= cross[:-1]
            diagonal[1:, v, v] += slow[:-1]
            diagonal[:, v, p] = diagonal[:, p, v]
            coupling[:, p, p] = -stiff
            coupling[:, p, v] = cross
            coupling[:, v, p] = -cross
            coupling[:, v, v] = 0.5 * slow
        return diagonal, coupling

    def deviations(self, states: FloatArray) -> FloatArray:
        """Return e (N, 2D) of the steps from each state (N, 2D); of a track's last state without meaning."""
        dimension = states.shape[1] // 2
        ahead = np.append(states[1:], states[:1], axis=0)
        deviation = ahead - states
        deviation[:, :dimension] -= self.step_s[:, None] * states[:, dimension:]
        return deviation

    def cost(self, states: FloatArray) -> FloatArray:
        """Return the cost (N,) of the step from each state, 0 at the last of a track."""
        stiff, cross, slow = self.weights
        dimension = states.shape[1] // 2
        deviation = self.deviations(states)
        shift, turn = deviation[:, :dimension], deviation[:, dimension:]
        return np.asarray(
            0.5 * stiff * np.sum(shift * shift, axis=1)
            - cross * np.sum(shift * turn, axis=1)
            + 0.5 * slow * np.sum(turn * turn, axis=1)
        )

    def gradient(self, states: FloatArray) -> FloatArray:
        """Return the gradient (N, 2D) of the cost, from the deviations: exact where the path is nearly straight."""
        stiff, cross, slow = (weight[:, None] for weight in self.weights)
        dimension = states.shape[1] // 2
        deviation = self.deviations(states)
        shift, turn = deviation[:, :dimension], deviation[:, dimension:]
        ahead = np.concatenate([stiff * shift - cross * turn, slow * turn - cross * shift], axis=1)
        gradient = np.zeros_like(states)
        gradient[1:] += ahead[:-1]
        gradient[:, :dimension] -= ahead[:, :dimension]
        gradient[:, dimension:] -= self.step_s[:, None] * ahead[:, :dimension] + ahead[:, dimension:]
        return gradient

    def log_normalization(self, dimension: int) -> FloatArray:
        """Return half the logarithm (N,) of the determinant of Q^-1 of each step, 0 at the last of a track."""
        h = self.step_s
        logs = 0.5 * dimension * (np.log(12.0) - 4.0 * np.log(h) - 2.0 * np.log(self.density))
        return np.where(self.moves, logs, 0.0)
