"""Ananthasubramaniam, Madhow, Figure 8: failure probability of suppression by number of bootstraps."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.madhow.paper import PAPER, RECEIVERS, ring, solve
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, measure_all, rms
from nlosctl.reproduce.verdicts import at_least, printed
from nlosctl.solvers.sequential.starting_pairs import bootstrap_failure

__all__ = ["EXPERIMENT"]

_BLOCKED = (1, 2, 3)
_STDS_DEG = (2.0, 4.0, 6.0)
_BOOTSTRAPS = (1, 2, 4, 7, 11, 18)
_BEYOND = 3.0


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    trials = ring(chunk, sensors=RECEIVERS, **condition)
    alpha = int(condition["nlos_receivers"]) / RECEIVERS
    suppress = {
        f"suppress_{count}": solve(trials, chunk, "suppress", alpha=alpha, bootstraps=count).error_m
        for count in _BOOTSTRAPS
    }
    repaired = solve(trials, chunk, "suppress", alpha=alpha, bootstraps=28, acceptance="likelihood")
    return {"ml": solve(trials, chunk, "mixture-ml", alpha=alpha).error_m, "repaired": repaired.error_m, **suppress}


def _failures(samples: Samples, name: str) -> float:
    """Return the share of trials farther from the truth than three rms errors of ML, or without a fix."""
    return float(1.0 - np.mean(samples[name] <= _BEYOND * rms(samples["ml"])))


def _observed(name: str, blocked: int, std_deg: float) -> Callable[[Results], float]:
    return at(partial(_failures, name=name), nlos_receivers=blocked, bearing_std_deg=std_deg)


def _expected(blocked: int, count: int) -> float:
    return bootstrap_failure(RECEIVERS, blocked / RECEIVERS, count)


def _share_below(results: Results) -> float:
    """Return the share of the figure's points at 4 deg where the expected failures exceed the observed ones."""
    below = [
        _expected(blocked, count) >= _observed(f"suppress_{count}", blocked, 4.0)(results)
        for blocked in _BLOCKED
        for count in _BOOTSTRAPS
    ]
    return sum(below) / len(below)


def _panels(results: Results) -> Sequence[Panel]:
    panels = []
    counts = np.array(_BOOTSTRAPS, dtype=np.float64)
    for blocked in _BLOCKED:
        expected = np.array([_expected(blocked, count) for count in _BOOTSTRAPS])
        lines = [Series(label="expected, (27)", x=counts, y=np.where(expected > 1e-5, expected, np.nan), style=0)]
        for style, std_deg in enumerate(_STDS_DEG, 1):
            observed = [_observed(f"suppress_{count}", blocked, std_deg) for count in _BOOTSTRAPS]
            share, error = measure_all(observed, results)
            lines.append(Series(label=f"observed, {std_deg:g} deg", x=counts, y=share, error=error, style=style))
        panels.append(
            LinesPanel(
                x_label="bootstraps M [-]",
                y_label="probability of failure [-]",
                title=f"{blocked} of 8 blocked",
                lines=tuple(lines),
                log_y=True,
            )
        )
    return panels


EXPERIMENT = Experiment(
    name="madhow-fig8",
    paper=PAPER,
    title="Failures of suppression: errors beyond three rms errors of ML",
    conditions=conditions(nlos_receivers=_BLOCKED, bearing_std_deg=_STDS_DEG),
    sample=_sample,
    quantities={
        f"failures_{name}": partial(_failures, name=name)
        for name in ("ml", "repaired", *(f"suppress_{count}" for count in _BOOTSTRAPS))
    },
    claims=(
        Claim(
            text="Expected failures (27) exceed the observed ones almost everywhere: share of points, 4 deg",
            where="Section V-B1, Fig. 8",
            ours=_share_below,
            expected=at_least(0.8, "~ 1"),
            note="ML itself is beyond 3 rms in 0.7 to 1.6 % of trials, and outliers that the residual test lets in "
            "(masking) fail with any bootstrap. (27) is printed upside down.",
        ),
        *(
            Claim(
                text=f"It levels off at about 3e-3: observed with M = 18, {blocked} blocked, 4 deg",
                where="Section V-B1, Fig. 8",
                ours=_observed("suppress_18", blocked, 4.0),
                expected=printed("3e-3", tolerance=1.5e-3),
            )
            for blocked in _BLOCKED
        ),
        Claim(
            text="Noise alone is beyond 3 nu with probability exp(-9) = 1e-4, of errors N(0, nu^2) in x and y",
            where="Section V-B1",
            ours=lambda results: math.exp(-0.5 * _BEYOND**2),
            expected=printed("1e-4"),
            note="exp(-4.5); exp(-9) holds for three times the total rms, as in the figure's own definition.",
        ),
    ),
    comparisons=(
        Comparison(text="Failures of mixture-ml, 1 blocked, 4 deg", ours=_observed("ml", 1, 4.0)),
        Comparison(
            text="Failures of suppression with all 28 pairs and acceptance=likelihood, 1 blocked, 4 deg",
            ours=_observed("repaired", 1, 4.0),
        ),
    ),
    panels=_panels,
    trials=3000,
    quick_trials=60,
    chunk_trials=1000,
)
