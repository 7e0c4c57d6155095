"""Liang, Zeng, Li, Figure 3: mean spread of the first five candidates after the comparison, and its elbow."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.liang.paper import CHUNK_TRIALS, NOISES_DB, PAPER, TARGETS, candidates, echo_trials, identified
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, measure_all, share_of, smallest
from nlosctl.reproduce.verdicts import at_least

__all__ = ["EXPERIMENT"]

_WHERE = "Section III.B, Fig. 3"
_SHOWN = 5
_RANKS = range(1, _SHOWN + 1)
_ETAS_M = (15, 35)


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return for each trial the spreads of the first candidates, NaN beyond the last, and whether counts are right."""
    trials = echo_trials(condition, chunk)
    spreads = np.full((chunk.size, _SHOWN), np.nan)
    for trial, sets in enumerate(candidates(trials, chunk.size)):
        first = sets.spread_m[sets.kept][:_SHOWN]
        spreads[trial, : first.size] = first
    counts = {f"right_eta{eta}": identified(trials, chunk, "extended-tca", eta=float(eta)).count for eta in _ETAS_M}
    counts["right_assignment"] = identified(trials, chunk, "assignment").count
    return {
        **{f"spread{rank}_m": spreads[:, rank - 1] for rank in _RANKS},
        **{name: (count == TARGETS).astype(float) for name, count in counts.items()},
    }


def _mean_spread(samples: Samples, *, rank: int) -> float:
    values = samples[f"spread{rank}_m"]
    return float(np.nanmean(values)) if np.isfinite(values).any() else np.nan


def _ratio(samples: Samples) -> float:
    """Return the mean spread of the first false candidate divided by that of the last true one."""
    return _mean_spread(samples, rank=TARGETS + 1) / _mean_spread(samples, rank=TARGETS)


def _panels(results: Results) -> Sequence[Panel]:
    lines = []
    for condition, alone in results.separately():
        mean, error = measure_all([at(partial(_mean_spread, rank=rank)) for rank in _RANKS], alone)
        label = f"{condition['noise_db']:g} dB"
        lines.append(Series(label=label, x=np.array(_RANKS, dtype=float), y=mean, error=np.nan_to_num(error)))
    title = f"N = 5, K = {TARGETS}, L = 4; the first {TARGETS} are targets"
    return [
        LinesPanel(
            title=title,
            x_label="candidate, by rising spread [-]",
            y_label="mean spread [m]",
            lines=tuple(lines),
            log_y=True,
        )
    ]


EXPERIMENT = Experiment(
    name="liang-fig3",
    paper=PAPER,
    title="The elbow of the spread",
    conditions=conditions(sensors=(5,), scatterers=(4,), noise_db=NOISES_DB),
    sample=_sample,
    quantities={f"spread{rank}_m": partial(_mean_spread, rank=rank) for rank in _RANKS},
    claims=(
        Claim(
            text="A clear elbow past the number of targets: mean spread of candidate 4 over 3, least of all noises",
            where=_WHERE,
            ours=smallest(_ratio),
            expected=at_least(2.0, "clear"),
        ),
        Claim(
            text="Even at 5 dB true sets have a significantly smaller spread than the others: candidate 4 over 3",
            where=_WHERE,
            ours=at(_ratio, noise_db=5.0),
            expected=at_least(2.0, "> 1"),
        ),
        Claim(
            text="The elbow shows the number of targets, eta = 35 m, 5 dB: share of trials that have it right",
            where=_WHERE,
            ours=at(share_of("right_eta35"), noise_db=5.0),
            note="With eta = 15 m it fails at 5 dB: the third true set is often more than that above the first two.",
        ),
        Claim(text="The same, eta = 15 m", where=_WHERE, ours=at(share_of("right_eta15"), noise_db=5.0)),
    ),
    comparisons=(
        Comparison(
            text="Number of targets right at 5 dB by assignment, which needs no eta",
            ours=at(share_of("right_assignment"), noise_db=5.0),
        ),
    ),
    panels=_panels,
    trials=300,
    quick_trials=20,
    chunk_trials=CHUNK_TRIALS,
)
