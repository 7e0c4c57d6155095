"""Tables of directions relative to each anchor's boresight, one per line, from any angle-of-arrival system."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row
from nlosctl.contract.options import option
from nlosctl.formats.anchors import anchor_values, anchors_of
from nlosctl.formats.clock import TIME_TYPES, Clock
from nlosctl.formats.epochs import WINDOW_MEANING, in_epochs, parse_window
from nlosctl.formats.fields import number
from nlosctl.formats.own_fields import OwnFieldOptions, OwnFields
from nlosctl.formats.tables import Wide, open_table

__all__ = ["FORMAT"]


@dataclass(frozen=True, kw_only=True)
class AnchorOptions(OwnFieldOptions):
    """Names of the columns, and settings that the file does not contain."""

    time: str = option("time_s", meaning="column with the time in seconds, or as ISO 8601")
    sensor: str = option("sensor", meaning="column with the anchor's name, as in the scene")
    azimuth: str = option(
        "azimuth_deg", meaning="column with the direction from the boresight in degrees, or columns such as az_*"
    )
    tag: str | None = option(None, meaning="column with the tag's name; each tag has its own snapshots")
    sense: Literal["clockwise", "counter-clockwise"] = option(
        "clockwise", meaning="positive sense of directions from the boresight, seen from above"
    )
    window: str = option("0.1s", meaning=WINDOW_MEANING)
    bearing_std_deg: float | None = option(
        None,
        meaning="standard deviation of every direction; otherwise set it in the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def _rows(file: ForeignFile, options: AnchorOptions) -> Iterator[Row | BadLine]:
    anchors = anchors_of(file)
    own, clock = OwnFields(options.group, options.keep), Clock()
    wide = None
    wanted = [*own.wanted, options.time, *([options.tag] if options.tag else [])]
    if "*" in options.azimuth:
        wide = Wide(pattern=options.azimuth, sensor=options.sensor, known=list(anchors))
    else:
        wanted += [options.sensor, options.azimuth]

    def parse(line: int, cells: Mapping[str, str]) -> Row:
        angle = number(cells[options.azimuth], options.azimuth, -360.0, 360.0)
        clockwise = angle if options.sense == "clockwise" else -angle
        epoch_s, time = clock.read(line, cells[options.time], options.time)
        values: dict[str, Any] = {
            **anchor_values(anchors, cells[options.sensor], clockwise, time, options.sensor),
            "bearing_std_deg": options.bearing_std_deg,
            "tag": cells[options.tag] if options.tag else None,
            **time,
        }
        group = own.group(cells, values["tag"] or "")
        return Row(line=line, epoch_s=epoch_s, group=group, values=values, kept=own.kept(cells))

    rows = open_table(file).rows(wanted, parse, wide)
    yield from in_epochs(rows, parse_window(options.window, "importer 'anchor-azimuths'"), file, options.group or "tag")


FORMAT = ImporterSpec(
    name="anchor-azimuths",
    summary="Tables (CSV, TSV, JSON Lines) of directions from each anchor's boresight; anchors in the scene",
    reference="this project, docs/formats.md",
    options=AnchorOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r"(?![\d<]|.*\bsnapshot\b)(?=.*\btime_s\b)(?=.*\bsensor\b)(?=.*\bazimuth_deg\b)",
    extra={**TIME_TYPES, "sensor_z_m": "number", "tag": "text"},
)
"""The specification of the importer."""
