"""Paths through rows whose sensors have offsets that are not exactly known: the offsets are unknowns of each track.

A track's unknowns z have the prior N(0, 1) (`offset_factors`). At a path that is the likeliest at given z, with the
rows' weights w, residuals r, and their derivatives a by the states and e by z,

    S = 1 + sum w e e' - B' T^-1 B,    B = sum w a e',    z <- z - S^-1 (z + sum w e r)                       (1)

T the block-tridiagonal matrix of the states: the Gauss-Newton step of z with the states eliminated, then the path is
found again. The covariance of the states, offsets marginalized, is that of `measured_paths` plus T^-1 B S^-1 B' T^-1.
Each track is given its own rows alone, so that no track depends on the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray
from nlosctl.models.scaled_residuals import ScaledResiduals
from nlosctl.solvers.tracking.block_tridiagonal import BlockTridiagonal
from nlosctl.solvers.tracking.measured_paths import FoundPaths, MeasuredTracks, RowsAtStates, find_paths
from nlosctl.solvers.tracking.offset_factors import OffsetCauses, offset_factors
from nlosctl.solvers.tracking.path_rows import FollowedRows
from nlosctl.solvers.tracking.states import state_sums

__all__ = ["UncertainRows", "with_offsets"]

_MOST_STEPS = 40
_SETTLED = 1e-6
"""A step of z whose square over its covariance is less than this is the last; the path's own search ends at 1e-9."""


class UncertainRows(Protocol):
    """The rows (B, K) of blocks of snapshots, whose measurements have offsets of Q quantities that are not known."""

    @property
    def causes(self) -> Sequence[Sequence[OffsetCauses]]:
        """The causes of the offsets of each block's rows, in the order of the file (B K, M), by quantity."""
        ...

    def widened(self) -> Sequence[FollowedRows]:
        """Return the rows with the variances of the offsets added to their own."""
        ...

    def without(self, offset: Sequence[FloatArray]) -> Sequence[FollowedRows]:
        """Return the rows less offsets (Q, B, K) of each block."""
        ...

    def scalars(self, block: int, position_m: FloatArray, offset: FloatArray) -> Sequence[ScaledResiduals]:
        """Return the scalars that offsets change of a block's rows less offsets (Q, B, K), by quantity.

        Each row is compared with a position (B, K, D) of its own; a scalar's derivatives are over its std.
        """
        ...


Place = Callable[[Sequence[FollowedRows]], MeasuredTracks]
"""Makes tracks of the rows of all blocks."""


def with_offsets(
    rows: UncertainRows, place: Place, tracks: MeasuredTracks, found: FoundPaths, known: FloatArray | None = None
) -> tuple[MeasuredTracks, FoundPaths, FloatArray]:
    """Return the tracks less the likeliest offsets, their paths, and the unknowns z (T, R).

    The search starts from paths that were ``found`` without the offsets, or with those of unknowns that are ``known``.
    """
    factors = _factors(rows, tracks)
    states, motion = found.path.states.copy(), tracks.motion
    shape = motion.first.shape[0], factors[0].shape[-1]
    unknown = np.zeros(shape) if known is None else known.copy()
    active, searched = np.ones(unknown.shape[0], dtype=bool), found.settled.copy()
    for _ in range(_MOST_STEPS):
        pairs = zip(factors, tracks.blocks, strict=True)
        offsets = [_offsets(factor, unknown[motion.track[block.state]]) for factor, block in pairs]
        tracks = place(rows.without(offsets))
        again = find_paths(tracks.only(active), states[active[motion.track]])
        states[active[motion.track]], searched[active] = again.path.states, again.settled
        equations = _Equations.of(rows, tracks, states, factors, offsets)
        step = equations.step(unknown)
        square = np.einsum("ti,tij,tj->t", step, equations.matrix, step)
        active &= square > _SETTLED
        if not active.any():
            break
        unknown[active] -= step[active]
    last = find_paths(tracks, states, most=0)
    covariance = last.path.covariance + equations.spread(motion.track)
    evidence = last.path.log_evidence - 0.5 * (equations.log_determinant + np.sum(unknown * unknown, axis=1))
    path = replace(last.path, covariance=covariance, log_evidence=evidence)
    return tracks, FoundPaths(path, searched & ~active), unknown


def _factors(rows: UncertainRows, tracks: MeasuredTracks) -> list[FloatArray]:
    """Return the changes (Q, B, K, R) of the offsets of each block's rows per unit of the unknowns of their tracks."""
    motion = tracks.motion
    count = [(block.state.shape[0], block.rows.count) for block in tracks.blocks]
    of_row = [np.repeat(motion.track[block.state], k) for block, (_, k) in zip(tracks.blocks, count, strict=True)]
    quantities = len(rows.causes[0])
    number = [causes.number for one in rows.causes for causes in one]
    std = [causes.std for one in rows.causes for causes in one]
    track = [part for part in of_row for _ in range(quantities)]
    joined = OffsetCauses(np.concatenate(number), np.concatenate(std), rows.causes[0][0].covariance)
    whole = offset_factors(joined, np.concatenate(track), motion.first.shape[0])
    parts = np.split(whole, np.cumsum([part.shape[0] for part in number])[:-1])
    return [
        np.stack([part.reshape(*shape, -1) for part in parts[start : start + quantities]])
        for start, shape in zip(range(0, len(parts), quantities), count, strict=True)
    ]


def _offsets(factor: FloatArray, unknown: FloatArray) -> FloatArray:
    """Return the offsets (Q, B, K) of a block's rows at the unknowns (B, R) of their tracks."""
    total = np.zeros(factor.shape[:-1])
    for r in range(unknown.shape[1]):
        total += factor[..., r] * unknown[:, r, None]
    return total


@dataclass(frozen=True)
class _Equations:
    """(1): T^-1 B (N, 2D, R), S (T, R, R) and sum w e r (T, R)."""

    gain: FloatArray
    matrix: FloatArray
    pull: FloatArray

    @classmethod
    def of(
        cls,
        rows: UncertainRows,
        tracks: MeasuredTracks,
        states: FloatArray,
        factors: Sequence[FloatArray],
        offsets: Sequence[FloatArray],
    ) -> _Equations:
        """Return the equations at the path of ``states`` (N, 2D)."""
        motion, (size, whole) = tracks.motion, states.shape
        unknowns = factors[0].shape[-1]
        cross = np.zeros((size, whole, unknowns))
        square, pull = np.zeros((size, unknowns, unknowns)), np.zeros((size, unknowns))
        for number, block in enumerate(tracks.blocks):
            sums = _block_sums(rows, number, block, states, factors[number], offsets[number])
            cross += state_sums(sums.cross, block.state, size)
            square += state_sums(sums.square, block.state, size)
            pull += state_sums(sums.pull, block.state, size)
        cross[motion.alone, tracks.dimension :] = 0.0
        diagonal, coupling = motion.blocks(tracks.dimension)
        terms = tracks.terms(states)
        system = BlockTridiagonal(diagonal + terms.matrix, coupling, motion.within)
        gain = np.stack([system.solve(cross[:, :, r]) for r in range(unknowns)], axis=2)
        gain[system.singular] = 0.0
        taken = np.zeros(square.shape)
        for axis in range(whole):
            taken += cross[:, axis, :, None] * gain[:, axis, None, :]
        matrix = np.eye(unknowns) + np.add.reduceat(square - taken, motion.first, axis=0)
        return cls(gain, 0.5 * (matrix + matrix.transpose(0, 2, 1)), np.add.reduceat(pull, motion.first, axis=0))

    def step(self, unknown: FloatArray) -> FloatArray:
        """Return S^-1 (z + sum w e r) (T, R) at the unknowns z (T, R)."""
        return np.asarray(np.linalg.solve(self.matrix, (unknown + self.pull)[:, :, None])[:, :, 0])

    @property
    def log_determinant(self) -> FloatArray:
        """The logarithm (T,) of the determinant of S."""
        return np.asarray(np.linalg.slogdet(self.matrix)[1])

    def spread(self, track: IntArray) -> FloatArray:
        """Return T^-1 B S^-1 B' T^-1 (N, 2D, 2D)."""
        half = self.gain @ np.linalg.inv(self.matrix)[track]
        spread = half @ self.gain.transpose(0, 2, 1)
        return np.asarray(0.5 * (spread + spread.transpose(0, 2, 1)))


@dataclass(frozen=True)
class _BlockSums:
    """Sums over the rows of each snapshot: w a e' (B, 2D, R), w e e' (B, R, R) and w e r (B, R)."""

    cross: FloatArray
    square: FloatArray
    pull: FloatArray

    @classmethod
    def zeros(cls, size: int, whole: int, unknowns: int) -> _BlockSums:
        """Return sums of nothing."""
        return cls(np.zeros((size, whole, unknowns)), np.zeros((size, unknowns, unknowns)), np.zeros((size, unknowns)))

    def add(self, slope: FloatArray, error: FloatArray, residual: FloatArray, weight: FloatArray) -> None:
        """Add a row: derivatives (B, 2D) by the state and (B, R) by the unknowns, residual and weight (B,)."""
        weighted = weight[:, None] * error
        self.cross[...] += slope[:, :, None] * weighted[:, None, :]
        self.square[...] += error[:, :, None] * weighted[:, None, :]
        self.pull[...] += weighted * residual[:, None]


def _block_sums(
    rows: UncertainRows, number: int, block: RowsAtStates, states: FloatArray, factor: FloatArray, offset: FloatArray
) -> _BlockSums:
    found = block.compare(states)
    weight = block.rows.in_file_order(found.weight)
    delay = block.rows.in_file_order(block.delay_s)
    own, dimension = states[block.state], block.origin_m.shape[1]
    place = (own[:, :dimension] + block.origin_m)[:, None] + delay[:, :, None] * own[:, None, dimension:]
    unknowns = factor.shape[-1]
    sums = _BlockSums.zeros(own.shape[0], 2 * dimension, unknowns)
    common = _Common.zeros(own.shape[0], 2 * dimension, unknowns)
    for scalar, per_unit in zip(rows.scalars(number, place, offset), factor, strict=True):
        assert scalar.per_offset is not None  # noqa: S101 - an offset changes it
        residual = scalar.residual
        if found.residuals is not None:  # about the offset of arrivals that the snapshot has in common
            residual = -scalar.per_offset * block.rows.in_file_order(found.residuals["residual_m"])
        for k in range(delay.shape[1]):
            along = np.stack([slope[:, k] for slope in scalar.slopes[:dimension]], axis=1)
            slope = np.concatenate([along, delay[:, k, None] * along], axis=1)
            error = scalar.per_offset[:, k, None] * per_unit[:, k]
            sums.add(slope, error, residual[:, k], weight[:, k])
            if len(scalar.slopes) > dimension:
                common.add(scalar.slopes[-1][:, k], slope, error, residual[:, k], weight[:, k])
    common.eliminate(sums)
    return sums


@dataclass(frozen=True)
class _Common:
    """The unknown that the rows of a snapshot have in common: w c c (B,), w c a (B, 2D), w c e (B, R), w c r (B,)."""

    bend: FloatArray
    by_state: FloatArray
    by_unknown: FloatArray
    slope: FloatArray

    @classmethod
    def zeros(cls, size: int, whole: int, unknowns: int) -> _Common:
        """Return sums of nothing."""
        return cls(np.zeros(size), np.zeros((size, whole)), np.zeros((size, unknowns)), np.zeros(size))

    def add(
        self, own: FloatArray, slope: FloatArray, error: FloatArray, residual: FloatArray, weight: FloatArray
    ) -> None:
        """Add a row with the derivative ``own`` (B,) by the unknown in common."""
        weighted = weight * own
        self.bend[...] += weighted * own
        self.by_state[...] += weighted[:, None] * slope
        self.by_unknown[...] += weighted[:, None] * error
        self.slope[...] += weighted * residual

    def eliminate(self, sums: _BlockSums) -> None:
        """Take from sums what the unknown takes at its best value: Schur's complement."""
        known: BoolArray = self.bend > 0.0
        share = self.by_unknown / np.where(known, self.bend, np.inf)[:, None]
        sums.cross[...] -= self.by_state[:, :, None] * share[:, None, :]
        sums.square[...] -= self.by_unknown[:, :, None] * share[:, None, :]
        sums.pull[...] -= share * self.slope[:, None]
