"""Song, Willett, Zhou 2013, Figure 6: region that a sensor on an opaque circle sees via the reflector around it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from nlosctl.geometry.circles import leave_circle
from nlosctl.geometry.circular_reflection import all_reflections, count_reflections
from nlosctl.geometry.short_arc import short_arc_reflection
from nlosctl.geometry.visibility import (
    reach_by_reflection,
    sees_by_reflection,
    sees_by_reflection_from_ground,
    sees_directly,
)
from nlosctl.plotting.panels import Panel, RegionsPanel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.panels import lattice_points, on_lattice
from nlosctl.reproduce.samples import Condition, Results, Samples
from nlosctl.reproduce.song.paper import PAPER
from nlosctl.reproduce.verdicts import at_least, at_most, printed

__all__ = ["EXPERIMENT"]

_GROUND_M, _REFLECTOR_M = 6371e3, 6671e3
_FARTHEST_RAD = np.radians(42.0)
_HORIZONTAL = np.zeros(1)
_A1, _A2, _A3 = 1.0, 2.0, 3.0


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    """Return the visibility of points at angles along the ground and heights above it, for a sensor at the angle 0."""
    angle, height = lattice_points(chunk, (0.0, _FARTHEST_RAD), (0.0, _REFLECTOR_M - _GROUND_M))
    x, y = (_GROUND_M + height) * np.cos(angle), (_GROUND_M + height) * np.sin(angle)
    sensor_x, sensor_y = np.full(x.shape, _GROUND_M), np.zeros(x.shape)
    radius, blocker, flat = (np.full(x.shape, value) for value in (_REFLECTOR_M, _GROUND_M, 0.0))
    ends = (sensor_x, sensor_y, x, y)
    seen = sees_by_reflection_from_ground(*ends, radius, blocker, flat)
    direct = sees_directly(*ends, blocker, flat)
    paths = all_reflections(*ends, radius)
    free = sees_by_reflection(*ends, paths, radius, blocker, flat)
    short = short_arc_reflection(*ends, radius)
    return {
        "angle_rad": angle,
        "height_m": height,
        "region": np.where(direct, _A3, np.where(seen, _A2, _A1)),
        "free_paths": np.count_nonzero(free, axis=0).astype(np.float64),
        "paths": count_reflections(*ends, radius).astype(np.float64),
        "short_arc_free": sees_by_reflection(*ends, short, radius, blocker, flat).astype(np.float64),
    }


def _share(results: Results, regions: tuple[float, ...], name: str, value: float) -> float:
    samples = results.samples[0]
    inside = np.isin(samples["region"], regions)
    return float((samples[name][inside] == value).mean())


def _share_of_region(samples: Samples, number: int) -> float:
    return float((samples["region"] == number).mean())


def _grazing_angles() -> tuple[float, float]:
    """Return the angles BC and AD of the figure, where the horizontal ray hits the reflector and touches the ground."""
    hit = leave_circle(np.array([_GROUND_M]), _HORIZONTAL, _HORIZONTAL, np.ones(1), np.array([_REFLECTOR_M]))
    normal = np.array([hit.x[0], hit.y[0]]) / _REFLECTOR_M
    ray = np.array([0.0, 1.0])
    back = ray - 2.0 * (ray @ normal) * normal
    point = np.array([hit.x[0], hit.y[0]])
    foot = point - (point @ back) * back
    return float(np.arctan2(point[1], point[0])), float(np.arctan2(foot[1], foot[0]))


def _distance_from_singular_point() -> float:
    """Return the distance of the traced D from the singular point (39) of the separatrix, in radii of the reflector."""
    c, touch = _GROUND_M / _REFLECTOR_M, _grazing_angles()[1]
    at = c * np.array([np.cos(touch), np.sin(touch)])
    return float(np.hypot(at[0] - c * (2.0 * c * c - 1.0), at[1] - 2.0 * c * c * np.sqrt(1.0 - c * c)))


def _panels(results: Results) -> Sequence[Panel]:
    samples = results.samples[0]
    angle, height, region = on_lattice(samples["angle_rad"], samples["height_m"], samples["region"])
    edge_height = np.linspace(0.0, _REFLECTOR_M - _GROUND_M, 200)
    shape = edge_height.shape
    edge = reach_by_reflection(
        _GROUND_M + edge_height, np.full(shape, _REFLECTOR_M), np.full(shape, _GROUND_M), np.zeros(shape)
    )
    horizon = np.arccos(_GROUND_M / (_GROUND_M + edge_height))
    return [
        RegionsPanel(
            x_label="distance along the ground [km]",
            y_label="height [km]",
            x=_GROUND_M * angle / 1e3,
            y=height / 1e3,
            region=np.where(np.isfinite(region), region, 0.0).astype(np.int64) - 1,
            labels=("A1: neither", "A2: by reflection", "A3: directly too"),
            outlines=(
                Series(label="reach, Lemma 2", x=_GROUND_M * edge / 1e3, y=edge_height / 1e3, marker=False, style=1),
                Series(label="horizon", x=_GROUND_M * horizon / 1e3, y=edge_height / 1e3, marker=False, style=0),
                Series(label="sensor", x=np.zeros(1), y=np.zeros(1), line=False, style=2),
            ),
        )
    ]


EXPERIMENT = Experiment(
    name="song-fig6",
    paper=PAPER,
    title="Visible regions of a sensor on the ground",
    conditions=({"ground_radius_m": _GROUND_M, "reflector_radius_m": _REFLECTOR_M},),
    sample=_sample,
    quantities={f"share_of_a{number}": partial(_share_of_region, number=number) for number in (1, 2, 3)},
    claims=(
        Claim(
            text="A target in A1 is reflectively invisible: share of places in A1 without an unblocked path",
            where="Lemma 2",
            ours=lambda results: _share(results, (_A1,), "free_paths", 0.0),
            expected=at_least(1.0, "1"),
            note="Every path is traced, two or four for each place, and both of its legs are checked for the ground.",
        ),
        Claim(
            text="A target in A2 is visible by exactly one unblocked reflection: share of places in A2",
            where="Lemmas 2 and 3",
            ours=lambda results: _share(results, (_A2, _A3), "free_paths", 1.0),
            expected=at_least(1.0, "1"),
            note="Lemma 3 and its proof say A1 where they mean A2.",
        ),
        Claim(
            text="A2 falls into the two-solution region: share of places in A2",
            where="proof of Lemma 3",
            ours=lambda results: _share(results, (_A2, _A3), "paths", 2.0),
            expected=at_least(1.0, "1"),
        ),
        Claim(
            text="Angle AD = angle BC = 2 arccos(r / R): AD over BC of the traced horizontal ray",
            where="proof of Lemma 3, before (40)",
            ours=lambda results: _grazing_angles()[1] / _grazing_angles()[0],
            expected=printed("1.0"),
            note="AD is twice BC: AD = 2 arccos(r / R), BC = arccos(r / R). (40) itself uses AD and is right.",
        ),
        Claim(
            text="AD = 2 arccos(r / R)",
            where="(40)",
            ours=lambda results: float(np.degrees(_grazing_angles()[1])),
            expected=printed(f"{np.degrees(2.0 * np.arccos(_GROUND_M / _REFLECTOR_M)):.3f} deg"),
            unit="deg",
        ),
        Claim(
            text="D is the singular point (39) of the separatrix: distance between the two",
            where="after (40)",
            ours=lambda results: _distance_from_singular_point(),
            expected=at_most(1e-9, "0"),
            unit="radii",
        ),
    ),
    comparisons=(
        Comparison(
            text="The one path on the short arc, all that the methods follow, is that path: share of places in A2",
            ours=lambda results: _share(results, (_A2, _A3), "short_arc_free", 1.0),
        ),
    ),
    panels=_panels,
    trials=62_500,
    quick_trials=3_600,
    chunk_trials=62_500,
    random=False,
)
