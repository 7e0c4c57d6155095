"""Shen, Molisch 2012, Figure 8: P_f and P_d over the transmitted power in scenario 5, expected P_f 5 %."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Claim, Comparison, Experiment
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Results, at, conditions
from nlosctl.reproduce.shen.paper import ALL_READINGS, CHUNK_TRIALS, PAPER, RULES, detection_samples, rate
from nlosctl.reproduce.verdicts import about, at_least

__all__ = ["EXPERIMENT"]

_WHERE = "Section VI-D, Fig. 8"
_LEVEL = 0.05
_POWERS_DBM = (-10.0, -5.0, 0.0, 5.0, 10.0, 20.0, 30.0)
_EXPECTED = Series(
    label="expected", x=np.array([_POWERS_DBM[0], _POWERS_DBM[-1]]), y=np.full(2, _LEVEL), marker=False, style=7
)
_BOTH = (
    "Both halves at once: rays keep P_f, lines reach P_d; rays that are indirect where they meet behind a node come "
    "near both."
)
_RULES = ("lambda5", "fusion0", "fusion1", "chi2")


def _rate(truth: str, rule: str, power_dbm: float, reading: str = "rays") -> Callable[[Results], float]:
    return at(partial(rate, truth=truth, rule=rule, level=_LEVEL), power_dbm=power_dbm, reading=reading)


def _excess(results: Results, rule: str) -> float:
    """Return the largest difference of P_f from the expected one, over all powers."""
    return max(abs(_rate("direct", rule, power_dbm)(results) - _LEVEL) for power_dbm in _POWERS_DBM)


def _steadier(results: Results, *, rule: str) -> float:
    return _excess(results, rule) - _excess(results, "lambda5")


def _least_rise(results: Results) -> float:
    p_d = [_rate("indirect", "lambda5", power_dbm)(results) for power_dbm in _POWERS_DBM]
    return float(np.min(np.diff(p_d)))


def _closer(results: Results) -> float:
    """Return how much closer P_f of fusion with K = 0 is to 0.05 at the highest power than at the lowest."""
    low, high = (abs(_rate("direct", "fusion0", _POWERS_DBM[end])(results) - _LEVEL) for end in (0, -1))
    return low - high


def _panels(results: Results) -> Sequence[Panel]:
    return [
        LinesPanel(
            title=f"{label}, {truth} paths",
            x_label="transmitted power [dBm]",
            y_label=f"{kind} [-]",
            lines=tuple(
                curve(
                    results,
                    "power_dbm",
                    RULES[rule][0],
                    partial(rate, truth=truth, rule=rule, level=_LEVEL),
                    reading=reading,
                )
                for rule in _RULES
            )
            + (() if truth == "indirect" else (_EXPECTED,)),
        )
        for reading, label in ALL_READINGS.items()
        for truth, kind in (("direct", "P_f"), ("indirect", "P_d"))
    ]


EXPERIMENT = Experiment(
    name="shen-fig8",
    paper=PAPER,
    title="False alarms and detections over the transmitted power",
    conditions=conditions(reading=tuple(ALL_READINGS), power_dbm=_POWERS_DBM),
    sample=partial(detection_samples, number=5, rules=_RULES),
    quantities={
        f"{kind}_{rule}": partial(rate, truth=truth, rule=rule, level=_LEVEL)
        for rule in _RULES
        for truth, kind in (("direct", "p_f"), ("indirect", "p_d"))
    },
    claims=(
        *(
            claim
            for reading, label in ALL_READINGS.items()
            for claim in (
                Claim(
                    text=f"lambda 5 at -5 dBm, {label}: P_f = 5 %",
                    where=_WHERE,
                    ours=_rate("direct", "lambda5", -5.0, reading),
                    expected=about(0.05, 0.1, "0.05"),
                    note=_BOTH,
                ),
                Claim(
                    text=f"lambda 5 at -5 dBm, {label}: P_d > 85 %",
                    where=_WHERE,
                    ours=_rate("indirect", "lambda5", -5.0, reading),
                    expected=at_least(0.85, "> 0.85"),
                    note=_BOTH,
                ),
            )
        ),
        Claim(
            text="P_d of lambda 5 rises with the power: least rise from one to the next",
            where=_WHERE,
            ours=_least_rise,
            expected=at_least(0.0, "> 0"),
        ),
        Claim(
            text="P_f comes nearer to the expected with rising power: fusion K = 0, by, -10 to 30 dBm",
            where=_WHERE,
            ours=_closer,
            expected=at_least(0.0, "> 0"),
        ),
        *(
            Claim(
                text=f"P_f of lambda 5 is less impacted than that of {RULES[rule][0]}: worst excess less by",
                where=_WHERE,
                ours=partial(_steadier, rule=rule),
                expected=at_least(0.0, "> 0"),
            )
            for rule in ("fusion0", "fusion1")
        ),
    ),
    comparisons=(
        *(
            Comparison(text=f"chi2 at -5 dBm: {kind}", ours=_rate(truth, "chi2", -5.0))
            for truth, kind in (("direct", "P_f"), ("indirect", "P_d"))
        ),
        Comparison(text="chi2: worst difference of P_f from 0.05, all powers", ours=partial(_excess, rule="chi2")),
    ),
    panels=_panels,
    trials=50_000,
    quick_trials=500,
    chunk_trials=CHUNK_TRIALS,
)
