"""Unlabelled echoes assigned to targets: likelihoods against clutter, and the best choice of disjoint targets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.solvers.echoes.assignment import choose_disjoint
from nlosctl.solvers.echoes.candidates import Candidates, Gates, clutter_density, find_candidates, target_weights
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.targets import IDENTIFICATION_FLAGS, IdentificationOptions, IdentifiedEchoes, identify
from nlosctl.solvers.echoes.type_sets import Gate, cross_all, find_seeds

__all__ = ["METHOD", "AssignmentOptions", "solve"]

_BANDWIDTH_SHARE = 0.1


@dataclass(frozen=True, kw_only=True)
class AssignmentOptions(IdentificationOptions):
    """Parameters of ``assignment``."""

    min_sensors: int | None = option(
        None, minimum=3, meaning="least number of sensors that see a target; default: all that have an echo"
    )
    gate_std: float = option(
        5.0, minimum=0.0, exclusive=True, meaning="largest distance of an echo from its target, in standard deviations"
    )
    false_alarm: float = option(
        1e-5,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="probability that the chi-square gate rejects a true target",
    )
    detection_probability: float = option(
        0.95,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="probability that a sensor receives the direct echo of a target",
    )
    clutter_bandwidth_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        exclusive=True,
        meaning="kernel width of the echo density; default: a tenth of the search region's size",
    )
    target_reward: float = option(
        8.0, unit="nats", meaning="prior evidence for a target: larger values give more targets, and more false ones"
    )
    max_nodes: int = option(100_000, minimum=1, meaning="nodes of the search after which it gives up")


def solve(batch: RangeBatch, options: AssignmentOptions) -> Solution:
    """Find targets among unlabelled echoes: the choice of targets of largest likelihood that share no echo.

    Candidates are range least-squares fits to the echoes nearest to them that pass a chi-square gate. No target is
    a possible answer; not_converged: ``max_nodes`` did not suffice for a proof.
    """

    def find(echoes: Echoes, gate: Gate) -> IdentifiedEchoes:
        candidates = _candidates(echoes, gate, options)
        area_m2 = float(gate.region.area_m2[0])
        weights = target_weights(
            echoes,
            candidates,
            density=clutter_density(echoes, options.clutter_bandwidth_m or _BANDWIDTH_SHARE * np.sqrt(area_m2)),
            area_m2=area_m2,
            detection_probability=options.detection_probability,
            reward=options.target_reward,
        )
        chosen = choose_disjoint(candidates.echo, weights, options.max_nodes)
        return Status.NOT_CONVERGED if chosen is None else candidates.echo[chosen]

    return identify(batch, options, find)


def _candidates(echoes: Echoes, gate: Gate, options: AssignmentOptions) -> Candidates:
    least = echoes.sensors if options.min_sensors is None else min(options.min_sensors, echoes.sensors)
    seeds = find_seeds(cross_all(echoes, options.gap_tolerance_m, gate))
    gates = Gates(min_sensors=least, gate_std=options.gate_std, false_alarm=options.false_alarm)
    candidates = find_candidates(echoes, seeds.x, seeds.y, gates)
    return candidates.take(np.flatnonzero(gate.contains(candidates.x, candidates.y)))


METHOD = MethodSpec(
    name="assignment",
    kind="ranges",
    job="identify-los",
    summary="targets by likelihood against clutter, disjoint ones chosen exactly (recommended)",
    reference="Liang, Zeng, Li, equation (8), with a likelihood ratio against clutter (docs/echoes.md)",
    options=AssignmentOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=3,
    flags=IDENTIFICATION_FLAGS,
)
