"""The sensors of the scene for an importer: the entry of each that holds at the time of a row."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from datetime import datetime
from typing import Any

from nlosctl.contract.formats import ForeignFile, UnfitError
from nlosctl.contract.scene import Sensor
from nlosctl.errors import did_you_mean

__all__ = ["SceneSensors", "position_columns"]

_SHOWN = 60


class SceneSensors:
    """The sensors of a file's scene by name, those of several entries with the times at which each holds."""

    def __init__(self, file: ForeignFile) -> None:
        self._entries: dict[str, list[Sensor]] = {}
        for sensor in file.scene.sensors:
            self._entries.setdefault(sensor.name, []).append(sensor)

    def __iter__(self) -> Iterator[str]:
        return iter(self._entries)

    def __contains__(self, name: object) -> bool:
        return name in self._entries

    def at(self, name: str, time: Mapping[str, Any], field: str) -> Sensor:
        """Return the entry of a sensor that holds at the time in the columns ``time_s`` or ``time``.

        Raises UnfitError for a sensor that the scene lacks, or that has no entry at this time. Numbers limit
        ``time_s``, date-times a ``time`` with an offset; others are an UnfitError too.
        """
        entries = self._entries.get(name)
        if entries is None:
            raise UnfitError(f"the scene has no sensor {name[:_SHOWN]!r}{did_you_mean(name, self._entries)}", field)
        for entry in entries:
            if _holds(entry, time, field):
                return entry
        shown = next(iter(time.values()))
        raise UnfitError(f"the scene's sensor {name!r} is not valid at {shown}; extend its 'from' or 'to'", field)


def _holds(entry: Sensor, time: Mapping[str, Any], field: str) -> bool:
    if not entry.limits:
        return True
    moment: Any = time.get("time_s")
    if "time" in time:
        moment = datetime.fromisoformat(time["time"])
    limit = entry.limits[0]
    if isinstance(limit, datetime) != isinstance(moment, datetime):
        kinds = "date-times" if isinstance(limit, datetime) else "numbers"
        raise UnfitError(
            f"the scene limits sensor {entry.name!r} by {kinds}, which the times of the log are not", field
        )
    if isinstance(moment, datetime) and moment.tzinfo is None:
        raise UnfitError(f"got {time['time']!r} without an offset, and the scene limits sensor {entry.name!r}", field)
    return (entry.start is None or entry.start <= moment) and (entry.end is None or moment < entry.end)


def position_columns(sensor: Sensor) -> dict[str, Any]:
    """Return the columns of a sensor's position."""
    return {"sensor_x_m": sensor.position[0], "sensor_y_m": sensor.position[1], "sensor_z_m": sensor.z_m}
