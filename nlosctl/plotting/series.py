"""Curves and point clouds of several labelled series that differ in line style and marker as well as colour."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.plotting.figures import SeriesStyle, figure_style, series_style
from nlosctl.plotting.library import Axes, FuncFormatter, LogLocator, NullFormatter
from nlosctl.plotting.panels import Series

__all__ = ["draw_cdf", "draw_points", "draw_reference_lines", "draw_series", "label_log_axis", "place_legend"]

_RASTER_POINTS = 5000
_MARKED_POINTS = 40
_INSIDE_ENTRIES = 6
_MOST_ENTRIES = 28


@figure_style()
def draw_series(
    axes: Axes, series: Sequence[Series], *, log_x: bool = False, log_y: bool = False, legend: bool = True
) -> None:
    """Draw lines through points with error bars, and a legend if there are several series.

    On a logarithmic axis an error bar that reaches 0 ends at the axis; long lines have a few markers only.
    """
    _scale(axes, log_x, log_y)
    for index, line in enumerate(series):
        look = series_style(index if line.style is None else line.style)
        every = max(1, line.x.size // _MARKED_POINTS)
        axes.errorbar(
            line.x,
            line.y,
            yerr=line.error,
            label=line.label,
            color=look.color,
            linestyle=look.line if line.line else "none",
            marker=look.marker if line.marker else "",
            markevery=every,
            errorevery=every,
            markerfacecolor=look.color if look.filled else "white",
            elinewidth=0.8,
        )
    if legend and len(series) > 1:
        place_legend(axes)


@figure_style()
def draw_points(axes: Axes, series: Sequence[Series], *, size_pt: float = 3.0, legend: bool = True) -> None:
    """Draw points of several series; large clouds are rasterized in vector pictures."""
    for index, cloud in enumerate(series):
        look = series_style(index if cloud.style is None else cloud.style)
        many = cloud.x.size > _RASTER_POINTS
        axes.plot(
            cloud.x,
            cloud.y,
            linestyle="none",
            marker=look.marker,
            markersize=size_pt,
            color=look.color,
            markerfacecolor=look.color if look.filled else "none",
            markeredgewidth=0.6,
            alpha=0.4 if many else 0.9,
            rasterized=many,
            label=cloud.label,
        )
    if legend and len(series) > 1:
        place_legend(axes)


@figure_style()
def draw_cdf(
    axes: Axes,
    values: Mapping[str, FloatArray],
    *,
    log_x: bool = False,
    legend: bool = True,
    styles: Sequence[SeriesStyle] | None = None,
) -> None:
    """Draw the share of each label's values (N,) at or below x, as steps.

    NaN and infinity count as larger than every x: the steps reach 1 only if all values are finite. ``styles`` has one
    style for each label; default: by number.
    """
    _scale(axes, log_x, log_y=False)
    for index, (label, samples) in enumerate(values.items()):
        look = series_style(index) if styles is None else styles[index]
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
def draw_reference_lines(axes: Axes, levels: Mapping[str, float]) -> None:
    """Draw horizontal lines with labels at their right end."""
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
    """Put the legend inside the panel if it has few entries, otherwise (or with ``beside``) beside the panel."""
    handles, labels = axes.get_legend_handles_labels()
    if len(labels) > _MOST_ENTRIES:
        more = axes.plot([], [], linestyle="none")[0]
        labels = [*labels[: _MOST_ENTRIES - 1], f"… {len(labels) - _MOST_ENTRIES + 1} more"]
        handles = [*handles[: _MOST_ENTRIES - 1], more]
    if labels and (beside or len(labels) > _INSIDE_ENTRIES):
        axes.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    elif labels:
        axes.legend(handles, labels, loc="best")


def label_log_axis(axes: Axes) -> None:
    """Label the y axis at 1, 2 and 5 times powers of ten, or at every digit where it spans less than half a decade."""
    low, high = axes.get_ylim()
    if high > 300.0 * low:
        return
    subs = (1.0, 2.0, 5.0) if high > 3.0 * low else tuple(map(float, range(1, 10)))
    axes.yaxis.set_major_locator(LogLocator(subs=subs))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:.6g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def _scale(axes: Axes, log_x: bool, log_y: bool) -> None:
    if log_x:
        axes.set_xscale("log")
        axes.xaxis.set_major_formatter(FuncFormatter(_plain_power))
    if log_y:
        axes.set_yscale("log", nonpositive="clip")
        axes.yaxis.set_major_formatter(FuncFormatter(_plain_power))


def _plain_power(value: float, _: int) -> str:
    """Return a tick label of a logarithmic axis: a short plain number, otherwise a power of ten."""
    if 1e-3 <= value <= 1e4 or value <= 0.0:
        return f"{value:g}"
    return f"$10^{{{np.log10(value):g}}}$"
