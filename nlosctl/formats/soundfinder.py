"""Sound Finder tables: a sound a line, with its arrival time at each recorder in seconds and the air temperature.

The columns between ``idx`` and ``temp`` (degrees Celsius) have the names of the recorders, whose positions in metres
are in a table of their own, ``recorder,x,y`` and perhaps ``z``, or in the scene. Times become lengths by the speed of
sound at the temperature, 331.3 sqrt(1 + temp / 273.15) m/s. An empty cell: the sound was not heard there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, ImporterSpec, Row, UnfitError
from nlosctl.contract.options import option
from nlosctl.errors import DataError
from nlosctl.formats.fields import KEEP_MEANING, kept_cells, listed, number
from nlosctl.formats.positions_file import Positions, number_or_none, of_scene, of_table
from nlosctl.formats.tables import LogTable, open_table

__all__ = ["FORMAT"]

_CURE = "`parameters` recorders=FILE with the columns recorder, x, y, and perhaps z"


@dataclass(frozen=True, kw_only=True)
class SoundFinderOptions:
    """The recorders, and settings that the table does not contain."""

    recorders: str | None = option(None, meaning="table with recorder, x, y, perhaps z, in metres; default: the scene")
    temperature_c: float | None = option(
        None,
        meaning="temperature of the air, of sounds without one",
        unit="degrees Celsius",
        minimum=-100.0,
        maximum=100.0,
    )
    arrival_std_s: float | None = option(
        None,
        meaning="standard deviation of every arrival; otherwise set `arrival_std_m` in the next command",
        unit="s",
        minimum=0.0,
        exclusive=True,
    )
    keep: str | None = option(None, meaning=KEEP_MEANING)


def _rows(file: ForeignFile, options: SoundFinderOptions) -> Iterator[Row | BadLine]:
    positions = _positions(file, options)
    keep, table = listed(options.keep), open_table(file)
    table.require(["idx", *keep])
    recorders = _recorders(table, keep, file)
    for line, cells in table.records:
        if isinstance(cells, BadLine):
            yield cells
            continue
        try:
            rows = _sound(cells, recorders, positions, options)
        except UnfitError as unfit:
            yield BadLine(line=line, fault=unfit.fault, column=unfit.column, text=",".join(cells.values()))
            continue
        kept = kept_cells(cells, keep)
        yield from (Row(line=line, values=values, kept=kept) for values in rows)


def _recorders(table: LogTable, keep: list[str], file: ForeignFile) -> list[str]:
    """Return the columns from ``idx`` to ``temp``, or to the last one, without those that are kept."""
    names = table.columns
    end = names.index("temp") if "temp" in names else len(names)
    found = [name for name in names[names.index("idx") + 1 : end] if name not in keep]
    if not found:
        raise DataError(f"{file.name}: no column of a recorder between 'idx' and 'temp'. It has: {', '.join(names)}")
    return found


def _sound(
    cells: Mapping[str, str], recorders: list[str], positions: Positions, options: SoundFinderOptions
) -> list[dict[str, Any]]:
    """Return the arrivals of a sound."""
    temperature_c = number_or_none(cells.get("temp", ""), "temp", -100.0, 100.0)
    if temperature_c is None:
        temperature_c = options.temperature_c
    if temperature_c is None:
        raise UnfitError("empty, expected degrees Celsius; set `parameters` temperature_c", "temp")
    speed_m_s = 331.3 * math.sqrt(1.0 + temperature_c / 273.15)
    std_s = options.arrival_std_s
    rows = []
    for name in recorders:
        time_s = number_or_none(cells[name], name)
        if time_s is None:
            continue
        rows.append(
            {
                "snapshot": cells["idx"],
                "sensor": name,
                **positions(name, {}, name),
                "arrival_m": time_s * speed_m_s,
                "arrival_std_m": None if std_s is None else std_s * speed_m_s,
                "temperature_c": temperature_c,
                "sound_speed_m_s": speed_m_s,
            }
        )
    return rows


def _positions(file: ForeignFile, options: SoundFinderOptions) -> Positions:
    if options.recorders is None:
        return of_scene(file, _CURE)
    return of_table(options.recorders, ("recorder", "x", "y"), _recorder)


def _recorder(cells: Mapping[str, str]) -> tuple[str, dict[str, Any]]:
    """Return name and position of a recorder."""
    axes = ("x", "y", "z") if "z" in cells else ("x", "y")
    return cells["recorder"], {f"sensor_{axis}_m": number(cells[axis], axis, -1e9, 1e9) for axis in axes}


FORMAT = ImporterSpec(
    name="soundfinder",
    summary="Arrival times of sounds at recorders, a column for each (Sound Finder: idx, recorders, temp)",
    reference="Wilson, Battiston, Brzustowski, Mennill 2014 (Sound Finder), and its Python version pysoundfinder, "
    "README.md and dfs_from_files (names and units)",
    options=SoundFinderOptions,
    kind=lambda options: "arrivals",
    rows=_rows,
    begins_like=r"idx\s*[,;\t].*[,;\t]\s*temp\s*$",
    extra={"sensor_z_m": "number", "temperature_c": "number", "sound_speed_m_s": "number"},
)
"""The specification of the importer."""
