"""Estimates and truth of one snapshot, drawn over its measurements; labels and positions of result rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.statuses import Status
from nlosctl.errors import DataError
from nlosctl.io.results.plot_inputs import PlotInput, read_rows_of_snapshot
from nlosctl.plotting.figures import series_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plane import Extent, draw_ellipses
from nlosctl.plotting.texts import plain

__all__ = [
    "Columns",
    "covariances_of",
    "draw_estimates_of_snapshot",
    "draw_truth",
    "estimate_rows_of",
    "fixes_of",
    "labels_of_rows",
    "positions_of",
]

Columns = Mapping[str, npt.NDArray[np.generic]]


def estimate_rows_of(files: Sequence[PlotInput], snapshot: str | None) -> tuple[str | None, list[tuple[str, Columns]]]:
    """Return the snapshot's id, and for each file of estimates its name (if there are several) and its rows."""
    estimates: list[tuple[str, Columns]] = []
    for file in files:
        snapshot, columns = read_rows_of_snapshot(file, snapshot)
        estimates.append((file.name if len(files) > 1 else "", columns))
    return snapshot, estimates


def labels_of_rows(columns: Columns, count: int, prefix: str = "") -> list[str]:
    """Return a label for each row (N,): file, source, method, swept values."""
    parts = [[prefix] * count] if prefix else []
    parts += [[str(word) for word in columns[name]] for name in ("source", "method") if name in columns]
    for name, values in columns.items():
        if name.startswith("sweep_"):
            key = name.removeprefix("sweep_")
            parts.append([f"{key}={_as_text(value)}" if _is_known(value) else "" for value in values])
    words = [" ".join(filter(None, words)) for words in zip(*parts, strict=True)] if parts else [""] * count
    shown = {word: plain(word) for word in set(words)}
    return [shown[word] for word in words]


def draw_estimates_of_snapshot(
    axes: Axes, estimates: Sequence[tuple[str, Columns]], extent: Extent, seen: str = "xy"
) -> list[str]:
    """Draw the estimates with their 95 % ellipses, a style per method; return notes on what could not be drawn.

    ``seen`` are the two coordinates of the panel; the ellipse is that of their marginal covariance.
    """
    notes = []
    style = 0
    for prefix, columns in estimates:
        position = positions_of(columns, *(f"{axis}_m" for axis in seen))
        covariance = covariances_of(columns, seen)
        degrees = _numbers(columns, "std_dof") if "std_dof" in columns else np.full(position.shape[0], np.nan)
        labels = np.array(labels_of_rows(columns, position.shape[0], prefix), dtype=object)
        best = _numbers(columns, "alternative") == 0.0
        for label in dict.fromkeys(labels.tolist()):
            own = labels == label
            fixed = own & np.isfinite(position).all(axis=1)
            if not fixed.any():
                words = ", ".join(dict.fromkeys(str(word) for word in columns["status"][own]))
                notes.append(f"{label or 'the estimates'}: no position ({words})")
                continue
            look = series_style(style + 1)
            style += 1
            name = label or "estimate"
            unfit = fixed & ~fixes_of(columns)
            words = ", ".join(dict.fromkeys(str(word) for word in columns["status"][unfit]))
            drawn = (
                (fixed & best & ~unfit, look.marker, 7.0, name),
                (fixed & ~best & ~unfit, look.marker, 4.0, f"{name}, alternatives"),
                (unfit, "x", 7.0, f"{name}: no fix ({words})"),
            )
            for rows, marker, size, shown in drawn:
                if not rows.any():
                    continue
                axes.plot(
                    *position[rows].T,
                    linestyle="none",
                    marker=marker,
                    markersize=size,
                    color=look.color,
                    markerfacecolor=look.color if look.filled else "white",
                    markeredgewidth=1.2,
                    label=shown,
                    zorder=3.5,
                )
                extent.include(position[rows])
            ellipses = draw_ellipses(axes, position[own], covariance[own], look, extent, degrees=degrees[own])
            if ellipses < int(fixed.sum()):
                notes.append(f"{name}: no covariance, so no ellipse")
    return notes


def draw_truth(axes: Axes, columns: Columns, extent: Extent, seen: str = "xy") -> None:
    """Draw the true positions in the rows, each once, by the two coordinates ``seen``."""
    names = [f"truth_{axis}_m" for axis in seen]
    if not set(names) <= columns.keys():
        return
    truth = np.unique(positions_of(columns, *names), axis=0)
    truth = truth[np.isfinite(truth).all(axis=1)]
    if truth.size:
        axes.plot(
            *truth.T,
            linestyle="none",
            marker="*",
            markersize=10,
            color="black",
            markerfacecolor="white",
            label="truth",
            zorder=3.8,
        )
        extent.include(truth)


def fixes_of(columns: Columns) -> npt.NDArray[np.bool_]:
    """Return which rows (N,) of estimates count as a fix by their status."""
    return ~np.isin(columns["status"], [status.word for status in Status if not status.is_fix])


def positions_of(columns: Columns, *names: str) -> FloatArray:
    """Return D columns as points (N, D); raise DataError if they are not numeric."""
    return np.stack([_numbers(columns, name) for name in names], axis=1)


def covariances_of(columns: Columns, seen: str = "xy") -> FloatArray:
    """Return the marginal covariances (N, 3) of two coordinates of estimates: of the first, both, and the second."""
    right, up = seen[0], seen[1]
    return np.stack([_numbers(columns, f"cov_{pair}_m2") for pair in (2 * right, right + up, 2 * up)], axis=1)


def _numbers(columns: Columns, name: str) -> FloatArray:
    values = columns[name]
    if values.dtype.kind == "O" and not any(values):
        return np.full(values.shape, np.nan)
    if values.dtype.kind not in "fiu":
        raise DataError(f"column {name!r}: got text, expected numbers")
    return values.astype(np.float64)


def _is_known(value: object) -> bool:
    return value != "" and not (isinstance(value, float) and np.isnan(value))


def _as_text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
