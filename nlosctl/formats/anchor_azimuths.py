"""CSV of directions from each anchor's boresight: any angle-of-arrival system that logs one direction per line."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import option
from nlosctl.formats.anchors import anchor_values, anchors_of
from nlosctl.formats.epochs import WINDOW_MEANING, in_epochs, parse_window
from nlosctl.formats.fields import number, read_table

__all__ = ["FORMAT"]


@dataclass(frozen=True, kw_only=True)
class AnchorOptions:
    """The names of the columns, and what they leave open."""

    time: str = option("time_s", meaning="column of the time in seconds")
    sensor: str = option("sensor", meaning="column of the anchor's name, as in the scene")
    azimuth: str = option("azimuth_deg", meaning="column of the direction from the boresight, in degrees")
    tag: str | None = option(None, meaning="column of what was heard: each its own snapshots")
    sense: Literal["clockwise", "counter-clockwise"] = option(
        "clockwise", meaning="how directions count from the boresight, seen from above"
    )
    window: str = option("0.1s", meaning=WINDOW_MEANING)
    bearing_std_deg: float | None = option(
        None,
        meaning="std of every direction; else give it to the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def _rows(file: ForeignFile, options: AnchorOptions) -> Iterator[Row | BadLine]:
    anchors = anchors_of(file)
    wanted = [options.time, options.sensor, options.azimuth, *([options.tag] if options.tag else [])]

    def parse(line: int, cells: Mapping[str, str]) -> Row:
        turned = number(cells[options.azimuth], options.azimuth, -360.0, 360.0)
        clockwise = turned if options.sense == "clockwise" else -turned
        time_s = number(cells[options.time], options.time)
        values: dict[str, Any] = {
            **anchor_values(anchors, cells[options.sensor], clockwise, options.sensor),
            "bearing_std_deg": options.bearing_std_deg,
            "time_s": time_s,
            "tag": cells[options.tag] if options.tag else None,
        }
        return Row(line=line, epoch_s=time_s, group=values["tag"] or "", values=values)

    yield from in_epochs(read_table(file, wanted, parse), parse_window(options.window, "importer 'anchor-azimuths'"))


FORMAT = ImporterSpec(
    name="anchor-azimuths",
    summary="CSV of directions from each anchor's boresight, the anchors in the scene",
    reference="this project, docs/formats.md",
    options=AnchorOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    extra={"time_s": "number", "tag": "text"},
)
"""The specification of the importer."""
