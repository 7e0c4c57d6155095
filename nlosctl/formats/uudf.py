"""Angle events of u-blox u-connectLocate: the ``+UUDF:`` lines of a serial log; other lines are skipped."""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.contract.options import option
from nlosctl.errors import DataError
from nlosctl.formats.anchors import anchor_values, anchors_of
from nlosctl.formats.epochs import WINDOW_MEANING, in_epochs, in_rounds, parse_window
from nlosctl.formats.fields import integer, lines, number, take_apart
from nlosctl.formats.own_fields import OwnFieldOptions, OwnFields

__all__ = ["FORMAT"]

_EVENT = "+UUDF:"
_FIELDS = (
    *("instance_id", "rssi_pol1", "angle_azimuth", "angle_elevation", "rssi_pol2", "channel", "anchor_id"),
    *("user_defined_str", "timestamp_ms", "sequence_number"),
)
"""The names of the manual; the last one is absent in early versions."""


@dataclass(frozen=True, kw_only=True)
class UudfOptions(OwnFieldOptions):
    """Settings that a log of angle events does not contain."""

    window: str = option(
        "round",
        meaning=f"round: a snapshot of a tag ends when an anchor reports again; {WINDOW_MEANING}, by the anchors' "
        "unsynchronized clocks",
    )
    bearing_std_deg: float | None = option(
        None,
        meaning="standard deviation of every azimuth; otherwise set it in the next command",
        unit="deg",
        minimum=0.0,
        exclusive=True,
    )


def _rows(file: ForeignFile, options: UudfOptions) -> Iterator[Row | BadLine]:
    anchors = anchors_of(file)
    own = OwnFields(options.group, options.keep)
    events = 0

    def parse(line: int, text: str) -> Row | None:
        nonlocal events
        start = text.find(_EVENT)
        if start < 0:
            return None
        events += 1
        fields = [field.strip() for field in next(csv.reader([text[start + len(_EVENT) :].replace("”", '"')]))]
        if len(fields) not in (len(_FIELDS) - 1, len(_FIELDS)):
            raise UnfitError(f"got {len(fields)} fields after {_EVENT}, expected 9, or 10 with the sequence number")
        cells = dict(zip(_FIELDS, fields, strict=False))
        time = {"time_s": number(fields[8], "timestamp_ms", 0.0) / 1e3}
        azimuth_deg = number(fields[2], "angle_azimuth", -90.0, 90.0)
        return Row(
            line=line,
            epoch_s=time["time_s"],
            group=own.group(cells, fields[0]),
            kept=own.kept(cells),
            values={
                **anchor_values(anchors, fields[6], azimuth_deg, time, "anchor_id"),
                "bearing_std_deg": options.bearing_std_deg,
                "tag": fields[0],
                "elevation_deg": number(fields[3], "angle_elevation", -90.0, 90.0),
                "rssi_dbm": number(fields[1], "rssi_pol1"),
                "channel": integer(fields[5], "channel", 0, 39),
                **time,
            },
        )

    rows = take_apart(lines(file), parse)
    if options.window == "round":
        yield from in_rounds(rows)
    else:
        yield from in_epochs(rows, parse_window(options.window, "importer 'uudf'"), file, options.group or "tag")
    if not events:
        raise DataError(f"{file.name}: no line contains {_EVENT!r}; not a u-connectLocate log")
    own.check(file)


FORMAT = ImporterSpec(
    name="uudf",
    summary="u-blox u-connectLocate angle events (+UUDF lines of a serial log)",
    reference="u-blox XPLR-AOA user guide UBX-21004616, appendix A.4: Angle calculation event +UUDF",
    options=UudfOptions,
    kind=lambda options: "bearings",
    rows=_rows,
    begins_like=r".{0,100}?\+UUDF:",
    extra={
        "tag": "text",
        "sensor_z_m": "number",
        "elevation_deg": "number",
        "rssi_dbm": "number",
        "channel": "integer",
        "time_s": "number",
    },
)
"""The specification of the importer."""
