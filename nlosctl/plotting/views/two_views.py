"""Pictures in space: the plan and an elevation side by side, with equal scales; close-ups below if they are needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import (
    CircleReflector,
    EarthFrame,
    LineReflector,
    PlaneReflector,
    Reflector,
    Scene,
    SegmentReflector,
    SphereReflector,
)
from nlosctl.plotting.figures import new_figure
from nlosctl.plotting.library import Artist, Axes
from nlosctl.plotting.plane import Extent, finish_map, scene_sensors
from nlosctl.plotting.plot_request import Picture, PlotRequest

__all__ = [
    "VIEWS",
    "DrawView",
    "across",
    "coordinates",
    "draw_plan_and_elevation",
    "finish_view",
    "scene_positions",
    "seen_reflectors",
    "side_of",
]

VIEWS = ("xy", "xz", "yz")
"""The views by their two coordinates: the plan, and two elevations."""

DrawView = Callable[[Axes, str], tuple[Extent, Extent, list[str]]]
"""Draws everything into a panel of a view; returns the extent of the map, that of a close-up, and notes."""

_SMALL = 0.16
_PANEL_IN = (5.2, 4.6)


def coordinates(seen: str) -> list[int]:
    """Return the indices of the two coordinates of a view."""
    return ["xyz".index(axis) for axis in seen]


def across(seen: str) -> str:
    """Return the coordinate that a view does not show."""
    return next(axis for axis in "xyz" if axis not in seen)


def side_of(plan: Extent) -> str:
    """Return the elevation over x or y, whichever the plan is longer in."""
    return "xz" if np.subtract(plan.high, plan.low).argmax() == 0 else "yz"


def scene_positions(scene: Scene) -> tuple[list[str], FloatArray]:
    """Return the names and positions (N, 3) of a scene's sensors; heights NaN where the scene has none."""
    names, plan = scene_sensors(scene)
    return names, np.column_stack([plan, np.array([sensor.z_m for sensor in scene.sensors], dtype=np.float64)])


def draw_plan_and_elevation(request: PlotRequest, draw: DrawView, title: str, frame: EarthFrame | None) -> Picture:
    """Return the picture of both views, the elevation over x or y, whichever the plan is longer in.

    ``draw`` is called once for each view to get the extents, then once per panel.
    """
    _, (scratch,) = new_figure()
    wholes, focuses, remarks = dict[str, Extent](), dict[str, Extent](), dict[str, list[str]]()
    for seen in VIEWS:
        wholes[seen], focuses[seen], remarks[seen] = draw(scratch, seen)
    plan, focus = wholes["xy"], focuses["xy"]
    side = side_of(plan)
    close = focus.is_known and focus.span_m < _SMALL * plan.span_m
    size = (2 * _PANEL_IN[0] + 2.0, _PANEL_IN[1] * (1 + close))
    figure, panels = request.figure(1 + close, 2, size_in=size, title=title)
    legend = dict[str, Artist]()
    for number, axes in enumerate(panels):
        seen = ("xy", side)[number % 2]
        draw(axes, seen)
        extent = focuses[seen] if number > 1 else wholes[seen]
        finish_view(axes, seen, extent, square=number > 1, frame=frame)
        axes.set_title(("plan", "elevation")[number % 2] + (", close-up" if number > 1 else ""), fontsize=9)
        handles, words = axes.get_legend_handles_labels()
        for word, handle in zip(words, handles, strict=True):
            legend.setdefault(word, handle)
    figure.legend(list(legend.values()), list(legend), loc="outside right upper")
    return Picture(figure=figure, notes=list(dict.fromkeys([*remarks["xy"], *remarks[side]])))


def finish_view(
    axes: Axes, seen: str, extent: Extent, *, square: bool = False, frame: EarthFrame | None = None
) -> None:
    """Set limits, equal scales and labels of a view; places on earth have degrees in the plan alone."""
    finish_map(axes, extent, square=square, frame=frame if seen == "xy" else None)
    if seen != "xy":
        axes.set_xlabel(axes.get_xlabel().replace("x", seen[0]))
        axes.set_ylabel(axes.get_ylabel().replace("y", "z"))


def seen_reflectors(reflectors: Sequence[Reflector], seen: str) -> list[Reflector]:
    """Return the mirrors that are lines in a view, in its coordinates; spheres as their outline in an elevation."""
    right, up = coordinates(seen)
    shown: list[Reflector] = []
    for mirror in reflectors:
        if isinstance(mirror, PlaneReflector):
            point, normal = ((part[right], part[up]) for part in (mirror.point, mirror.normal))
            if mirror.normal[3 - right - up] == 0.0:
                shown.append(LineReflector(name=mirror.name, point=point, direction=(-normal[1], normal[0])))
        elif isinstance(mirror, SphereReflector):
            center, opaque = (mirror.center[right], mirror.center[up]), mirror.blocker_radius
            if seen != "xy":
                shown.append(
                    CircleReflector(name=mirror.name, center=center, radius=mirror.radius, blocker_radius=opaque)
                )
        elif seen == "xy":
            shown.append(mirror)
        elif isinstance(mirror, LineReflector | SegmentReflector) and mirror.direction[right] == 0.0:
            shown.append(LineReflector(name=mirror.name, point=(mirror.point[right], 0.0), direction=(0.0, 1.0)))
    return shown
