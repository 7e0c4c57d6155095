"""Ananthasubramaniam, Madhow, Figure 4: the gain by ranges in addition to bearings, by number of receivers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial

from nlosctl.plotting.panels import LinesPanel, Panel
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.madhow.paper import PAPER, SEQUENTIAL, ring, solve
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, ratio_of, rms, rms_of
from nlosctl.reproduce.simulated import bound_rms_m
from nlosctl.reproduce.verdicts import about, at_least, at_most

__all__ = ["EXPERIMENT"]

_STDS_DEG = (0.5, 1.2, 4.0)
_SIDE_M = 1000.0
_RECEIVERS = (4, 6, 8, 10, 12, 16)
_RANGE_STD_SHARE = 1.0 / (3.0 * 10.0**1.2)
"""2.1 % of the range: path loss exponent 3, SNR = 12 dB as a linear ratio."""


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    trials = ring(chunk, range_std_share=_RANGE_STD_SHARE, **condition)
    bearings = {"use_ranges": False}
    both = {"range_noise": "lognormal"}
    return {
        "bearings": solve(trials, chunk, "sequential", bootstraps=3, **SEQUENTIAL, **bearings).error_m,
        "both": solve(trials, chunk, "sequential", bootstraps=1, **SEQUENTIAL, **both).error_m,
        "ml": solve(trials, chunk, "ml", **both).error_m,
        "crlb_bearings": bound_rms_m(trials, **bearings),
        "crlb_both": bound_rms_m(trials),
    }


_gain = partial(at, ratio_of("bearings", "both"), sensors=8)


def _panels(results: Results) -> Sequence[Panel]:
    return [
        LinesPanel(
            x_label="receivers [-]",
            y_label="rms error [radii of the field]",
            title=f"AoA spread {std_deg:g} deg",
            lines=tuple(
                curve(results, "sensors", label, rms_of(name), marker="bound" not in label, bearing_std_deg=std_deg)
                for name, label in (
                    ("bearings", "bearings, sequential"),
                    ("crlb_bearings", "bearings, bound"),
                    ("both", "and ranges, sequential"),
                    ("crlb_both", "and ranges, bound"),
                )
            ),
        )
        for std_deg in _STDS_DEG
    ]


EXPERIMENT = Experiment(
    name="madhow-fig4",
    paper=PAPER,
    title="Bearings alone, and with ranges of 2.1 %",
    conditions=conditions(bearing_std_deg=_STDS_DEG, sensors=_RECEIVERS),
    sample=_sample,
    quantities={f"rms_{name}": rms_of(name) for name in ("bearings", "crlb_bearings", "both", "crlb_both", "ml")},
    claims=(
        Claim(
            text="The better the ranges (against the bearings), the greater the gain: rms of bearings alone over both, "
            "at 4 deg over at 0.5 deg, 8 receivers",
            where="Section V-A",
            ours=lambda results: _gain(bearing_std_deg=4.0)(results) / _gain(bearing_std_deg=0.5)(results),
            expected=at_least(1.5, "> 1"),
        ),
        *(
            Claim(
                text=f"Gain at {std_deg:g} deg: rms of bearings alone over both, 8 receivers",
                where="Fig. 4",
                ours=_gain(bearing_std_deg=std_deg),
            )
            for std_deg in _STDS_DEG
        ),
        Claim(
            text="Where ranges are less accurate, more receivers make up for them: rms of 10 with bearings alone over "
            "8 with both, at 0.5 deg",
            where="Section V-A",
            ours=lambda results: (
                rms(results.of(bearing_std_deg=0.5, sensors=10)["bearings"])
                / rms(results.of(bearing_std_deg=0.5, sensors=8)["both"])
            ),
            expected=at_most(1.05, "1"),
        ),
        Claim(
            text="An area of 1 km^2 with a spread of 4 deg: about 15 m with 8 receivers",
            where="Section VI",
            ours=lambda results: _SIDE_M / math.pi * rms(results.of(bearing_std_deg=4.0, sensors=8)["bearings"]),
            expected=about(15.0, 0.15, "15 m"),
            unit="m",
            note="By the paper's scale, sqrt(area) / pi. The right one, sqrt(area / pi), makes 1.77 times as much.",
        ),
    ),
    comparisons=(
        Comparison(
            text="rms of sequential over ml, both with ranges, 4 deg, 8 receivers",
            ours=at(ratio_of("both", "ml"), bearing_std_deg=4.0, sensors=8),
        ),
        Comparison(
            text="rms of ml over the joint bound, 4 deg, 8 receivers",
            ours=at(ratio_of("ml", "crlb_both"), bearing_std_deg=4.0, sensors=8),
        ),
    ),
    panels=_panels,
    trials=4000,
    quick_trials=200,
    chunk_trials=1000,
)
