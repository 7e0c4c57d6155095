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
_NARROW_PANEL_IN = (3.7, 3.2)
_HATCHES = ("", "////", "||||", "\\\\\\\\", "xxxx", "----")


@figure_style()
def draw_panels(title: str, panels: Sequence[Panel]) -> Figure:
    """Return a figure with all panels, two in a row, or three narrower ones where that fills all rows."""
    columns = 3 if len(panels) % 3 == 0 else min(len(panels), 2)
    rows = -(-len(panels) // columns)
    width, height = _NARROW_PANEL_IN if columns == 3 else _PANEL_IN
    height *= max(panel.height for panel in panels)
    figure, places = new_figure(rows, columns, width_in=width * columns, height_in=height * rows + 0.3, title=title)
    for place, panel in zip(places, panels, strict=False):
        _draw(panel, place)
        _finish(panel, place)
    for place in places[len(panels) :]:
        place.set_axis_off()
    return figure


def _finish(panel: Panel, axes: Axes) -> None:
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title)
    if panel.equal_aspect:
        axes.set_aspect("equal")
    legend = axes.get_legend()
    if legend is not None and not panel.legend:
        legend.remove()


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
    areas = axes.get_legend()
    _outlines(axes, panel.outlines)
    lines, _ = axes.get_legend_handles_labels()
    if areas is not None and lines:
        handles = [*areas.legend_handles, *lines]
        axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


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
    count = max(len(panel.values), 1)
    width = 0.8 if panel.stacked else 0.8 / count
    place = np.arange(len(panel.groups), dtype=np.float64)
    base = np.zeros(place.shape)
    for number, (label, values) in enumerate(panel.values.items()):
        heights = np.nan_to_num(values)
        axes.bar(
            place if panel.stacked else place + (number - 0.5 * (count - 1)) * width,
            heights,
            width,
            bottom=base if panel.stacked else 0.0,
            yerr=panel.errors.get(label),
            label=label,
            color=series_style(number).color,
            hatch=_HATCHES[number % len(_HATCHES)],
            edgecolor="white",
            error_kw={"elinewidth": 0.8, "ecolor": "#404040"},
        )
        base = base + heights
    axes.set_xticks(place, panel.groups)
    if panel.stacked:
        axes.margins(y=0.0)
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0, reverse=True)
    elif panel.log_y:
        axes.set_yscale("log")
        place_legend(axes)
    else:
        axes.margins(y=0.3)
        place_legend(axes)


def _outlines(axes: Axes, lines: Sequence[Line]) -> None:
    draw_series(axes, _series(lines), legend=False)


def _series(lines: Sequence[Line]) -> list[Series]:
    return [Series(**vars(line)) for line in lines]
