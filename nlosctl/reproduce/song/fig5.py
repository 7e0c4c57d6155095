"""Song, Willett, Zhou 2013, Figure 5: the number of reflection paths, and the separatrix between two and four."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.geometry.circular_reflection import all_points, count_reflections, separatrix
from nlosctl.plotting.panels import Panel, RegionsPanel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Experiment
from nlosctl.reproduce.panels import lattice_points, on_lattice
from nlosctl.reproduce.samples import Condition, Results, Samples, conditions
from nlosctl.reproduce.song.paper import PAPER
from nlosctl.reproduce.verdicts import at_least, at_most, printed

__all__ = ["EXPERIMENT"]

_FIGURE, _SMALL = 0.955, 0.2
"""Distance of the sensor from the centre, in radii: that of the figure, and one below 1/3."""
_BESIDE = 1e-8
"""Distance from the separatrix, in radii, at which paths are counted on both sides."""
_TURNING = 0.01
"""Speed along the separatrix below which it turns back at a singular point, where its sides are not defined."""


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    c = float(condition["sensor_distance"])
    x, y = lattice_points(chunk, (-1.0, 1.0), (-1.0, 1.0))
    curve_x, curve_y = separatrix(c, 0.0, 1.0, _angles(chunk))
    speed_x, speed_y = _velocity(c, _angles(chunk))
    speed = np.hypot(speed_x, speed_y)
    sides = [
        _count(c, curve_x + side * speed_y / speed, curve_y - side * speed_x / speed) for side in (_BESIDE, -_BESIDE)
    ]
    inside = (np.hypot(curve_x, curve_y) < 1.0 - 2.0 * _BESIDE) & (speed > _TURNING)
    count = _count(c, x, y)
    return {
        "x": x,
        "y": y,
        "paths": np.where(count > 0.0, count, np.nan),
        "points": np.where(count > 0.0, _verified(c, x, y), np.nan),
        "curve_radius": np.hypot(curve_x, curve_y),
        "fewer": np.where(inside, np.minimum(*sides), np.nan),
        "more": np.where(inside, np.maximum(*sides), np.nan),
    }


def _angles(chunk: Chunk) -> FloatArray:
    return np.asarray(2.0 * np.pi * (chunk.trials + 0.5) / chunk.total)


def _velocity(c: float, angle: FloatArray, step: float = 1e-6) -> tuple[FloatArray, FloatArray]:
    (x1, y1), (x0, y0) = (separatrix(c, 0.0, 1.0, angle + shift) for shift in (step, -step))
    return (x1 - x0) / (2.0 * step), (y1 - y0) / (2.0 * step)


def _arguments(c: float, x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
    return np.full(x.shape, c), np.zeros(x.shape), x, y, np.ones(x.shape)


def _count(c: float, x: FloatArray, y: FloatArray) -> FloatArray:
    return count_reflections(*_arguments(c, x, y)).astype(np.float64)


def _verified(c: float, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the number of computed reflection points that are on the circle and obey the law of reflection."""
    hit_x, hit_y = all_points(*_arguments(c, x, y))
    across = [
        ((hit_x - px) * hit_y - (hit_y - py) * hit_x) / np.hypot(hit_x - px, hit_y - py)
        for px, py in ((c, 0.0), (x, y))
    ]
    return np.asarray(np.count_nonzero(np.abs(across[0] + across[1]) < 1e-7, axis=0).astype(np.float64))


def _singular_points(c: float) -> FloatArray:
    """Return the points (P, 2) inside the circle where the separatrix turns back."""
    angle = 2.0 * np.pi * (np.arange(40_000) + 0.5) / 40_000
    (x0, y0), (x1, y1) = _velocity(c, angle), _velocity(c, np.roll(angle, -1))
    turns = (x0 * x1 + y0 * y1 < 0.0) & (np.arange(40_000) < 39_999)
    points = np.stack(separatrix(c, 0.0, 1.0, angle[turns] + np.pi / 40_000), axis=1)
    start = np.stack(separatrix(c, 0.0, 1.0, np.array([1e-9])), axis=1)
    cusp_at_start = np.hypot(*_velocity(c, np.array([1e-4]))) < 1e-2
    cusps = np.concatenate([points, start[cusp_at_start]])
    return np.asarray(cusps[np.hypot(cusps[:, 0], cusps[:, 1]) < 1.0])


def _distance_from_printed(c: float) -> float:
    """Return the largest distance of a printed singular point (39) from the nearest of ours."""
    across = 2.0 * c * c * np.sqrt(1.0 - c * c)
    along = c * (2.0 * c * c - 1.0)
    printed_points = [(-c / (1.0 + 2.0 * c), 0.0), (along, across), (along, -across)]
    if c < 1.0 / 3.0:
        printed_points.append((-c / (1.0 - 2.0 * c), 0.0))
    ours = _singular_points(c)
    return max(float(np.hypot(*(ours - point).T).min()) for point in np.array(printed_points))


def _share(results: Results, names: tuple[str, ...], counts: tuple[float, ...]) -> float:
    samples = results.of(sensor_distance=_FIGURE)
    defined = np.isfinite(samples[names[0]])
    equal = np.logical_and.reduce([samples[name] == count for name, count in zip(names, counts, strict=True)])
    return float(equal[defined].mean())


def _share_two_or_four(results: Results) -> float:
    paths = results.of(sensor_distance=_FIGURE)["paths"]
    return float(np.isin(paths[np.isfinite(paths)], (2.0, 4.0)).mean())


def _share_complete(results: Results) -> float:
    samples = results.of(sensor_distance=_FIGURE)
    defined = np.isfinite(samples["paths"])
    return float((samples["paths"] == samples["points"])[defined].mean())


def _panels(results: Results) -> Sequence[Panel]:
    return [_panel(float(condition["sensor_distance"]), samples) for condition, samples in results.where()]


def _panel(c: float, samples: Samples) -> Panel:
    x, y, count = on_lattice(samples["x"], samples["y"], samples["paths"])
    angle = np.linspace(0.0, 2.0 * np.pi, 2001)[1:-1]
    curve_x, curve_y = separatrix(c, 0.0, 1.0, angle)
    beyond = np.hypot(curve_x, curve_y) > 1.0
    singular = _singular_points(c)
    return RegionsPanel(
        x_label="x [radii]",
        y_label="y [radii]",
        title=f"sensor at c = {c:g}",
        equal_aspect=True,
        x=x,
        y=y,
        region=np.where(np.isfinite(count), np.where(count == 4.0, 1, 0), -1),
        labels=("2 paths", "4 paths"),
        outlines=(
            Series(label="circle", x=np.cos(angle), y=np.sin(angle), marker=False, style=0),
            Series(label="separatrix", x=np.where(beyond, np.nan, curve_x), y=curve_y, marker=False, style=1),
            Series(label="singular points", x=singular[:, 0], y=singular[:, 1], line=False, style=1),
            Series(label="sensor", x=np.array([c]), y=np.array([0.0]), line=False, style=2),
        ),
    )


EXPERIMENT = Experiment(
    name="song-fig5",
    paper=PAPER,
    title="Number of reflection paths within a circle",
    conditions=conditions(sensor_distance=(_FIGURE, _SMALL)),
    sample=_sample,
    quantities={
        "share_of_four_paths": lambda part: float((part["paths"] == 4.0).sum() / np.isfinite(part["paths"]).sum()),
        "largest_radius_of_separatrix": lambda part: float(part["curve_radius"].max()),
    },
    claims=(
        Claim(
            text="(33) has two or four solutions off the separatrix: share of places where it has",
            where="Section 3.3, Lemma 1",
            ours=_share_two_or_four,
            expected=at_least(1.0, "1"),
        ),
        Claim(
            text="... and that many reflection points are there: share of places where all are found",
            where="Section 3.3, Lemma 1",
            ours=_share_complete,
            expected=at_least(1.0, "1"),
        ),
        Claim(
            text="The region that includes (0, 0) has two solutions: their number there",
            where="Section 3.3, Lemma 1",
            ours=lambda results: float(_count(_FIGURE, np.array([1e-9]), np.array([0.0]))[0]),
            expected=printed("2"),
        ),
        Claim(
            text="The curve (37)-(38) parts two from four: share of its points with 2 on one side and 4 on the other",
            where="Section 3.3, Lemma 1",
            ours=lambda results: _share(results, ("fewer", "more"), (2.0, 4.0)),
            expected=at_least(0.999, "1"),
            note="The curve is right as printed; its parameter t is cot(theta / 2), not tan.",
        ),
        Claim(
            text="For |c| >= 1/3 the separatrix is open: its largest distance from the centre, c = 0.955",
            where="after (38)",
            ours=lambda results: float(results.of(sensor_distance=_FIGURE)["curve_radius"].max()),
            expected=at_least(1.0, "> 1"),
            unit="radii",
        ),
        Claim(
            text="... with three singular points: their number",
            where="after (38)",
            ours=lambda results: float(len(_singular_points(_FIGURE))),
            expected=printed("3"),
        ),
        Claim(
            text="... at the coordinates of (39): largest distance of ours from them",
            where="(39)",
            ours=lambda results: _distance_from_printed(_FIGURE),
            expected=at_most(1e-3, "0"),
            unit="radii",
        ),
        Claim(
            text="The sensor and the right two singular points are concentric: distance of these from the centre",
            where="Fig. 5, caption",
            ours=lambda results: float(np.hypot(*max(_singular_points(_FIGURE), key=lambda point: point[0]))),
            expected=printed("0.955"),
            unit="radii",
        ),
        Claim(
            text="For |c| < 1/3 it is closed: its largest distance from the centre, c = 0.2",
            where="after (39)",
            ours=lambda results: float(results.of(sensor_distance=_SMALL)["curve_radius"].max()),
            expected=at_most(1.0, "< 1"),
            unit="radii",
        ),
        Claim(
            text="... with one more singular point, at (-c / (1 - 2 c), 0): largest distance of ours from all four",
            where="after (39)",
            ours=lambda results: _distance_from_printed(_SMALL),
            expected=at_most(1e-3, "0"),
            unit="radii",
        ),
    ),
    panels=_panels,
    trials=62_500,
    quick_trials=3_600,
    chunk_trials=62_500,
    random=False,
)
