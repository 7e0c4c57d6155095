"""Ananthasubramaniam, Madhow, Figure 8: how often suppression fails, by the number of bootstraps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Beside, Chunk, Claim, Experiment
from nlosctl.reproduce.madhow.paper import PAPER, RECEIVERS, ring, solve
from nlosctl.reproduce.samples import Condition, Drawn, Samples, conditions, measure, rms
from nlosctl.reproduce.verdicts import at_least, printed
from nlosctl.solvers.sequential.starting_pairs import bootstrap_failure

__all__ = ["EXPERIMENT"]

_BLOCKED = (1, 2, 3)
_STDS_DEG = (2.0, 4.0, 6.0)
_BOOTSTRAPS = (1, 2, 4, 7, 11, 18)
_BEYOND = 3.0


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    given = ring(chunk, sensors=RECEIVERS, **condition)
    alpha = int(condition["nlos_receivers"]) / RECEIVERS
    found = {
        f"suppress_{count}": solve(given, chunk, "suppress", alpha=alpha, bootstraps=count).error_m
        for count in _BOOTSTRAPS
    }
    repaired = solve(given, chunk, "suppress", alpha=alpha, bootstraps=28, acceptance="likelihood")
    return {"ml": solve(given, chunk, "mixture-ml", alpha=alpha).error_m, "repaired": repaired.error_m, **found}


def _failures(samples: Samples, name: str) -> float:
    """Return the share of trials farther from the truth than three rms errors of ML, or without a fix."""
    return float(1.0 - np.mean(samples[name] <= _BEYOND * rms(samples["ml"])))


def _observed(drawn: Drawn, name: str, blocked: int, std_deg: float) -> float:
    return _failures(drawn.of(nlos_receivers=blocked, bearing_std_deg=std_deg), name)


def _expected(blocked: int, count: int) -> float:
    return bootstrap_failure(RECEIVERS, blocked / RECEIVERS, count)


def _share_below(drawn: Drawn) -> float:
    """Return the share of the figure's points, at 4 deg, at which the expected failures exceed the observed."""
    pairs = [(blocked, count) for blocked in _BLOCKED for count in _BOOTSTRAPS]
    below = [_expected(*pair) >= _observed(drawn, f"suppress_{pair[1]}", pair[0], 4.0) for pair in pairs]
    return sum(below) / len(below)


def _panels(drawn: Drawn) -> Sequence[Panel]:
    panels = []
    counts = np.array(_BOOTSTRAPS, dtype=np.float64)
    for blocked in _BLOCKED:
        expected = np.array([_expected(blocked, count) for count in _BOOTSTRAPS])
        lines = [Series(label="expected, (27)", x=counts, y=np.where(expected > 1e-5, expected, np.nan), style=0)]
        for style, std_deg in enumerate(_STDS_DEG, 1):
            found = [
                measure(
                    partial(_observed, name=f"suppress_{count}", blocked=blocked, std_deg=std_deg),
                    drawn,
                )
                for count in _BOOTSTRAPS
            ]
            lines.append(
                Series(
                    label=f"observed, {std_deg:g} deg",
                    x=counts,
                    y=np.array([one.value for one in found]),
                    error=np.array([one.standard_error for one in found]),
                    style=style,
                )
            )
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
            says="Expected failures (27) exceed the observed ones almost everywhere: share of points, 4 deg",
            where="Section V-B1, Fig. 8",
            ours=_share_below,
            expected=at_least(0.8, "~ 1"),
            note="ML itself is beyond 3 rms in 0.7 to 1.6 % of trials, and outliers that the residual test lets in "
            "(masking) fail whatever the bootstrap. (27) is printed upside down.",
        ),
        *(
            Claim(
                says=f"It levels off at about 3e-3: observed with M = 18, {blocked} blocked, 4 deg",
                where="Section V-B1, Fig. 8",
                ours=partial(_observed, name="suppress_18", blocked=blocked, std_deg=4.0),
                expected=printed("3e-3", tolerance=1.5e-3),
            )
            for blocked in _BLOCKED
        ),
        Claim(
            says="Noise alone is beyond 3 nu with probability exp(-9) = 1e-4, of errors N(0, nu^2) in x and y",
            where="Section V-B1",
            ours=lambda drawn: math.exp(-0.5 * _BEYOND**2),
            expected=printed("1e-4"),
            note="exp(-4.5); exp(-9) holds for three times the total rms, as in the figure's own definition.",
        ),
    ),
    beside=(
        Beside(
            says="Failures of mixture-ml, 1 blocked, 4 deg",
            ours=partial(_observed, name="ml", blocked=1, std_deg=4.0),
        ),
        Beside(
            says="Failures of suppression with all 28 pairs and acceptance=likelihood, 1 blocked, 4 deg",
            ours=partial(_observed, name="repaired", blocked=1, std_deg=4.0),
        ),
    ),
    panels=_panels,
    trials=3000,
    quick_trials=60,
    chunk_trials=1000,
)
