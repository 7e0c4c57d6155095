"""Estimates as a page of HTML without scripts: a drawing in metres of the plane, and a table of all their columns."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import IO, Any

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.formats import ExporterSpec, Places
from nlosctl.contract.options import option
from nlosctl.contract.statuses import Status
from nlosctl.formats.map_options import MapOptions, known_values, title, xml_text
from nlosctl.formats.track_lines import TrackLines

__all__ = ["FORMAT"]

_HEAD = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'">
<title>Estimates</title>
<style>
:root { color-scheme: light dark }
body { font: 15px/1.45 system-ui, sans-serif; margin: 1rem }
svg { border: 1px solid #888; max-width: 46rem; width: 100% }
svg * { vector-effect: non-scaling-stroke }
.ellipse { fill: #d9601a; fill-opacity: 0.15; stroke: #d9601a }
.fix { fill: #d9601a }
.other { fill: none; stroke: #d9601a }
.truth, .track, .scale { fill: none; stroke: currentColor }
text { fill: currentColor }
div { overflow-x: auto }
table { border-collapse: collapse; font-size: 13px }
caption { text-align: left }
th, td { border-bottom: 1px solid #8886; padding: 0.15rem 0.5rem; text-align: right; white-space: nowrap }
th { position: sticky; top: 0; background: Canvas }
</style>
</head>
<body>
<h1>Estimates</h1>
"""

_MARGIN, _RADIUS, _TEXT = 0.08, 0.005, 0.022
"""The margin of the drawing, the radius of a point and the height of text, as shares of the longer side."""

_FIXES = {status.word for status in Status if status.is_fix}


@dataclass(frozen=True, kw_only=True)
class HtmlOptions(MapOptions):
    """Ellipses of the estimates, and how many are shown."""

    rows: int = option(10_000, minimum=1, meaning="number of estimates on the page, which names the total")

    @property
    def metres(self) -> bool:
        """Whether positions are in metres of the plane: always."""
        return True


@dataclass(frozen=True)
class _Mark:
    """What is drawn of an estimate: its place and ellipse as points (1 or V, 2), the truth, its words."""

    place: FloatArray
    ellipse: FloatArray
    truth: FloatArray
    is_fix: bool
    words: str


class _Writer:
    def __init__(self, sink: IO[bytes], options: HtmlOptions) -> None:
        self._sink, self._options, self._tracks = sink, options, TrackLines()
        self._marks: list[_Mark] = []
        self._rows: list[dict[str, Any]] = []
        self._total = 0

    def write(self, places: Places) -> None:
        self._total += places.size
        self._tracks.add(places)
        for row in range(min(places.size, self._options.rows - len(self._rows))):
            values = {name: column[row] for name, column in places.columns.items()}
            self._rows.append(values)
            self._marks.append(_mark(places, row, values))

    def close(self) -> None:
        parts = [_HEAD, *self._drawing(), *self._table(), "</body>\n</html>\n"]
        self._sink.write("".join(parts).encode("utf-8", errors="replace"))

    def _drawing(self) -> Iterator[str]:
        """Yield a picture of places, ellipses, truths and tracks, north or +y on top."""
        tracks = [np.array([point[:2] for _, point in track.points]) for track in self._tracks.lines()]
        shown = [part for mark in self._marks if mark.is_fix for part in (mark.place, mark.ellipse)]
        shown = shown or [mark.place for mark in self._marks]
        points = np.concatenate([np.empty((0, 2)), *shown, *(mark.truth for mark in self._marks), *tracks])
        points = points[np.isfinite(points).all(axis=1)]
        if not len(points):
            yield "<p>No estimate has a position.</p>\n"
            return
        low, high = points.min(axis=0), points.max(axis=0)
        side = float((high - low).max()) or 1.0
        low, high = low - _MARGIN * side, high + _MARGIN * side
        width, height = high - low
        yield (
            f'<svg viewBox="0 0 {width:.6g} {height:.6g}" role="img" font-size="{_TEXT * side:.4g}" '
            f'aria-label="Drawing of the estimates">\n'
        )

        def on_paper(points: FloatArray) -> FloatArray:
            return np.stack([points[:, 0] - low[0], high[1] - points[:, 1]], axis=1)

        for path in tracks:
            yield f'<path class="track" d="{_path(on_paper(path))}"/>\n'
        for mark in self._marks:
            yield from _drawn(mark, on_paper, _RADIUS * side)
        yield _scale(side, height)
        yield "</svg>\n"

    def _table(self) -> Iterator[str]:
        shown, share = len(self._rows), 100.0 * self._options.ellipse
        yield f"<p>Places in metres of the plane; ellipses hold {share:g} % of Gaussian errors. "
        yield "Circles without filling are no fix, crosses are true positions."
        yield "</p>\n" if shown == self._total else f" The first {shown} of {self._total} estimates are shown.</p>\n"
        names = list(dict.fromkeys(name for values in self._rows for name in values))
        yield f"<div><table><caption>{self._total} estimates</caption>\n<thead><tr>"
        yield "".join(f'<th scope="col">{xml_text(name)}</th>' for name in names)
        yield "</tr></thead>\n<tbody>\n"
        for values in self._rows:
            yield f"<tr>{''.join(f'<td>{_cell(values.get(name))}</td>' for name in names)}</tr>\n"
        yield "</tbody></table></div>\n"


def _mark(places: Places, row: int, values: Mapping[str, Any]) -> _Mark:
    truth = np.array([[np.nan if values.get(name) is None else values[name] for name in ("truth_x_m", "truth_y_m")]])
    words = " ".join(filter(None, [title(known_values(places, row)), str(values.get("status", ""))]))
    place = np.array([[places.x[row], places.y[row]]])
    return _Mark(place, places.outline[row], truth, str(values.get("status", "ok")) in _FIXES, words)


def _drawn(mark: _Mark, on_paper: Callable[[FloatArray], FloatArray], radius: float) -> Iterator[str]:
    named = f"<title>{xml_text(mark.words)}</title>"
    if np.isfinite(mark.ellipse).all():
        yield f'<path class="ellipse" d="{_path(on_paper(mark.ellipse))}Z">{named}</path>\n'
    if np.isfinite(mark.place).all():
        x, y = on_paper(mark.place)[0]
        look = "fix" if mark.is_fix else "other"
        yield f'<circle class="{look}" cx="{x:.6g}" cy="{y:.6g}" r="{radius:.4g}">{named}</circle>\n'
    if np.isfinite(mark.truth).all():
        x, y = on_paper(mark.truth)[0]
        arm = f"{2.0 * radius:.4g}"
        cross = f"M{x - radius:.6g} {y:.6g}h{arm}M{x:.6g} {y - radius:.6g}v{arm}"
        yield f'<path class="truth" d="{cross}"/>\n'


def _scale(side: float, height: float) -> str:
    """Return a bar of a round length and its label, at the lower left."""
    length = 10.0 ** math.floor(math.log10(side / 4.0))
    length *= max(factor for factor in (1.0, 2.0, 5.0) if factor * length <= side / 4.0)
    x, y = 0.02 * side, height - 0.02 * side
    bar = f'<path class="scale" d="M{x:.6g} {y:.6g}h{length:.6g}"/>'
    return f'{bar}<text x="{x:.6g}" y="{y - 0.4 * _TEXT * side:.6g}">{length:g} m</text>\n'


def _path(points: FloatArray) -> str:
    return "M" + "L".join(f"{x:.6g} {y:.6g}" for x, y in points)


def _cell(value: Any) -> str:
    """Return a value as text of a cell, empty for null."""
    return "" if value is None else f"{value:.10g}" if isinstance(value, float) else xml_text(str(value))


FORMAT = ExporterSpec(
    name="html",
    summary="HTML: a drawing of places, ellipses, tracks and truths in metres, and a table",
    reference="HTML Living Standard, WHATWG; SVG 2, W3C",
    options=HtmlOptions,
    start=_Writer,
)
"""The specification of the exporter."""
