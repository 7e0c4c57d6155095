"""Shen, Molisch 2012, Figure 4: the blind spots of lambda 1 to 6, for a target at (-1, 5)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, ignoring_division
from nlosctl.plotting.panels import Panel, RegionsPanel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions
from nlosctl.reproduce.shen.detection_theory import (
    ORDERS,
    Order,
    blind_spots,
    detection_probability,
    mean_detection_probability,
    outage_probabilities,
    reflector_grid,
    rule_moments,
    scene_detection_probability,
)
from nlosctl.reproduce.shen.paper import PAPER
from nlosctl.reproduce.shen.spots import REGION_M, SCENE, SPOTS, Spot
from nlosctl.reproduce.verdicts import at_least, at_most
from nlosctl.solvers.triplets.target_fits import fit_paths

__all__ = ["EXPERIMENT"]

_WHERE = "Section IV-C, Fig. 4"
_LEVEL = 0.05
_RULES = (*(f"lambda{rule}" for rule in range(1, 7)), "chi2")
_BLIND = 0.5
_ETA_M = 0.5
_POINTS = 100
_CLASSES = {"P_d below 0.5": 0.5, "0.5 to 0.9": 0.9, "above 0.9": 1.1}


def _reflectors(trials: IntArray, total: int) -> FloatArray:
    """Return reflectors (T, 2) of a lattice of square cells over the region, x varying fastest."""
    columns, step = _lattice(total)
    cell = np.stack([trials % columns, trials // columns], axis=1)
    return np.asarray(np.array([REGION_M[0], REGION_M[2]]) + (cell + 0.5) * step)


def _lattice(total: int) -> tuple[int, float]:
    """Return the number of columns and the side of a cell in metres."""
    width, height = REGION_M[1] - REGION_M[0], REGION_M[3] - REGION_M[2]
    columns = max(1, round(math.sqrt(total * width / height)))
    return columns, width / columns


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return P_d via each reflector by (33), the smaller of both orders; for lambda also its mean in each order."""
    reflectors, rule = _reflectors(chunk.trials, chunk.total), str(condition["rule"])
    with ignoring_division():  # a reflector on the target
        return _fields(reflectors, rule)


def _fields(reflectors: FloatArray, rule: str) -> Samples:
    if rule == "chi2":
        return {"p_d": np.minimum(*(_consistency_detection(reflectors, order) for order in ORDERS))}
    number = int(rule[-1])
    spots = [blind_spots(SCENE, reflectors, number, order) for order in ORDERS]
    p_d = [scene_detection_probability(SCENE, reflectors, number, _LEVEL, order) for order in ORDERS]
    sector = 2.0 * (spots[0].off_dod_line_m > 0.0) + (spots[0].off_doa_line_m > 0.0)
    return {
        "p_d": np.minimum(*p_d),
        "first_mean_m": spots[0].mean_m,
        "second_mean_m": spots[1].mean_m,
        "divisor": np.minimum(*(np.abs(spot.divisor) for spot in spots)),
        "sector": sector,
    }


def _consistency_detection(reflectors: FloatArray, order: Order) -> FloatArray:
    """Return P_d of chi2 via reflectors, by (33) with the square root of its noise-free value as mean and std 1."""
    mean = np.sqrt(2.0 * fit_paths(SCENE.indirect_rows(reflectors, order)).cost)
    return detection_probability(mean, np.ones(mean.shape), _LEVEL)


def _blind_share(samples: Samples) -> float:
    """Return the share of the region where P_d is below one half."""
    return float(np.mean(~(samples["p_d"] >= _BLIND)))


def _next_best(results: Results) -> float:
    """Return the smallest blind share of the other rules divided by that of lambda 5."""
    others = (_blind_share(results.of(rule=rule)) for rule in _RULES[:6] if rule != "lambda5")
    return min(others) / _blind_share(results.of(rule="lambda5"))


def _sectors_of_two_signs(results: Results) -> float:
    """Return the number of sectors between the lines to the target, of both orders, where the mean changes its sign."""
    samples = results.of(rule="lambda5")
    return float(
        sum(
            np.unique(np.sign(samples[mean][(samples["sector"] == sector) & (np.abs(samples[mean]) > 1e-9)])).size > 1
            for mean in ("first_mean_m", "second_mean_m")
            for sector in range(4)
        )
    )


def _least_divisor(results: Results) -> float:
    return float(results.of(rule="lambda5")["divisor"].min())


def _largest_alpha(results: Results) -> float:
    """Return the largest sine between DOD and DOA over reflectors on the lines of BS2."""
    along = np.linspace(0.0, 1.0, 50)
    return max(
        float(np.abs(SCENE.indirect_rows(spot.points(along), spot.order).rays.crossing_sine).max())
        for spot in SPOTS["lambda1"]
        if spot.kind == "BS2"
    )


def _panels(results: Results) -> Sequence[Panel]:
    return [_map(results, rule) for rule in _RULES[:6]]


def _map(results: Results, rule: str) -> Panel:
    p_d = results.of(rule=rule)["p_d"]
    columns, step = _lattice(p_d.size)
    rows = -(-p_d.size // columns)
    limits = np.array(list(_CLASSES.values()))
    region = np.full(rows * columns, -1)
    region[: p_d.size] = np.searchsorted(limits, np.nan_to_num(p_d), side="right")
    return RegionsPanel(
        title=f"lambda {rule[-1]}",
        x_label="reflector x [m]",
        y_label="reflector y [m]",
        equal_aspect=True,
        height=0.8,
        x=REGION_M[0] + (np.arange(float(columns)) + 0.5) * step,
        y=REGION_M[2] + (np.arange(float(rows)) + 0.5) * step,
        region=region.reshape(rows, columns),
        labels=tuple(_CLASSES),
        outlines=tuple(
            _outline([spot for spot in SPOTS[rule] if spot.kind == kind], label, style)
            for kind, label, style in (("BS1", "BS1", 2), ("BS2", "BS2", 1), ("BS3", "BS3", 0))
        ),
    )


def _outline(spots: Sequence[Spot], label: str, style: int) -> Series:
    gap = np.full((1, 2), np.nan)
    points = np.concatenate([gap, *(np.concatenate([spot.points(np.array([0.0, 1.0])), gap]) for spot in spots)])
    return Series(label=label, x=points[:, 0], y=points[:, 1], style=style, marker=False)


def _mean_p_d(results: Results, *, rule: int) -> float:
    """Return (32) by the theory, which needs no samples."""
    return mean_detection_probability(SCENE, rule, _LEVEL, x_m=REGION_M[:2], y_m=REGION_M[2:], points=_POINTS)


def _outage(results: Results, *, outside: bool) -> float:
    """Return (36) of lambda 5 with delta' = eta, over both orders, by the theory."""
    grid = reflector_grid(REGION_M[:2], REGION_M[2:], _POINTS)
    moments = [rule_moments(SCENE.indirect_rows(grid, order), 5) for order in ORDERS]
    mean, std = (np.concatenate(parts) for parts in zip(*moments, strict=True))
    known = np.isfinite(mean) & np.isfinite(std)
    return outage_probabilities(mean[known], std[known], _ETA_M, _ETA_M)[outside]


EXPERIMENT = Experiment(
    name="shen-fig4",
    paper=PAPER,
    title="Where indirect paths are missed, by the place of the reflector; target at (-1, 5)",
    conditions=conditions(rule=_RULES),
    sample=_sample,
    quantities={
        "share_missed_half": _blind_share,
        "mean_p_d": lambda samples: float(np.mean(np.nan_to_num(samples["p_d"]))),
    },
    claims=(
        Claim(
            text="BS2 by beta or gamma -> 0 does not exist here: least product over the region",
            where=_WHERE,
            ours=_least_divisor,
            expected=at_least(1e-3, "> 0"),
            note="It never does: from a focus inside it, no ray meets the ellipse along its tangent.",
        ),
        Claim(
            text="BS2 by alpha -> 0: lines from the nodes, parallel to DOD and DOA: largest alpha on them",
            where=_WHERE,
            ours=_largest_alpha,
            expected=at_most(1e-9, "0"),
        ),
        Claim(
            text="lambda 5 has BS1 alone: parts between the lines to the target where its mean changes sign",
            where=_WHERE,
            ours=_sectors_of_two_signs,
            expected=at_most(0.0, "0"),
        ),
        Claim(
            text="lambda 5 has the smallest blind spots: region with P_d < 0.5 of the next best, over its own",
            where=_WHERE,
            ours=_next_best,
            expected=at_least(1.0, "> 1"),
        ),
        *(
            Claim(
                text=f"Share of the region with P_d < 0.5 by (33), worse order, 1 dBm: lambda {rule[-1]}",
                where=_WHERE,
                ours=at(_blind_share, rule=rule),
            )
            for rule in _RULES[:6]
        ),
    ),
    comparisons=(
        Comparison(text="The same of chi2", ours=at(_blind_share, rule="chi2")),
        *(
            Comparison(
                text=f"Mean P_d (32) over reflectors of the region, both orders, P_f = 0.05: lambda {rule[-1]}",
                ours=partial(_mean_p_d, rule=int(rule[-1])),
            )
            for rule in _RULES[:6]
        ),
        *(
            Comparison(
                text=f"Outage (36), lambda 5, eta = delta' = {_ETA_M:g} m: share flagged {place} the safe region",
                ours=partial(_outage, outside=outside),
            )
            for outside, place in ((False, "inside"), (True, "outside"))
        ),
    ),
    panels=_panels,
    trials=5760,
    quick_trials=1440,
    chunk_trials=1440,
    random=False,
)
