"""Unlabelled bearings assigned to sources: likelihoods against clutter, and the best choice of disjoint sources."""

from __future__ import annotations

from dataclasses import dataclass

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.methods import LEAST_HALF_CHI_SQUARE, MethodSpec
from nlosctl.contract.options import option
from nlosctl.contract.results import Solution
from nlosctl.solvers.association.sensor_rows import rows_by_sensor
from nlosctl.solvers.association.source_model import Hypotheses, source_model
from nlosctl.solvers.association.source_sets import Gates, find_sets
from nlosctl.solvers.association.sources import EXISTENCE, choose_sources, locate_sources

__all__ = ["METHOD", "AssignmentOptions", "solve"]


@dataclass(frozen=True, kw_only=True)
class AssignmentOptions:
    """Parameters of ``assignment`` on bearings."""

    min_sensors: int = option(3, minimum=3, meaning="least number of sensors that see a source")
    gate_std: float = option(
        4.0,
        minimum=0.0,
        exclusive=True,
        meaning="largest distance of a bearing from its source, in standard deviations",
    )
    false_alarm: float = option(
        1e-5,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="probability that the chi-square gate rejects a true source",
    )
    detection_probability: float = option(
        0.9,
        minimum=0.0,
        maximum=1.0,
        exclusive=True,
        meaning="probability that a sensor gives a bearing of a source; rather too small than too large",
    )
    clutter_density: float | None = option(
        None,
        unit="1/rad",
        minimum=0.0,
        exclusive=True,
        meaning="false bearings of a sensor per radian (with elevations per square radian); default: as if all were",
    )
    target_reward: float = option(
        1.1, unit="nats", meaning="log of the number of sources to expect in the search region: larger values give more"
    )
    field_margin_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        meaning="sources up to this far outside the search region are kept; default: 5 % of its size",
    )
    max_echoes: int = option(100, minimum=1, meaning="most bearings of one sensor in a snapshot; more are an error")
    min_range_m: float | None = option(
        None,
        unit="m",
        minimum=0.0,
        meaning="least distance of a source from a sensor that sees it; default: 0.5 % of the sensors' extent",
    )
    max_nodes: int = option(
        100_000, minimum=1, meaning="nodes of the search after which the best set so far is kept: not_proven"
    )


def solve(batch: BearingBatch, options: AssignmentOptions) -> Solution:
    """Find sources among unlabelled bearings: the sets of rows of largest likelihood that share no row.

    A set takes at most one row of each sensor (a name, a position and a reflector), and weighs the log of the
    likelihood ratio against clutter, with its position integrated out. Rows by reflectors are unfolded first. No source
    is a possible answer, the only one where fewer than ``min_sensors`` sensors have rows; not_proven: ``max_nodes`` did
    not suffice for a proof. Each source is located by maximum likelihood, as ``ml`` does.
    """
    table = rows_by_sensor(batch, options.max_echoes)
    model = source_model(
        table,
        Hypotheses(
            detection_probability=options.detection_probability,
            clutter_density=options.clutter_density,
            reward=options.target_reward,
            margin_m=options.field_margin_m,
            min_range_m=options.min_range_m,
        ),
    )
    gates = Gates(min_sensors=options.min_sensors, gate_std=options.gate_std, false_alarm=options.false_alarm)
    sets, weight = find_sets(table, model, gates)
    sources = choose_sources(sets, weight, options.max_nodes)
    return locate_sources(table, model.lines.center, sources, min_range_m=options.min_range_m or 0.0)


METHOD = MethodSpec(
    name="assignment",
    kind="bearings",
    job="identify-los",
    summary="several sources by likelihood against clutter, disjoint sets of bearings chosen exactly",
    reference="Pattipati, Deb, Bar-Shalom, Washburn 1992: S-D assignment; equation (1) of docs/several-sources.md",
    options=AssignmentOptions,
    solve=solve,
    cost=LEAST_HALF_CHI_SQUARE,
    minimum_measurements=1,
    dimensions=(2, 3),
    flags=("los", "target", "residual_rad", "residual_elevation_rad"),
    flags_needing={"residual_elevation_rad": "elevation_rad"},
    estimate_columns=(EXISTENCE,),
)
