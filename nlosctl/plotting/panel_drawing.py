"""Pictures of panels that were declared as plain data."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch

import numpy as np

from nlosctl.plotting.figures import figure_style, new_figure, series_style
from nlosctl.plotting.library import Axes, Figure
from nlosctl.plotting.maps import draw_map, draw_regions
from nlosctl.plotting.panels import (
    BarsPanel,
    CdfPanel,
    HistogramPanel,
    Line,
    LinesPanel,
    MapPanel,
    Panel,
    PointsPanel,
    RegionsPanel,
)
from nlosctl.plotting.series import (
    Series,
    draw_cdf,
    draw_histogram,
    draw_points,
    draw_reference_lines,
    draw_series,
    place_legend,
)

__all__ = ["draw_panels"]

_PANEL_IN = (5.0, 3.8)
_IN_A_ROW = 2


def draw_panels(title: str, panels: Sequence[Panel]) -> Figure:
    """Return a figure with all panels, two in a row."""
    columns = min(len(panels), _IN_A_ROW)
    rows = -(-len(panels) // columns)
    width, height = _PANEL_IN
    figure, places = new_figure(rows, columns, width_in=width * columns, height_in=height * rows + 0.3, title=title)
    for place, panel in zip(places, panels, strict=False):
        _draw(panel, place)
        _finish(panel, place)
    for place in places[len(panels) :]:
        place.set_axis_off()
    return figure


@figure_style()
def _finish(panel: Panel, axes: Axes) -> None:
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title)
    if panel.equal_aspect:
        axes.set_aspect("equal")


@singledispatch
def _draw(panel: Panel, axes: Axes) -> None:
    raise TypeError(f"no picture of a {type(panel).__name__}")


@_draw.register
def _(panel: LinesPanel, axes: Axes) -> None:
    draw_series(axes, _series(panel.lines), log_x=panel.log_x, log_y=panel.log_y)
    draw_reference_lines(axes, panel.references)


@_draw.register
def _(panel: PointsPanel, axes: Axes) -> None:
    _outlines(axes, panel.outlines)
    draw_points(axes, _series(panel.points), size_pt=panel.size_pt, legend=False)
    place_legend(axes)


@_draw.register
def _(panel: RegionsPanel, axes: Axes) -> None:
    draw_regions(axes, panel.x, panel.y, panel.region, panel.labels, equal_aspect=panel.equal_aspect)
    _outlines(axes, panel.outlines)


@_draw.register
def _(panel: MapPanel, axes: Axes) -> None:
    draw_map(axes, panel.x, panel.y, panel.values, panel.label, log=panel.log, equal_aspect=panel.equal_aspect)
    draw_points(axes, _series(panel.points), size_pt=5.0, legend=False)


@_draw.register
def _(panel: CdfPanel, axes: Axes) -> None:
    draw_cdf(axes, panel.values, log_x=panel.log_x)


@_draw.register
def _(panel: HistogramPanel, axes: Axes) -> None:
    draw_histogram(axes, panel.values, bins=panel.bins, density=panel.density, legend=False)
    draw_series(axes, _series(panel.curves), legend=False)
    place_legend(axes)


@_draw.register
def _(panel: BarsPanel, axes: Axes) -> None:
    width = 0.8 / max(len(panel.values), 1)
    place = np.arange(len(panel.groups), dtype=np.float64)
    hatches = ("", "////", "....", "\\\\\\\\", "xxxx", "----")
    with figure_style():
        for number, (label, heights) in enumerate(panel.values.items()):
            axes.bar(
                place + (number - 0.5 * (len(panel.values) - 1)) * width,
                heights,
                width,
                yerr=panel.errors.get(label),
                label=label,
                color=series_style(number).color,
                hatch=hatches[number % len(hatches)],
                edgecolor="white",
                error_kw={"elinewidth": 0.8, "ecolor": "#404040"},
            )
        axes.set_xticks(place, panel.groups)
    place_legend(axes)


def _outlines(axes: Axes, lines: Sequence[Line]) -> None:
    draw_series(axes, _series(lines), legend=False)


def _series(lines: Sequence[Line]) -> list[Series]:
    return [Series(**vars(line)) for line in lines]
