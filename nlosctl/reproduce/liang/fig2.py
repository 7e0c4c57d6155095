"""Liang, Zeng, Li, Figure 2: the six cases of structured candidate sets, an example of each, and how many there are."""

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
from nlosctl.reproduce.samples import Condition, Drawn, Samples, conditions
from nlosctl.reproduce.simulated import Simulated
from nlosctl.reproduce.verdicts import at_least, at_most

__all__ = ["EXPERIMENT"]


_WHERE = "Section III.B, Fig. 2"
_COUNTS = {"sets": "candidates", "kept": "left by the comparison"}
_EXAMPLE: Condition = {"sensors": 3, "nlos_range": "half", "noise_db": 0.0}
_EXAMPLE_SPREAD_M = 30.0
_WINDOW = 2.5


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return by case, for each trial, how many candidates there are, are kept, and have a larger spread than true sets.

    Than the true ones with which they share a point (ii, iii), or than all true ones of the trial (iv to vi).
    """
    found = candidates(echo_trials(condition, chunk), chunk.size)
    samples: dict[str, FloatArray] = {}
    for number, case in enumerate(CASES):
        mine = [some.case == number for some in found]
        picked = {
            "sets": mine,
            "kept": [some.kept & of for some, of in zip(found, mine, strict=True)],
            "larger": [_is_larger(some) & of for some, of in zip(found, mine, strict=True)],
        }
        samples |= {
            f"{name}_{case}": np.array([of.sum() for of in places], dtype=float) for name, places in picked.items()
        }
        spreads = [some.spread_m[of] for some, of in zip(found, mine, strict=True)]
        samples[f"spread_{case}_m"] = np.array([np.median(of) if of.size else np.nan for of in spreads])
    return samples


def _is_larger(some: CandidateSets) -> BoolArray:
    largest = some.spread_m[some.case == 0].max(initial=0.0)
    return np.where(some.case < 3, some.larger, some.spread_m > largest)


def _share(drawn: Drawn, *, part: str, cases: Sequence[str], sensors: int, noise_db: float) -> float:
    """Return which share of the candidates of some cases is counted by ``part``; ranges by (1)."""
    samples = drawn.of(sensors=sensors, nlos_range="sum", noise_db=noise_db)
    return float(
        sum(samples[f"{part}_{case}"].sum() for case in cases) / sum(samples[f"sets_{case}"].sum() for case in cases)
    )


def _per_trial(samples: Samples, name: str) -> float:
    return float(np.nanmean(samples[name])) if np.isfinite(samples[name]).any() else np.nan


def _kept_per_trial(drawn: Drawn) -> float:
    samples = drawn.of(sensors=3, nlos_range="sum", noise_db=0.0)
    return float(sum(_per_trial(samples, f"kept_{case}") for case in ("iv", "v", "vi")))


def _scattered_alone(drawn: Drawn) -> float:
    return _per_trial(drawn.of(sensors=3, nlos_range="sum", noise_db=0.0), "sets_vi")


def _cases_there(drawn: Drawn, nlos_range: str) -> float:
    samples = drawn.of(sensors=3, nlos_range=nlos_range, noise_db=0.0)
    return float(sum(samples[f"sets_{case}"].any() for case in CASES))


def _panels(drawn: Drawn) -> Sequence[Panel]:
    chunk = Chunk(seed=0, number=0, first=0, size=CHUNK_TRIALS, total=CHUNK_TRIALS)
    given = echo_trials(_EXAMPLE, chunk)
    found = candidates(given, chunk.size)
    names = tuple(f"({case})" for case in CASES)
    both = {sensors: drawn.of(sensors=sensors, nlos_range="sum", noise_db=0.0) for sensors in (3, 5)}
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
    return [*(_example(given, found, number) for number in range(len(CASES))), *counts, spreads]


def _by_case(samples: Samples, name: str, unit: str = "") -> FloatArray:
    return np.array([_per_trial(samples, f"{name}_{case}{unit}") for case in CASES])


def _example(given: Simulated, found: Sequence[CandidateSets], case: int) -> Panel:
    """Return the candidate of a case whose spread is nearest to what shows well: its circles, its points, targets."""
    every = [(trial, place) for trial, some in enumerate(found) for place in np.flatnonzero(some.case == case)]
    trial, place = min(every, key=lambda one: abs(found[one[0]].spread_m[one[1]] - _EXAMPLE_SPREAD_M))
    some = found[trial]
    columns = {name: values.reshape(len(found), -1)[trial] for name, values in given.columns.items()}
    points = some.point_m[place]
    center = points.mean(axis=0)
    half = _WINDOW * float(np.abs(points - center).max())
    targets = np.unique(np.stack([columns["truth_x_m"], columns["truth_y_m"]], axis=1), axis=0)
    near = targets[(np.abs(targets - center) < half).all(axis=1)]
    return PointsPanel(
        title=f"case ({CASES[case]}), spread {some.spread_m[place]:.0f} m",
        x_label="x [m]",
        y_label="y [m]",
        equal_aspect=True,
        legend=case == len(CASES) - 1,
        points=(
            Series(label="crossing of the set", x=points[:, 0], y=points[:, 1], style=2),
            Series(label="target", x=near[:, 0], y=near[:, 1], style=7),
        ),
        outlines=tuple(
            _arcs(label, columns, [row for row in some.row[place] if columns["truth_los"][row] == direct], center, half)
            for direct, label in ((True, "direct circle"), (False, "scattered circle"))
        ),
        size_pt=6.0,
    )


def _arcs(
    label: str, columns: Mapping[str, npt.NDArray[Any]], rows: Sequence[int], center: FloatArray, half: float
) -> Series:
    """Return the circles of some rows as far as they are within the window, solid for direct ones, else dashed."""
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
            says="Candidates are of six cases: how many occur, N = 3, scattered ranges of half the round trip",
            where=_WHERE,
            ours=partial(_cases_there, nlos_range="half"),
            expected=at_least(6.0, "6"),
        ),
        Claim(
            says="Candidates of case (vi) per trial, N = 3, 0 dB, ranges by (1)",
            where=_WHERE,
            ours=_scattered_alone,
            note="Hardly any: scattered ranges by (1) are too long for three such circles to meet in the square.",
        ),
        *(
            Claim(
                says=f"(i) has usually a smaller spread than (ii), (iii) that share its points: N = {sensors}, 0 dB",
                where=_WHERE,
                ours=partial(_share, part="larger", cases=("ii", "iii"), sensors=sensors, noise_db=0.0),
                expected=at_least(0.9, "usually"),
            )
            for sensors in (3, 5)
        ),
        Claim(
            says="Cases (iv) to (vi) have generally a larger spread than (i): share, N = 3, 0 dB",
            where=_WHERE,
            ours=partial(_share, part="larger", cases=("iv", "v", "vi"), sensors=3, noise_db=0.0),
            expected=at_least(0.9, "generally"),
        ),
        Claim(
            says="The comparison can't eliminate cases (iv) to (vi): sets left per trial, N = 3, 0 dB",
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
                    says=f"The comparison eliminates cases (ii) and (iii): share left, N = 3, {noise_db:g} dB",
                    where=_WHERE,
                    ours=partial(_share, part="kept", cases=("ii", "iii"), sensors=3, noise_db=noise_db),
                    expected=at_most(0.02, "0"),
                    note=note,
                ),
                Claim(
                    says=f"and preserves case (i): share left, N = 3, {noise_db:g} dB",
                    where=_WHERE,
                    ours=partial(_share, part="kept", cases=("i",), sensors=3, noise_db=noise_db),
                    expected=at_least(0.98, "1"),
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
