"""Shen, Molisch 2012, Table IV: P_f and P_d of lambda 5 and two fusion rules in scenario 2."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Claim, Comparison, Experiment
from nlosctl.reproduce.samples import Results, at, conditions
from nlosctl.reproduce.shen.paper import (
    CHUNK_TRIALS,
    PAPER,
    READINGS,
    RULES,
    TRIALS,
    detection_samples,
    printed_share,
    rate,
)

__all__ = ["EXPERIMENT"]

_LEVELS = (0.03, 0.04, 0.05, 0.07, 0.1)
_PRINTED = {
    "lambda5": {
        "P_f": ("0.0294", "0.0397", "0.0496", "0.0691", "0.0998"),
        "P_d": ("0.9002", "0.9051", "0.9095", "0.9164", "0.9234"),
    },
    "fusion0": {
        "P_f": ("0.0334", "0.0439", "0.0544", "0.0743", "0.1049"),
        "P_d": ("0.9237", "0.9272", "0.9302", "0.9348", "0.9400"),
    },
    "fusion5": {
        "P_f": ("0.0260", "0.0357", "0.0452", "0.0640", "0.0938"),
        "P_d": ("0.5657", "0.5799", "0.5933", "0.6157", "0.6499"),
    },
}
"""By rule: P_f and P_d over the expected P_f; the column printed as 0075 is that of 0.07."""
_TRUTHS = {"P_f": "direct", "P_d": "indirect"}
_NOTES = {
    "rays": "The paper's simulator took lines for rays: see the rows below.",
    "lines": "Angles modulo pi, and indirect where the lines meet behind a node: found by search, not in the text.",
}


def _claim(reading: str, rule: str, kind: str, index: int) -> Claim:
    level = _LEVELS[index]
    return Claim(
        text=f"{RULES[rule][0]}, {READINGS[reading]}, expected P_f {level:g}: {kind}",
        where="Table IV",
        ours=at(partial(rate, truth=_TRUTHS[kind], rule=rule, level=level), reading=reading),
        expected=printed_share(_PRINTED[rule][kind][index]),
        note=_NOTES[reading],
    )


def _panels(results: Results) -> Sequence[Panel]:
    panels = []
    for kind, truth in _TRUTHS.items():
        lines = []
        for number, rule in enumerate(_PRINTED):
            shown = np.array(_PRINTED[rule][kind], dtype=float)
            label = RULES[rule][0]
            lines.append(Series(label=f"{label}: paper", x=np.array(_LEVELS), y=shown, line=False, style=number))
            for reading, reading_label in READINGS.items():
                samples = results.of(reading=reading)
                y = np.array([rate(samples, truth=truth, rule=rule, level=level) for level in _LEVELS])
                style = number if reading == "lines" else number + 3
                line_label = f"{label}: {reading_label}"
                lines.append(Series(label=line_label, x=np.array(_LEVELS), y=y, style=style, marker=False))
        samples = results.of(reading="rays")
        y = np.array([rate(samples, truth=truth, rule="chi2", level=level) for level in _LEVELS])
        lines.append(Series(label=RULES["chi2"][0], x=np.array(_LEVELS), y=y, style=6))
        panels.append(LinesPanel(x_label="expected P_f [-]", y_label=f"{kind} [-]", lines=tuple(lines)))
    return panels


EXPERIMENT = Experiment(
    name="shen-table4",
    paper=PAPER,
    title="False alarms and detections in scenario 2",
    conditions=conditions(reading=tuple(READINGS)),
    sample=partial(detection_samples, number=2, rules=(*_PRINTED, "chi2")),
    quantities={
        f"{kind.lower()}_{rule}_{level:g}": partial(rate, truth=truth, rule=rule, level=level)
        for rule in (*_PRINTED, "chi2")
        for kind, truth in _TRUTHS.items()
        for level in _LEVELS
    },
    claims=(
        *(_claim("lines", rule, kind, index) for rule in _PRINTED for kind in _TRUTHS for index in range(len(_LEVELS))),
        *(_claim("rays", rule, kind, _LEVELS.index(0.05)) for rule in _PRINTED for kind in _TRUTHS),
    ),
    comparisons=tuple(
        Comparison(
            text=f"chi2, expected P_f {level:g}: {kind}",
            ours=at(partial(rate, truth=truth, rule="chi2", level=level), reading="rays"),
        )
        for level in (0.05, 0.1)
        for kind, truth in _TRUTHS.items()
    ),
    panels=_panels,
    trials=TRIALS,
    quick_trials=4000,
    chunk_trials=CHUNK_TRIALS,
)
