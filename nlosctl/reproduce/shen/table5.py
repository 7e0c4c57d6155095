"""Shen, Molisch 2012, Table V: localization in a room with and without detection of indirect paths."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from nlosctl.api import detect_ip
from nlosctl.arrays import BoolArray, FloatArray, ignoring_invalid
from nlosctl.io.results.tables import measurement_table
from nlosctl.plotting.panels import BarsPanel, Panel
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.samples import Condition, Results, Samples, at, measure_all, rms, share_of, smallest
from nlosctl.reproduce.shen.paper import CHUNK_TRIALS, PAPER, p_values, printed_share, triplet_trials
from nlosctl.reproduce.simulated import Simulated, fixes
from nlosctl.reproduce.verdicts import at_least, printed

__all__ = ["EXPERIMENT"]

_WHERE = "Table V"
_ROOM_M = (-5.0, 5.0, 0.0, 8.0)
_LEVEL = 0.05
_PAPER_TRIALS = 100_000
_TRUTHS = ("direct", "indirect")
_JOINT_PATHS = 4
"""Number of direct paths, and of indirect paths, in a snapshot for ``joint``."""
_PRINTED = {
    (-1.0, 5.0): ("4.2575", "0.5602", "0.0504", "0.9832"),
    (-2.0, 6.0): ("5.4581", "0.8152", "0.0498", "0.9806"),
    (3.0, 7.0): ("4.2980", "0.7863", "0.0506", "0.9760"),
    (-3.0, 4.6): ("4.6665", "0.5179", "0.0496", "0.9797"),
}
"""By target: RMSE without and with detection, P_f, P_d."""
_RMSE_NOTE = (
    "A few outliers carry it: the paper's iteration is not stated, and stopped early it gives up to three times ours. "
    "Only that detection makes it several times smaller holds."
)
_RULE_NOTE = (
    "lambda 5, or lines that meet behind a node, or an average of the three points outside of the room: the rules that "
    "give the paper's numbers. By lambda 5 alone P_d is 0.966 to 0.978."
)


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return, for direct and indirect paths, whether they are flagged or in the room, and the errors of their fixes."""
    target = (float(condition["target_x_m"]), float(condition["target_y_m"]))
    scene: dict[str, Any] = {"number": 3, "target_m": target, "region_m": _ROOM_M}
    samples: dict[str, FloatArray] = {}
    unfolded = {}
    for truth in _TRUTHS:
        trials = triplet_trials(chunk, indirect=truth == "indirect", reading="lines", **scene)
        unfolded[truth] = triplet_trials(chunk, indirect=truth == "indirect", **scene)
        inside = _average_in_room(trials, chunk)
        flagged = (p_values(trials, chunk, "lambda5", reading="lines") < _LEVEL) | ~inside
        samples |= {
            f"{truth}_flagged": flagged.astype(float),
            f"{truth}_inside": inside.astype(float),
            f"{truth}_chi2": (p_values(unfolded[truth], chunk, "chi2") < _LEVEL).astype(float),
            f"{truth}_error_m": fixes(trials, chunk, "ml").error_m,
            f"{truth}_unfolded_error_m": fixes(unfolded[truth], chunk, "ml").error_m,
        }
    return {**samples, **_jointly(unfolded, chunk)}


def _average_in_room(trials: Simulated, chunk: Chunk) -> BoolArray:
    """Return whether the average of the three intersections is in the room; false if one does not exist."""
    flags = detect_ip(trials.table, method="tdaj", details=True, seed=chunk.seed).flags
    x, y = (
        sum(
            flags.column(f"{name}_{axis}_m").to_numpy(zero_copy_only=False)
            for name in ("dod_doa", "dod_toa", "doa_toa")
        )
        / 3.0
        for axis in "xy"
    )
    x_low, x_high, y_low, y_high = _ROOM_M
    with ignoring_invalid():
        return np.asarray((x >= x_low) & (x <= x_high) & (y >= y_low) & (y <= y_high))


def _jointly(trials: Mapping[str, Simulated], chunk: Chunk) -> Samples:
    """Return flags by ``joint`` on the same paths, eight per snapshot, and the error of the snapshot's target.

    The error is that of the snapshot's first trial; the others are NaN.
    """
    trial = np.arange(chunk.size)
    columns = {
        name: np.concatenate([trials[truth].columns[name] for truth in _TRUTHS]) for name in trials["direct"].columns
    }
    columns["snapshot"] = np.tile(trial // _JOINT_PATHS, 2)
    columns["path"] = np.concatenate([trial % _JOINT_PATHS, _JOINT_PATHS + trial % _JOINT_PATHS])
    order = np.argsort(columns["snapshot"], kind="stable")
    table = measurement_table("triplets", {name: values[order] for name, values in columns.items()})
    result = detect_ip(table, method="joint", seed=chunk.seed)
    flagged = np.empty(order.shape)
    flagged[order] = result.flags.column("ip").to_numpy(zero_copy_only=False)
    estimates: Any = result.estimates
    first = estimates.column("target").to_numpy() == 0
    position = np.stack([estimates.column(name).to_numpy(zero_copy_only=False)[first] for name in ("x_m", "y_m")])
    truth = trials["direct"].truth_m[::_JOINT_PATHS].T
    error = np.full(chunk.size, np.nan)
    error[::_JOINT_PATHS] = np.hypot(*(position - truth))
    return {"direct_joint": flagged[: chunk.size], "indirect_joint": flagged[chunk.size :], "joint_error_m": error}


def _rmse(samples: Samples, *, rule: str) -> float:
    """Return the RMSE of the fixes of all used paths: those in the room, or those that the rule does not flag."""
    if rule == "joint":
        return rms(samples["joint_error_m"])
    used = []
    for truth in _TRUTHS:
        error = samples[f"{truth}_unfolded_error_m" if rule == "chi2" else f"{truth}_error_m"]
        is_used = samples[f"{truth}_inside"] == 1.0 if rule == "none" else samples[f"{truth}_{rule}"] == 0.0
        used.append(error[is_used])
    return rms(np.concatenate(used))


def _gain(samples: Samples) -> float:
    return _rmse(samples, rule="none") / _rmse(samples, rule="flagged")


def _condition(target: tuple[float, float]) -> Condition:
    return {"target_x_m": target[0], "target_y_m": target[1]}


def _claims(target: tuple[float, float]) -> tuple[Claim, ...]:
    without, with_detection, p_f, p_d = _PRINTED[target]
    target_label = f"target at ({target[0]:g}, {target[1]:g})"
    shares = (
        Claim(
            text=f"{name}, {target_label}",
            where=_WHERE,
            ours=at(share_of(f"{truth}_flagged"), **_condition(target)),
            expected=printed_share(shown, _PAPER_TRIALS),
            note=_RULE_NOTE,
        )
        for name, truth, shown in (("P_f", "direct", p_f), ("P_d", "indirect", p_d))
    )
    errors = (
        Claim(
            text=f"RMSE {name} detection, {target_label}",
            where=_WHERE,
            ours=at(partial(_rmse, rule=rule), **_condition(target)),
            expected=printed(shown),
            unit="m",
            note=_RMSE_NOTE,
        )
        for name, rule, shown in (("without", "none", without), ("with", "flagged", with_detection))
    )
    return (*shares, *errors)


def _comparisons(target: tuple[float, float]) -> tuple[Comparison, ...]:
    target_label, condition = f"target at ({target[0]:g}, {target[1]:g})", _condition(target)
    return tuple(
        comparison
        for rule, label in (("chi2", "chi2"), ("joint", f"joint, one fix of {2 * _JOINT_PATHS} of the paths"))
        for comparison in (
            Comparison(text=f"{label}: P_f, {target_label}", ours=at(share_of(f"direct_{rule}"), **condition)),
            Comparison(text=f"{label}: P_d, {target_label}", ours=at(share_of(f"indirect_{rule}"), **condition)),
            Comparison(
                text=f"{label}: RMSE, {target_label}", ours=at(partial(_rmse, rule=rule), **condition), unit="m"
            ),
        )
    )


def _panels(results: Results) -> Sequence[Panel]:
    rules = {"none": "ours, no detection", "flagged": "ours, lambda 5", "chi2": "chi2", "joint": "joint, 8 paths"}
    paper = np.array([values[:2] for values in _PRINTED.values()], dtype=float).T
    values = {"paper, no detection": paper[0], "paper, lambda 5": paper[1]}
    errors = {}
    for rule, label in rules.items():
        statistic = partial(_rmse, rule=rule)
        values[label], error = measure_all([at(statistic, **_condition(target)) for target in _PRINTED], results)
        errors[label] = np.nan_to_num(error)
    groups = tuple(f"({x:g}, {y:g})" for x, y in _PRINTED)
    return [
        BarsPanel(
            x_label="target, x and y [m]",
            y_label="RMSE [m]",
            groups=groups,
            values=values,
            errors=errors,
            log_y=True,
            y_range=(1e-3, 60.0),
        )
    ]


EXPERIMENT = Experiment(
    name="shen-table5",
    paper=PAPER,
    title="Localization with and without detection",
    conditions=[_condition(target) for target in _PRINTED],
    sample=_sample,
    quantities={
        **{
            f"{kind}_{rule}": share_of(f"{truth}_{rule}")
            for rule in ("flagged", "chi2", "joint")
            for truth, kind in (("direct", "p_f"), ("indirect", "p_d"))
        },
        **{f"rmse_{rule}_m": partial(_rmse, rule=rule) for rule in ("none", "flagged", "chi2", "joint")},
    },
    claims=(
        *(claim for target in _PRINTED for claim in _claims(target)),
        Claim(
            text="Detection makes the RMSE several times smaller (Table V: 5.5 to 9): least ratio of all targets",
            where=_WHERE,
            ours=smallest(_gain),
            expected=at_least(5.0, "5.5 to 9"),
        ),
        Claim(
            text='Detection makes the RMSE smaller "by several orders of magnitude": least ratio of all targets',
            where="Section VI-E",
            ours=smallest(_gain),
            expected=at_least(100.0, ">= 100"),
            note="By the paper's own table it is 5 to 9 times.",
        ),
    ),
    comparisons=tuple(beside for target in _PRINTED for beside in _comparisons(target)),
    panels=_panels,
    trials=100_000,
    quick_trials=800,
    chunk_trials=CHUNK_TRIALS,
)
