"""Symmetric positive definite block-tridiagonal systems of many independent tracks: solutions and inverse blocks.

Cyclic reduction: every second state of each track is eliminated, all tracks at once, until one state is left of each;
time and memory grow linearly with the number of states (Hockney 1965; the inverse's blocks as in the forward and
backward recursions of Rauch, Tung, Striebel 1965). The order of elimination is that of a track's own states, so that
the bits of a track do not depend on the others.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_invalid

__all__ = ["BlockTridiagonal"]

_LEAST_EIGENVALUE = 1e-13
"""A matrix of unit diagonal with a smaller eigenvalue than this is singular."""


@dataclass(frozen=True)
class _Level:
    """One elimination: the states ``odd`` (E,), and those that are kept, ``even``.

    ``inverse`` (E, d, d) is that of the eliminated blocks, ``before`` and ``after`` (E, d, d) are its products with
    the couplings. ``followed`` (E,) marks eliminated states with a neighbour after them.
    """

    odd: IntArray
    even: IntArray
    followed: BoolArray
    inverse: FloatArray
    before: FloatArray
    after: FloatArray


class BlockTridiagonal:
    """The factors of matrices with the blocks ``diagonal`` (N, d, d) and ``coupling`` (N, d, d) to the state after.

    ``within`` (N,) counts the states of each track from 0; the coupling of a track's last state is not used.
    ``singular`` (N,) marks the states of tracks whose matrix is singular: they have solutions that mean nothing.
    ``log_determinant`` (T,) is that of each track's matrix. A block whose track continues after it, or has a state
    before it, must itself be positive definite, as motion makes it; only the whole may be singular.
    """

    def __init__(self, diagonal: FloatArray, coupling: FloatArray, within: IntArray) -> None:
        scale = 1.0 / np.sqrt(np.maximum(np.diagonal(diagonal, axis1=1, axis2=2), np.finfo(np.float64).tiny))
        after = np.append(scale[1:], scale[:1], axis=0)
        diagonal = diagonal * scale[:, :, None] * scale[:, None, :]
        coupling = coupling * scale[:, :, None] * after[:, None, :]
        self._scale = scale
        self._track = np.cumsum(within == 0) - 1
        self._levels: list[_Level] = []
        logarithm = np.zeros(within.shape)
        at, within = np.arange(within.shape[0]), within.copy()
        while within.any():
            level, diagonal, coupling = self._eliminate(diagonal, coupling, within, logarithm, at)
            self._levels.append(level)
            at, within = at[level.even], within[level.even] // 2
        self._inverse, last, degenerate = _guarded_inverses(diagonal)
        logarithm[at] += last
        tracks = self._track[-1] + 1 if within.size else 0
        self.log_determinant = np.bincount(self._track, logarithm - 2.0 * np.log(scale).sum(axis=1), minlength=tracks)
        self.singular: BoolArray = degenerate[self._track]

    @staticmethod
    def _eliminate(
        diagonal: FloatArray, coupling: FloatArray, within: IntArray, logarithm: FloatArray, at: IntArray
    ) -> tuple[_Level, FloatArray, FloatArray]:
        """Return an elimination and the blocks that remain; adds the logarithms of determinants."""
        odd, even = np.flatnonzero(within % 2), np.flatnonzero(within % 2 == 0)
        following = np.append(within[1:], 0)
        followed = following[odd] > 0
        inverse: FloatArray = np.asarray(np.linalg.inv(diagonal[odd]), dtype=np.float64)
        with ignoring_invalid():  # of a path that rows drive to infinity
            logarithm[at[odd]] += np.linalg.slogdet(diagonal[odd])[1]
        left = coupling[odd - 1]
        right = np.where(followed[:, None, None], coupling[odd], 0.0)
        before: FloatArray = inverse @ left.transpose(0, 2, 1)
        after: FloatArray = inverse @ right
        reduced = diagonal.copy()
        reduced[odd - 1] -= left @ before
        some = odd[followed]
        reduced[some + 1] -= (right.transpose(0, 2, 1) @ after)[followed]
        joined = np.zeros_like(coupling)
        joined[odd - 1] = -(left @ after)
        level = _Level(odd, even, followed, inverse, before, after)
        return level, reduced[even], joined[even]

    def solve(self, right_side: FloatArray) -> FloatArray:
        """Return the solutions (N, d) for right-hand sides (N, d)."""
        values = right_side * self._scale
        eliminated = []
        for level in self._levels:
            own = values[level.odd]
            part = _times(level.inverse, own)
            eliminated.append(part)
            reduced = values.copy()
            reduced[level.odd - 1] -= _times(level.before.transpose(0, 2, 1), own)
            some = level.followed
            reduced[level.odd[some] + 1] -= _times(level.after.transpose(0, 2, 1), own)[some]
            values = reduced[level.even]
        solved = _times(self._inverse, values)
        for level, part in zip(reversed(self._levels), reversed(eliminated), strict=True):
            whole = np.empty((level.odd.shape[0] + level.even.shape[0], part.shape[1]))
            whole[level.even] = solved
            own = part - _times(level.before, whole[level.odd - 1])
            some = level.followed
            own[some] -= _times(level.after[some], whole[level.odd[some] + 1])
            whole[level.odd] = own
            solved = whole
        return solved * self._scale

    def inverse_blocks(self) -> FloatArray:
        """Return the diagonal blocks (N, d, d) of the inverse: the covariances."""
        blocks, across = self._inverse, np.zeros_like(self._inverse)
        for level in reversed(self._levels):
            size, odd = level.odd.shape[0] + level.even.shape[0], level.odd
            whole, beside = np.empty((size, *blocks.shape[1:])), np.zeros((size, *blocks.shape[1:]))
            whole[level.even] = blocks
            from_left = np.empty_like(whole)
            from_left[level.even] = across
            some = level.followed
            left = whole[odd - 1]
            right = np.zeros_like(left)
            right[some] = whole[odd[some] + 1]
            between = np.where(some[:, None, None], from_left[odd - 1], 0.0)
            to_left = -(level.before @ left + level.after @ between.transpose(0, 2, 1))
            to_right = -(level.before @ between + level.after @ right)
            own = level.inverse - to_left @ level.before.transpose(0, 2, 1) - to_right @ level.after.transpose(0, 2, 1)
            whole[odd] = 0.5 * (own + own.transpose(0, 2, 1))
            beside[odd - 1] = to_left.transpose(0, 2, 1)
            beside[odd] = to_right
            blocks, across = whole, beside
        return blocks * self._scale[:, :, None] * self._scale[:, None, :]


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    """Return products (E, d) of matrices (E, d, d) and vectors (E, d)."""
    return np.asarray((matrices @ vectors[:, :, None])[:, :, 0])


def _guarded_inverses(matrices: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return inverses (E, d, d), logarithms of determinants (E,), and which are singular: their inverse is 0."""
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    sound = np.asarray(np.isfinite(matrices).all(axis=(1, 2)) & (diagonal > 0.0).all(axis=1))
    scale = 1.0 / np.sqrt(np.where(sound[:, None], diagonal, 1.0))
    unit = np.where(sound[:, None, None], matrices * scale[:, :, None] * scale[:, None, :], np.eye(matrices.shape[1]))
    values, vectors = np.linalg.eigh(unit)
    sound &= values[:, 0] > _LEAST_EIGENVALUE
    inverse_values = np.where(sound[:, None], 1.0 / np.where(sound[:, None], values, 1.0), 0.0)
    inverse = (vectors * inverse_values[:, None, :]) @ vectors.transpose(0, 2, 1)
    logs = np.where(
        sound, np.log(np.where(sound[:, None], values, 1.0)).sum(axis=1) - 2.0 * np.log(scale).sum(axis=1), 0.0
    )
    return inverse * scale[:, :, None] * scale[:, None, :], np.where(sound, logs, 0.0), ~sound
