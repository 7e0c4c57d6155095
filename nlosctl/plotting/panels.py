"""Panels of a picture as plain data: declared without matplotlib, drawn by `nlosctl.plotting.panel_drawing`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from nlosctl.arrays import FloatArray, IntArray

__all__ = ["BarsPanel", "LinesPanel", "MapPanel", "Panel", "PointsPanel", "RegionsPanel", "Series"]


@dataclass(frozen=True, kw_only=True)
class Series:
    """A labelled series ``x`` and ``y`` (N,), with half-lengths ``error`` (N,) of error bars; NaN leaves a gap.

    ``style`` is a number for `nlosctl.plotting.figures.series_style`; default: the index in the panel. A label that
    starts with ``_`` is not in the legend. Without ``marker`` only the line is drawn, without ``line`` only markers.
    """

    label: str
    x: FloatArray
    y: FloatArray
    error: FloatArray | None = None
    style: int | None = None
    line: bool = True
    marker: bool = True


@dataclass(frozen=True, kw_only=True)
class Panel:
    """Common settings: axis labels as ``quantity [unit]``, a title, and limits (default: from the data).

    Without ``legend`` the panel uses that of another panel. ``height`` is relative to the default; the largest of all
    panels applies.
    """

    x_label: str = ""
    y_label: str = ""
    title: str = ""
    equal_aspect: bool = False
    x_range: tuple[float, float] | None = None
    y_range: tuple[float, float] | None = None
    legend: bool = True
    height: float = 1.0


@dataclass(frozen=True, kw_only=True)
class LinesPanel(Panel):
    """Curves with error bars."""

    lines: tuple[Series, ...]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True, kw_only=True)
class PointsPanel(Panel):
    """Point clouds, over ``outlines`` such as walls."""

    points: tuple[Series, ...]
    outlines: tuple[Series, ...] = ()
    size_pt: float = 3.0


@dataclass(frozen=True, kw_only=True)
class RegionsPanel(Panel):
    """A map of categories at cell centres ``x`` (W,), ``y`` (H,): ``region`` (H, W) indexes ``labels``, -1 is blank."""

    x: FloatArray
    y: FloatArray
    region: IntArray
    labels: tuple[str, ...]
    outlines: tuple[Series, ...] = ()


@dataclass(frozen=True, kw_only=True)
class MapPanel(Panel):
    """A map of values (H, W) at cell centres ``x`` (W,), ``y`` (H,); ``label`` is that of the colour bar."""

    x: FloatArray
    y: FloatArray
    values: FloatArray
    label: str
    log: bool = False
    contours: bool = True
    points: tuple[Series, ...] = ()


@dataclass(frozen=True, kw_only=True)
class BarsPanel(Panel):
    """Groups of bars, side by side or ``stacked``: ``values[label]`` (G,) over the ``groups``; NaN: no bar.

    ``errors[label]`` (G,) are half-lengths of error bars.
    """

    groups: tuple[str, ...]
    values: Mapping[str, FloatArray]
    errors: Mapping[str, FloatArray] = field(default_factory=dict)
    stacked: bool = False
    log_y: bool = False
