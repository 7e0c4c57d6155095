"""Rows of measurements of one snapshot: where their sensors are, how they look, and the circles of their ranges."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import FloatArray
from nlosctl.contract.scene import Reflector, Scene
from nlosctl.errors import UsageError
from nlosctl.io.results.plot_inputs import PlotSnapshot, read_snapshot
from nlosctl.io.results.plotted_rows import row_positions
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plot_request import PlotRequest
from nlosctl.plotting.views.many_rows import draw_faint_lines

__all__ = [
    "ROW_LOOKS",
    "RowLook",
    "assigned_targets",
    "draw_row_curves",
    "first_measurements",
    "horizontal_ranges",
    "range_label",
    "reflector_of",
    "sensor_positions",
    "without_std",
]


@dataclasses.dataclass(frozen=True)
class RowLook:
    """Look of a kind of row, and its label in the legend."""

    label: str
    color: str
    line: str | tuple[int, tuple[float, ...]]
    wedge: bool


ROW_LOOKS = {
    "direct": RowLook("bearing $\\pm 1$ std, direct", "#0072b2", "-", wedge=True),
    "reflected": RowLook("bearing $\\pm 1$ std, by a mirror", "#b35900", (0, (5.0, 1.5)), wedge=True),
    "flagged": RowLook("bearing, flagged (los false)", "#808080", (0, (1.0, 2.0)), wedge=False),
    "unused": RowLook("bearing, not used", "#a8a8a8", (0, (3.0, 3.0)), wedge=False),
}


def first_measurements(request: PlotRequest) -> PlotSnapshot | None:
    """Return the requested snapshot of the file of measurements or flags; None without such a file."""
    files = request.of("measurements", "flags")
    if len(files) > 1:
        raise UsageError(
            f"{', '.join(file.name for file in files)}: a picture takes one file of measurements; name only one"
        )
    if not files:
        return None
    return read_snapshot(files[0], request.read, request.snapshot)


def sensor_positions(measured: PlotSnapshot, dimension: int = 2) -> tuple[list[str], FloatArray]:
    """Return the names of a snapshot's sensors and their positions (N, D), each once; references of differences too."""
    sensor, names = row_positions(measured, "sensor", dimension), list(measured.sensor)
    if measured.reference:
        reference = row_positions(measured, "reference", dimension)
        names += measured.reference
        sensor = np.concatenate([sensor, reference])
    rows = np.flatnonzero(np.isfinite(sensor).all(axis=1))
    each = dict.fromkeys((str(names[row]), *sensor[row].tolist()) for row in rows)
    return [str(key[0]) for key in each], np.array([key[1:] for key in each]).reshape(-1, dimension)


def horizontal_ranges(measured: PlotSnapshot, target_z_m: float | None) -> tuple[FloatArray, list[str]]:
    """Return the radii (K,) of the circles of the ranges in the plane of the targets, and notes on them.

    With ``target_z_m`` a range is a slant one from the height of its sensor; NaN where it is shorter than the height.
    """
    slant, height = measured.columns["range_m"], measured.columns.get("sensor_z_m")
    if target_z_m is None:
        note = "ranges are drawn as horizontal; `target_z_m` takes the heights of the sensors into account"
        return slant, [] if height is None else [note]
    if height is None:
        raise UsageError("`target_z_m` needs the column 'sensor_z_m', the height of each sensor")
    squared = slant * slant - (height - target_z_m) ** 2
    short = int(np.count_nonzero(squared < 0.0))
    notes = [f"{short} of {slant.size} ranges are shorter than the height of their sensor: no circle"] if short else []
    return np.sqrt(np.where(squared < 0.0, np.nan, squared)), notes


def range_label(look: RowLook) -> str:
    """Return the label of a kind of range in the legend."""
    return without_std(look.label).replace("bearing", "range")


def without_std(label: str) -> str:
    """Return a label of rows that are drawn without their standard deviation."""
    return label.replace(" $\\pm 1$ std", "")


def draw_row_curves(axes: Axes, lines: Sequence[FloatArray], look: RowLook, label: str, *, faint: bool) -> None:
    """Draw polylines (P, 2) of a kind of row, with one entry of the legend; ``faint`` if the snapshot has many rows."""
    if faint and lines:
        draw_faint_lines(axes, lines, color=look.color, label=label, zorder=2.0)
        return
    for number, line in enumerate(lines):
        axes.plot(
            *line.T,
            color=look.color,
            linestyle=look.line,
            linewidth=1.1,
            label="_nolegend_" if number else label,
            zorder=2.4,
            scalex=False,
            scaley=False,
        )


def assigned_targets(measured: PlotSnapshot) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Return the target (K,) of each unlabelled row, NaN without one, and whether it is a direct row of it."""
    size = len(measured.sensor)
    target = np.asarray(measured.file_columns.get("target", np.full(size, np.nan)), dtype=np.float64)
    return target, (measured.file_columns.get("los", np.zeros(size)) == 1) & ~np.isnan(target)


def reflector_of(scene: Scene, columns: dict[str, npt.NDArray[np.generic]], row: int) -> Reflector | None:
    """Return the reflector of a row, None without one."""
    index = int(columns["reflector"][row]) if "reflector" in columns else -1
    return scene.reflectors[index] if index >= 0 else None
