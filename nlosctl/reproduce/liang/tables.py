"""Liang, Zeng, Li, Tables I and II: exact identification over the noise, elbow thresholds 15 and 35 m."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np

from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.liang.paper import CHUNK_TRIALS, NOISES_DB, PAPER, SENSORS, echo_trials, identified
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, share
from nlosctl.reproduce.verdicts import Expected, printed

__all__ = ["TABLE1", "TABLE2"]

_METHODS = {"extended_tca": "extended-tca", "assignment": "assignment (recommended)"}
_PAPER_TRIALS = 1000
_SCATTERERS_STD = {4: 0.02, 5: 0.01, 6: 0.01}
"""Standard deviation of the share of exact trials over draws of the scatterers, by number of sensors."""


def _table_experiment(
    *, name: str, title: str, where: str, eta: float, counts: Mapping[int, tuple[int, ...]], notes: Mapping[int, str]
) -> Experiment:
    """Return the experiment of a table; ``counts`` are exact trials of 1000 over the noise, by number of sensors."""
    cells = [(sensors, noise_db) for sensors in SENSORS for noise_db in NOISES_DB]
    claims = tuple(
        Claim(
            text=f"N = {sensors}, {noise_db:g} dB: trials of 1000 with all direct echoes right",
            where=where,
            ours=at(partial(_thousandths, method="extended_tca"), sensors=sensors, noise_db=noise_db),
            expected=_printed_count(counts[sensors][NOISES_DB.index(noise_db)], sensors),
            note=notes.get(sensors, ""),
            per_trial=1000.0,
        )
        for sensors, noise_db in cells
    )
    comparisons = tuple(
        Comparison(
            text=f"N = {sensors}, {noise_db:g} dB: the same by assignment",
            ours=at(partial(_thousandths, method="assignment"), sensors=sensors, noise_db=noise_db),
        )
        for sensors, noise_db in cells
    )
    return Experiment(
        name=name,
        paper=PAPER,
        title=title,
        conditions=conditions(sensors=SENSORS, noise_db=NOISES_DB),
        sample=partial(_sample, eta=eta),
        quantities={method: partial(_thousandths, method=method) for method in _METHODS},
        claims=claims,
        comparisons=comparisons,
        panels=partial(_panels, counts=counts),
        trials=1000,
        quick_trials=10,
        chunk_trials=CHUNK_TRIALS,
    )


def _sample(condition: Condition, chunk: Chunk, *, eta: float) -> Samples:
    trials = echo_trials(condition, chunk)
    return {
        "extended_tca": identified(trials, chunk, "extended-tca", eta=eta, seeds="first").exact,
        "assignment": identified(trials, chunk, "assignment").exact,
    }


def _panels(results: Results, counts: Mapping[int, tuple[int, ...]]) -> Sequence[Panel]:
    return [
        LinesPanel(
            title=f"N = {sensors} sensors",
            x_label="noise, 10 log10(std / 1 m) [dB]",
            y_label="trials exactly right of 1000 [-]",
            lines=(
                Series(label="paper", x=np.array(NOISES_DB), y=np.array(counts[sensors], dtype=float), line=False),
                *(
                    curve(results, "noise_db", label, partial(_thousandths, method=method), sensors=sensors)
                    for method, label in _METHODS.items()
                ),
            ),
        )
        for sensors in SENSORS
    ]


def _thousandths(samples: Samples, *, method: str) -> float:
    return 1000.0 * share(samples[method])


def _printed_count(count: int, sensors: int) -> Expected:
    """Return a printed count of 1000 trials, with its binomial error and that of the unknown scatterers."""
    probability = count / _PAPER_TRIALS
    binomial = math.sqrt(probability * (1.0 - probability) / _PAPER_TRIALS)
    return printed(str(count), standard_error=1000.0 * math.hypot(binomial, _SCATTERERS_STD[sensors]))


TABLE1 = _table_experiment(
    name="liang-table1",
    title="Exact identification over the noise, eta = 15 m",
    where="Table I",
    eta=15.0,
    counts={
        4: (923, 917, 868, 828, 755, 667, 444),
        5: (972, 955, 927, 875, 758, 584, 336),
        6: (983, 963, 886, 840, 710, 481, 295),
    },
    notes={},
)

TABLE2 = _table_experiment(
    name="liang-table2",
    title="Exact identification over the noise, eta = 35 m",
    where="Table II",
    eta=35.0,
    counts={
        4: (888, 856, 822, 771, 671, 570, 400),
        5: (970, 943, 916, 868, 757, 647, 437),
        6: (983, 963, 886, 840, 727, 550, 422),
    },
    notes={},
)
