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
from nlosctl.reproduce.experiment import Beside, Chunk, Claim, Experiment
from nlosctl.reproduce.samples import Condition, Drawn, Samples, measure, rms, share
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
"""Direct paths, and as many indirect ones, that are one snapshot for ``joint``."""
_PRINTED = {
    (-1.0, 5.0): ("4.2575", "0.5602", "0.0504", "0.9832"),
    (-2.0, 6.0): ("5.4581", "0.8152", "0.0498", "0.9806"),
    (3.0, 7.0): ("4.2980", "0.7863", "0.0506", "0.9760"),
    (-3.0, 4.6): ("4.6665", "0.5179", "0.0496", "0.9797"),
}
"""By target: RMSE without and with detection, P_f, P_d."""
_RMSE_NOTE = (
    "A few outliers carry it: the paper's iteration is not told, and stopped early it gives up to three times ours. "
    "Only that detection makes it several times smaller holds."
)
_RULE_NOTE = (
    "lambda 5, or lines that meet behind a node, or an average of the three points outside of the room: the rules that "
    "give the paper's numbers. By lambda 5 alone P_d is 0.966 to 0.978."
)


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return of direct and indirect paths whether each is flagged, is in the room, and the error of its fix."""
    target = (float(condition["target_x_m"]), float(condition["target_y_m"]))
    scene: dict[str, Any] = {"number": 3, "target_m": target, "region_m": _ROOM_M}
    samples: dict[str, FloatArray] = {}
    unfolded = {}
    for truth in _TRUTHS:
        given = triplet_trials(chunk, indirect=truth == "indirect", reading="lines", **scene)
        unfolded[truth] = triplet_trials(chunk, indirect=truth == "indirect", **scene)
        inside = _average_in_room(given, chunk)
        flagged = (p_values(given, chunk, "lambda5", reading="lines") < _LEVEL) | ~inside
        samples |= {
            f"{truth}_flagged": flagged.astype(float),
            f"{truth}_inside": inside.astype(float),
            f"{truth}_chi2": (p_values(unfolded[truth], chunk, "chi2") < _LEVEL).astype(float),
            f"{truth}_error_m": fixes(given, chunk, "ml").error_m,
            f"{truth}_unfolded_error_m": fixes(unfolded[truth], chunk, "ml").error_m,
        }
    return {**samples, **_jointly(unfolded, chunk)}


def _average_in_room(given: Simulated, chunk: Chunk) -> BoolArray:
    """Return whether the average of the three intersections is in the room; false where one does not exist."""
    flags = detect_ip(given.table, method="tdaj", details=True, seed=chunk.seed).flags
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


def _jointly(given: Mapping[str, Simulated], chunk: Chunk) -> Samples:
    """Return flags by ``joint`` on the same paths, eight to a snapshot, and the error of its target, one of four."""
    trial = np.arange(chunk.size)
    columns = {
        name: np.concatenate([given[truth].columns[name] for truth in _TRUTHS]) for name in given["direct"].columns
    }
    columns["snapshot"] = np.tile(trial // _JOINT_PATHS, 2)
    columns["path"] = np.concatenate([trial % _JOINT_PATHS, _JOINT_PATHS + trial % _JOINT_PATHS])
    order = np.argsort(columns["snapshot"], kind="stable")
    table = measurement_table("triplets", {name: values[order] for name, values in columns.items()})
    found = detect_ip(table, method="joint", seed=chunk.seed)
    flagged = np.empty(order.shape)
    flagged[order] = found.flags.column("ip").to_numpy(zero_copy_only=False)
    estimates: Any = found.estimates
    first = estimates.column("target").to_numpy() == 0
    position = np.stack([estimates.column(name).to_numpy(zero_copy_only=False)[first] for name in ("x_m", "y_m")])
    truth = given["direct"].truth_m[::_JOINT_PATHS].T
    error = np.full(chunk.size, np.nan)
    error[::_JOINT_PATHS] = np.hypot(*(position - truth))
    return {"direct_joint": flagged[: chunk.size], "indirect_joint": flagged[chunk.size :], "joint_error_m": error}


def _flagged(samples: Samples, *, truth: str, rule: str) -> float:
    return share(samples[f"{truth}_{rule}"])


def _rmse(samples: Samples, *, rule: str) -> float:
    """Return the RMSE of the fixes of all paths that are used: in the room, or by a rule not flagged."""
    if rule == "joint":
        return rms(samples["joint_error_m"])
    used = []
    for truth in _TRUTHS:
        error = samples[f"{truth}_unfolded_error_m" if rule == "chi2" else f"{truth}_error_m"]
        kept = samples[f"{truth}_inside"] == 1.0 if rule == "none" else samples[f"{truth}_{rule}"] == 0.0
        used.append(error[kept])
    return rms(np.concatenate(used))


def _at(drawn: Drawn, *, statistic: Any, target: tuple[float, float], **keys: str) -> float:
    return float(statistic(drawn.of(target_x_m=target[0], target_y_m=target[1]), **keys))


def _least_gain(drawn: Drawn) -> float:
    return min(_rmse(samples, rule="none") / _rmse(samples, rule="flagged") for _, samples in drawn.where())


def _claims(target: tuple[float, float]) -> tuple[Claim, ...]:
    without, with_detection, p_f, p_d = _PRINTED[target]
    at = f"target at ({target[0]:g}, {target[1]:g})"
    rmse = partial(_at, statistic=_rmse, target=target)
    flagged = partial(_at, statistic=_flagged, target=target, rule="flagged")
    return (
        Claim(
            says=f"P_f, {at}",
            where=_WHERE,
            ours=partial(flagged, truth="direct"),
            expected=printed_share(p_f, _PAPER_TRIALS),
            note=_RULE_NOTE,
        ),
        Claim(
            says=f"P_d, {at}",
            where=_WHERE,
            ours=partial(flagged, truth="indirect"),
            expected=printed_share(p_d, _PAPER_TRIALS),
            note=_RULE_NOTE,
        ),
        Claim(
            says=f"RMSE without detection, {at}",
            where=_WHERE,
            ours=partial(rmse, rule="none"),
            expected=printed(without),
            unit="m",
            note=_RMSE_NOTE,
        ),
        Claim(
            says=f"RMSE with detection, {at}",
            where=_WHERE,
            ours=partial(rmse, rule="flagged"),
            expected=printed(with_detection),
            unit="m",
            note=_RMSE_NOTE,
        ),
    )


def _besides(target: tuple[float, float]) -> tuple[Beside, ...]:
    at = f"target at ({target[0]:g}, {target[1]:g})"
    paths = 2 * _JOINT_PATHS
    return tuple(
        beside
        for rule, told in (("chi2", "chi2"), ("joint", f"joint, one fix of {paths} of the paths"))
        for beside in (
            Beside(
                says=f"{told}: P_f, {at}",
                ours=partial(_at, statistic=_flagged, target=target, truth="direct", rule=rule),
            ),
            Beside(
                says=f"{told}: P_d, {at}",
                ours=partial(_at, statistic=_flagged, target=target, truth="indirect", rule=rule),
            ),
            Beside(says=f"{told}: RMSE, {at}", ours=partial(_at, statistic=_rmse, target=target, rule=rule), unit="m"),
        )
    )


def _panels(drawn: Drawn) -> Sequence[Panel]:
    rules = {"none": "ours, no detection", "flagged": "ours, lambda 5", "chi2": "chi2", "joint": "joint, 8 paths"}
    paper = np.array([values[:2] for values in _PRINTED.values()], dtype=float).T
    values = {"paper, no detection": paper[0], "paper, lambda 5": paper[1]}
    errors = {}
    for rule, label in rules.items():
        ours = [measure(partial(_at, statistic=_rmse, target=target, rule=rule), drawn) for target in _PRINTED]
        values[label] = np.array([one.value for one in ours])
        errors[label] = np.nan_to_num(np.array([one.standard_error for one in ours]))
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
    conditions=[{"target_x_m": x, "target_y_m": y} for x, y in _PRINTED],
    sample=_sample,
    quantities={
        **{
            f"{kind}_{rule}": partial(_flagged, truth=truth, rule=rule)
            for rule in ("flagged", "chi2", "joint")
            for truth, kind in (("direct", "p_f"), ("indirect", "p_d"))
        },
        **{f"rmse_{rule}_m": partial(_rmse, rule=rule) for rule in ("none", "flagged", "chi2", "joint")},
    },
    claims=(
        *(claim for target in _PRINTED for claim in _claims(target)),
        Claim(
            says="Detection makes the RMSE several times smaller (Table V: 5.5 to 9): least ratio of all targets",
            where=_WHERE,
            ours=_least_gain,
            expected=at_least(5.0, "5.5 to 9"),
        ),
        Claim(
            says='Detection makes the RMSE smaller "by several orders of magnitude": least ratio of all targets',
            where="Section VI-E",
            ours=_least_gain,
            expected=at_least(100.0, ">= 100"),
            note="By the paper's own table it is 5 to 9 times.",
        ),
    ),
    beside=tuple(beside for target in _PRINTED for beside in _besides(target)),
    panels=_panels,
    trials=100_000,
    quick_trials=800,
    chunk_trials=CHUNK_TRIALS,
)
