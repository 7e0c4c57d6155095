"""Song, Willett, Zhou 2013, Figure 7: uncertainty of a bearing at the target, after a flat and a circular mirror."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import CircleReflector
from nlosctl.geometry.circles import leave_circle
from nlosctl.geometry.circular_reflection import ReflectedPath
from nlosctl.geometry.short_arc import short_arc_reflection
from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Chunk, Claim, Comparison, Experiment
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Condition, Results, Samples, conditions, ratio_of, rms, rms_of
from nlosctl.reproduce.song.paper import PAPER
from nlosctl.reproduce.verdicts import at_most, between
from nlosctl.scenarios import song_circle

__all__ = ["EXPERIMENT"]

_STD_RAD = np.radians(0.5)
_SHARES = (0.1, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5)
"""Distances along the reflected ray, in units of the target's distance from the reflection point."""

_SCENE = song_circle.scene(song_circle.SongCircleOptions(parameter_set="a"))
_SENSOR = np.array(_SCENE.sensors[0].position)
_TARGET = np.array([6421e3, 0.0])


def _radius() -> float:
    (circle,) = _SCENE.reflectors
    assert isinstance(circle, CircleReflector)  # noqa: S101 - the scenario's one reflector
    return circle.radius


def _path() -> ReflectedPath:
    """Return the path from the target to sensor 1 of parameter set A."""
    ends = (_SENSOR[:1], _SENSOR[1:], _TARGET[:1], _TARGET[1:])
    return short_arc_reflection(*ends, np.array([_radius()]))


def _across(bearing: FloatArray, distance_m: float, *, flat: bool) -> FloatArray:
    """Return the offsets (T,) of rays with these bearings from the true ray, at a distance from its reflection point.

    The rays are reflected by the tangent at the true reflection point if ``flat``, otherwise by the circle.
    """
    path = _path()
    ray_x, ray_y = np.cos(bearing), np.sin(bearing)
    if flat:
        normal_x, normal_y = path.hit_x / _radius(), path.hit_y / _radius()
        ahead = (path.hit_x - _SENSOR[0]) * normal_x + (path.hit_y - _SENSOR[1]) * normal_y
        length = ahead / (ray_x * normal_x + ray_y * normal_y)
        hit_x, hit_y = _SENSOR[0] + length * ray_x, _SENSOR[1] + length * ray_y
    else:
        x, y = (np.full(bearing.shape, value) for value in _SENSOR)
        leaving = leave_circle(x, y, ray_x, ray_y, np.array(_radius()))
        hit_x, hit_y = leaving.x, leaving.y
        normal_x, normal_y = hit_x / _radius(), hit_y / _radius()
    twice = 2.0 * (ray_x * normal_x + ray_y * normal_y)
    back_x, back_y = ray_x - twice * normal_x, ray_y - twice * normal_y
    screen_x, screen_y = path.hit_x + distance_m * path.cosine, path.hit_y + distance_m * path.sine
    length = ((screen_x - hit_x) * path.cosine + (screen_y - hit_y) * path.sine) / (
        back_x * path.cosine + back_y * path.sine
    )
    x, y = hit_x + length * back_x - screen_x, hit_y + length * back_y - screen_y
    return np.asarray(y * path.cosine - x * path.sine)


def _sample(condition: Condition, chunk: Chunk) -> Samples:
    path = _path()
    bearing = path.bearing_rad + _STD_RAD * chunk.generator().standard_normal(chunk.size)
    distance_m = float(condition["share_of_leg"]) * float(path.second_leg_m[0])
    return {name: _across(bearing, distance_m, flat=name == "flat") for name in ("flat", "circle")}


def _ratio(results: Results, share: float) -> float:
    return ratio_of("circle", "flat")(results.of(share_of_leg=share))


def _spread_per_distance(results: Results) -> float:
    """Return the ratio of the largest and smallest span after the flat mirror per metre of the whole path."""
    path = _path()
    spans = [
        rms(samples["flat"]) / float(path.first_leg_m[0] + float(condition["share_of_leg"]) * path.second_leg_m[0])
        for condition, samples in results.where()
    ]
    return max(spans) / min(spans)


def _formula_ratio() -> float:
    path = _path()
    return float(path.tube_width_m[0] / path.length_m[0])


def _cone(flat: bool, sigmas: float) -> tuple[FloatArray, FloatArray]:
    """Return distances after the reflection and offsets (km) of a ray with a bearing error of ``sigmas`` stds."""
    distances = np.linspace(0.0, 1.5, 40) * float(_path().second_leg_m[0])
    bearing = _path().bearing_rad + sigmas * _STD_RAD
    across = np.array([_across(bearing, float(distance), flat=flat)[0] for distance in distances])
    return distances / 1e3, across / 1e3


def _panels(results: Results) -> Sequence[Panel]:
    target_km = float(_path().second_leg_m[0]) / 1e3
    cones = []
    for flat, style, name in ((True, 1, "flat"), (False, 0, "circle")):
        for sigmas in (2.0, -2.0):
            x, y = _cone(flat, sigmas)
            label = f"{name}, ±2 sigma" if sigmas > 0.0 else f"_{name}"
            cones.append(Series(label=label, x=x, y=y, style=style, marker=False))
    cones.append(Series(label="target", x=np.array([target_km]), y=np.zeros(1), line=False, style=2))
    lines = tuple(
        curve(results, "share_of_leg", label, rms_of(name), style=style)
        for name, label, style in (("flat", "flat", 1), ("circle", "circle", 0))
    )
    scaled = tuple(
        Series(label=line.label, x=line.x * target_km, y=line.y / 1e3, error=line.error / 1e3, style=line.style)
        for line in lines
        if line.error is not None
    )
    along = "distance after the reflection [km]"
    return [
        LinesPanel(x_label=along, y_label="across the true ray [km]", lines=tuple(cones), title="rays of a bearing"),
        LinesPanel(x_label=along, y_label="rms span [km]", lines=scaled, title="bearing error 0.5 deg"),
    ]


EXPERIMENT = Experiment(
    name="song-fig7",
    paper=PAPER,
    title="Focusing: from bearing error to position error, sensor 1 of set A",
    conditions=conditions(share_of_leg=_SHARES),
    sample=_sample,
    quantities={"rms_flat_m": rms_of("flat"), "rms_circle_m": rms_of("circle")},
    claims=(
        Claim(
            text="After a flat mirror the span grows linearly with the distance: largest over least span per metre",
            where="Fig. 7, caption",
            ours=_spread_per_distance,
            expected=between(1.0, 1.01, "1"),
        ),
        Claim(
            text="After the circle it is smaller (focused): span over that of the flat mirror, at the target",
            where="Section 4, Fig. 7",
            ours=lambda results: _ratio(results, 1.0),
            expected=at_most(1.0, "< 1"),
            note="The paper's 'somewhat reduced' is a factor of two here, and Stansfield's weights do not know of it.",
        ),
        Claim(
            text="The shrinking grows with the distance: the ratio of the spans at 1.5 over that at 0.5 legs",
            where="Section 4, Fig. 7",
            ours=lambda results: _ratio(results, 1.5) / _ratio(results, 0.5),
            expected=at_most(1.0, "< 1"),
        ),
    ),
    comparisons=(
        Comparison(
            text="The closed form that stansfield-focused weighs by, spread over distance, at the target",
            ours=lambda results: _formula_ratio(),
        ),
    ),
    panels=_panels,
    trials=4000,
    quick_trials=400,
    chunk_trials=1000,
)
