"""Figures in one style, readable without colour, and picture files whose bytes depend only on the figure."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from nlosctl.errors import UsageError, did_you_mean
from nlosctl.io.paths.locations import Location, location
from nlosctl.io.writers.byte_output import write_bytes
from nlosctl.io.writers.output_set import check_targets
from nlosctl.plotting.library import Axes, Figure, style
from nlosctl.plotting.texts import FONT

__all__ = [
    "PICTURE_FORMATS",
    "SERIES_STYLES",
    "SeriesStyle",
    "axis_label",
    "combined_style",
    "figure_bytes",
    "figure_style",
    "new_figure",
    "picture_format",
    "save_figure",
    "series_style",
    "styles_by_part",
]

PICTURE_FORMATS = ("png", "svg", "pdf")

_STYLE = {
    "font.family": FONT,
    "font.size": 9.0,
    "axes.labelsize": 9.0,
    "axes.titlesize": 10.0,
    "figure.titlesize": 11.0,
    "legend.fontsize": 8.0,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#d0d0d0",
    "grid.linewidth": 0.5,
    "axes.linewidth": 0.8,
    "lines.linewidth": 1.3,
    "lines.markersize": 4.5,
    "errorbar.capsize": 2.0,
    "legend.framealpha": 0.85,
    "image.cmap": "cividis",
    "figure.dpi": 100.0,
    "savefig.dpi": 200.0,
    "svg.hashsalt": "nlosctl",
    "svg.fonttype": "path",
    "pdf.fonttype": 42,
    "axes.unicode_minus": True,
}
_NO_DATES = {
    "png": {"Software": None},
    "svg": {"Date": None, "Creator": None},
    "pdf": {"CreationDate": None, "Creator": None, "Producer": None},
}


@dataclass(frozen=True)
class SeriesStyle:
    """Look of one of several series; colour, line style or marker alone distinguish it."""

    color: str
    line: str | tuple[int, tuple[float, ...]]
    marker: str
    filled: bool


SERIES_STYLES = (
    SeriesStyle("#000000", "-", "o", filled=True),
    SeriesStyle("#d55e00", "--", "s", filled=False),
    SeriesStyle("#0072b2", "-.", "^", filled=True),
    SeriesStyle("#e69f00", ":", "D", filled=False),
    SeriesStyle("#009e73", (0, (6.0, 1.5)), "v", filled=True),
    SeriesStyle("#56b4e9", (0, (3.0, 1.0, 1.0, 1.0, 1.0, 1.0)), "x", filled=True),
    SeriesStyle("#cc79a7", (0, (1.0, 2.5)), "P", filled=False),
    SeriesStyle("#707070", (0, (8.0, 2.0, 2.0, 2.0)), "*", filled=True),
)
"""The colours of Okabe and Ito, distinguishable with colour blindness, alternating dark and light for print in grey."""


def series_style(number: int) -> SeriesStyle:
    """Return the style of series ``number``, counted from 0; the first 64 differ.

    After the eighth the colours repeat with other lines and markers.
    """
    turn = number // len(SERIES_STYLES)
    return combined_style(number, number + 3 * turn, other_fill=turn % 2 == 1)


def styles_by_part(parts: Sequence[tuple[str, str]]) -> list[SeriesStyle]:
    """Return a style for each pair of a method and a value: up to eight series in order.

    Of more, those of one method have one colour and those of one value have one line and marker.
    """
    methods, values = (list(dict.fromkeys(words)) for words in zip(*parts, strict=True)) if parts else ([], [])
    most = len(SERIES_STYLES)
    if len(parts) <= most or min(len(methods), len(values)) < 2 or max(len(methods), len(values)) > most:
        return [series_style(number) for number in range(len(parts))]
    return [combined_style(methods.index(method), values.index(value)) for method, value in parts]


def combined_style(color: int, look: int, *, other_fill: bool = False) -> SeriesStyle:
    """Return the colour of one style with line and marker of another, numbers counted from 0."""
    own, other = (SERIES_STYLES[number % len(SERIES_STYLES)] for number in (color, look))
    return SeriesStyle(own.color, other.line, other.marker, filled=other.filled != other_fill)


@contextmanager
def figure_style() -> Iterator[None]:
    """Apply the project's style while drawing, regardless of matplotlibrc; also a decorator."""
    with style.context(["default", _STYLE]):
        yield


@figure_style()
def new_figure(
    rows: int = 1,
    columns: int = 1,
    *,
    width_in: float = 6.4,
    height_in: float = 4.4,
    title: str | None = None,
    width_ratios: Sequence[float] | None = None,
) -> tuple[Figure, list[Axes]]:
    """Return an empty figure of ``width_in`` by ``height_in`` inches and its panels, row by row.

    ``width_ratios`` are those of the columns; default: equal.
    """
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, width_ratios=width_ratios)
    if title:
        figure.suptitle(title)
    return figure, list(panels.ravel())


def axis_label(quantity: str, unit: str) -> str:
    """Return the label of an axis: the quantity and its unit, ``-`` for a dimensionless quantity."""
    return f"{quantity} [{unit or '-'}]"


def picture_format(target: str, format: str | None = None) -> str:
    """Return png, svg or pdf, from ``format`` or the extension of ``target``; raise UsageError for anything else."""
    wanted = format if format is not None else PurePosixPath(location(target).name).suffix[1:]
    if wanted.lower() in PICTURE_FORMATS:
        return wanted.lower()
    known = ", ".join(f".{name}" for name in PICTURE_FORMATS)
    if format is not None:
        raise UsageError(f"`format` must be one of {', '.join(PICTURE_FORMATS)}. Got {format!r} instead.")
    got = f"extension {'.' + wanted!r}" if wanted else "no extension"
    near = did_you_mean(wanted, PICTURE_FORMATS)
    raise UsageError(f"{target}: got {got}, expected a picture's name that ends in one of {known}{near}")


@figure_style()
def figure_bytes(figure: Figure, format: str) -> bytes:
    """Return the picture as png, svg or pdf; the same bytes for the same figure and version of matplotlib.

    The first call fixes the layout, so that a picture does not depend on pictures of other formats made before it.
    """
    if figure.get_layout_engine() is not None:
        figure.draw_without_rendering()
        figure.set_layout_engine("none")
    content = io.BytesIO()
    figure.savefig(content, format=format, metadata=_NO_DATES[format])
    return content.getvalue()


def save_figure(
    figure: Figure,
    target: str | Path,
    *,
    format: str | None = None,
    overwrite: bool = False,
    inputs: Sequence[Location] = (),
) -> None:
    """Write a picture completely or not at all: PNG, SVG or PDF, from ``format`` or the extension.

    Raises UsageError for another extension, DataError if the file exists (without ``overwrite``), is one of ``inputs``
    or can't be written.
    """
    check_targets([str(target)], overwrite=overwrite, inputs=inputs)
    write_bytes(str(target), figure_bytes(figure, picture_format(str(target), format)), overwrite=overwrite)
