"""Arrivals of one snapshot as hyperbolas: the points of each row's difference to the arrival at a reference."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import EarthFrame
from nlosctl.io.results.plotted_rows import Differences
from nlosctl.io.scenes.places import errors_in, from_tangent_plane
from nlosctl.models.sections import hyperbola_sections
from nlosctl.plotting.library import Axes, Polygon
from nlosctl.plotting.views.many_rows import MANY_ROWS
from nlosctl.plotting.views.measured_rows import ROW_LOOKS, draw_row_curves, without_std
from nlosctl.plotting.views.two_views import across

__all__ = ["draw_hyperbolas", "draw_hyperbolas_on_earth"]

_WITHIN = 1.0 - 1e-9
"""Share of the baseline to which the ends of +-1 std are limited: there the hyperbola becomes a ray."""


def draw_hyperbolas(
    axes: Axes,
    found: Differences,
    reach_m: float,
    seen: str = "xy",
    depth_m: float = 0.0,
    *,
    bands: bool = True,
    to_map: Callable[[FloatArray], FloatArray] = np.asarray,
) -> list[str]:
    """Draw every difference in the coordinates ``seen``, as far as ``reach_m``; return notes on what is not drawn.

    In space the curves are the sections of the hyperboloids at ``depth_m``, the third coordinate. ``bands`` of +-1
    standard deviation are those of few rows. ``to_map`` converts points (..., 2) to those of the map.
    """
    order = ["xyz".index(axis) for axis in (*seen, across(seen))]
    flat = np.zeros((found.difference_m.size, 3 - found.sensor_m.shape[1]))
    ends = [np.concatenate([part, flat], axis=1)[:, order] for part in (found.sensor_m, found.reference_m)]

    def sections(stds: float) -> FloatArray:
        limit = _WITHIN * found.baseline_m
        moved = np.clip(found.difference_m + stds * found.std_m, -limit, limit) if stds else found.difference_m
        return to_map(hyperbola_sections(ends[0], ends[1], moved, depth_m, reach_m))

    curves, many = sections(0.0), found.difference_m.size > MANY_ROWS
    exists = np.asarray(np.isfinite(curves).all(axis=(1, 2)))
    bands = bands and not many
    if bands:
        _draw_bands(axes, found.kind, sections(-1.0), sections(1.0))
    for kind, look in ROW_LOOKS.items():
        label = (look.label if bands else without_std(look.label)).replace("bearing", "hyperbola")
        draw_row_curves(axes, list(curves[(found.kind == kind) & exists]), look, label, faint=many)
    axes.plot(
        *to_map(np.unique(ends[1][:, :2], axis=0)).T,
        linestyle="none",
        marker="o",
        markersize=11.0,
        color="black",
        markerfacecolor="none",
        label="reference of differences",
        zorder=4.0,
    )
    return _notes(found, exists)


def _draw_bands(axes: Axes, kinds: npt.NDArray[np.object_], low: FloatArray, high: FloatArray) -> None:
    """Draw the areas between two curves (N, P, 2) of each row."""
    for kind, *edges in zip(kinds, low, high, strict=True):
        color = ROW_LOOKS[kind].color
        if ROW_LOOKS[kind].wedge and np.isfinite(edges).all():
            outline = np.concatenate([edges[0], edges[1][::-1]])
            axes.add_patch(Polygon(outline, closed=True, facecolor=color, alpha=0.13, edgecolor="none", zorder=1.8))


def draw_hyperbolas_on_earth(
    axes: Axes, found: Differences, reach_m: float, frame: EarthFrame, place_m: FloatArray
) -> list[str]:
    """Draw every difference among places on the ellipsoid, in the horizontal plane of one at a height; return notes.

    ``place_m`` (3,) is x, y of the map and the height.
    """
    at = np.broadcast_to(place_m, found.sensor_m.shape)
    sensor, reference = (-errors_in(frame, at, part) for part in (found.sensor_m, found.reference_m))
    local = replace(found, sensor_m=sensor, reference_m=reference)
    notes = draw_hyperbolas(axes, local, reach_m, to_map=partial(from_tangent_plane, frame, place_m))
    return [*notes, f"the hyperbolas are in the horizontal plane of an estimate, at a height of {place_m[2]:.6g} m"]


def _notes(found: Differences, exists: npt.NDArray[np.bool_]) -> list[str]:
    count, notes = found.difference_m.size, []
    longer = np.abs(found.difference_m) >= found.baseline_m
    if longer.any():
        notes.append(
            f"{np.count_nonzero(longer)} of {count} differences are longer than the distance of their sensors: no "
            "hyperbola"
        )
    if (~exists & ~longer).any():
        notes.append(f"{np.count_nonzero(~exists & ~longer)} of {count} hyperboloids do not cross the plane drawn")
    return notes
