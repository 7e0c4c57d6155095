"""Liang, Zeng, Li, Figure 2: the six cases of structured candidate sets, with an example and counts of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, FloatArray
from nlosctl.evaluation.targets import CASES
from nlosctl.plotting.panels import BarsPanel, Panel, PointsPanel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Experiment
from nlosctl.reproduce.liang.candidate_sets import CandidateSets
from nlosctl.reproduce.liang.paper import CHUNK_TRIALS, PAPER, candidates, echo_trials
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions
from nlosctl.reproduce.simulated import Simulated
from nlosctl.reproduce.verdicts import at_least, at_most

__all__ = ["EXPERIMENT"]

_WHERE = "Section III.B, Fig. 2"
_COUNTS = {"sets": "candidates", "kept": "left by the comparison"}
_EXAMPLE: Condition = {"sensors": 3, "nlos_range": "half", "noise_db": 0.0}
_EXAMPLE_SPREAD_M = 30.0
_WINDOW = 2.5


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return by case, for each trial, how many candidates exist, are kept, and have a larger spread than true sets.

    The true sets are those with a common point (ii, iii), or all of the trial (iv to vi).
    """
    trials = candidates(echo_trials(condition, chunk), chunk.size)
    samples: dict[str, FloatArray] = {}
    for number, case in enumerate(CASES):
        own = [sets.case == number for sets in trials]
        masks = {
            "sets": own,
            "kept": [sets.kept & mask for sets, mask in zip(trials, own, strict=True)],
            "larger": [_is_larger(sets) & mask for sets, mask in zip(trials, own, strict=True)],
        }
        for name, of_trials in masks.items():
            samples[f"{name}_{case}"] = np.array([mask.sum() for mask in of_trials], dtype=float)
        spreads = [sets.spread_m[mask] for sets, mask in zip(trials, own, strict=True)]
        samples[f"spread_{case}_m"] = np.array([np.median(values) if values.size else np.nan for values in spreads])
    return samples


def _is_larger(sets: CandidateSets) -> BoolArray:
    largest = sets.spread_m[sets.case == 0].max(initial=0.0)
    return np.where(sets.case < 3, sets.larger, sets.spread_m > largest)


def _share(results: Results, *, part: str, cases: Sequence[str], sensors: int, noise_db: float) -> float:
    """Return the share of the candidates of some cases that are counted by ``part``; ranges by (1)."""
    samples = results.of(sensors=sensors, nlos_range="sum", noise_db=noise_db)
    return float(
        sum(samples[f"{part}_{case}"].sum() for case in cases) / sum(samples[f"sets_{case}"].sum() for case in cases)
    )


def _per_trial(samples: Samples, name: str) -> float:
    return float(np.nanmean(samples[name])) if np.isfinite(samples[name]).any() else np.nan


def _kept_per_trial(results: Results) -> float:
    samples = results.of(sensors=3, nlos_range="sum", noise_db=0.0)
    return float(sum(_per_trial(samples, f"kept_{case}") for case in ("iv", "v", "vi")))


def _occurring_cases(samples: Samples) -> float:
    return float(sum(samples[f"sets_{case}"].any() for case in CASES))


def _panels(results: Results) -> Sequence[Panel]:
    chunk = Chunk(seed=0, number=0, first=0, size=CHUNK_TRIALS, total=CHUNK_TRIALS)
    trials = echo_trials(_EXAMPLE, chunk)
    sets = candidates(trials, chunk.size)
    names = tuple(f"({case})" for case in CASES)
    both = {sensors: results.of(sensors=sensors, nlos_range="sum", noise_db=0.0) for sensors in (3, 5)}
    counts = [
        BarsPanel(
            x_label="case [-]",
            y_label="sets per trial [-]",
            title=f"N = {sensors}, 0 dB, ranges by (1)",
            groups=names,
            values={label: _by_case(samples, name) for name, label in _COUNTS.items()},
        )
        for sensors, samples in both.items()
    ]
    spreads = BarsPanel(
        x_label="case [-]",
        y_label="median spread [m]",
        title="0 dB, ranges by (1)",
        groups=names,
        values={f"N = {sensors}": _by_case(samples, "spread", "_m") for sensors, samples in both.items()},
    )
    return [*(_example(trials, sets, number) for number in range(len(CASES))), *counts, spreads]


def _by_case(samples: Samples, name: str, unit: str = "") -> FloatArray:
    return np.array([_per_trial(samples, f"{name}_{case}{unit}") for case in CASES])


def _example(trials: Simulated, all_sets: Sequence[CandidateSets], case: int) -> Panel:
    """Return the candidate of a case with a spread that shows well: its circles, its points and the targets."""
    every = [(trial, index) for trial, sets in enumerate(all_sets) for index in np.flatnonzero(sets.case == case)]
    trial, index = min(every, key=lambda item: abs(all_sets[item[0]].spread_m[item[1]] - _EXAMPLE_SPREAD_M))
    sets = all_sets[trial]
    columns = {name: values.reshape(len(all_sets), -1)[trial] for name, values in trials.columns.items()}
    points = sets.point_m[index]
    center = points.mean(axis=0)
    half = _WINDOW * float(np.abs(points - center).max())
    targets = np.unique(np.stack([columns["truth_x_m"], columns["truth_y_m"]], axis=1), axis=0)
    near = targets[(np.abs(targets - center) < half).all(axis=1)]
    return PointsPanel(
        title=f"case ({CASES[case]}), spread {sets.spread_m[index]:.0f} m",
        x_label="x [m]",
        y_label="y [m]",
        equal_aspect=True,
        legend=case == len(CASES) - 1,
        points=(
            Series(label="crossing of the set", x=points[:, 0], y=points[:, 1], style=2),
            Series(label="target", x=near[:, 0], y=near[:, 1], style=7),
        ),
        outlines=tuple(
            _arcs(label, columns, [row for row in sets.row[index] if columns["truth_los"][row] == direct], center, half)
            for direct, label in ((True, "direct circle"), (False, "scattered circle"))
        ),
        size_pt=6.0,
    )


def _arcs(
    label: str, columns: Mapping[str, npt.NDArray[Any]], rows: Sequence[int], center: FloatArray, half: float
) -> Series:
    """Return the arcs of some rows' circles inside the window, solid for direct echoes, otherwise dashed."""
    parts = [np.full((1, 2), np.nan)]
    for row in rows:
        sensor, radius = np.array([columns["sensor_x_m"][row], columns["sensor_y_m"][row]]), columns["range_m"][row]
        angle = np.linspace(-np.pi, np.pi, 20_001) + np.arctan2(*(center - sensor)[::-1])
        points = sensor + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        inside = (np.abs(points - center) <= half).all(axis=1)
        points[~inside] = np.nan
        parts += [points[inside | np.roll(inside, 1)], np.full((1, 2), np.nan)]
    x, y = np.concatenate(parts).T
    return Series(label=label, x=x, y=y, style=0 if label.startswith("direct") else 1, marker=False)


EXPERIMENT = Experiment(
    name="liang-fig2",
    paper=PAPER,
    title="The six cases of structured candidate sets",
    conditions=conditions(sensors=(3, 5), nlos_range=("sum", "half"), noise_db=(-10.0, 0.0)),
    sample=_sample,
    quantities={
        f"{name}_{case}{unit}": partial(_per_trial, name=f"{name}_{case}{unit}")
        for name, unit in (("sets", ""), ("kept", ""), ("larger", ""), ("spread", "_m"))
        for case in CASES
    },
    claims=(
        Claim(
            text="Candidates are of six cases: how many occur, N = 3, scattered ranges of half the round trip",
            where=_WHERE,
            ours=at(_occurring_cases, sensors=3, nlos_range="half", noise_db=0.0),
            expected=at_least(6.0, "6"),
        ),
        Claim(
            text="Candidates of case (vi) per trial, N = 3, 0 dB, ranges by (1)",
            where=_WHERE,
            ours=at(partial(_per_trial, name="sets_vi"), sensors=3, nlos_range="sum", noise_db=0.0),
            note="Hardly any: scattered ranges by (1) are too long for three such circles to meet in the square.",
        ),
        *(
            Claim(
                text=f"(i) has usually a smaller spread than (ii), (iii) that share its points: N = {sensors}, 0 dB",
                where=_WHERE,
                ours=partial(_share, part="larger", cases=("ii", "iii"), sensors=sensors, noise_db=0.0),
                expected=at_least(0.9, "usually"),
            )
            for sensors in (3, 5)
        ),
        Claim(
            text="Cases (iv) to (vi) have generally a larger spread than (i): share, N = 3, 0 dB",
            where=_WHERE,
            ours=partial(_share, part="larger", cases=("iv", "v", "vi"), sensors=3, noise_db=0.0),
            expected=at_least(0.9, "generally"),
        ),
        Claim(
            text="The comparison can't eliminate cases (iv) to (vi): sets left per trial, N = 3, 0 dB",
            where=_WHERE,
            ours=_kept_per_trial,
            expected=at_least(0.5, "> 0"),
        ),
        *(
            claim
            for noise_db, note in (
                (-10.0, ""),
                (
                    0.0,
                    "True sets fall to smaller wrong ones that share a point with them: most wrong trials of Table I.",
                ),
            )
            for claim in (
                Claim(
                    text=f"The comparison eliminates cases (ii) and (iii): share left, N = 3, {noise_db:g} dB",
                    where=_WHERE,
                    ours=partial(_share, part="kept", cases=("ii", "iii"), sensors=3, noise_db=noise_db),
                    expected=at_most(0.0, "0"),
                    note=note,
                ),
                Claim(
                    text=f"and preserves case (i): share left, N = 3, {noise_db:g} dB",
                    where=_WHERE,
                    ours=partial(_share, part="kept", cases=("i",), sensors=3, noise_db=noise_db),
                    expected=at_least(1.0, "1"),
                    note=note,
                ),
            )
        ),
    ),
    panels=_panels,
    trials=1000,
    quick_trials=50,
    chunk_trials=CHUNK_TRIALS,
)
