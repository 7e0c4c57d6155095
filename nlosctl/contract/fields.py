"""The search region: where a source may be. `nlosctl.geometry.regions` has the arrays.

``str`` of a region is the text that `parse_field` reads back, exactly: it determines whether two runs are equal, and
provenance contains it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from nlosctl.contract.limits import LARGEST_NUMBER, read_limited
from nlosctl.errors import DataError, UsageError

__all__ = ["BoxField", "CircleField", "Field", "PolygonField", "SensorsField", "parse_field"]

_FORMS = "xmin,xmax,ymin,ymax[,zmin,zmax] or circle:x,y,r or sensors:FACTOR or polygon:FILE or polygon:x,y;x,y;..."


@dataclass(frozen=True, kw_only=True)
class BoxField:
    """A box along the axes, in metres; without ``zmin_m`` and ``zmax_m`` of the plane, or of any height in space."""

    xmin_m: float
    xmax_m: float
    ymin_m: float
    ymax_m: float
    zmin_m: float | None = None
    zmax_m: float | None = None

    def __str__(self) -> str:
        heights = [height for height in (self.zmin_m, self.zmax_m) if height is not None]
        return _text(self.xmin_m, self.xmax_m, self.ymin_m, self.ymax_m, *heights)


@dataclass(frozen=True, kw_only=True)
class CircleField:
    """A disc, in metres."""

    x_m: float
    y_m: float
    radius_m: float

    def __str__(self) -> str:
        return f"circle:{_text(self.x_m, self.y_m, self.radius_m)}"


@dataclass(frozen=True, kw_only=True)
class SensorsField:
    """The bounding box of each snapshot's sensors, extended on every side by ``factor`` times its largest side.

    If there are ranges, it is at least extended by the longest.
    """

    factor: float = 1.0

    def __str__(self) -> str:
        return f"sensors:{_text(self.factor)}"


@dataclass(frozen=True, kw_only=True)
class PolygonField:
    """A simple polygon; ``vertices_m`` are x, y in metres in order, without the first repeated at the end."""

    vertices_m: tuple[tuple[float, float], ...]

    def __str__(self) -> str:
        return "polygon:" + ";".join(_text(*vertex) for vertex in self.vertices_m)


Field = BoxField | CircleField | SensorsField | PolygonField
"""Any kind of search region."""


def parse_field(text: str) -> Field:
    """Return the search region that a text such as ``circle:0,0,100`` describes.

    Raises UsageError for an invalid description, DataError for a polygon file (lines ``x,y`` in metres, ``#`` comments
    and a header ``x_m,y_m`` allowed) that cannot be read.
    """
    form, colon, rest = text.partition(":")
    if not colon:
        xmin, xmax, ymin, ymax, *heights = _numbers(text, text, 6 if text.count(",") == 5 else 4)
        if not (xmin < xmax and ymin < ymax and sorted(set(heights)) == heights):
            raise UsageError(
                f"field {text!r} requires xmin < xmax and ymin < ymax{' and zmin < zmax' if heights else ''}"
            )
        zmin, zmax = heights or (None, None)
        return BoxField(xmin_m=xmin, xmax_m=xmax, ymin_m=ymin, ymax_m=ymax, zmin_m=zmin, zmax_m=zmax)
    if form == "circle":
        x, y, radius = _numbers(rest, text, 3)
        if radius <= 0.0:
            raise UsageError(f"field {text!r} requires a radius above 0")
        return CircleField(x_m=x, y_m=y, radius_m=radius)
    if form == "sensors":
        (factor,) = _numbers(rest, text, 1)
        if factor < 0.0:
            raise UsageError(f"field {text!r} requires a factor of 0 or more")
        return SensorsField(factor=factor)
    if form == "polygon":
        vertices = [_numbers(pair, text, 2) for pair in rest.split(";")] if ";" in rest else _read_vertices(rest)
        return PolygonField(vertices_m=_closed(vertices, text))
    raise UsageError(f"field {text!r} is invalid; expected {_FORMS}")


def _text(*numbers: float) -> str:
    """Return numbers as the shortest text that reads back as the same numbers."""
    return ",".join(repr(float(number)).removesuffix(".0") for number in numbers)


def _numbers(listed: str, text: str, count: int) -> tuple[float, ...]:
    try:
        numbers = tuple(float(number) for number in listed.split(","))
    except ValueError:
        raise UsageError(f"field {text!r} is invalid; expected {_FORMS}") from None
    if len(numbers) != count or not all(abs(number) <= LARGEST_NUMBER for number in numbers):
        raise UsageError(f"field {text!r} requires {count} finite numbers within {LARGEST_NUMBER:g}; expected {_FORMS}")
    return numbers


def _closed(vertices: Sequence[tuple[float, ...]], name: str) -> tuple[tuple[float, float], ...]:
    """Return the vertices without a repeated first one at the end."""
    pairs = [(x, y) for x, y in vertices]
    if len(pairs) > 1 and pairs[0] == pairs[-1]:
        pairs.pop()
    if len(pairs) < 3:
        raise DataError(f"{name}: a polygon needs at least 3 vertices, got {len(pairs)}")
    return tuple(pairs)


def _read_vertices(name: str) -> list[tuple[float, ...]]:
    try:
        lines = read_limited(Path(name), f"polygon file {name!r}").splitlines()
    except OSError as error:
        raise DataError(f"polygon file {name!r} cannot be read: {error.strerror}") from None
    vertices: list[tuple[float, ...]] = []
    for number, line in enumerate(lines, start=1):
        cells = [cell.strip() for cell in line.partition("#")[0].split(",")]
        if cells == [""] or (not vertices and cells == ["x_m", "y_m"]):
            continue
        try:
            x, y = (float(cell) for cell in cells)
        except ValueError:
            raise DataError(f"{name}, line {number}: expected x,y in metres, got {line.strip()!r}") from None
        if not all(abs(number) <= LARGEST_NUMBER for number in (x, y)):
            raise DataError(
                f"{name}, line {number}: a vertex must be finite and within {LARGEST_NUMBER:g}, got {line.strip()!r}"
            )
        vertices.append((x, y))
    return vertices
