"""A map of one snapshot, with a close-up beside it if the estimates are small on the map."""

from __future__ import annotations

from collections.abc import Callable

from nlosctl.contract.scene import EarthFrame
from nlosctl.plotting.figures import new_figure
from nlosctl.plotting.library import Axes, Rectangle
from nlosctl.plotting.plane import Extent, finish_map
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.series import place_legend

__all__ = ["DrawLayers", "draw_with_close_up", "map_size_in"]

DrawLayers = Callable[[Axes], tuple[Extent, Extent, list[str]]]
"""Draws everything into a panel; returns the extent of the map, the extent of a close-up, and notes."""

_SMALL = 0.16
_PANEL_IN, _TALLEST_IN, _LEGEND_IN, _FRAME_IN, _BESIDE_IN = 4.6, 5.2, 2.6, 0.95, 0.75


def draw_with_close_up(request: PlotRequest, draw: DrawLayers, title: str, frame: EarthFrame | None = None) -> Picture:
    """Return the picture that ``draw`` draws; it is called once to get the extents, then once per panel."""
    _, (scratch,) = new_figure()
    extent, focus, notes = draw(scratch)
    close = focus.is_known and focus.span_m < _SMALL * extent.span_m
    width, height = map_size_in(extent)
    side = height - _FRAME_IN
    ratios = [width - _LEGEND_IN, side + _BESIDE_IN] if close else None
    size = (width + side + _BESIDE_IN, height) if close else (width, height)
    figure, panels = request.figure(1, 2 if close else 1, size_in=size, title=title, width_ratios=ratios)
    draw(panels[0])
    finish_map(panels[0], extent, frame=frame)
    if close:
        draw(panels[1])
        finish_map(panels[1], focus, square=True, frame=frame)
        panels[1].set_title("close-up", fontsize=9)
        low, high = focus.framed(square=True)
        panels[0].add_patch(
            Rectangle((low[0], low[1]), *(high - low), fill=False, edgecolor="#404040", linewidth=0.7, zorder=3.0)
        )
    place_legend(panels[-1], beside=True)
    return Picture(figure=figure, notes=notes)


def map_size_in(extent: Extent, columns: int = 1, rows: int = 1) -> tuple[float, float]:
    """Return the width and height in inches of a figure with panels of an extent and a legend beside them."""
    low, high = extent.framed()
    ratio = float((high[1] - low[1]) / (high[0] - low[0]))
    height = min(_PANEL_IN * ratio, _TALLEST_IN)
    width = max(height / ratio, 0.5 * _PANEL_IN)
    return columns * (width + _BESIDE_IN) + _LEGEND_IN, rows * (height + _FRAME_IN)
