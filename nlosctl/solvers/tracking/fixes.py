"""Paths through fixes with covariances: the linear smoother, and the filter.

The maximum of the posterior of the path under `Motion` and the fixes is the solution of one block-tridiagonal system:
the smoother of Rauch, Tung, Striebel 1965 without a prior of the first state. The filter is in information form, so
that nothing needs to be known of the first state either.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.solvers.tracking.block_tridiagonal import BlockTridiagonal
from nlosctl.solvers.tracking.motion import Motion
from nlosctl.solvers.tracking.states import States, state_sums

__all__ = ["Fixes", "Path", "filter_fixes", "guarded_inverse", "smooth_fixes", "smooth_robustly"]

_REFINEMENTS = 2
_ROBUST_STEPS = 15
_LEAST_EIGENVALUE = 1e-12


@dataclass(frozen=True)
class Path:
    """States (N, 2D) with covariances (N, 2D, 2D); ``known`` (N,) and ``moving`` (N,): position, velocity are known.

    ``cost`` (T,) is that of each track, ``log_evidence`` (T,) the logarithm of the marginal likelihood up to a constant
    that the motion does not change.
    """

    states: FloatArray
    covariance: FloatArray
    known: BoolArray
    moving: BoolArray
    cost: FloatArray
    log_evidence: FloatArray


@dataclass(frozen=True)
class Fixes:
    """Positions (S, D) of snapshots with information matrices (S, D, D), both 0 without a fix; ``known`` (S,).

    Positions are about a local origin of each track.
    """

    position_m: FloatArray
    information: FloatArray
    known: BoolArray

    @classmethod
    def of(cls, position_m: FloatArray, covariance_m2: FloatArray) -> Fixes:
        """Return fixes (S, D) with covariances (S, D, D); those not finite or not positive definite are unknown."""
        finite = np.asarray(np.isfinite(position_m).all(axis=1) & np.isfinite(covariance_m2).all(axis=(1, 2)))
        matrices = np.where(finite[:, None, None], covariance_m2, np.eye(position_m.shape[1]))
        information, sound = guarded_inverse(matrices)
        known = finite & sound
        return cls(np.where(known[:, None], position_m, 0.0), np.where(known[:, None, None], information, 0.0), known)

    def weighted(self, weight: FloatArray) -> Fixes:
        """Return the fixes with their information times weights (S,)."""
        return Fixes(self.position_m, self.information * weight[:, None, None], self.known)

    def misfit(self, states: FloatArray, of: States) -> tuple[FloatArray, FloatArray]:
        """Return the residuals (S, D), positions minus those of the path, and their chi-squares (S,)."""
        dimension = self.position_m.shape[1]
        own = states[of.of_snapshot]
        residual = self.position_m - own[:, :dimension] - of.offset_s[:, None] * own[:, dimension:]
        return residual, np.asarray(np.einsum("si,sij,sj->s", residual, self.information, residual))

    def matrix(self, of: States) -> FloatArray:
        """Return the information (N, 2D, 2D) of each state."""
        return state_sums(moved_information(self.information, of.offset_s), of.of_snapshot, of.within.shape[0])

    def gradient(self, states: FloatArray, of: States) -> FloatArray:
        """Return the gradient (N, 2D) of half the chi-square."""
        residual, _ = self.misfit(states, of)
        pull = -np.einsum("sij,sj->si", self.information, residual)
        whole = np.concatenate([pull, of.offset_s[:, None] * pull], axis=1)
        return state_sums(whole, of.of_snapshot, of.within.shape[0])


def moved_information(information: FloatArray, offset_s: FloatArray) -> FloatArray:
    """Return the information (S, 2D, 2D) on the state of information (S, D, D) on the position ``offset_s`` later."""
    size, dimension = information.shape[:2]
    whole = np.empty((size, 2 * dimension, 2 * dimension))
    shifted = offset_s[:, None, None] * information
    whole[:, :dimension, :dimension] = information
    whole[:, :dimension, dimension:] = whole[:, dimension:, :dimension] = shifted
    whole[:, dimension:, dimension:] = offset_s[:, None, None] * shifted
    return whole


def guarded_inverse(matrices: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return the inverses (E, d, d) of symmetric matrices, 0 where one is not positive definite beyond rounding."""
    diagonal = np.diagonal(matrices, axis1=1, axis2=2)
    sound = np.asarray((diagonal > 0.0).all(axis=1))
    scale = 1.0 / np.sqrt(np.where(sound[:, None], diagonal, 1.0))
    unit = np.where(sound[:, None, None], matrices * scale[:, :, None] * scale[:, None, :], np.eye(matrices.shape[1]))
    values, vectors = np.linalg.eigh(unit)
    sound &= values[:, 0] > _LEAST_EIGENVALUE
    inverse = (vectors * np.where(sound[:, None], 1.0 / np.where(sound[:, None], values, 1.0), 0.0)[:, None, :]) @ (
        vectors.transpose(0, 2, 1)
    )
    return inverse * scale[:, :, None] * scale[:, None, :], sound


def smooth_fixes(fixes: Fixes, of: States, motion: Motion) -> Path:
    """Return the likeliest path through fixes, with the covariances of all states given all fixes."""
    states, factors = _solve(fixes, of, motion)
    cost = motion.cost(states) + _by_state(0.5 * fixes.misfit(states, of)[1], of)
    return finished_path(states, factors, cost, fixes.matrix(of), motion)


def finished_path(
    states: FloatArray, factors: BlockTridiagonal, cost: FloatArray, information: FloatArray, motion: Motion
) -> Path:
    """Return the path at the optimum of its cost (N,), whose rows have the ``information`` (N, 2D, 2D).

    A track of one state has a position alone, by the first D unknowns.
    """
    dimension = states.shape[1] // 2
    tracks = motion.first.shape[0]
    covariance = factors.inverse_blocks()
    known = ~factors.singular
    moving = known.copy()
    alone = motion.alone
    if alone.any():
        inverse, sound = guarded_inverse(information[alone][:, :dimension, :dimension])
        covariance[alone] = np.nan
        covariance[np.flatnonzero(alone)[:, None, None], np.arange(dimension)[:, None], np.arange(dimension)] = inverse
        known[alone], moving[alone] = sound, False
    total: FloatArray = np.bincount(motion.track, weights=cost, minlength=tracks).astype(np.float64)
    normalization = np.bincount(motion.track, motion.log_normalization(dimension), minlength=tracks)
    evidence = np.where(alone[motion.first], 0.0, -total + normalization - 0.5 * factors.log_determinant)
    return Path(states, covariance, known, moving, total, evidence)


def smooth_robustly(fixes: Fixes, of: States, motion: Motion) -> FloatArray:
    """Return the states (N, 2D) of the path through fixes with the weights 1 / (1 + chi^2 / 2), iterated."""
    states, _ = _solve(fixes, of, motion)
    for _ in range(_ROBUST_STEPS):
        _, chi_square = fixes.misfit(states, of)
        states, _ = _solve(fixes.weighted(1.0 / (1.0 + 0.5 * chi_square)), of, motion)
    return states


def _solve(fixes: Fixes, of: States, motion: Motion) -> tuple[FloatArray, BlockTridiagonal]:
    """Return the states, refined by gradients of the deviations, and the factors of the system."""
    dimension = fixes.position_m.shape[1]
    diagonal, coupling = motion.blocks(dimension)
    factors = BlockTridiagonal(diagonal + fixes.matrix(of), coupling, motion.within)
    states = np.zeros((motion.within.shape[0], 2 * dimension))
    alone = motion.alone
    if alone.any():
        matrix = fixes.matrix(of)[alone][:, :dimension, :dimension]
        inverse, _ = guarded_inverse(matrix)
        pull = -fixes.gradient(states, of)[alone][:, :dimension]
        states[alone, :dimension] = np.einsum("nij,nj->ni", inverse, pull)
    for _ in range(1 + _REFINEMENTS):
        step = factors.solve(motion.gradient(states) + fixes.gradient(states, of))
        states -= np.where(alone[:, None], 0.0, step)
    return states, factors


def _by_state(values: FloatArray, of: States) -> FloatArray:
    return state_sums(values, of.of_snapshot, of.within.shape[0])


def filter_fixes(fixes: Fixes, of: States, motion: Motion) -> Path:
    """Return each state given the fixes until then, by the filter in information form.

    Of the first fix alone the position is known; before it nothing.
    """
    dimension = fixes.position_m.shape[1]
    gained = fixes.matrix(of)
    pulled = -fixes.gradient(np.zeros((motion.within.shape[0], 2 * dimension)), of)
    information, vector = filter_forward(gained, pulled, motion)
    covariance, moving = guarded_inverse(information)
    states = np.einsum("nij,nj->ni", covariance, vector)
    inverse, own = guarded_inverse(gained[:, :dimension, :dimension])
    own &= ~moving
    states[own, :dimension] = np.einsum("nij,nj->ni", inverse[own], pulled[own, :dimension])
    covariance[~moving] = np.nan
    at = np.flatnonzero(own)[:, None, None], np.arange(dimension)[:, None], np.arange(dimension)
    covariance[at] = inverse[own]
    nothing = np.full(motion.first.shape, np.nan)
    return Path(states, covariance, moving | own, moving, nothing, nothing)


def filter_forward(gained: FloatArray, pulled: FloatArray, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return the information (N, 2D, 2D) and its vector (N, 2D) of each state, of what is until then.

    ``gained`` and ``pulled`` are what the rows of each state add. With M = F^-T Y F^-1 the information before the rows
    of the next state is (I + M Q)^-1 M, which exists for a singular Y and for any step.
    """
    whole = gained.shape[1]
    augmented = np.concatenate([gained, pulled[:, :, None]], axis=2)
    back, noise = _steps_back(motion, whole // 2)
    transposed, unit = back.transpose(0, 2, 1), np.eye(whole)
    by_number = np.argsort(motion.within, kind="stable")
    bounds = np.searchsorted(motion.within[by_number], np.arange(1, int(motion.within.max(initial=0)) + 2))
    for first, last in zip(bounds[:-1].tolist(), bounds[1:].tolist(), strict=True):
        at = by_number[first:last]
        moved = transposed[at] @ augmented[at - 1]
        moved[:, :, :whole] = moved[:, :, :whole] @ back[at]
        ahead = np.linalg.solve(unit + moved[:, :, :whole] @ noise[at], moved)
        augmented[at] += ahead
    information = augmented[:, :, :whole]
    return 0.5 * (information + information.transpose(0, 2, 1)), augmented[:, :, whole]


def _steps_back(motion: Motion, dimension: int) -> tuple[FloatArray, FloatArray]:
    """Return F^-1 and Q (N, 2D, 2D) of the step to each state from the one before."""
    size, whole = motion.within.shape[0], 2 * dimension
    h, q = np.roll(motion.step_s, 1), np.roll(motion.density, 1)
    back, noise = np.tile(np.eye(whole), (size, 1, 1)), np.zeros((size, whole, whole))
    for axis in range(dimension):
        speed = dimension + axis
        back[:, axis, speed] = -h
        noise[:, axis, axis] = q * h * h * h / 3.0
        noise[:, axis, speed] = noise[:, speed, axis] = q * h * h / 2.0
        noise[:, speed, speed] = q * h
    return back, noise
