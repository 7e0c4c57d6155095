"""What a picture shows, as plain data: declared without matplotlib, drawn by `nlosctl.plotting.panel_drawing`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from nlosctl.arrays import FloatArray, IntArray

__all__ = [
    "BarsPanel",
    "CdfPanel",
    "HistogramPanel",
    "Line",
    "LinesPanel",
    "MapPanel",
    "Panel",
    "PointsPanel",
    "RegionsPanel",
]


@dataclass(frozen=True, kw_only=True)
class Line:
    """A labelled series ``x`` and ``y`` (N,), with half-lengths of error bars (N,); NaN leaves a gap.

    ``style`` numbers the styles of `nlosctl.plotting.figures`; its place in the panel unless given. A label that begins
    with ``_`` is not in the legend. ``marker`` false:
    the line alone, ``line`` false: the markers alone.
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
    """What all panels have: axis labels as ``quantity [unit]``, a title, and limits where the data don't set them.

    ``legend`` false: that of another panel holds. ``height`` is in units of the usual one; the largest counts.
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
    """Curves with error bars; ``references`` are labelled horizontal lines, such as a paper's number."""

    lines: tuple[Line, ...]
    log_x: bool = False
    log_y: bool = False
    references: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class PointsPanel(Panel):
    """Clouds of points, and ``outlines``: lines under them, such as walls."""

    points: tuple[Line, ...]
    outlines: tuple[Line, ...] = ()
    size_pt: float = 3.0


@dataclass(frozen=True, kw_only=True)
class RegionsPanel(Panel):
    """A map of categories: ``region`` (H, W) places in ``labels``, -1 is blank, at cell centres ``x`` and ``y``."""

    x: FloatArray
    y: FloatArray
    region: IntArray
    labels: tuple[str, ...]
    outlines: tuple[Line, ...] = ()


@dataclass(frozen=True, kw_only=True)
class MapPanel(Panel):
    """A map of values (H, W) at cell centres ``x`` (W,) and ``y`` (H,); ``label`` is the colour bar's."""

    x: FloatArray
    y: FloatArray
    values: FloatArray
    label: str
    log: bool = False
    contours: bool = True
    points: tuple[Line, ...] = ()


@dataclass(frozen=True, kw_only=True)
class CdfPanel(Panel):
    """Empirical distribution functions of labelled samples (N,)."""

    values: Mapping[str, FloatArray]
    log_x: bool = False


@dataclass(frozen=True, kw_only=True)
class HistogramPanel(Panel):
    """Histograms of labelled samples (N,), over common bins."""

    values: Mapping[str, FloatArray]
    bins: int | FloatArray = 40
    density: bool = True
    curves: tuple[Line, ...] = ()


@dataclass(frozen=True, kw_only=True)
class BarsPanel(Panel):
    """Groups of bars: ``values[label]`` (G,) over the ``groups``, with half-lengths of error bars; NaN: no bar.

    Side by side, or one upon the other where ``stacked``.
    """

    groups: tuple[str, ...]
    values: Mapping[str, FloatArray]
    errors: Mapping[str, FloatArray] = field(default_factory=dict)
    stacked: bool = False
    log_y: bool = False
