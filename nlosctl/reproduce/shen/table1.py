"""Shen, Molisch 2012, Table I and Theorem 1: rules on their blind spots, and on direct paths where they fail."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import Scene
from nlosctl.io.results.tables import measurement_table
from nlosctl.models.triplets import PathRows
from nlosctl.plotting.panels import BarsPanel, Panel
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.samples import Condition, Results, Samples, at, measure_all, share_of
from nlosctl.reproduce.shen.detection_theory import TABLE_I, DetectionScene
from nlosctl.reproduce.shen.paper import PAPER, RULES, p_values
from nlosctl.reproduce.shen.spots import SCENE, SPOTS
from nlosctl.reproduce.simulated import Simulated
from nlosctl.reproduce.verdicts import about, at_most
from nlosctl.scenarios.triplet_rows import triplet_columns

__all__ = ["EXPERIMENT"]

_LEVEL = 0.05
_KINDS = ("BS1", "BS2", "BS3")
_ON_SPOTS: list[Condition] = [
    {"rule": rule, "place": kind, "target_x_m": SCENE.target_m[0], "target_y_m": SCENE.target_m[1]}
    for rule, spots in SPOTS.items()
    for kind in _KINDS
    if any(spot.kind == kind for spot in spots)
]
_DIRECT_PATHS: list[Condition] = [
    {"rule": rule, "place": "direct", "target_x_m": x, "target_y_m": y}
    for rule, x, y in (
        ("lambda5", 1.0, 5.0),
        ("lambda1", -2.5, 6.0),
        ("lambda3", 2.5, 6.0),
        ("lambda6", 0.0, 5.0),
        ("lambda5", 5.0, 0.1),
        ("fusion0", 5.0, 0.5),
    )
]
"""An ordinary target, and five whose direct paths are a blind spot of the rule."""


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return whether the rule and chi2 flag paths via reflectors on the blind spots, or direct paths."""
    generator = chunk.generator()
    rule = str(condition["rule"])
    if condition["place"] == "direct":
        scene = DetectionScene(target_m=(float(condition["target_x_m"]), float(condition["target_y_m"])))
        noise_free = np.repeat(_triplets(scene.direct_row()), chunk.size, axis=1)
    else:
        scene = SCENE
        spots = [spot for spot in SPOTS[rule] if spot.kind == condition["place"]]
        along = generator.uniform(0.02, 0.98, chunk.size)
        every = [_triplets(scene.indirect_rows(spot.points(along), spot.order)) for spot in spots]
        noise_free = np.stack(every)[chunk.trials % len(spots), :, np.arange(chunk.size)].T
    trials = _measured(scene, noise_free, condition["place"] != "direct", generator)
    return {
        "rule": (p_values(trials, chunk, rule) < _LEVEL).astype(float),
        "chi2": (p_values(trials, chunk, "chi2") < _LEVEL).astype(float),
    }


def _triplets(rows: PathRows) -> FloatArray:
    """Return DOD, DOA, path length and their standard deviations (6, N); the baseline frame is the global frame."""
    rays = rows.rays
    return np.stack(
        [
            np.arctan2(rays.dod_sine, rays.dod_cosine),
            np.arctan2(rays.doa_sine, rays.doa_cosine),
            rays.path_length_m,
            rows.dod_std_rad,
            rows.doa_std_rad,
            rows.path_length_std_m,
        ]
    )


def _measured(
    scene: DetectionScene, noise_free: FloatArray, indirect: bool, generator: np.random.Generator
) -> Simulated:
    size = noise_free.shape[1]
    dod, doa, length, dod_std, doa_std, length_std = noise_free
    target = np.tile(np.array(scene.target_m), (size, 1))
    columns = triplet_columns(
        generator=generator,
        snapshot=np.arange(size, dtype=np.int64),
        path=np.zeros(size, dtype=np.int64),
        tx_m=np.tile(np.array(scene.tx_m), (size, 1)),
        rx_m=np.tile(np.array(scene.rx_m), (size, 1)),
        triplet=(dod, doa, length),
        stds=(dod_std, doa_std, length_std),
        truth_ip=np.full(size, indirect),
        target_m=target,
    )
    table = measurement_table("triplets", columns)
    return Simulated(kind="triplets", columns=columns, table=table, scene=Scene(), truth_m=target)


def _description(condition: Condition) -> str:
    rule, place = str(condition["rule"]), str(condition["place"])
    label = RULES[rule][0]
    if place == "direct":
        return f"{label}, direct paths over ({condition['target_x_m']:g}, {condition['target_y_m']:g})"
    return f"{label} on {place} ({TABLE_I[int(rule[-1])][_KINDS.index(place)]})"


def _claim(condition: Condition) -> Claim:
    ours = at(share_of("rule"), **condition)
    if condition["place"] == "direct":
        return Claim(
            text=f"All rules have the expected P_f = 0.05: {_description(condition)}",
            where="Theorem 1",
            ours=ours,
            expected=about(0.05, 0.1, "0.05"),
            note="Blind spots of direct paths, which Table I leaves out: there the linear law (19) of the rule fails.",
        )
    return Claim(
        text=f"Blind: P_d of {_description(condition)}",
        where="Table I",
        ours=ours,
        expected=at_most(2.0 * _LEVEL, "about P_f"),
    )


def _panels(results: Results) -> Sequence[Panel]:
    panels = []
    for title, y_label, wanted in (
        ("indirect paths on blind spots", "P_d at P_f = 0.05 [-]", _ON_SPOTS),
        ("direct paths", "P_f at an expected 0.05 [-]", _DIRECT_PATHS),
    ):
        ours = {
            label: measure_all([at(share_of(by), **condition) for condition in wanted], results)
            for by, label in (("rule", "the rule"), ("chi2", "chi2"))
        }
        panels.append(
            BarsPanel(
                title=title,
                x_label="rule and place [-]",
                y_label=y_label,
                groups=tuple(_short(condition) for condition in wanted),
                values={label: values for label, (values, _) in ours.items()},
                errors={label: np.nan_to_num(errors) for label, (_, errors) in ours.items()},
            )
        )
    return panels


def _short(condition: Condition) -> str:
    rule = str(condition["rule"])
    name = f"λ{rule[-1]}" if rule.startswith("lambda") else "K = 0"
    if condition["place"] == "direct":
        return f"{name}\n({condition['target_x_m']:g}, {condition['target_y_m']:g})"
    return f"{name}\n{condition['place']}"


EXPERIMENT = Experiment(
    name="shen-table1",
    paper=PAPER,
    title="Blind spots: those of Table I, and those of direct paths",
    conditions=(*_ON_SPOTS, *_DIRECT_PATHS),
    sample=_sample,
    quantities={"flagged_by_rule": share_of("rule"), "flagged_by_chi2": share_of("chi2")},
    claims=tuple(_claim(condition) for condition in (*_ON_SPOTS, *_DIRECT_PATHS)),
    comparisons=tuple(
        Comparison(
            text=f"chi2 in place of {_description(condition)}: {'P_f' if condition['place'] == 'direct' else 'P_d'}",
            ours=at(share_of("chi2"), **condition),
        )
        for condition in (*_ON_SPOTS, *_DIRECT_PATHS)
    ),
    panels=_panels,
    trials=20_000,
    quick_trials=400,
    chunk_trials=5000,
)
