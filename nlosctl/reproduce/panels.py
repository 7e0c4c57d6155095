"""Parts of the figures: curves over a swept condition with error bars, and maps over a lattice of trials."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Chunk
from nlosctl.reproduce.samples import Results, Statistic, at, measure, ratio_of, rms_of

__all__ = ["curve", "lattice_points", "on_lattice", "rms_panels"]


def curve(
    results: Results,
    x: str,
    label: str,
    statistic: Statistic,
    *,
    marker: bool = True,
    style: int | None = None,
    **keys: float | int | str,
) -> Series:
    """Return a statistic over the condition ``x``, for the conditions with the values ``keys``.

    Error bars are one Monte-Carlo standard error to each side; a curve without ``marker`` (a bound, a theory) has none.
    """
    points = [(condition[x], measure(at(statistic), alone)) for condition, alone in results.separately(**keys)]
    errors = np.nan_to_num(np.array([ours.standard_error for _, ours in points]))
    return Series(
        label=label,
        x=np.array([float(value) for value, _ in points]),
        y=np.array([ours.value for _, ours in points]),
        error=errors if marker and results.random else None,
        marker=marker,
        style=style,
    )


def rms_panels(results: Results, x: str, x_label: str, y_label: str, labels: Mapping[str, str]) -> Sequence[Panel]:
    """Return the RMS errors over the condition ``x``, and the same divided by the bound, the samples ``crlb``."""
    panels = []
    for axis, statistics in (
        (y_label, {name: rms_of(name) for name in labels}),
        ("over the bound [-]", {name: ratio_of(name, "crlb") for name in labels}),
    ):
        lines = (curve(results, x, labels[name], statistics[name], marker=name != "crlb") for name in labels)
        panels.append(LinesPanel(x_label=x_label, y_label=axis, lines=tuple(lines)))
    return panels


def lattice_points(
    chunk: Chunk, x_range: tuple[float, float], y_range: tuple[float, float]
) -> tuple[FloatArray, FloatArray]:
    """Return x and y (size,) of the chunk's points: cell centres of a square lattice over the box, row by row."""
    side = math.ceil(math.sqrt(chunk.total))
    x = x_range[0] + (x_range[1] - x_range[0]) * (chunk.trials % side + 0.5) / side
    y = y_range[0] + (y_range[1] - y_range[0]) * (chunk.trials // side + 0.5) / side
    return x, y


def on_lattice(x: FloatArray, y: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return columns (W,), rows (H,) and values (H, W) of all points of a lattice; NaN at the end of the last row."""
    side = math.ceil(math.sqrt(x.shape[0]))
    rows = -(-x.shape[0] // side)
    grid = np.full(rows * side, np.nan)
    grid[: values.shape[0]] = values
    return x[:side], y[::side], grid.reshape(rows, side)
