"""UWB ranging logs, one range per line: the lines of a time window are a snapshot."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.contract.limits import LARGEST_NUMBER
from nlosctl.contract.options import option
from nlosctl.errors import UsageError
from nlosctl.formats.clock import TIME_TYPES, Clock
from nlosctl.formats.epochs import WINDOW_MEANING, in_epochs, parse_window
from nlosctl.formats.fields import number
from nlosctl.formats.own_fields import OwnFieldOptions, OwnFields
from nlosctl.formats.scene_sensors import SceneSensors, position_columns
from nlosctl.formats.tables import Wide, open_table

__all__ = ["FORMAT"]

_SECONDS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_METRES = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


@dataclass(frozen=True, kw_only=True)
class UwbOptions(OwnFieldOptions):
    """Names of the columns, their units, and settings that the file does not contain."""

    time: str | None = option(None, meaning="column with the time; default: time or timestamp")
    time_unit: Literal["s", "ms", "us", "ns"] = option("s", meaning="unit of the time")
    anchor: str = option("anchor", meaning="column with the anchor's name, as in the scene")
    range: str | None = option(
        None, meaning="column with the range, or columns of one anchor each, such as r_*; default: range or dist_*"
    )
    range_unit: Literal["m", "cm", "mm"] = option("m", meaning="unit of range and std; the variance is in its square")
    tag: str | None = option(None, meaning="column with the tag's name; each tag has its own snapshots")
    std: str | None = option(None, meaning="column with the standard deviation of a range")
    variance: str | None = option(None, meaning="column with the variance of a range")
    range_std_m: float | None = option(
        None,
        meaning="standard deviation of every range; otherwise set it in the next command",
        unit="m",
        minimum=0.0,
        exclusive=True,
    )
    window: str = option("0.1s", meaning=WINDOW_MEANING)


def _rows(file: ForeignFile, options: UwbOptions) -> Iterator[Row | BadLine]:
    if sum(value is not None for value in (options.std, options.variance, options.range_std_m)) > 1:
        raise UsageError("importer 'uwb' takes only one of the parameters std, variance and range_std_m")
    own, clock = OwnFields(options.group, options.keep), Clock(_SECONDS[options.time_unit])
    sensors = SceneSensors(file)
    metres = _METRES[options.range_unit]
    table = open_table(file)
    time_name = options.time or ("timestamp" if "timestamp" in table.columns else "time")
    range_name = options.range or _range_of(table.columns)
    wide = None
    if "*" in range_name:
        wide = Wide(pattern=range_name, sensor=options.anchor, known=list(sensors))
        if options.std is not None or options.variance is not None:
            raise UsageError("importer 'uwb' with one column per anchor takes range_std_m, not std or variance")
    optional = (options.tag, options.std, options.variance)
    wanted = [*own.wanted, time_name, *(name for name in optional if name)]
    if wide is None:
        wanted += [options.anchor, range_name]

    def parse(line: int, cells: Mapping[str, str]) -> Row:
        anchor = cells[options.anchor]
        if not anchor:
            raise UnfitError("empty, expected the name of the anchor", options.anchor)
        epoch_s, time = clock.read(line, cells[time_name], time_name)
        values: dict[str, Any] = {
            "sensor": anchor,
            **(position_columns(sensors.at(anchor, time, options.anchor)) if anchor in sensors else {}),
            "range_m": number(cells[range_name], range_name, 1e-9, LARGEST_NUMBER) * metres,
            "range_std_m": _std(cells, options, metres),
            "tag": cells[options.tag] if options.tag else None,
            **time,
        }
        group = own.group(cells, values["tag"] or "")
        return Row(line=line, epoch_s=epoch_s, group=group, values=values, kept=own.kept(cells))

    rows = table.rows(wanted, parse, wide)
    yield from in_epochs(rows, parse_window(options.window, "importer 'uwb'"), file, options.group or "tag")


def _range_of(columns: Sequence[str]) -> str:
    """Return the column of the ranges; ``dist_*`` if the table has several such columns and no ``range``."""
    several = sum(column.startswith("dist_") for column in columns) > 1
    return "dist_*" if several and "range" not in columns else "range"


def _std(cells: Mapping[str, str], options: UwbOptions, metres: float) -> float | None:
    if options.variance is not None:
        return math.sqrt(number(cells[options.variance], options.variance, 1e-18, LARGEST_NUMBER)) * metres
    if options.std is not None:
        return number(cells[options.std], options.std, 1e-9, LARGEST_NUMBER) * metres
    return options.range_std_m


FORMAT = ImporterSpec(
    name="uwb",
    summary="UWB ranging logs (CSV, TSV, JSON Lines: time, anchor, range, or as named), one range per line or column",
    reference="this project, docs/formats.md; columns as in common UWB logs",
    options=UwbOptions,
    kind=lambda options: "ranges",
    rows=_rows,
    begins_like=r"(?![\d<]|.*\bsnapshot\b)(?=.*\btime(?:stamp)?\b)"
    r"(?:(?=.*\banchor\b)(?=.*\brange\b)|(?=.*\bdist_\w+\W+dist_\w+))",
    extra={**TIME_TYPES, "tag": "text"},
)
"""The specification of the importer."""
