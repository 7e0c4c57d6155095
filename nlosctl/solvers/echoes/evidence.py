"""The evidence of targets against clutter: weights of candidates, the best set of them, and whether each exists.

The weight of a candidate is the log of a likelihood ratio: its echoes come from one target, or from clutter. The
density of the clutter is estimated from the echoes of the snapshot that no target explains, so it and the set of
targets are found in turn; then also the scatterers that explain echoes by these targets.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_overflow
from nlosctl.solvers.echoes.assignment import choose_disjoint
from nlosctl.solvers.echoes.candidates import Candidates
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.scatterers import scattered_density

__all__ = ["Hypotheses", "TargetSet", "choose_targets", "clutter_density", "existence_probability", "target_weights"]

_ROUNDS = 4
"""Rounds of clutter density and set of targets, without and with scatterers; usually the second set is the first."""

_SAME_TARGET_SHARE = 0.5
"""Candidates that share more than this of their echoes are the same target with another echo here or there."""


@dataclass(frozen=True, kw_only=True)
class Hypotheses:
    """What is known before the echoes are seen.

    ``detection_probability`` is that of a direct echo at a sensor, ``reward`` (nats) the log of the number of targets
    to expect in ``area_m2`` if there are any (in space, where ``dimension`` is 3, a volume), ``least_evidence`` (nats)
    what all targets together need against clutter alone, ``bandwidth_m`` the kernel width of the density of the
    clutter, ``scatterers`` whether targets may have further echoes via scatterers.
    """

    detection_probability: float
    reward: float
    least_evidence: float
    area_m2: float
    bandwidth_m: float
    scatterers: bool = True
    dimension: int = 2


class TargetSet(NamedTuple):
    """Chosen candidates, the probability (T,) that each exists, and whether the choice is proven to be the best."""

    chosen: IntArray
    existence: FloatArray
    proven: bool


def clutter_density(echoes: Echoes, bandwidth_m: float, clutter: BoolArray | None = None) -> FloatArray:
    """Return the density (N, M) of clutter per metre and sensor at each echo: all ranges pooled, a Gaussian kernel.

    Only the echoes of ``clutter`` (N, M) count (default: all), and at each echo that echo itself. The kernel is
    reflected at zero, since ranges are positive. NaN where there is no echo.
    """
    present = np.isfinite(echoes.range_m)
    counted = present if clutter is None else present & clutter
    pooled = echoes.range_m[counted]
    density = np.empty(echoes.range_m.shape)
    for sensor, here in enumerate(echoes.range_m[..., None]):
        kernel = np.exp(-0.5 * ((here - pooled) / bandwidth_m) ** 2)
        kernel += np.exp(-0.5 * ((here + pooled) / bandwidth_m) ** 2)
        density[sensor] = kernel.sum(axis=-1)
    density += np.where(present & ~counted, 1.0 + np.exp(-2.0 * (echoes.range_m / bandwidth_m) ** 2), 0.0)
    density /= np.sqrt(2.0 * np.pi) * bandwidth_m * echoes.sensors
    return np.where(present, density, np.nan)


def target_weights(echoes: Echoes, candidates: Candidates, density: FloatArray, hypotheses: Hypotheses) -> FloatArray:
    """Return the log of the likelihood ratio (C,) of a target against clutter, in nats.

    sum of -ln(density sqrt(2 pi) std) over the echoes taken, less half the chi-square, plus ln(2 pi / (sqrt det
    F area)) for a position that could be anywhere in the area, plus the reward; and for each sensor the log of the
    probability with which it sees a target, or doesn't.
    """
    seen = candidates.echo >= 0
    index = np.where(seen, candidates.echo, 0)
    sensor = np.broadcast_to(np.arange(echoes.sensors), index.shape)
    surprise = -np.log(density[sensor, index] * np.sqrt(2.0 * np.pi) * echoes.std_m[sensor, index])
    detection = hypotheses.detection_probability
    detected = np.where(seen, surprise + np.log(detection), np.log1p(-detection))
    turns = (2.0 * np.pi) ** (0.5 * hypotheses.dimension)
    volume = np.log(turns / hypotheses.area_m2) - 0.5 * np.log(candidates.information.determinant)
    weights: FloatArray = detected.sum(axis=1) - 0.5 * candidates.chi_square + volume + hypotheses.reward
    return weights


def choose_targets(echoes: Echoes, candidates: Candidates, hypotheses: Hypotheses, max_nodes: int) -> TargetSet:
    """Return the set of candidates (C,) of most evidence, without those that probably do not exist.

    The set has no targets if its evidence against clutter alone is less than the least.
    """
    everything = clutter_density(echoes, hypotheses.bandwidth_m)
    weights = at_first = target_weights(echoes, candidates, everything, hypotheses)
    choice = choose_disjoint(candidates.echo, weights, max_nodes)
    for scattered in (False, hypotheses.scatterers):
        for _ in range(_ROUNDS - 1):
            density = _explained_density(echoes, candidates, choice.indices, hypotheses, scattered)
            weights = target_weights(echoes, candidates, density, hypotheses)
            before, choice = choice, choose_disjoint(candidates.echo, weights, max_nodes)
            if np.array_equal(before.indices, choice.indices):
                break
    chosen = choice.indices
    if not chosen.size:
        return TargetSet(chosen, np.empty(0), choice.proven)
    rest = _unexplained(echoes, candidates.echo[chosen]) & np.isfinite(everything)
    fewer = np.log(clutter_density(echoes, hypotheses.bandwidth_m, rest)[rest] / everything[rest]).sum()
    explained = np.isfinite(everything).sum() - rest.sum()
    evidence = float(at_first[chosen].sum() + fewer + explained) - hypotheses.least_evidence
    existence = existence_probability(candidates.echo, weights, chosen, evidence)
    probable = np.flatnonzero((existence >= 0.5) & (evidence > 0.0))
    return TargetSet(chosen[probable], existence[probable], choice.proven)


def _explained_density(
    echoes: Echoes, candidates: Candidates, chosen: IntArray, hypotheses: Hypotheses, scattered: bool
) -> FloatArray:
    """Return the density (N, M) of clutter without the chosen targets, with or without their scattered echoes."""
    clutter = _unexplained(echoes, candidates.echo[chosen])
    density = clutter_density(echoes, hypotheses.bandwidth_m, clutter)
    if scattered and chosen.size:
        x, y = (part[chosen] for part in candidates.point)
        density += scattered_density(echoes, x, y, clutter, density, hypotheses.area_m2)
    return density


def _unexplained(echoes: Echoes, taken: IntArray) -> BoolArray:
    """Return the echoes (N, M) that no target (T, N) takes."""
    free = np.ones(echoes.range_m.shape, dtype=bool)
    target, sensor = np.nonzero(taken >= 0)
    free[sensor, taken[target, sensor]] = False
    return free


def existence_probability(echo: IntArray, weights: FloatArray, chosen: IntArray, evidence: float) -> FloatArray:
    """Return the posterior probability (T,) of each chosen candidate, given the other chosen ones.

    The alternatives are: all echoes are clutter (``evidence`` nats less likely), its own echoes are clutter, or they
    belong to another target. Candidates that take nearly the same echoes are the same target.
    """
    taken = echo[chosen]
    shared = np.zeros((echo.shape[0], chosen.shape[0]), dtype=np.int64)
    for sensor in range(echo.shape[1]):
        shared += (echo[:, sensor, None] == taken[:, sensor]) & (taken[:, sensor] >= 0)
    only = (shared > 0) & ((shared > 0).sum(axis=1) == 1)[:, None]
    same = shared > _SAME_TARGET_SHARE * (taken >= 0).sum(axis=1)
    with ignoring_overflow():
        odds = np.exp(weights[:, None] - weights[chosen])
        own, others = (np.where(only & which, odds, 0.0).sum(axis=0) for which in (same, ~same))
        nothing = np.exp(-evidence) + (np.exp(-weights[chosen]) if chosen.shape[0] > 1 else 0.0)
        existence: FloatArray = own / (own + others + nothing)
    return existence
