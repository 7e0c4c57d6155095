"""Options and helpers shared by the map exporters."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from xml.sax.saxutils import escape

from nlosctl.contract.formats import Places, Shapes
from nlosctl.contract.options import option

__all__ = ["LineOptions", "MapOptions", "known_values", "title", "xml_text"]

_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


@dataclass(frozen=True, kw_only=True)
class MapOptions:
    """Ellipses of the estimates."""

    ellipse: float = option(
        0.95, meaning="probability content of the error ellipses", minimum=0.0, maximum=1.0, exclusive=True
    )
    vertices: int = option(72, meaning="vertices of an ellipse", minimum=8, maximum=3600)


@dataclass(frozen=True, kw_only=True)
class LineOptions(MapOptions):
    """Ellipses of the estimates, and lines of bearing."""

    line_length_m: float = option(
        10_000.0,
        unit="m",
        minimum=0.0,
        maximum=1e7,
        exclusive=True,
        meaning="length of a line of bearing; a row with a range is as long as that",
    )


def known_values(places: Places | Shapes, row: int) -> dict[str, Any]:
    """Return the values of one estimate by column, without nulls."""
    return {name: values[row] for name, values in places.columns.items() if values[row] is not None}


def title(values: Mapping[str, Any]) -> str:
    """Return the title of an estimate, its snapshot and method, or of a bearing, its snapshot and sensor."""
    return " ".join(str(values[key]) for key in ("snapshot", "method", "sensor") if key in values)


def xml_text(text: str) -> str:
    """Return text as XML, characters that XML can't state replaced."""
    return escape(_NOT_XML.sub("\ufffd", text))
