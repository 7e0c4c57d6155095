"""Curves and clouds of several labelled series, each told apart by line style and marker as well as colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.plotting.figures import figure_style, series_style
from nlosctl.plotting.library import Axes, FuncFormatter

__all__ = ["Series", "draw_cdf", "draw_histogram", "draw_points", "draw_reference_lines", "draw_series", "place_legend"]


_RASTER_POINTS = 5000
_MARKED_POINTS = 40
_INSIDE_ENTRIES = 6


@dataclass(frozen=True, kw_only=True)
class Series:
    """A labelled series ``x`` and ``y`` (N,); NaN leaves a gap.

    ``error`` is the half-length of the error bars (N,), or (2, N) below and above. ``style`` is a number for
    `nlosctl.plotting.figures.series_style`, the place in the list unless given; ``line`` False leaves the markers
    alone, ``marker`` False the line.
    """

    label: str
    x: FloatArray
    y: FloatArray
    error: FloatArray | None = None
    style: int | None = None
    line: bool = True
    marker: bool = True


@figure_style()
def draw_series(
    axes: Axes, series: Sequence[Series], *, log_x: bool = False, log_y: bool = False, legend: bool = True
) -> None:
    """Draw lines through points with error bars, and a legend where there are several.

    On a logarithmic axis an error bar that reaches 0 ends at the axis; lines of many points carry a few markers.
    """
    _scale(axes, log_x, log_y)
    for place, one in enumerate(series):
        look = series_style(place if one.style is None else one.style)
        every = max(1, one.x.size // _MARKED_POINTS)
        axes.errorbar(
            one.x,
            one.y,
            yerr=one.error,
            label=one.label,
            color=look.color,
            linestyle=look.line if one.line else "none",
            marker=look.marker if one.marker else "",
            markevery=every,
            errorevery=every,
            markerfacecolor=look.color if look.filled else "white",
            elinewidth=0.8,
        )
    if legend and len(series) > 1:
        place_legend(axes)


@figure_style()
def draw_points(axes: Axes, series: Sequence[Series], *, size_pt: float = 3.0, legend: bool = True) -> None:
    """Draw points of several series; large clouds become an image within a vector picture."""
    for place, one in enumerate(series):
        look = series_style(place if one.style is None else one.style)
        many = one.x.size > _RASTER_POINTS
        axes.plot(
            one.x,
            one.y,
            linestyle="none",
            marker=look.marker,
            markersize=size_pt,
            color=look.color,
            markerfacecolor=look.color if look.filled else "none",
            markeredgewidth=0.6,
            alpha=0.4 if many else 0.9,
            rasterized=many,
            label=one.label,
        )
    if legend and len(series) > 1:
        place_legend(axes)


@figure_style()
def draw_cdf(axes: Axes, values: Mapping[str, FloatArray], *, log_x: bool = False, legend: bool = True) -> None:
    """Draw the share of each label's values (N,) that lie at or below x; NaN and infinity stay above every x.

    Stairs that reach 1 only where every value is finite: what has no value counts as too large.
    """
    _scale(axes, log_x, log_y=False)
    for place, (label, samples) in enumerate(values.items()):
        look = series_style(place)
        finite = np.sort(samples[np.isfinite(samples)])
        share = np.arange(1, finite.size + 1) / max(samples.size, 1)
        start = finite[:1]
        x, y = np.concatenate([start, finite]), np.concatenate([np.zeros(start.size), share])
        marks = np.searchsorted(y, np.linspace(0.1, 0.9, 5)).clip(max=max(x.size - 1, 0))
        axes.plot(
            x,
            y,
            drawstyle="steps-post",
            color=look.color,
            linestyle=look.line,
            marker=look.marker,
            markerfacecolor=look.color if look.filled else "white",
            markevery=sorted(set(marks.tolist())) if x.size else None,
            label=label,
        )
    axes.set_ylim(-0.02, 1.02)
    if legend and len(values) > 1:
        place_legend(axes)


@figure_style()
def draw_histogram(
    axes: Axes,
    values: Mapping[str, FloatArray],
    *,
    bins: int | FloatArray = 30,
    density: bool = False,
    legend: bool = True,
) -> None:
    """Draw each label's values (N,) as the outline of a histogram over common bins; NaN and infinity are left out."""
    kept = {label: samples[np.isfinite(samples)] for label, samples in values.items()}
    edges = np.histogram_bin_edges(np.concatenate([*kept.values(), np.empty(0)]), bins)
    for place, (label, samples) in enumerate(kept.items()):
        look = series_style(place)
        heights, _ = np.histogram(samples, edges, density=density and samples.size > 0)
        axes.stairs(heights, edges, color=look.color, linestyle=look.line, linewidth=1.3, label=label)
    if legend and len(values) > 1:
        place_legend(axes)


@figure_style()
def draw_reference_lines(axes: Axes, levels: Mapping[str, float]) -> None:
    """Draw labelled horizontal lines, such as a paper's number; each label stands at the right end of its line."""
    for label, level in levels.items():
        axes.axhline(level, color="#404040", linestyle=(0, (2.0, 2.0)), linewidth=1.0, zorder=1.5)
        axes.annotate(
            label,
            (1.0, level),
            xycoords=("axes fraction", "data"),
            xytext=(-3, 2),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=7.5,
            color="#404040",
            bbox={"facecolor": "white", "edgecolor": "none", "alpha": 0.75, "pad": 0.5},
        )


def place_legend(axes: Axes, *, beside: bool = False) -> None:
    """Put the legend inside where few entries leave room, else (or if told) beside the panel."""
    handles, labels = axes.get_legend_handles_labels()
    if labels and (beside or len(labels) > _INSIDE_ENTRIES):
        axes.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    elif labels:
        axes.legend(handles, labels, loc="best")


def _scale(axes: Axes, log_x: bool, log_y: bool) -> None:
    if log_x:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(_plain_power))
    if log_y:
        axes.set_yscale("log", nonpositive="clip")
        axes.yaxis.set_major_formatter(FuncFormatter(_plain_power))


def _plain_power(value: float, _: int) -> str:
    """Return a tick of a logarithmic axis: plain where that is short, else a power of ten."""
    if 1e-3 <= value <= 1e4 or value <= 0.0:
        return f"{value:g}"
    return f"$10^{{{np.log10(value):g}}}$"
