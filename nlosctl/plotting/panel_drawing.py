"""Drawing of panels that are declared as plain data (`nlosctl.plotting.panels`)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import singledispatch
from typing import Any

import numpy as np

from nlosctl.plotting.figures import figure_style, new_figure, series_style
from nlosctl.plotting.library import Axes, Figure, Patch
from nlosctl.plotting.maps import draw_map, draw_regions
from nlosctl.plotting.panels import BarsPanel, LinesPanel, MapPanel, Panel, PointsPanel, RegionsPanel
from nlosctl.plotting.series import draw_points, draw_series, place_legend

__all__ = ["draw_panels"]

_PANEL_IN = {1: (6.0, 4.2), 2: (5.0, 3.8), 3: (4.2, 3.4)}
"""Width and height of a panel by the number of panels in a row."""
_HATCHES = ("", "////", "||||", "\\\\\\\\", "xxxx", "----")

_ENTRIES_ABOVE_BARS = 3
"""Most entries of a legend that fit above the bars without hiding any."""


@figure_style()
def draw_panels(title: str, panels: Sequence[Panel]) -> Figure:
    """Return a figure with all panels, two per row, or three if that fills all rows.

    Panels with equal labels share one legend beside all of them, and so do point panels.
    """
    columns = 3 if len(panels) % 3 == 0 else min(len(panels), 2)
    rows = -(-len(panels) // columns)
    width, height = _PANEL_IN[columns]
    height *= max(panel.height for panel in panels)
    figure, grid = new_figure(rows, columns, width_in=width * columns, height_in=height * rows + 0.3, title=title)
    for axes, panel in zip(grid, panels, strict=False):
        _draw(panel, axes)
        _finish(panel, axes)
    for axes in grid[len(panels) :]:
        axes.set_axis_off()
    _add_legends(figure, grid[: len(panels)], panels)
    return figure


def _finish(panel: Panel, axes: Axes) -> None:
    axes.set_xlabel(panel.x_label)
    axes.set_ylabel(panel.y_label)
    axes.set_title(panel.title)
    if panel.x_range is not None:
        axes.set_xlim(*panel.x_range)
    if panel.y_range is not None:
        axes.set_ylim(*panel.y_range)
    if panel.equal_aspect:
        axes.set_aspect("equal")


def _add_legends(figure: Figure, grid: Sequence[Axes], panels: Sequence[Panel]) -> None:
    entries = [_entries(axes) for axes in grid]
    alike = len(panels) > 1 and len(entries[0]) > 1 and all(list(labels) == list(entries[0]) for labels in entries)
    if not alike and not all(isinstance(panel, PointsPanel) for panel in panels):
        for axes, panel, labels in zip(grid, panels, entries, strict=True):
            if panel.legend and len(labels) > 1 and not isinstance(panel, RegionsPanel):
                place_legend(axes, beside=isinstance(panel, BarsPanel) and len(labels) > _ENTRIES_ABOVE_BARS)
        return
    for legend in filter(None, (axes.get_legend() for axes in grid)):
        legend.remove()
    union = {label: handle for labels in entries for label, handle in labels.items()}
    figure.legend(union.values(), union.keys(), loc="outside right upper")


def _entries(axes: Axes) -> dict[str, Any]:
    """Return the legend's handles by label: patches of the panel's own legend, then what is drawn."""
    legend = axes.get_legend()
    patches: dict[str, Any] = {}
    if legend is not None:
        texts = [text.get_text() for text in legend.get_texts()]
        pairs = zip(texts, legend.legend_handles, strict=True)
        patches = {text: handle for text, handle in pairs if isinstance(handle, Patch)}
    handles, labels = axes.get_legend_handles_labels()
    return patches | dict(zip(labels, handles, strict=True))


@singledispatch
def _draw(panel: Panel, axes: Axes) -> None:
    raise TypeError(f"no picture of a {type(panel).__name__}")


@_draw.register
def _(panel: LinesPanel, axes: Axes) -> None:
    draw_series(axes, panel.lines, log_x=panel.log_x, log_y=panel.log_y, legend=False)


@_draw.register
def _(panel: PointsPanel, axes: Axes) -> None:
    draw_series(axes, panel.outlines, legend=False)
    draw_points(axes, panel.points, size_pt=panel.size_pt, legend=False)


@_draw.register
def _(panel: RegionsPanel, axes: Axes) -> None:
    draw_regions(axes, panel.x, panel.y, panel.region, panel.labels, equal_aspect=panel.equal_aspect)
    draw_series(axes, panel.outlines, legend=False)
    entries = _entries(axes)
    axes.legend(entries.values(), entries.keys(), loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)


@_draw.register
def _(panel: MapPanel, axes: Axes) -> None:
    draw_map(
        axes,
        panel.x,
        panel.y,
        panel.values,
        panel.label,
        log=panel.log,
        contours=panel.contours,
        equal_aspect=panel.equal_aspect,
    )
    if panel.points:
        axes.use_sticky_edges = False
        axes.margins(0.04)
        draw_points(axes, panel.points, size_pt=5.0, legend=False)


@_draw.register
def _(panel: BarsPanel, axes: Axes) -> None:
    count = max(len(panel.values), 1)
    width = 0.8 if panel.stacked else 0.8 / count
    center = np.arange(len(panel.groups), dtype=np.float64)
    base = np.zeros(center.shape)
    for number, (label, values) in enumerate(panel.values.items()):
        heights = np.nan_to_num(values)
        axes.bar(
            center if panel.stacked else center + (number - 0.5 * (count - 1)) * width,
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
    axes.set_xticks(center, panel.groups)
    if panel.log_y:
        axes.set_yscale("log")
    else:
        axes.margins(y=0.0 if panel.stacked else 0.3)
