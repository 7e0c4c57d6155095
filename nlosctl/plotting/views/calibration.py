"""A calibration: the offset of each sensor with its standard deviation, and residuals before and after it."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

from nlosctl.contract.calibration import Calibration
from nlosctl.contract.run_options import InputOptions, OutputOptions, SolveOptions
from nlosctl.errors import DataError
from nlosctl.geometry.angles import deviation_terms
from nlosctl.io.results.plot_inputs import PlotInput, open_plot_input
from nlosctl.io.results.residual_sectors import SensorResiduals, read_residuals
from nlosctl.jobs.files import Destination, open_inputs
from nlosctl.jobs.solve import solve
from nlosctl.plotting.figures import axis_label, figure_style, series_style
from nlosctl.plotting.library import Axes
from nlosctl.plotting.plot_request import Picture, PlotRequest
from nlosctl.plotting.series import place_legend
from nlosctl.plotting.texts import plain

__all__ = ["draw_calibration_view"]

_MOST_NAMES = 12
_MOST_LINES = 8
_FROM_HEADING = "direction from the heading, counter-clockwise"
_LOOKS = ((0, (1.0, 1.5)), "-", "--", "-.")
"""Lines of the residuals of the first file, the second, ..."""

Key = tuple[str, ...]


@figure_style()
def draw_calibration_view(request: PlotRequest) -> Picture:
    """Draw offsets with bars of one standard deviation, and residuals of flags or measurements beside the calibration.

    Several flags appear in the order of the files; measurements are localized without and with the calibration.
    """
    (file,) = request.of("calibration")
    assert file.calibration is not None  # noqa: S101 - read when the file was opened
    calibration = file.calibration
    with _residuals(request, file, calibration) as found:
        residuals = list(found)
    with_directions = any(part.sectors for part in residuals)
    columns = 1 + bool(residuals) + with_directions
    figure, panels = request.figure(1, columns, size_in=(4.6 * columns if columns > 1 else 6.4, 4.4))
    notes = _draw_deviations(panels[0], calibration) if calibration.harmonics else _draw_offsets(panels[0], calibration)
    if residuals:
        _draw_by_sensor(panels[1], calibration, residuals)
    if with_directions:
        notes += _draw_by_direction(panels[2], calibration, residuals)
    elif residuals:
        notes.append("residuals by direction need the positions: name the estimates too")
    return Picture(figure=figure, notes=notes)


@contextmanager
def _residuals(request: PlotRequest, file: PlotInput, calibration: Calibration) -> Iterator[Iterator[SensorResiduals]]:
    """Yield the residuals of the files beside a calibration, those of measurements before and after it."""
    given = request.of("flags", "measurements")
    for other in given:
        if other.kind != calibration.kind:
            raise DataError(f"{file.name} has offsets of {calibration.kind}, and {other.name} {other.kind}")
    estimates = request.of("estimates")
    limit, by = request.max_rows, calibration.by
    relative = None if not calibration.harmonics else Calibration(kind="bearings", harmonics=calibration.harmonics)
    measured = [other for other in given if other.content == "measurements"]
    if not measured:
        own = estimates[0] if estimates else None
        read = replace(request.read, calibration=relative)
        yield (read_residuals(flags, flags.name, by, read, own, limit) for flags in given)
        return
    read = InputOptions(scene=request.read.scene, calibration=relative)
    with tempfile.TemporaryDirectory() as folder:
        yield (
            read_residuals(flags, label, by, read, fixes, limit)
            for label, applied in (("before", None), ("after", calibration))
            for flags, fixes in [_localized(measured[0], request.read, file.method, applied, Path(folder, label))]
        )


def _localized(
    file: PlotInput, read: InputOptions, method: str, calibration: Calibration | None, folder: Path
) -> tuple[PlotInput, PlotInput]:
    """Return the flags and the estimates of measurements, as files in a folder."""
    folder.mkdir()
    targets = {"estimates": str(folder / "fixes.parquet"), "flags": str(folder / "flags.parquet")}
    options = SolveOptions(method=(method,))
    read = replace(read, calibration=calibration)
    solve("localize", [file.input()], read, options, OutputOptions(), Destination(targets=targets))
    fixes, flags = (open_plot_input(open_inputs([path], None)[0], InputOptions()) for path in targets.values())
    return flags, fixes


def _draw_offsets(axes: Axes, calibration: Calibration) -> list[str]:
    """Draw the offset of each sensor, the groups side by side; return a note on sensors without a std."""
    groups = list(dict.fromkeys(entry.group for entry in calibration.entries))
    names = list(dict.fromkeys(entry.name for entry in calibration.entries))
    for number, group in enumerate(groups):
        entries = [entry for entry in calibration.entries if entry.group == group]
        look = series_style(number)
        axes.errorbar(
            [names.index(entry.name) + _beside(number, len(groups)) for entry in entries],
            [entry.offset for entry in entries],
            yerr=[entry.std or 0.0 for entry in entries],
            color=look.color,
            linestyle="none",
            marker=look.marker,
            markerfacecolor=look.color if look.filled else "white",
            label=plain(" ".join(group)) or None,
        )
    _label_sensors(axes, names)
    axes.axhline(0.0, color="#404040", linewidth=0.8, zorder=1.5)
    axes.set_ylabel(axis_label("offset, and its standard deviation", calibration.quantity.unit))
    if len(groups) > 1:
        place_legend(axes)
    lacking = [" ".join(entry.key) for entry in calibration.entries if entry.std is None]
    more = f" and {len(lacking) - _MOST_NAMES} more" if len(lacking) > _MOST_NAMES else ""
    return [f"not determined: {', '.join(lacking[:_MOST_NAMES])}{more}"] if lacking else []


def _draw_deviations(axes: Axes, calibration: Calibration) -> list[str]:
    """Draw the deviation of each array by the direction, with one std to either side; return a note on the others."""
    direction = np.linspace(-np.pi, np.pi, 361)
    per_term = deviation_terms(direction, calibration.terms)
    whole = np.zeros((len(calibration.entries) * calibration.terms,) * 2)
    if calibration.covariance is not None:
        whole[np.ix_(calibration.order, calibration.order)] = calibration.covariance
    for number, entry in enumerate(calibration.entries[:_MOST_LINES]):
        own = slice(number * calibration.terms, (number + 1) * calibration.terms)
        value, std = per_term @ entry.terms, np.sqrt(np.sum(per_term @ whole[own, own] * per_term, axis=1))
        look = series_style(number)
        x = np.degrees(direction)
        axes.plot(x, value, color=look.color, linestyle=look.line, label=plain(" ".join(entry.key)))
        axes.fill_between(x, value - std, value + std, color=look.color, alpha=0.2, linewidth=0.0)
    _label_directions(axes, _FROM_HEADING)
    axes.set_ylabel(axis_label("deviation, and its standard deviation", calibration.quantity.unit))
    place_legend(axes)
    left = len(calibration.entries) - _MOST_LINES
    return [f"the deviations of {left} more arrays are not drawn"] if left > 0 else []


def _draw_by_sensor(axes: Axes, calibration: Calibration, residuals: Sequence[SensorResiduals]) -> None:
    """Draw mean and standard deviation of each sensor's residuals, the files side by side."""
    keys = _keys(residuals)
    for number, part in enumerate(residuals):
        mean, std = np.array([part.mean_and_std(key) for key in keys]).reshape(-1, 2).T
        look = series_style(number)
        axes.errorbar(
            np.arange(len(keys)) + _beside(number, len(residuals)),
            mean,
            yerr=std,
            color=look.color,
            linestyle="none",
            marker=look.marker,
            markerfacecolor=look.color if look.filled else "white",
            label=plain(part.label),
        )
    _label_sensors(axes, [" ".join(key) for key in keys])
    axes.axhline(0.0, color="#404040", linewidth=0.8, zorder=1.5)
    axes.set_ylabel(axis_label("residual, mean and standard deviation", calibration.quantity.unit))
    place_legend(axes)


def _draw_by_direction(axes: Axes, calibration: Calibration, residuals: Sequence[SensorResiduals]) -> list[str]:
    """Draw the mean residual in sectors of ten degrees, a line per file and sensor; return a note on sensors left out.

    Of many sensors those with the largest mean residuals in the first file are drawn.
    """
    keys = _keys(residuals)
    largest = sorted(keys, key=lambda key: -abs(np.nan_to_num(residuals[0].mean_and_std(key)[0])))
    chosen = [key for key in keys if key in largest[: max(_MOST_LINES // len(residuals), 1)]]
    for number, part in enumerate(residuals):
        for index, key in enumerate(chosen):
            direction, mean = part.by_direction(key)
            look = series_style(index)
            name = " ".join(key)
            axes.plot(
                direction,
                mean,
                color=look.color,
                linestyle=_LOOKS[number % len(_LOOKS)],
                marker=look.marker,
                markersize=3.0,
                markerfacecolor=look.color if number else "white",
                label=plain(f"{name}, {part.label}" if len(residuals) > 1 else name),
            )
    what = "bearing" if calibration.kind == "bearings" else "direction from the sensor"
    _label_directions(axes, _FROM_HEADING if calibration.harmonics else f"{what}, counter-clockwise from +x")
    axes.set_ylabel(axis_label("mean residual in a sector of 10 degrees", calibration.quantity.unit))
    place_legend(axes)
    left = len(keys) - len(chosen)
    return [f"residuals by direction of {left} more sensors are not drawn"] if left else []


def _label_directions(axes: Axes, what: str) -> None:
    axes.axhline(0.0, color="#404040", linewidth=0.8, zorder=1.5)
    axes.set_xlim(-180.0, 180.0)
    axes.set_xticks(range(-180, 181, 60))
    axes.set_xlabel(axis_label(what, "deg"))


def _keys(residuals: Sequence[SensorResiduals]) -> list[Key]:
    return sorted({key for part in residuals for key in part.sums})


def _beside(number: int, count: int) -> float:
    """Return how far the series of this number is from the middle, of one sensor's width of 1."""
    return 0.5 * ((number + 0.5) / count - 0.5)


def _label_sensors(axes: Axes, names: Sequence[str]) -> None:
    """Write the names of the sensors below, turned if they are many or long; of very many some."""
    step = -(-len(names) // 40)
    shown = [plain(name) for name in names[::step]]
    turned = sum(map(len, shown)) > 40
    axes.set_xticks(range(0, len(names), step), shown, rotation=90 if turned else 0)
    axes.set_xlim(-0.5, len(names) - 0.5)
