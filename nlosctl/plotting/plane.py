"""Maps of the plane: their extent, axes in metres or kilometres, the scene's mirrors and sensors, error ellipses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import CircleReflector, EarthFrame, LineReflector, Reflector, Scene, SegmentReflector
from nlosctl.geometry.ellipses import ellipse_threshold, error_ellipse
from nlosctl.geometry.symmetric import Symmetric2x2
from nlosctl.plotting.earth_axes import draw_earth_axes
from nlosctl.plotting.figures import SeriesStyle, axis_label
from nlosctl.plotting.library import Annotation, Axes, Circle, Ellipse, FuncFormatter
from nlosctl.plotting.texts import plain

__all__ = [
    "Extent",
    "annotate_points",
    "draw_ellipses",
    "draw_reflectors",
    "draw_sensors",
    "draw_sensors_of_map",
    "finish_map",
    "legend_once",
    "scene_sensors",
    "set_map_limits",
]

_MARGIN, _MAP_MARGIN = 0.08, 0.04
_FLATTEST = 0.45
_MOST_NAMES = 15
_MOST_SENSORS = 50
_KILOMETRES_FROM_M = 20e3
_FRAMED = 1.0 + 2.0 * _MARGIN
_MIRROR_COLOR = "#606060"
_NAME = "sensor name"
_NEAR_EDGE = 0.85
_NAMES_AT_ONE_POINT = 4


class Extent:
    """Bounding box of everything that must be in view; points that are not finite are ignored."""

    def __init__(self) -> None:
        self.low, self.high = np.full(2, np.inf), np.full(2, -np.inf)

    def include(self, points_m: FloatArray, radius_m: FloatArray | float = 0.0) -> None:
        """Include points (N, 2) and their surroundings up to ``radius_m``, a number or (N, 2) by axis."""
        radius = np.broadcast_to(np.asarray(radius_m, dtype=np.float64), points_m.shape)
        good = np.isfinite(points_m).all(axis=1) & np.isfinite(radius).all(axis=1)
        if good.any():
            self.low = np.minimum(self.low, (points_m - radius)[good].min(axis=0))
            self.high = np.maximum(self.high, (points_m + radius)[good].max(axis=0))

    def include_extent(self, other: Extent) -> None:
        """Include another box."""
        self.include(np.stack([other.low, other.high]))

    @property
    def is_known(self) -> bool:
        """Whether the box includes any point."""
        return bool(np.isfinite(self.low).all())

    @property
    def span_m(self) -> float:
        """The longer side; 1 for a box without extent."""
        span = float(np.max(self.high - self.low))
        return span if np.isfinite(span) and span > 0.0 else 1.0

    def framed(self, *, square: bool = False) -> tuple[FloatArray, FloatArray]:
        """Return the lower and upper corner with a margin; very flat boxes become less flat, or ``square``."""
        if not self.is_known:
            return np.array([-1.0, -1.0]), np.array([1.0, 1.0])
        center, half = 0.5 * (self.low + self.high), 0.5 * (self.high - self.low)
        half = (1.0 + 2.0 * _MARGIN) * np.maximum(half, 0.5 * (1.0 if square else _FLATTEST) * self.span_m)
        return center - half, center + half


def finish_map(axes: Axes, extent: Extent, *, square: bool = False, frame: EarthFrame | None = None) -> None:
    """Set limits, equal scales, and labels in metres or kilometres by the size, or in degrees with a ``frame``."""
    low, high = extent.framed(square=square)
    set_map_limits(axes, low, high, frame)


def set_map_limits(axes: Axes, low: FloatArray, high: FloatArray, frame: EarthFrame | None = None) -> None:
    """Set the corners of a map, with equal scales and labels as by `finish_map`."""
    axes.set_xlim(low[0], high[0])
    axes.set_ylim(low[1], high[1])
    axes.set_aspect("equal")
    axes.locator_params(axis="x", nbins=6)
    kilometres = float(np.max(high - low)) >= _KILOMETRES_FROM_M * _FRAMED
    axes.set_xlabel(axis_label("x", "km" if kilometres else "m"))
    axes.set_ylabel(axis_label("y", "km" if kilometres else "m"))
    if kilometres:
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / 1e3:g}"))
    else:
        axes.ticklabel_format(useOffset=False, style="plain")
    if frame is not None:
        draw_earth_axes(axes, frame)
    _turn_names(axes, low, high)


def _turn_names(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    """Put the names near the right or the upper edge on the other side of their points."""
    for text in axes.texts:
        if not isinstance(text, Annotation) or text.get_gid() != _NAME:
            continue
        share = (np.array(text.xy) - low) / (high - low)
        right, upper = share[0] > _NEAR_EDGE, share[1] > _NEAR_EDGE
        text.set_horizontalalignment("right" if right else "left")
        text.set_verticalalignment("top" if upper else "baseline")
        text.set_position((-5.0 if right else 5.0, -4.0 if upper else 4.0))


def draw_reflectors(axes: Axes, reflectors: Sequence[Reflector]) -> None:
    """Draw mirrors as thick grey lines and opaque circles hatched, each kind once in the legend."""
    labels: set[str] = set()
    for reflector in reflectors:
        if isinstance(reflector, CircleReflector):
            outline = Circle(reflector.center, reflector.radius, fill=False, edgecolor=_MIRROR_COLOR, linewidth=2.0)
            axes.add_patch(outline).set_zorder(1.2)
            axes.plot([], [], color=_MIRROR_COLOR, linewidth=2.0, label=legend_once(labels, "mirror"))
            if reflector.blocker_radius is not None:
                axes.add_patch(
                    Circle(
                        reflector.center,
                        reflector.blocker_radius,
                        facecolor="#eeeeee",
                        edgecolor="#a0a0a0",
                        hatch="...",
                        zorder=0.6,
                        label=legend_once(labels, "opaque"),
                    )
                )
        elif isinstance(reflector, SegmentReflector):
            ends = np.array([reflector.start, reflector.end])
            axes.plot(
                *ends.T,
                color=_MIRROR_COLOR,
                linewidth=2.4,
                solid_capstyle="butt",
                label=legend_once(labels, "mirror"),
                zorder=1.2,
            )
        elif isinstance(reflector, LineReflector):
            second = np.add(reflector.point, reflector.direction)
            axes.axline(
                reflector.point,
                (float(second[0]), float(second[1])),
                color=_MIRROR_COLOR,
                linewidth=2.0,
                label=legend_once(labels, "mirror"),
                zorder=1.2,
            )


def legend_once(labels: set[str], label: str) -> str:
    """Return ``label`` and add it to ``labels``; return a label outside the legend if it was in ``labels``."""
    shown = "_nolegend_" if label in labels else label
    labels.add(label)
    return shown


def draw_sensors(axes: Axes, names: Sequence[str], position_m: FloatArray, *, label: str = "sensor") -> None:
    """Draw sensors (N, 2) as triangles, with their names if they are few."""
    size = 6.5 if len(names) <= _MOST_SENSORS else 3.0
    axes.plot(*position_m.T, linestyle="none", marker="^", markersize=size, color="black", label=label, zorder=4.0)
    annotate_points(axes, names, position_m)


def draw_sensors_of_map(
    axes: Axes,
    names: Sequence[str],
    sensors: FloatArray,
    edges: tuple[FloatArray, FloatArray],
    frame: EarthFrame | None,
) -> None:
    """Draw the sensors within a map (its cells' edges along x and y) or near it, and set the limits to show both."""
    first, last = (np.array([edge[end] for edge in edges]) for end in (0, -1))
    low, high = first, last
    close = np.flatnonzero(((sensors >= 2.0 * low - high) & (sensors <= 2.0 * high - low)).all(axis=1))
    if close.size:
        draw_sensors(axes, [names[index] for index in close.tolist()], sensors[close])
        low, high = np.minimum(low, sensors[close].min(axis=0)), np.maximum(high, sensors[close].max(axis=0))
        beyond = np.where((low < first) | (high > last), _MAP_MARGIN * (high - low), 0.0)
        low, high = low - beyond, high + beyond
    set_map_limits(axes, low, high, frame)


def annotate_points(axes: Axes, names: Sequence[str], position_m: FloatArray) -> None:
    """Write names beside points (N, 2), if there are few: those at one point in one text."""
    at: dict[tuple[float, float], list[str]] = {}
    for name, position in zip(names, position_m.tolist(), strict=True):
        at.setdefault((position[0], position[1]), []).append(plain(name))
    if len(at) > _MOST_NAMES:
        return
    for point, here in at.items():
        more = f", +{len(here) - _NAMES_AT_ONE_POINT}" if len(here) > _NAMES_AT_ONE_POINT else ""
        axes.annotate(
            ", ".join(here[:_NAMES_AT_ONE_POINT]) + more,
            point,
            xytext=(5, 4),
            textcoords="offset points",
            fontsize=7.5,
            zorder=4.5,
            gid=_NAME,
            annotation_clip=True,
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
    degrees: FloatArray | None = None,
) -> int:
    """Draw ellipses that contain ``share`` of Gaussian errors, include them in ``extent``, and return their number.

    ``position_m`` (N, 2), ``covariance_m2`` (N, 3) as xx, xy, yy; rows that are not finite have no ellipse.
    ``degrees`` (N,) of freedom of estimated standard deviations, as in `ellipse_threshold`.
    """
    ellipse = error_ellipse(Symmetric2x2(*covariance_m2.T))
    scale = np.broadcast_to(np.sqrt(ellipse_threshold(share, degrees)), position_m.shape[:1])
    reach = scale[:, None] * np.sqrt(np.maximum(covariance_m2[:, [0, 2]], 0.0))
    rows = np.flatnonzero(np.isfinite(ellipse.semi_major_m) & np.isfinite(position_m).all(axis=1))
    for row in rows:
        axes.add_patch(
            Ellipse(
                (float(position_m[row, 0]), float(position_m[row, 1])),
                2.0 * float(scale[row] * ellipse.semi_major_m[row]),
                2.0 * float(scale[row] * ellipse.semi_minor_m[row]),
                angle=float(np.degrees(ellipse.orientation_rad[row])),
                fill=False,
                edgecolor=look.color,
                linestyle=look.line,
                linewidth=1.2,
                zorder=3.2,
            )
        )
        extent.include(position_m[row][None], reach[row][None])
    return int(rows.size)
