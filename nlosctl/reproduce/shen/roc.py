"""Shen, Molisch 2012, Figures 5 to 7 have one form: P_d over P_f of all rules in scenarios 2, 3, 4."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Beside, Claim, Experiment
from nlosctl.reproduce.samples import Drawn, conditions
from nlosctl.reproduce.shen.paper import (
    CHUNK_TRIALS,
    PAPER,
    READINGS,
    RULES,
    TRIALS,
    detection_samples,
    rate,
    rate_in,
    rates,
)
from nlosctl.reproduce.verdicts import about, at_least

__all__ = ["roc_experiment"]


_INDIVIDUAL = tuple(f"lambda{rule}" for rule in range(1, 7))
_RULES = (*_INDIVIDUAL, "fusion0", "fusion5", "chi2", "chi2_miss")
_SHOWN = (*_INDIVIDUAL, "fusion0", "chi2")
_LARGEST_SHOWN = 0.2


def roc_experiment(*, figure: int, scenario: int, detection_note: str, alarm_note: str) -> Experiment:
    """Return the figure of a scenario: claims of Section VI-C, each for rays and for lines in place of them.

    The notes are on the claims of detection and of false alarms.
    """
    where = f"Section VI-C, Fig. {figure}"
    return Experiment(
        name=f"shen-fig{figure}",
        paper=PAPER,
        title=f"Detections over false alarms in scenario {scenario}",
        conditions=conditions(reading=tuple(READINGS)),
        sample=partial(detection_samples, number=scenario, rules=_RULES),
        quantities={
            f"{kind}_{rule}_{level:g}": partial(rate, truth=truth, rule=rule, level=level)
            for rule in _RULES
            for truth, kind in (("direct", "p_f"), ("indirect", "p_d"))
            for level in (0.01, 0.05, 0.1)
        },
        claims=tuple(claim for reading in READINGS for claim in _claims(where, reading, detection_note, alarm_note)),
        beside=(
            Beside(
                says="chi2: P_d at P_f = 0.1",
                ours=partial(_detected, rule="chi2", false_alarm=0.1, reading="rays"),
            ),
            Beside(
                says="chi2 with rays_miss=true: P_d at P_f = 0.1",
                ours=partial(_detected, rule="chi2_miss", false_alarm=0.1, reading="rays"),
            ),
            Beside(
                says="chi2: P_f at an expected 0.05",
                ours=partial(rate_in, truth="direct", rule="chi2", level=0.05, reading="rays"),
            ),
        ),
        panels=_panels,
        trials=TRIALS,
        quick_trials=2000,
        chunk_trials=CHUNK_TRIALS,
    )


def _claims(where: str, reading: str, detection_note: str, alarm_note: str) -> tuple[Claim, ...]:
    told = READINGS[reading]
    return (
        *(
            Claim(
                says=f"P_d > 90 % where P_f < 10 %: {RULES[rule][0]}, {told}: P_d at P_f = 0.1",
                where=where,
                ours=partial(_detected, rule=rule, false_alarm=0.1, reading=reading),
                expected=at_least(0.9, "> 0.9"),
                note=detection_note,
            )
            for rule in ("lambda5", "fusion0")
        ),
        Claim(
            says=f"lambda 5 is the best individual rule, {told}: its P_d above the next best at P_f = 0.05",
            where=where,
            ours=partial(_lead, reading=reading),
            expected=at_least(0.0, "> 0"),
        ),
        Claim(
            says=f"lambda 5 accurately achieves an expected P_f of 0.05, {told}",
            where=where,
            ours=partial(rate_in, truth="direct", rule="lambda5", level=0.05, reading=reading),
            expected=about(0.05, 0.1, "0.05"),
            note=alarm_note if reading == "lines" else "",
        ),
    )


def _curve(drawn: Drawn, rule: str, reading: str) -> tuple[FloatArray, FloatArray]:
    """Return P_f and P_d over `LEVELS`."""
    samples = drawn.of(reading=reading)
    return rates(samples, truth="direct", rule=rule), rates(samples, truth="indirect", rule=rule)


def _detected(drawn: Drawn, *, rule: str, false_alarm: float, reading: str) -> float:
    """Return P_d where the direct paths are flagged that often."""
    return float(np.interp(false_alarm, *_curve(drawn, rule, reading)))


def _lead(drawn: Drawn, *, reading: str) -> float:
    found = {rule: _detected(drawn, rule=rule, false_alarm=0.05, reading=reading) for rule in _INDIVIDUAL}
    return found.pop("lambda5") - max(found.values())


def _panels(drawn: Drawn) -> Sequence[Panel]:
    panels = []
    for reading, told in READINGS.items():
        lines = []
        for rule in _SHOWN:
            p_f, p_d = _curve(drawn, rule, reading)
            shown = p_f <= _LARGEST_SHOWN
            lines.append(Series(label=RULES[rule][0], x=p_f[shown], y=p_d[shown]))
        panels.append(
            LinesPanel(
                title=told,
                x_label="P_f [-]",
                y_label="P_d [-]",
                lines=tuple(lines),
            )
        )
    return panels
