"""Ananthasubramaniam, Madhow, Figure 7: suppression with a threshold for half of the receivers blocked."""

from __future__ import annotations

from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.madhow.paper import BOOTSTRAPS, PAPER, RECEIVERS, panels_by_blocked, ring, solve
from nlosctl.reproduce.samples import Condition, Samples, conditions, largest, median_of, ratio_of, rms_of
from nlosctl.reproduce.verdicts import at_most

__all__ = ["EXPERIMENT"]

_STDS_DEG = (1.0, 2.0, 4.0, 7.0, 10.0)
_BLOCKED = (0, 1, 2, 3, 4)
_ALPHA_MAX = 0.5


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    blocked = int(condition["nlos_receivers"])
    trials = ring(chunk, sensors=RECEIVERS, **condition)
    alpha = blocked / RECEIVERS
    return {
        "ml": solve(trials, chunk, "mixture-ml", alpha=alpha).error_m
        if blocked
        else solve(trials, chunk, "ml").error_m,
        "suppress": solve(trials, chunk, "suppress", alpha=_ALPHA_MAX, bootstraps=BOOTSTRAPS[4]).error_m,
        "ml_half": solve(trials, chunk, "mixture-ml", alpha=_ALPHA_MAX).error_m,
        "ml_quarter": solve(trials, chunk, "mixture-ml").error_m,
    }


EXPERIMENT = Experiment(
    name="madhow-fig7",
    paper=PAPER,
    title="Suppression with alpha_max = 0.5, ML with the true fraction",
    conditions=conditions(nlos_receivers=_BLOCKED, bearing_std_deg=_STDS_DEG),
    sample=_sample,
    quantities={
        **{f"rms_{name}": rms_of(name) for name in ("ml", "suppress", "ml_half", "ml_quarter")},
        **{f"median_{name}": median_of(name) for name in ("ml", "suppress", "ml_half", "ml_quarter")},
    },
    claims=tuple(
        Claim(
            text=f"{blocked} blocked: close to ML although the threshold is for 4: largest ratio of the {word} errors",
            where="Section V-B1, Fig. 7",
            ours=largest(ratio_of("suppress", "ml", statistic), nlos_receivers=blocked),
            expected=at_most(1.1, "1"),
            note="Without outliers the price grows with the spread, and is paid by mixture-ml with alpha = 0.5 as well."
            if blocked == 0
            else "",
        )
        for blocked in (0, 1, 2)
        for statistic, word in ((median_of, "median"), (rms_of, "rms"))
    ),
    comparisons=(
        Comparison(
            text="mixture-ml with alpha = 0.5 over ML with the true fraction, none blocked: largest ratio of the rms",
            ours=largest(ratio_of("ml_half", "ml"), nlos_receivers=0),
        ),
        Comparison(
            text="... as it comes, with alpha = 0.25", ours=largest(ratio_of("ml_quarter", "ml"), nlos_receivers=0)
        ),
    ),
    panels=lambda results: panels_by_blocked(results, _BLOCKED, ("suppress", "suppression"), ("ml", "ML")),
    trials=5000,
    quick_trials=60,
    chunk_trials=1000,
)
