"""CSV of directions relative to each anchor's boresight, one per line, from any angle-of-arrival system."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import option
from nlosctl.formats.anchors import anchor_values, anchors_of
from nlosctl.formats.epochs import WINDOW_MEANING, in_epochs, parse_window
from nlosctl.formats.fields import KEEP_MEANING, kept_cells, listed, number, read_table

__all__ = ["FORMAT"]


@dataclass(frozen=True, kw_only=True)
class AnchorOptions:
    """Names of the columns, and settings that the file does not contain."""

    time: str = option("time_s", meaning="column with the time in seconds")
    sensor: str = option("sensor", meaning="column with the anchor's name, as in the scene")
    azimuth: str = option("azimuth_deg", meaning="column with the direction from the boresight, in degrees")
    tag: str | None = option(None, meaning="column with the tag's name; each tag has its own snapshots")
    sense: Literal["clockwise", "counter-clockwise"] = option(
        "clockwise", meaning="positive sense of directions from the boresight, seen from above"
    )
    window: str = option("0.1s", meaning=WINDOW_MEANING)
    keep: str | None = option(None, meaning=KEEP_MEANING)
    bearing_std_deg: float | None = option(
        None,
        meaning="standard deviation of every direction; otherwise set it in the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def _rows(file: ForeignFile, options: AnchorOptions) -> Iterator[Row | BadLine]:
    anchors = anchors_of(file)
    keep = listed(options.keep)
    wanted = [*keep, options.time, options.sensor, options.azimuth, *([options.tag] if options.tag else [])]

    def parse(line: int, cells: Mapping[str, str]) -> Row:
        angle = number(cells[options.azimuth], options.azimuth, -360.0, 360.0)
        clockwise = angle if options.sense == "clockwise" else -angle
        time_s = number(cells[options.time], options.time)
        values: dict[str, Any] = {
            **anchor_values(anchors, cells[options.sensor], clockwise, options.sensor),
            "bearing_std_deg": options.bearing_std_deg,
            "time_s": time_s,
            "tag": cells[options.tag] if options.tag else None,
        }
        return Row(line=line, epoch_s=time_s, group=values["tag"] or "", values=values, kept=kept_cells(cells, keep))

    yield from in_epochs(read_table(file, wanted, parse), parse_window(options.window, "importer 'anchor-azimuths'"))


FORMAT = ImporterSpec(
    name="anchor-azimuths",
    summary="CSV of directions relative to each anchor's boresight, with the anchors in the scene",
    reference="this project, docs/formats.md",
    options=AnchorOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r"(?![\d{<]|.*\bsnapshot\b)(?=.*\btime_s\b)(?=.*\bsensor\b)(?=.*\bazimuth_deg\b)",
    extra={"time_s": "number", "tag": "text"},
)
"""The specification of the importer."""
