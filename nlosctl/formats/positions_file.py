"""Files of positions that belong to a log: a table with a header, or the scene in place of one."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from nlosctl.contract.formats import BadLine, ForeignFile, UnfitError
from nlosctl.contract.scene import Scene
from nlosctl.errors import DataError, did_you_mean
from nlosctl.formats.fields import number
from nlosctl.formats.scene_sensors import SceneSensors, position_columns
from nlosctl.formats.tables import open_table

__all__ = ["Positions", "line_fault", "number_or_none", "of_places", "of_scene", "of_table", "opened"]

Positions = Callable[[str, Mapping[str, Any], str], Mapping[str, Any]]
"""Returns the columns of a sensor's position by its name, the columns of the time, and the field of the log.

It raises UnfitError for a sensor without a position.
"""

ReadPlace = Callable[[Mapping[str, str]], tuple[str, Mapping[str, Any]] | None]

_MISSING = ("", "NA", "NaN", "null", "None")
"""Cells of exported tables that have no value."""

_LARGEST_M = 1e9
_SHOWN = 60


def number_or_none(text: str, name: str, low: float = -_LARGEST_M, high: float = _LARGEST_M) -> float | None:
    """Return a cell as a number, None if it has no value; raises UnfitError."""
    return None if text in _MISSING else number(text, name, low, high)


def of_scene(file: ForeignFile, cure: str) -> Positions:
    """Return the positions of the scene's sensors in metres; raises DataError with the ``cure`` if it has none."""
    if not file.scene.sensors:
        raise DataError(
            f"{file.name}: has no positions of the sensors: {cure}, or `scene` FILE with [[sensor]], name and position"
        )
    sensors = SceneSensors(file)
    return lambda name, time, field: position_columns(sensors.at(name, time, field))


def of_table(path: str, needed: Sequence[str], read: ReadPlace) -> Positions:
    """Return the positions in a table with a header, which has the columns ``needed``.

    ``read`` returns name and columns of a record, None for one without a position. Raises DataError for a file that
    can't be read, and with the line for a record that ``read`` refuses by UnfitError.
    """
    places = {}
    with opened(path) as file:
        table = open_table(file)
        table.require(needed)
        for line, cells in table.records:
            try:
                if isinstance(cells, BadLine):
                    raise UnfitError(cells.fault, cells.column)
                named = read(cells)
            except UnfitError as unfit:
                raise line_fault(path, line, unfit) from None
            if named is not None:
                places[named[0]] = named[1]
    return of_places(path, places)


def of_places(path: str, places: Mapping[str, Mapping[str, Any]]) -> Positions:
    """Return the positions that a file contains, by name; raises DataError for a file without any."""
    if not places:
        raise DataError(f"{path}: contains no position")

    def position(name: str, time: Mapping[str, Any], field: str) -> Mapping[str, Any]:
        if name not in places:
            raise UnfitError(f"{path} has no sensor {name[:_SHOWN]!r}{did_you_mean(name, places)}", field)
        return places[name]

    return position


def line_fault(path: str, line: int, unfit: UnfitError) -> DataError:
    """Return the error of a line of a file of positions."""
    where = f", field {unfit.column!r}" if unfit.column else ""
    return DataError(f"{path}, line {line}{where}: {unfit.fault}")


@contextmanager
def opened(path: str) -> Iterator[ForeignFile]:
    """Open a file of positions; raises DataError if it can't be read."""
    try:
        with Path(path).open("rb") as stream:
            yield ForeignFile(name=path, stream=stream, scene=Scene())
    except OSError as error:
        raise DataError(f"{path}: can't be read: {error.strerror or error}") from error
