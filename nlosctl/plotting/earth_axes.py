"""Maps of places on the earth: latitudes and longitudes at the ticks, the direction of north, and a scale bar."""

from __future__ import annotations

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import EarthFrame
from nlosctl.io.scenes.scene_file import plane_of
from nlosctl.plotting.library import Axes, FixedFormatter, FixedLocator, MaxNLocator, ScaledTranslation

__all__ = ["draw_earth_axes"]

_SAMPLES = 101
_NORTH_PT = np.array([16.0, -18.0])
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


def draw_earth_axes(axes: Axes, frame: EarthFrame) -> None:
    """Replace the metres at the ticks by longitudes along the lower edge and latitudes along the left one.

    The limits of the panel must be final. Nothing changes where an edge is off the earth or crosses the 180th meridian.
    """
    plane = plane_of(frame)
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    along_x, along_y = np.linspace(left, right, _SAMPLES), np.linspace(bottom, top, _SAMPLES)
    lon = plane.to_earth(along_x, np.full(_SAMPLES, bottom))[1]
    lat = plane.to_earth(np.full(_SAMPLES, left), along_y)[0]
    if not (_is_monotonic(lon) and _is_monotonic(lat)):
        return
    _label_degrees(axes, "x", along_x, lon, "EW")
    _label_degrees(axes, "y", along_y, lat, "NS")
    center = np.array([0.5 * (left + right)]), np.array([0.5 * (bottom + top)])
    _draw_north(axes, float(plane.north_rad(*center)[0]))
    _draw_scale(axes, right - left)


def _is_monotonic(degrees: FloatArray) -> bool:
    step = np.diff(degrees)
    return bool((step > 0.0).all() or (step < 0.0).all())


def _label_degrees(axes: Axes, name: str, position: FloatArray, degrees: FloatArray, letters: str) -> None:
    low, high = sorted((float(degrees[0]), float(degrees[-1])))
    ticks = np.asarray(MaxNLocator(5, steps=_STEPS).tick_values(low, high))
    ticks = ticks[(ticks >= low) & (ticks <= high)]
    digits = max(0, int(np.ceil(-np.log10(float(np.min(np.diff(ticks))) * 1.001)))) if ticks.size > 1 else 4
    digits = next(
        (more for more in range(digits, digits + 3) if np.allclose(np.round(ticks, more), ticks, 0, 1e-12)), 7
    )
    order = np.argsort(degrees)
    where = np.interp(ticks, degrees[order], position[order])
    labels = [f"{abs(tick):.{digits}f}° {letters[int(tick < 0.0)]}" for tick in ticks]
    axis = axes.xaxis if name == "x" else axes.yaxis
    axis.set_major_locator(FixedLocator(where.tolist()))
    axis.set_major_formatter(FixedFormatter(labels))
    axis.set_label_text("longitude" if name == "x" else "latitude")


def _draw_north(axes: Axes, direction_rad: float) -> None:
    """Draw an arrow to true north in the upper left corner: its foot is the letter N."""
    half = 9.0 * np.array([np.cos(direction_rad), np.sin(direction_rad)])
    tip, foot = (
        axes.transAxes + ScaledTranslation(float(x) / 72.0, float(y) / 72.0, axes.figure.dpi_scale_trans)
        for x, y in (_NORTH_PT + half, _NORTH_PT - half)
    )
    axes.annotate(
        "N",
        xy=(0.0, 1.0),
        xycoords=tip,
        xytext=(0.0, 1.0),
        textcoords=foot,
        ha="center",
        va="center",
        fontsize=8.0,
        zorder=5.0,
        arrowprops={"arrowstyle": "-|>", "color": "black", "linewidth": 1.0, "shrinkA": 4.0, "shrinkB": 0.0},
    )


def _draw_scale(axes: Axes, width_m: float) -> None:
    """Draw a bar of a round length in the lower right corner."""
    length = 10.0 ** np.floor(np.log10(0.3 * width_m))
    length *= next(step for step in (5.0, 2.0, 1.0) if step * length <= 0.3 * width_m)
    text = f"{length / 1e3:g} km" if length >= 1e3 else f"{length:g} m"
    share = float(length / width_m)
    axes.plot([0.97 - share, 0.97], [0.03, 0.03], transform=axes.transAxes, color="black", linewidth=2.0, zorder=5.0)
    axes.annotate(
        text,
        (0.97 - 0.5 * share, 0.035),
        xycoords="axes fraction",
        ha="center",
        va="bottom",
        fontsize=7.0,
        zorder=5.0,
        bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4},
    )
