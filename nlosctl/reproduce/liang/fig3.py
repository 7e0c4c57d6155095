"""Liang, Zeng, Li, Figure 3: mean spread of the first five candidates after the comparison, and its elbow."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.models.ranges.circles import range_circles
from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.liang.paper import (
    CHUNK_TRIALS,
    NOISES_DB,
    PAPER,
    TARGETS,
    candidates,
    direct_batch,
    echo_trials,
    identified,
)
from nlosctl.reproduce.samples import (
    Condition,
    Results,
    Samples,
    at,
    conditions,
    measure_all,
    ratio_of,
    share_of,
    smallest,
)
from nlosctl.reproduce.simulated import Simulated
from nlosctl.reproduce.verdicts import at_least
from nlosctl.solvers.optimization.levenberg_marquardt import minimize
from nlosctl.solvers.ranges.likelihood import RangeProblem
from nlosctl.solvers.ranges.squared_ranges import fit_squared_ranges

__all__ = ["EXPERIMENT"]

_WHERE = "Section III.B, Fig. 3"
_SHOWN = 5
_RANKS = range(1, _SHOWN + 1)
_ETAS_M = (15, 35)
_STARTS_M = (-150.0, -50.0, 50.0, 150.0)


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
        **_located(trials, chunk.size),
        **{f"spread{rank}_m": spreads[:, rank - 1] for rank in _RANKS},
        **{name: (count == TARGETS).astype(float) for name, count in counts.items()},
    }


def _located(trials: Simulated, size: int) -> Samples:
    """Return each trial's rms error of both fits to the true direct echoes, and whether R-LS ends at the best optimum.

    R-LS starts from the SR-LS solution; the best optimum is that of starts on a grid over the square and at the target.
    """
    batch, truth_m = direct_batch(trials, size)
    circles = range_circles(batch)
    target_x, target_y = truth_m[:, 0] - circles.center_x, truth_m[:, 1] - circles.center_y
    squared = fit_squared_ranges(circles.sensor, circles.squared_in_plane(), 1.0 / (circles.std_m * circles.std_m))
    problem = RangeProblem.of_rows(circles)
    found = minimize(problem, *squared.point)
    least = minimize(problem, target_x, target_y).cost
    for start_x in _STARTS_M:
        for start_y in _STARTS_M:
            least = np.fmin(least, minimize(problem, start_x - circles.center_x, start_y - circles.center_y).cost)

    def rms_m(x: FloatArray, y: FloatArray) -> FloatArray:
        squared_m2 = (x - target_x) ** 2 + (y - target_y) ** 2
        return np.asarray(np.sqrt(squared_m2.reshape(size, TARGETS).mean(axis=1)))

    global_optimum = (found.cost <= least + 1e-6 * (1.0 + least)).reshape(size, TARGETS).all(axis=1)
    return {
        "r_ls_m": rms_m(found.x, found.y),
        "sr_ls_m": rms_m(*squared.point),
        "global_optimum": global_optimum.astype(float),
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
        Claim(
            text="R-LS (8) has better accuracy than SR-LS (9): rms of SR-LS over that of R-LS, least of all noises",
            where="Section III.C",
            ours=smallest(ratio_of("sr_ls_m", "r_ls_m")),
            expected=at_least(1.0, "better"),
        ),
        Claim(
            text="The global optimum of (8) is always reached from the SR-LS solution: share of trials, least of all",
            where="Section III.C",
            ours=smallest(share_of("global_optimum")),
            expected=at_least(1.0, "always"),
        ),
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
