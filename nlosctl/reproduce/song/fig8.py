"""Song, Willett, Zhou 2013, Figure 8: RMSE over the bearing error with flat mirrors."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.plotting.panels import Panel
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.panels import rms_panels
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, ratio_of, rms, rms_of
from nlosctl.reproduce.simulated import bound_rms_m, fixes, simulated
from nlosctl.reproduce.song.paper import PAPER
from nlosctl.reproduce.verdicts import at_least, between

__all__ = ["EXPERIMENT"]

_SIGMAS_DEG = (0.1, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0)
_METHODS = ("ls", "stansfield", "ml")


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    trials = simulated("song-flat", chunk, **condition)
    estimates = {method: fixes(trials, chunk, method) for method in _METHODS}
    errors = {method: estimates[method].position_m - trials.truth_m for method in _METHODS}
    return {
        **{method: estimates[method].error_m for method in _METHODS},
        **{f"{method}_{axis}": errors[method][:, index] for method in _METHODS for index, axis in enumerate("xy")},
        "crlb": bound_rms_m(trials),
    }


def _spread_of_slope(results: Results, method: str) -> float:
    """Return the ratio of the largest and smallest RMSE per degree, over all sigmas."""
    slopes = [rms(samples[method]) / float(condition["bearing_std_deg"]) for condition, samples in results.where()]
    return max(slopes) / min(slopes)


def _bias_share(samples: Samples, method: str) -> float:
    """Return the length of the bias divided by the RMSE."""
    return float(np.hypot(samples[f"{method}_x"].mean(), samples[f"{method}_y"].mean())) / rms(samples[method])


def _panels(results: Results) -> Sequence[Panel]:
    labels = {"ls": "least squares", "stansfield": "Stansfield", "ml": "maximum likelihood", "crlb": "Cramer-Rao bound"}
    return rms_panels(results, "bearing_std_deg", "bearing error, std [deg]", "RMSE [m]", labels)


EXPERIMENT = Experiment(
    name="song-fig8",
    paper=PAPER,
    title="RMSE over the bearing error, flat mirrors",
    conditions=conditions(bearing_std_deg=_SIGMAS_DEG),
    sample=_sample,
    quantities={f"rmse_{name}_m": rms_of(name) for name in (*_METHODS, "crlb")},
    claims=(
        *(
            Claim(
                text=f"The RMSE of {method} depends linearly on sigma: largest over least RMSE per degree",
                where="Section 5.1, first observation",
                ours=partial(_spread_of_slope, method=method),
                expected=between(1.0, 1.05, "1"),
            )
            for method in _METHODS
        ),
        Claim(
            text="LS is the worst: its RMSE over that of ML, at 1 deg",
            where="Section 5.1, second observation",
            ours=at(ratio_of("ls", "ml"), bearing_std_deg=1.0),
            expected=at_least(1.0, "> 1"),
            note="By 3 % only: the three sensors have nearly equal distances here.",
        ),
        Claim(
            text="The RMSE of Stansfield is close to that of ML, at 1 deg",
            where="Section 5.1, second observation",
            ours=at(ratio_of("stansfield", "ml"), bearing_std_deg=1.0),
            expected=between(0.98, 1.02, "1"),
        ),
        Claim(
            text="LS is biased: length of its bias over its RMSE, at 5 deg",
            where="Section 5.1, second observation",
            ours=at(partial(_bias_share, method="ls"), bearing_std_deg=5.0),
            expected=at_least(0.005, "> 0"),
            note="True, but a few per cent of the RMSE, and ML has as large a bias the other way: not why LS is worst.",
        ),
        Claim(
            text="RMSE of ML over the bound, at 1 deg",
            where="Fig. 8",
            ours=at(ratio_of("ml", "crlb"), bearing_std_deg=1.0),
        ),
        Claim(text="RMSE of LS at 1 deg", where="Fig. 8", ours=at(rms_of("ls"), bearing_std_deg=1.0), unit="m"),
    ),
    comparisons=(
        Comparison(
            text="Bias of ml over its RMSE, at 5 deg", ours=at(partial(_bias_share, method="ml"), bearing_std_deg=5.0)
        ),
    ),
    panels=_panels,
    trials=4000,
    quick_trials=200,
    chunk_trials=1000,
)
