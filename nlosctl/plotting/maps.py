"""Maps over the plane: categories with a legend, values with a colour bar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.plotting.figures import figure_style
from nlosctl.plotting.library import (
    Axes,
    BoundaryNorm,
    FuncFormatter,
    ListedColormap,
    LogLocator,
    LogNorm,
    MaxNLocator,
    Normalize,
    NullFormatter,
    Patch,
    Text,
    colormaps,
)

__all__ = ["draw_map", "draw_regions", "edges_of"]

_LEVELS = 9
_LABEL_SPACING = 0.09
_LIGHTEST, _DARKEST = 0.96, 0.25
_HATCHES = ("", "////", "\\\\\\\\", "xxxx", "----", "++++", "....", "oo")


@figure_style()
def draw_regions(
    axes: Axes, x: FloatArray, y: FloatArray, region: IntArray, labels: Sequence[str], *, equal_aspect: bool = True
) -> None:
    """Draw the region of each cell: ``region`` (H, W) indexes ``labels``, -1 is left white.

    ``x`` (W,) and ``y`` (H,) are ascending cell centres. Regions differ in lightness and hatching; a legend beside the
    panel lists those that occur.
    """
    colors = colormaps["cividis"](np.linspace(_LIGHTEST, _DARKEST, max(len(labels), 2)))[: len(labels)]
    painted = np.ma.masked_less(region, 0)
    norm = BoundaryNorm(np.arange(len(labels) + 1) - 0.5, len(labels))
    axes.pcolormesh(edges_of(x), edges_of(y), painted, cmap=ListedColormap(colors), norm=norm, rasterized=True)
    present = [number for number in range(len(labels)) if np.any(region == number)]
    for number in present:
        hatch = _HATCHES[number % len(_HATCHES)]
        if hatch and min(region.shape) > 1:
            inside = np.where(region == number, 1.0, 0.0)
            filled = axes.contourf(x, y, inside, levels=[0.5, 1.5], colors="none", hatches=[hatch])
            filled.set_edgecolor("#ffffff" if _dark(colors[number]) else "#606060")
            filled.set_linewidth(0.0)
    handles = [
        Patch(
            facecolor=colors[number],
            hatch=_HATCHES[number % len(_HATCHES)],
            edgecolor="#ffffff" if _dark(colors[number]) else "#606060",
            label=labels[number],
        )
        for number in present
    ]
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    _finish(axes, equal_aspect)


@figure_style()
def draw_map(
    axes: Axes,
    x: FloatArray,
    y: FloatArray,
    values: FloatArray,
    label: str,
    *,
    log: bool = False,
    contours: bool = True,
    equal_aspect: bool = True,
) -> None:
    """Draw values (H, W) at cell centres ``x`` (W,), ``y`` (H,) as colours with a bar, and labelled contour lines.

    ``label`` names the quantity with its unit. NaN, and on a logarithmic scale values that are not positive, are left
    white.
    """
    good = np.isfinite(values) & ((values > 0.0) if log else True)
    shown = np.ma.masked_where(~good, values)
    norm = _norm(values[good], log)
    mesh = axes.pcolormesh(edges_of(x), edges_of(y), shown, norm=norm, rasterized=True)
    bar = axes.figure.colorbar(mesh, cax=axes.inset_axes((1.03, 0.0, 0.04, 1.0)), label=label)
    bar.ax.grid(visible=False)
    levels = _levels(values[good], log) if contours and min(values.shape) > 1 else np.empty(0)
    if levels.size:
        lines = axes.contour(*_to_edges(x, y, shown), levels=levels, colors="black", linewidths=0.6)
        _thin_labels(axes, axes.clabel(lines, fontsize=7, inline=False, fmt=lambda level: f"{level:.6g}"))
        bar.add_lines(lines)
    if isinstance(norm, LogNorm):
        bar.ax.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
        bar.ax.yaxis.set_minor_formatter(NullFormatter())
    _finish(axes, equal_aspect)


def _to_edges(x: FloatArray, y: FloatArray, values: Any) -> tuple[FloatArray, FloatArray, Any]:
    """Return centres and values (H + 2, W + 2) with those of the outer cells repeated at the edges of the map.

    Contours between centres alone would end half a cell before the edge.
    """
    wide = [np.concatenate([edge[:1], centres, edge[-1:]]) for centres, edge in ((x, edges_of(x)), (y, edges_of(y)))]
    padded = np.pad(np.ma.filled(values.astype(np.float64), np.nan), 1, mode="edge")
    return wide[0], wide[1], np.ma.masked_invalid(padded)


def _thin_labels(axes: Axes, labels: Sequence[Text]) -> None:
    """Remove contour labels that would overlap an earlier one."""
    low, high = np.array(axes.dataLim.min), np.array(axes.dataLim.max)
    used: list[FloatArray] = []
    for label in labels:
        position = (np.array(label.get_position()) - low) / (high - low)
        if any(np.hypot(*(position - other)) < _LABEL_SPACING for other in used):
            label.remove()
        else:
            label.set_bbox({"facecolor": "white", "edgecolor": "none", "alpha": 0.6, "pad": 0.3})
            used.append(position)


def edges_of(centres: FloatArray) -> FloatArray:
    """Return the edges (N + 1,) of cells with ascending centres (N,); a single cell is 1 wide."""
    if centres.size == 1:
        return np.array([centres[0] - 0.5, centres[0] + 0.5])
    middles = 0.5 * (centres[1:] + centres[:-1])
    return np.concatenate([[2.0 * centres[0] - middles[0]], middles, [2.0 * centres[-1] - middles[-1]]])


def _norm(values: FloatArray, log: bool) -> Normalize:
    if not values.size:
        return Normalize(0.0, 1.0)
    low, high = float(values.min()), float(values.max())
    return LogNorm(low, high) if log and low < high else Normalize(low, high)


def _levels(values: FloatArray, log: bool) -> FloatArray:
    """Return round levels strictly inside the range of the values, on a logarithmic scale 1, 2, 5 times powers of 10.

    Evenly spaced on a linear scale, and on a logarithmic one of less than a decade.
    """
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 0.0)
    if log and high > 10.0 * low:
        decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1)
        steps = (1.0, 2.0, 5.0) if high < 1e3 * low else (1.0,)
        levels = np.sort(np.concatenate([step * 10.0**decades for step in steps]))
    else:
        levels = np.asarray(MaxNLocator(_LEVELS).tick_values(low, high))
    inside: FloatArray = levels[(levels > low) & (levels < high)]
    return inside


def _dark(color: FloatArray) -> bool:
    return bool(np.dot(color[:3], (0.2126, 0.7152, 0.0722)) < 0.45)


def _finish(axes: Axes, equal_aspect: bool) -> None:
    axes.grid(visible=False)
    if equal_aspect:
        axes.set_aspect("equal")
