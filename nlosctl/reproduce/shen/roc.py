"""Shen, Molisch 2012, Figures 5 to 7: P_d over P_f of all rules in scenarios 2, 3 and 4.

Scenario 2: a target at (5.2, 10), the reflector anywhere. Scenario 3: target and reflector anywhere. Scenario 4:
target and two reflectors anywhere, 25 dBm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Claim, Comparison, Experiment
from nlosctl.reproduce.samples import Results, Samples, at, conditions
from nlosctl.reproduce.shen.paper import (
    ALL_READINGS,
    CHUNK_TRIALS,
    PAPER,
    READINGS,
    RULES,
    TRIALS,
    detection_samples,
    rate,
    rates,
)
from nlosctl.reproduce.verdicts import about, at_least

__all__ = ["FIG5", "FIG6", "FIG7"]

_INDIVIDUAL = tuple(f"lambda{rule}" for rule in range(1, 7))
_RULES = (*_INDIVIDUAL, "fusion0", "fusion5", "chi2", "chi2_miss")
_SHOWN = (*_INDIVIDUAL, "fusion0", "chi2")
_LARGEST_SHOWN = 0.2


def _roc_experiment(
    *,
    figure: int,
    scenario: int,
    detection_note: str = "",
    alarm_note: str = "",
    readings: Mapping[str, str] = READINGS,
) -> Experiment:
    """Return the figure of a scenario: claims of Section VI-C, each for rays, for lines, and for further ``readings``.

    The notes are for the claims on detection and on false alarms.
    """
    where = f"Section VI-C, Fig. {figure}"
    return Experiment(
        name=f"shen-fig{figure}",
        paper=PAPER,
        title=f"Detections over false alarms in scenario {scenario}",
        conditions=conditions(reading=tuple(readings)),
        sample=partial(detection_samples, number=scenario, rules=_RULES),
        quantities={
            f"{kind}_{rule}_{level:g}": partial(rate, truth=truth, rule=rule, level=level)
            for rule in _RULES
            for truth, kind in (("direct", "p_f"), ("indirect", "p_d"))
            for level in (0.01, 0.05, 0.1)
        },
        claims=tuple(claim for reading in readings for claim in _claims(where, reading, detection_note, alarm_note)),
        comparisons=(
            Comparison(
                text="chi2: P_d at P_f = 0.1", ours=at(partial(_detected, rule="chi2", false_alarm=0.1), reading="rays")
            ),
            Comparison(
                text="chi2 with rays_miss=true: P_d at P_f = 0.1",
                ours=at(partial(_detected, rule="chi2_miss", false_alarm=0.1), reading="rays"),
            ),
            Comparison(
                text="chi2: P_f at an expected 0.05",
                ours=at(partial(rate, truth="direct", rule="chi2", level=0.05), reading="rays"),
            ),
        ),
        panels=_panels,
        trials=TRIALS,
        quick_trials=2000,
        chunk_trials=CHUNK_TRIALS,
    )


def _claims(where: str, reading: str, detection_note: str, alarm_note: str) -> tuple[Claim, ...]:
    label = ALL_READINGS[reading]
    return (
        *(
            Claim(
                text=f"P_d > 90 % where P_f < 10 %: {RULES[rule][0]}, {label}: P_d at P_f = 0.1",
                where=where,
                ours=at(partial(_detected, rule=rule, false_alarm=0.1), reading=reading),
                expected=at_least(0.9, "> 0.9"),
                note=detection_note,
            )
            for rule in ("lambda5", "fusion0")
        ),
        Claim(
            text=f"lambda 5 is the best individual rule, {label}: its P_d above the next best at P_f = 0.05",
            where=where,
            ours=at(_lead, reading=reading),
            expected=at_least(0.0, "> 0"),
        ),
        Claim(
            text=f"lambda 5 accurately achieves an expected P_f of 0.05, {label}",
            where=where,
            ours=at(partial(rate, truth="direct", rule="lambda5", level=0.05), reading=reading),
            expected=about(0.05, 0.1, "0.05"),
            note=alarm_note if reading == "lines" else "",
        ),
    )


def _curve(samples: Samples, rule: str) -> tuple[FloatArray, FloatArray]:
    """Return P_f and P_d over `LEVELS`."""
    return rates(samples, truth="direct", rule=rule), rates(samples, truth="indirect", rule=rule)


def _detected(samples: Samples, *, rule: str, false_alarm: float) -> float:
    """Return P_d at the level where this share of the direct paths is flagged."""
    return float(np.interp(false_alarm, *_curve(samples, rule)))


def _lead(samples: Samples) -> float:
    p_d = {rule: _detected(samples, rule=rule, false_alarm=0.05) for rule in _INDIVIDUAL}
    return p_d.pop("lambda5") - max(p_d.values())


def _panels(results: Results) -> Sequence[Panel]:
    panels = []
    for condition, samples in results.where():
        lines, title = [], ALL_READINGS[str(condition["reading"])]
        for rule in _SHOWN:
            p_f, p_d = _curve(samples, rule)
            shown = p_f <= _LARGEST_SHOWN
            lines.append(Series(label=RULES[rule][0], x=p_f[shown], y=p_d[shown]))
        panels.append(LinesPanel(title=title, x_label="P_f [-]", y_label="P_d [-]", lines=tuple(lines)))
    return panels


FIG5 = _roc_experiment(figure=5, scenario=2)
FIG6 = _roc_experiment(
    figure=6,
    scenario=3,
    alarm_note="One in a hundred direct paths has lines that meet behind a node, by noise, and is called indirect.",
)
FIG7 = _roc_experiment(
    figure=7,
    scenario=4,
    detection_note="Reached by fusion with K = 0; lambda 5 has 0.85 with rays, 0.89 with lines, 0.90 "
    "if rays that meet behind a node are indirect.",
    readings=ALL_READINGS,
)
