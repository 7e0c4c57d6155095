"""Ananthasubramaniam, Madhow, Figure 10: a wall that blocks, a wall that reflects, a narrowband source."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from nlosctl.api import localize
from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import SegmentReflector
from nlosctl.plotting.panels import Panel, PointsPanel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.madhow.paper import AS_PUBLISHED, EVERY_MAXIMUM, PAPER
from nlosctl.reproduce.madhow.random_worlds import random_worlds
from nlosctl.reproduce.samples import Condition, Results, Samples, at, conditions, median_of, rms, rms_of, share_of
from nlosctl.reproduce.simulated import Simulated, fixes, simulated
from nlosctl.reproduce.verdicts import about, at_least
from nlosctl.scenarios import madhow_walls

__all__ = ["EXPERIMENT", "outlines"]

_PRINTED_M = {"A": 18.42, "B": 2.7, "C": 2.57, "D": 14.22}
_RANDOM = "A, random worlds"
_FIELD = "0,500,0,500"
_SHOWN = 120
_ELIMINATES = {
    "r4_eliminated": "eliminates the outlier of R4",
    "r1_r2_kept": "eliminates the outlier of R4 and keeps R1 and R2",
}


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    if condition["source"] == _RANDOM:
        trials = random_worlds(chunk)
    else:
        trials = simulated("madhow-walls", chunk, figure="10", **condition)
    arguments = {"field": _FIELD, "alpha": 0.25, "bootstraps": 7, **AS_PUBLISHED}
    suppress = fixes(trials, chunk, "suppress", **arguments)
    used = _used(trials, chunk, arguments)
    eliminated = np.isfinite(suppress.error_m) & (used["R4"] == 0.0)
    mixture = fixes(trials, chunk, "mixture-ml", field=_FIELD, alpha=0.25, **EVERY_MAXIMUM)
    return {
        "suppress": suppress.error_m,
        "r4_eliminated": eliminated.astype(float),
        "r1_r2_kept": (eliminated & (used["R1"] == 1.0) & (used["R2"] == 1.0)).astype(float),
        "mixture": mixture.error_m,
        "mixture_ambiguous": (mixture.status == "ambiguous").astype(float),
        "ml": fixes(trials, chunk, "ml").error_m,
        "x_m": suppress.position_m[:, 0],
        "y_m": suppress.position_m[:, 1],
        "truth_x_m": trials.truth_m[:, 0],
        "truth_y_m": trials.truth_m[:, 1],
    }


def _used(trials: Simulated, chunk: Chunk, arguments: dict[str, Any]) -> dict[str, FloatArray]:
    """Return by receiver whether suppression used its row (T,): 1 or 0; NaN without a row."""
    flags = localize(
        trials.table, method="suppress", kind=trials.kind, scene=trials.scene, seed=chunk.seed, **arguments
    ).flags
    sensor, used, snapshot = (np.array(flags.column(name).to_pylist()) for name in ("sensor", "used", "snapshot"))
    values = {}
    for name in ("R1", "R2", "R4"):
        values[name] = np.full(chunk.size, np.nan)
        values[name][snapshot[sensor == name] - chunk.first] = used[sensor == name]
    return values


def _rms(results: Results, source: str, name: str = "suppress") -> float:
    return rms(results.of(source=source)[name])


def _disturbed_over_others(results: Results) -> float:
    return min(_rms(results, "A"), _rms(results, "D")) / max(_rms(results, "B"), _rms(results, "C"))


def outlines(figure: str) -> tuple[Series, ...]:
    """Return the walls and receivers of one of the paper's two worlds."""
    world = madhow_walls.scene(madhow_walls.MadhowWallsOptions(figure=figure))  # type: ignore[arg-type]
    walls = tuple(
        Series(
            label=f"{wall.name} wall" if wall.name != "wall" else "wall",
            x=np.array([wall.start[0], wall.end[0]]),
            y=np.array([wall.start[1], wall.end[1]]),
            marker=False,
            style=style,
        )
        for style, wall in enumerate(world.reflectors)
        if isinstance(wall, SegmentReflector)
    )
    receivers = np.array([sensor.position for sensor in world.sensors])
    return (*walls, Series(label="receivers", x=receivers[:, 0], y=receivers[:, 1], line=False, style=1))


def _panels(results: Results) -> Sequence[Panel]:
    ours = [item for item in results.where() if item[0]["source"] != _RANDOM]
    panels = []
    for wide in (True, False):
        points = []
        for style, (condition, samples) in enumerate(ours):
            points.append(
                Series(
                    label=f"estimates, source {condition['source']}",
                    x=samples["x_m"][:_SHOWN],
                    y=samples["y_m"][:_SHOWN],
                    style=(2, 3, 4, 5)[style],
                )
            )
        truths = [(samples["truth_x_m"][0], samples["truth_y_m"][0]) for _, samples in ours]
        x, y = np.array(truths).T
        points.append(Series(label="sources", x=x, y=y, style=0))
        if not wide:
            points = [points[0], Series(label="sources", x=x[:1], y=y[:1], style=0)]
        panels.append(
            PointsPanel(
                x_label="x [m]",
                y_label="y [m]",
                title="all sources" if wide else "source A",
                equal_aspect=True,
                points=tuple(points),
                outlines=outlines("10") if wide else (),
            )
        )
    return panels


EXPERIMENT = Experiment(
    name="madhow-fig10",
    paper=PAPER,
    title="Two walls, narrowband: suppression with M = 7",
    conditions=conditions(source=(*_PRINTED_M, _RANDOM)),
    sample=_sample,
    quantities={
        "rms_suppress_m": rms_of("suppress"),
        "median_suppress_m": median_of("suppress"),
        "rms_mixture_m": rms_of("mixture"),
        "rms_ml_m": rms_of("ml"),
    },
    claims=(
        *(
            Claim(
                text=f"rms error at {source}",
                where="Fig. 10, caption",
                ours=partial(_rms, source=source),
                expected=about(value, 0.5, f"{value:g} m"),
                unit="m",
                note="The text gives no positions; those of the scenario are ours, so half of the number is allowed.",
            )
            for source, value in _PRINTED_M.items()
        ),
        Claim(
            text="A and D, with R3 disturbed and R4 blocked, are worse than B and C: least ratio of the rms errors",
            where="Fig. 10, caption",
            ours=_disturbed_over_others,
            expected=at_least(1.0, "> 1"),
        ),
        Claim(
            text="The outlier of R4 is eliminated: rms of ml, all trusted, over that of suppression at A",
            where="Section V-B3",
            ours=lambda results: _rms(results, "A", "ml") / _rms(results, "A"),
            expected=at_least(1.0, "> 1"),
            note="It depends on the world, and the positions are ours. With R3 off too, each pair of the four rows "
            "explains two: here the likelihood does not distinguish R1 and R2, which are right, from the others, and "
            "suppression takes any. In most random worlds that fit the caption R4 is eliminated (in italics): "
            "their source, receivers and ends of walls are uniform in a square of 500 m, and each fits if the source "
            "reaches R1 and R2 directly, R3 also by reflection, and R4, behind the blocking wall, by reflection only.",
        ),
    ),
    comparisons=tuple(
        Comparison(
            text=f"mixture-ml calls the fix ambiguous, at {source}: share of trials",
            ours=at(share_of("mixture_ambiguous"), source=source),
        )
        for source in ("A", "C")
    )
    + tuple(
        Comparison(text=f"suppression {text}, {place}: share of trials", ours=at(share_of(name), source=source))
        for name, text in _ELIMINATES.items()
        for source, place in (("A", "our world, A"), (_RANDOM, "a random world each"))
    )
    + (
        Comparison(
            text="median error of suppression, a random world each",
            ours=at(median_of("suppress"), source=_RANDOM),
            unit="m",
        ),
        Comparison(text="median error of ml, a random world each", ours=at(median_of("ml"), source=_RANDOM), unit="m"),
    ),
    panels=_panels,
    trials=4000,
    quick_trials=200,
    chunk_trials=1000,
)
