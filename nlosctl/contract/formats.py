"""The specification of importers and exporters of files, to which the entry points in `nlosctl.formats` refer."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Any, Protocol

import numpy as np

from nlosctl.arrays import FloatArray
from nlosctl.contract.methods import version_fault
from nlosctl.contract.scene import Scene
from nlosctl.contract.tables import ColumnType

__all__ = [
    "FORMATS_VERSION",
    "OLDEST_FORMATS_VERSION",
    "BadLine",
    "ExporterSpec",
    "ForeignFile",
    "ImporterSpec",
    "Places",
    "PlacesWriter",
    "Row",
    "Shapes",
    "UnfitError",
    "formats_fault",
]

FORMATS_VERSION = 3
"""The version of this contract, incremented with every addition; a plugin states the version it was written for."""

OLDEST_FORMATS_VERSION = 1
"""The oldest version whose plugins still work."""


@dataclass(frozen=True, kw_only=True)
class ForeignFile:
    """A file of another program: its name for messages, its bytes and its scene.

    ``more`` are the further files of the run, for an importer that makes one table of ``several``.
    ``by`` are the columns that separate windows of time, in place of the groups of the importer's rows.
    """

    name: str
    stream: IO[bytes]
    scene: Scene
    more: Sequence[ForeignFile] = ()
    by: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Row:
    """A measurement: ``values`` by the names of standard columns, or their other spellings, or further columns.

    ``line`` is its first line. ``epoch_s`` and ``group`` are for `nlosctl.formats.epochs` only: the time in seconds,
    and what else separates snapshots (a frequency, a tag). ``kept`` are cells of the log's own columns, as text.
    """

    line: int
    values: Mapping[str, Any]
    epoch_s: float | None = None
    group: str = ""
    kept: Mapping[str, str | None] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class BadLine:
    """A line with a fault: what was read and what was expected, the name of the column if known, and the text.

    ``file`` is the name of its file, if that is not the first one of the run.
    """

    line: int
    fault: str
    column: str | None = None
    text: str = ""
    file: str | None = None


class UnfitError(Exception):
    """Raised by an importer while it parses a line; ``fault`` and ``column`` are those of `BadLine`."""

    def __init__(self, fault: str, column: str | None = None) -> None:
        super().__init__(fault)
        self.fault, self.column = fault, column


@dataclass(frozen=True, kw_only=True)
class ImporterSpec:
    """An importer.

    ``reference`` is the document that defines the format, ``options`` a frozen dataclass whose fields
    (`nlosctl.contract.options.option`) are the parameters. ``rows(file, options)`` yields the rows of each snapshot
    consecutively, and a `BadLine` for each line with a fault; it raises DataError if the file cannot be used at all.
    ``kind(options)`` is the kind of measurement, ``extra`` the types of columns that are not standard. A file is
    recognized by the pattern ``begins_like`` (a regular expression), which matches the beginning of a line that only
    its program writes: a header or any record. Files of arrays are recognized by one of the sets of names ``arrays``.
    With ``several`` it makes one table of all files of a run, and a folder is its files.
    """

    name: str
    summary: str
    reference: str
    options: type[Any]
    kind: Callable[[Any], str]
    rows: Callable[[ForeignFile, Any], Iterator[Row | BadLine]]
    extra: Mapping[str, ColumnType] = field(default_factory=dict)
    begins_like: str = ""
    arrays: Sequence[Sequence[str]] = ()
    several: bool = False
    contract_version: int | None = None

    @property
    def full_name(self) -> str:
        """The name of its entry point."""
        return f"import.{self.name}"


@dataclass(frozen=True, kw_only=True)
class Places:
    """N estimates to be shown on a map.

    ``columns`` has all of their columns as Python values. ``x`` and ``y`` (N,) are longitude and latitude in degrees
    (metres of the plane unless ``on_earth``), NaN without a position, ``z`` (N,) the height in metres, None in the
    plane. ``outline`` (N, V, 2) is the error ellipse of ``probability``, counter-clockwise, with the first point
    repeated at the end, NaN without a covariance. ``semi_major_m``, ``semi_minor_m`` (N,) are its semi-axes,
    ``major_azimuth_rad`` (N,) the direction of its major axis, clockwise from true north. ``cut`` has the parts of
    outlines that cross the 180th meridian or go around a pole, by row: closed rings between -180 and 180 degrees.
    ``track`` are the columns by which the estimates are states of separate tracks, if they are.
    """

    columns: Mapping[str, Sequence[Any]]
    x: FloatArray
    y: FloatArray
    outline: FloatArray
    probability: float
    semi_major_m: FloatArray
    semi_minor_m: FloatArray
    major_azimuth_rad: FloatArray
    on_earth: bool
    cut: Mapping[int, Sequence[FloatArray]] = field(default_factory=dict)
    z: FloatArray | None = None
    track: Sequence[str] = ()

    def point(self, row: int) -> list[float]:
        """Return x and y of a row, and the height where there are heights; empty without a position."""
        axes = (self.x, self.y) if self.z is None else (self.x, self.y, self.z)
        point = [float(axis[row]) for axis in axes]
        return [] if np.isnan(point).any() else point

    def rings(self, row: int) -> Sequence[FloatArray]:
        """Return the rings (V, 2) of the ellipse of a row: one, or more where it is cut, none without a covariance."""
        if np.isnan(self.outline[row, 0, 0]):
            return ()
        return self.cut.get(row, (self.outline[row],))

    @property
    def size(self) -> int:
        """The number of estimates."""
        return int(self.x.shape[0])


@dataclass(frozen=True, kw_only=True)
class Shapes:
    """N lines or polygons to be shown on a map, such as lines of bearing.

    ``columns`` has all of their columns as Python values, ``feature`` names what they are. ``parts`` has for each row
    its lines, or rings if ``closed``, as points (P, 2) like those of `Places`: several where the 180th meridian cuts
    one, none where a value is missing. A clockwise ring is a hole of the counter-clockwise one before it.
    """

    columns: Mapping[str, Sequence[Any]]
    feature: str
    parts: Sequence[Sequence[FloatArray]]
    closed: bool


class PlacesWriter(Protocol):
    """Writes estimates to a map file; one that can write `Shapes` too has a method ``write_shapes``."""

    def write(self, places: Places) -> None:
        """Write some of the estimates."""

    def close(self) -> None:
        """Complete the file; the sink stays open."""


@dataclass(frozen=True, kw_only=True)
class ExporterSpec:
    """An exporter of estimates.

    ``start(sink, options)`` begins a file and returns its writer, which receives the estimates in batches of any size;
    the file must not depend on the sizes. ``options`` are as in `ImporterSpec`; those named ``ellipse``, ``vertices``
    and ``metres`` determine the contents of `Places`. ``name`` is also the extension of the files.
    """

    name: str
    summary: str
    reference: str
    options: type[Any]
    start: Callable[[IO[bytes], Any], PlacesWriter]
    contract_version: int | None = None

    @property
    def full_name(self) -> str:
        """The name of its entry point."""
        return f"export.{self.name}"


def formats_fault(version: int | None) -> str:
    """Return why a plugin written for a version cannot be used here, or an empty string."""
    return version_fault(version, FORMATS_VERSION, OLDEST_FORMATS_VERSION, "spec")
