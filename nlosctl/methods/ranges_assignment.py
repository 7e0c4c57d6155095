"""Unlabelled echoes assigned to targets: likelihoods against clutter, and the best choice of disjoint targets."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import pi, sqrt
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.limits import limit
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.solvers.echoes.candidates import Candidates, Gates, find_candidates, usual_sensors
from nlosctl.solvers.echoes.echoes import Echoes
from nlosctl.solvers.echoes.evidence import Hypotheses, choose_targets, clutter_density, target_weights
from nlosctl.solvers.echoes.sphere_crossings import cross_spheres, far_apart
from nlosctl.solvers.echoes.targets import (
    EXISTENCE,
    IDENTIFICATION_FLAGS,
    IdentificationOptions,
    IdentifiedEchoes,
    identify,
)
from nlosctl.solvers.echoes.type_sets import Gate, cross_all, find_seeds

__all__ = ["METHOD", "AssignmentOptions", "solve"]

_BANDWIDTH_SHARE = 0.1
_EVIDENCE_MARGIN = 10.0
"""Candidates with less evidence than minus this are dropped: the clutter is less dense once targets explain echoes."""

_SEEDING_SENSORS = 20
_SEEING_SENSORS = 8


@dataclass(frozen=True, kw_only=True)
class AssignmentOptions(IdentificationOptions):
    """Parameters of ``assignment``."""

    min_sensors: int | None = option(
        None,
        minimum=3,
        meaning="least number of sensors that see a target; default: 99 % of targets are seen by so many",
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
        1.5, unit="nats", meaning="log of the number of targets to expect if there are any: larger values give more"
    )
    least_evidence: float = option(
        6.0, unit="nats", meaning="evidence that all targets together need against clutter alone, else no_target"
    )
    scatterers: bool = option(
        True, meaning="whether scatterers common to targets and sensors may explain echoes: sum of the legs, or half"
    )
    max_nodes: int = option(
        100_000, minimum=1, meaning="nodes of the search after which the best set so far is kept: not_proven"
    )


def solve(batch: RangeBatch, options: AssignmentOptions) -> Solution:
    """Find targets among unlabelled echoes: the choice of targets of largest likelihood that share no echo.

    Candidates are range least-squares fits to the echoes nearest to them that pass a chi-square gate. No target is
    a possible answer; not_proven: ``max_nodes`` or the limit on candidates did not suffice for a proof. In space the
    seeds are crossings of three spheres, and scatterers are not looked for. A measured height is that of every target,
    and one more scalar of its fit; with an exact one the ranges are slant ranges to the plane at that height.
    """
    if batch.dimension == 3 and batch.height_held:
        return _at_height(batch, options)

    def find(echoes: Echoes, gate: Gate) -> IdentifiedEchoes:
        area_m2 = float(gate.region.volume[0])
        if echoes.level is not None:
            (lower, upper), std_m = gate.region.bounds_m, 1.0 / echoes.level.inverse_std
            area_m2 *= min(1.0, float(sqrt(2.0 * pi) * std_m[0] / (upper[2] - lower[2])[0]))
        hypotheses = Hypotheses(
            detection_probability=options.detection_probability,
            reward=options.target_reward,
            least_evidence=options.least_evidence,
            area_m2=area_m2,
            scatterers=options.scatterers and batch.dimension == 2,
            bandwidth_m=options.clutter_bandwidth_m or _BANDWIDTH_SHARE * _side_m(area_m2, batch.dimension),
            dimension=batch.dimension,
        )
        candidates, complete = _candidates(echoes, gate, hypotheses, options)
        targets = choose_targets(echoes, candidates, hypotheses, options.max_nodes)
        return IdentifiedEchoes(
            candidates.echo[targets.chosen], existence=targets.existence, proven=targets.proven and complete
        )

    return identify(batch, options, find)


def _at_height(batch: RangeBatch, options: AssignmentOptions) -> Solution:
    """Return the targets of a batch in space whose heights are exactly known: those of slant ranges in the plane."""
    assert batch.sensor_z_m is not None  # noqa: S101 - batches in space have heights
    assert batch.target_z_m is not None  # noqa: S101 - the caller's case
    level = np.asfortranarray(batch.sensor_z_m - batch.target_z_m[:, None])
    nothing: dict[str, Any] = {"sensor_z_m": None, "target_z_m": None, "target_z_std_m": None}
    solution = solve(replace(batch, dimension=2, sensor_height_m=level, **nothing), options)
    estimates = solution.estimates
    place, size = estimates.position_m, estimates.row.shape[0]
    z = np.where(np.isnan(place[:, 0]), np.nan, batch.target_z_m[estimates.row])
    flat = np.where(np.isnan(estimates.covariance_m2[:, :1]), np.nan, np.zeros((size, 3)))
    whole = replace(
        estimates,
        position_m=np.column_stack([place, z]),
        covariance_m2=np.concatenate([estimates.covariance_m2, flat], axis=1),
    )
    return replace(solution, estimates=whole)


def _candidates(
    echoes: Echoes, gate: Gate, hypotheses: Hypotheses, options: AssignmentOptions
) -> tuple[Candidates, bool]:
    if options.min_sensors is None:
        least = usual_sensors(echoes.sensors, options.detection_probability, echoes.least_sensors)
    else:
        least = min(max(options.min_sensors, echoes.least_sensors), echoes.sensors)
    if hypotheses.dimension == 3:
        seeds = cross_spheres(echoes, least, gate)
    else:
        crossings = find_seeds(cross_all(_seeding_echoes(echoes, least), options.gap_tolerance_m, gate))
        seeds = (crossings.x, crossings.y)
    gates = Gates(
        min_sensors=least,
        gate_std=options.gate_std,
        false_alarm=options.false_alarm,
        least_evidence=-_EVIDENCE_MARGIN,
        most=limit("candidates"),
    )
    density = clutter_density(echoes, hypotheses.bandwidth_m)

    def evidence(candidates: Candidates) -> FloatArray:
        weights = target_weights(echoes, candidates, density, hypotheses)
        return np.where(gate.contains(*candidates.point), weights, -np.inf)

    return find_candidates(echoes, seeds, gates, evidence)


def _seeding_echoes(echoes: Echoes, least: int) -> Echoes:
    """Return the echoes of the sensors whose circles are crossed for seeds: all, or of many some that are far apart.

    A target that ``least`` of the sensors see is seen by ``_SEEING_SENSORS`` of the chosen ones in any case.
    """
    wanted = max(_SEEDING_SENSORS, echoes.sensors - least + _SEEING_SENSORS)
    if wanted >= echoes.sensors:
        return echoes
    chosen = far_apart(echoes, wanted)
    return replace(echoes, radius=np.where(chosen[:, None], echoes.radius, np.nan))


def _side_m(volume: float, dimension: int) -> float:
    """Return the side of a square or a cube."""
    return float(np.sqrt(volume) if dimension == 2 else np.cbrt(volume))


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
    dimensions=(2, 3),
    flags=IDENTIFICATION_FLAGS,
    estimate_columns=(EXISTENCE,),
)
