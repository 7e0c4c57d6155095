"""The plane that a map shows: what must be in view, axes in metres or kilometres, the scene's mirrors and sensors."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import CircleReflector, Reflector, Scene, SegmentReflector
from nlosctl.evaluation.consistency import ellipse_threshold
from nlosctl.geometry.error_ellipses import error_ellipse
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.plotting.figures import SeriesStyle, axis_label
from nlosctl.plotting.library import Axes, Circle, Ellipse, FuncFormatter

__all__ = ["Extent", "draw_ellipses", "draw_reflectors", "draw_sensors", "finish_map", "scene_sensors"]


_MARGIN = 0.08
_FLATTEST = 0.45
_MOST_NAMES = 15
_KILOMETRES_FROM_M = 20e3
_MIRROR_COLOR = "#606060"


class Extent:
    """The box of all that must be in view; points that are not finite take no part."""

    def __init__(self) -> None:
        self.low, self.high = np.full(2, np.inf), np.full(2, -np.inf)

    def include(self, points_m: FloatArray, radius_m: FloatArray | float = 0.0) -> None:
        """Put points (N, 2) into view, with what is within ``radius_m`` (a number, or (N, 2) by axis) about them."""
        radius = np.broadcast_to(np.asarray(radius_m, dtype=np.float64), points_m.shape)
        good = np.isfinite(points_m).all(axis=1) & np.isfinite(radius).all(axis=1)
        if good.any():
            self.low = np.minimum(self.low, (points_m - radius)[good].min(axis=0))
            self.high = np.maximum(self.high, (points_m + radius)[good].max(axis=0))

    def include_all(self, other: Extent) -> None:
        """Put all that another box has into view."""
        self.include(np.stack([other.low, other.high]))

    @property
    def is_known(self) -> bool:
        """Whether anything is to be seen."""
        return bool(np.isfinite(self.low).all())

    @property
    def span_m(self) -> float:
        """The larger side; 1 where there is nothing to see."""
        span = float(np.max(self.high - self.low))
        return span if np.isfinite(span) and span > 0.0 else 1.0

    def framed(self, *, square: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return the corners with a margin, the shorter side lengthened where the box is very flat, or to a square."""
        if not self.is_known:
            return np.array([-1.0, -1.0]), np.array([1.0, 1.0])
        center, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        half = (1.0 + 2.0 * _MARGIN) * np.maximum(half, 0.5 * (1.0 if square else _FLATTEST) * self.span_m)
        return center - half, center + half


def finish_map(axes: Axes, extent: Extent, *, square: bool = False) -> None:
    """Set the limits, equal scales, and labels with the unit that suits the size."""
    low, high = extent.framed(square=square)
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.locator_params(axis="x", nbins=6)
    kilometres = extent.span_m >= _KILOMETRES_FROM_M
    axes.set_xlabel(axis_label("x", "km" if kilometres else "m"))
    axes.set_ylabel(axis_label("y", "km" if kilometres else "m"))
    if kilometres:
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1e3:g}"))
    else:
        axes.ticklabel_format(useOffset=False, style="plain")


def draw_reflectors(axes: Axes, reflectors: Sequence[Reflector]) -> None:
    """Draw mirrors as thick grey lines, opaque circles hatched; the first of each is in the legend."""
    told: set[str] = set()

    def once(label: str) -> str:
        new = "_nolegend_" if label in told else label
        told.add(label)
        return new

    for reflector in reflectors:
        if isinstance(reflector, CircleReflector):
            outline = Circle(reflector.center, reflector.radius, fill=False, edgecolor=_MIRROR_COLOR, linewidth=2.0)
            axes.add_patch(outline).set_zorder(1.2)
            axes.plot([], [], color=_MIRROR_COLOR, linewidth=2.0, label=once("mirror"))
            if reflector.blocker_radius is not None:
                axes.add_patch(
                    Circle(
                        reflector.center,
                        reflector.blocker_radius,
                        facecolor="#eeeeee",
                        edgecolor="#a0a0a0",
                        hatch="...",
                        zorder=0.6,
                        label=once("opaque"),
                    )
                )
        elif isinstance(reflector, SegmentReflector):
            ends = np.array([reflector.start, reflector.end])
            axes.plot(
                *ends.T, color=_MIRROR_COLOR, linewidth=2.4, solid_capstyle="butt", label=once("mirror"), zorder=1.2
            )
        else:
            second = np.add(reflector.point, reflector.direction)
            axes.axline(
                reflector.point,
                (float(second[0]), float(second[1])),
                color=_MIRROR_COLOR,
                linewidth=2.0,
                label=once("mirror"),
                zorder=1.2,
            )


def draw_sensors(axes: Axes, names: Sequence[str], position_m: FloatArray, *, label: str = "sensor") -> None:
    """Draw sensors (N, 2) as triangles, with their names where they are few."""
    axes.plot(*position_m.T, linestyle="none", marker="^", markersize=6.5, color="black", label=label, zorder=4.0)
    if len(names) > _MOST_NAMES:
        return
    for name, place in zip(names, position_m, strict=True):
        axes.annotate(
            str(name),
            (float(place[0]), float(place[1])),
            xytext=(5, 4),
            textcoords="offset points",
            fontsize=7.5,
            zorder=4.5,
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.4},
        )


def scene_sensors(scene: Scene) -> tuple[list[str], FloatArray]:
    """Return the names and positions (N, 2) of a scene's sensors."""
    positions = np.array([sensor.position for sensor in scene.sensors], dtype=np.float64).reshape(-1, 2)
    return [sensor.name for sensor in scene.sensors], positions


def draw_ellipses(
    axes: Axes,
    position_m: FloatArray,
    covariance_m2: FloatArray,
    look: SeriesStyle,
    extent: Extent,
    share: float = 0.95,
) -> int:
    """Draw the ellipses that hold ``share`` of Gaussian errors, put them into view, and return how many there are.

    ``position_m`` (N, 2), ``covariance_m2`` (N, 3) as xx, xy, yy; none where either is not finite.
    """
    ellipse = error_ellipse(Symmetric2x2(*covariance_m2.T))
    scale = np.sqrt(ellipse_threshold(share))
    reach = scale * np.sqrt(np.maximum(covariance_m2[:, [0, 2]], 0.0))
    drawn = 0
    for place in np.flatnonzero(np.isfinite(ellipse.semi_major_m) & np.isfinite(position_m).all(axis=1)):
        axes.add_patch(
            Ellipse(
                (float(position_m[place, 0]), float(position_m[place, 1])),
                2.0 * scale * float(ellipse.semi_major_m[place]),
                2.0 * scale * float(ellipse.semi_minor_m[place]),
                angle=float(np.degrees(ellipse.orientation_rad[place])),
                fill=False,
                edgecolor=look.color,
                linestyle=look.line,
                linewidth=1.2,
                zorder=3.2,
            )
        )
        extent.include(position_m[place][None], reach[place][None])
        drawn += 1
    return drawn
