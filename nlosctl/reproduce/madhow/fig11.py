"""Ananthasubramaniam, Madhow, Figure 11: a source before a wall, wideband and narrowband."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.api import localize
from nlosctl.arrays import FloatArray
from nlosctl.plotting.panels import Panel, PointsPanel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.madhow.fig10 import outlines
from nlosctl.reproduce.madhow.paper import AS_PUBLISHED, EVERY_MAXIMUM, PAPER
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, median, median_of, rms_of, share
from nlosctl.reproduce.simulated import Simulated, fixes, simulated
from nlosctl.reproduce.verdicts import at_least, between

__all__ = ["EXPERIMENT"]

_FIELD = "-400,900,-400,800"
_NEAR_M = 25.0
"""An estimate within this distance of the source, or of its image, belongs to it."""
_SHOWN = 200


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    trials = simulated("madhow-walls", chunk, figure="11", **condition)
    image = trials.truth_m * np.array([1.0, -1.0])  # the wall is the x axis
    suppress = {"field": _FIELD, "alpha": 0.5, "bootstraps": 15, **AS_PUBLISHED}
    best = fixes(trials, chunk, "suppress", **suppress).position_m
    ours = fixes(trials, chunk, "mixture-ml", field=_FIELD, alpha=0.5, exclude_behind_walls=True, **EVERY_MAXIMUM)
    every = _alternatives(trials, chunk, suppress)
    return {
        "suppress": _distance(best, trials.truth_m),
        "nearest_to_image": np.fmin.reduce([_distance(position, image) for position in every]),
        "nearest_to_source": np.fmin.reduce([_distance(position, trials.truth_m) for position in every]),
        "mixture": ours.error_m,
        "x_m": best[:, 0],
        "y_m": best[:, 1],
        "second_x_m": every[1][:, 0],
        "second_y_m": every[1][:, 1],
        "truth_x_m": trials.truth_m[:, 0],
        "truth_y_m": trials.truth_m[:, 1],
    }


def _alternatives(trials: Simulated, chunk: Chunk, arguments: dict[str, object], count: int = 2) -> list[FloatArray]:
    """Return the positions (T, 2) of the best solutions of suppression, best first; NaN beyond the last one."""
    estimates = localize(
        trials.table,
        method="suppress",
        scene=trials.scene,
        seed=chunk.seed,
        alternatives=count,
        **arguments,  # type: ignore[arg-type]
    ).estimates
    columns = {name: estimates.column(name).to_numpy(zero_copy_only=False) for name in ("snapshot", "alternative")}
    positions = [np.full((chunk.size, 2), np.nan) for _ in range(count)]
    for axis, name in enumerate(("x_m", "y_m")):
        values = estimates.column(name).to_numpy(zero_copy_only=False).astype(float)
        for number, position in enumerate(positions):
            rows = columns["alternative"] == number
            position[columns["snapshot"][rows] - chunk.first, axis] = values[rows]
    return positions


def _distance(position_m: FloatArray, from_m: FloatArray) -> FloatArray:
    return np.asarray(np.hypot(*(position_m - from_m).T))


def _both_found(results: Results) -> float:
    samples = results.of(band="wide")
    return share((samples["nearest_to_image"] < _NEAR_M) & (samples["nearest_to_source"] < _NEAR_M))


def _share_at_source(results: Results, name: str) -> float:
    return share(results.of(band="wide")[name] < _NEAR_M)


def _share_between(results: Results) -> float:
    """Return the share of narrowband estimates with a y between those of the image and of the source."""
    samples = results.of(band="narrow")
    return share(np.abs(samples["y_m"]) < samples["truth_y_m"])


def _panels(results: Results) -> Sequence[Panel]:
    panels = []
    for band in ("wide", "narrow"):
        samples = results.of(band=band)
        truth_x, truth_y = samples["truth_x_m"][:1], samples["truth_y_m"][:1]
        second = [
            Series(
                label="second estimates", x=samples["second_x_m"][:_SHOWN], y=samples["second_y_m"][:_SHOWN], style=3
            )
        ]
        panels.append(
            PointsPanel(
                x_label="x [m]",
                y_label="y [m]",
                title=f"{band}band",
                equal_aspect=True,
                x_range=(-60.0, 560.0),
                y_range=(-220.0, 500.0),
                points=(
                    Series(label="best estimates", x=samples["x_m"][:_SHOWN], y=samples["y_m"][:_SHOWN], style=2),
                    *(second if band == "wide" else []),
                    Series(label="source", x=truth_x, y=truth_y, style=0),
                    Series(label="its image", x=truth_x, y=-truth_y, style=4),
                ),
                outlines=outlines("11"),
            )
        )
    return panels


EXPERIMENT = Experiment(
    name="madhow-fig11",
    paper=PAPER,
    title="A source before a wall, wideband and narrowband",
    conditions=conditions(band=("wide", "narrow")),
    sample=_sample,
    quantities={
        "median_suppress_m": median_of("suppress"),
        "median_mixture_m": median_of("mixture"),
        "rms_mixture_m": rms_of("mixture"),
    },
    claims=(
        Claim(
            text="Wideband: the virtual source is found beside the true one: share of trials with both within 25 m",
            where="Section V-B3, Fig. 11",
            ours=_both_found,
            expected=at_least(0.95, "~ 1"),
        ),
        Claim(
            text="... and the algorithm can't distinguish them: share of trials with the best at the true source",
            where="Section V-B3",
            ours=lambda results: _share_at_source(results, "suppress"),
            expected=between(0.3, 0.7, "0.5"),
            note="The positions are ours; the text gives none.",
        ),
        Claim(
            text="Narrowband: the source is placed between the true and the virtual one: share of trials",
            where="Section V-B3, Fig. 11",
            ours=_share_between,
            expected=at_least(0.9, "~ 1"),
        ),
        Claim(
            text="Narrowband degrades performance greatly: median error over that of the nearer wideband solution",
            where="Section V-B3",
            ours=lambda results: (
                median(results.of(band="narrow")["suppress"]) / median(results.of(band="wide")["nearest_to_source"])
            ),
            expected=at_least(5.0, ">> 1"),
        ),
    ),
    comparisons=(
        Comparison(
            text="Wideband, mixture-ml with exclude_behind_walls: share of trials at the true source",
            ours=lambda results: _share_at_source(results, "mixture"),
        ),
        Comparison(text="... and its rms error", ours=at(rms_of("mixture"), band="wide"), unit="m"),
    ),
    panels=_panels,
    trials=2000,
    quick_trials=200,
    chunk_trials=500,
)
