"""The specification of an importer or exporter of files: what a plugin's entry point in `nlosctl.formats` must name."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Any, Protocol

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
    "UnfitError",
    "formats_fault",
]

FORMATS_VERSION = 1
"""The version of this contract, raised with every addition; plugins say for which they were written."""

OLDEST_FORMATS_VERSION = 1
"""The oldest version whose plugins still work."""


@dataclass(frozen=True, kw_only=True)
class ForeignFile:
    """A file of another program: its name, for messages, its bytes, and the scene that goes with it."""

    name: str
    stream: IO[bytes]
    scene: Scene


@dataclass(frozen=True, kw_only=True)
class Row:
    """A measurement: ``values`` by the names of the contract's columns (or other spellings of them), or further ones.

    ``line`` is where it begins, ``epoch`` and ``group`` are for `nlosctl.formats.epochs` alone: the time in seconds,
    and what else parts snapshots (a frequency, a tag).
    """

    line: int
    values: Mapping[str, Any]
    epoch_s: float | None = None
    group: str = ""


@dataclass(frozen=True, kw_only=True)
class BadLine:
    """A line that does not fit: what came and what was expected, the field by its name where it is one, the text."""

    line: int
    fault: str
    column: str | None = None
    text: str = ""


class UnfitError(Exception):
    """Raised by an importer while it takes a line apart: ``fault`` and ``column`` as in `BadLine`."""

    def __init__(self, fault: str, column: str | None = None) -> None:
        super().__init__(fault)
        self.fault, self.column = fault, column


@dataclass(frozen=True, kw_only=True)
class ImporterSpec:
    """An importer, frozen.

    ``reference`` is the document that the format was taken from, ``options`` a frozen dataclass whose fields
    (`nlosctl.contract.options.option`) are the parameters. ``rows(file, options)`` yields the rows of a snapshot
    together, and a `BadLine` for each line that does not fit; it raises DataError where the whole file is of no use.
    ``kind(options)`` is the kind of measurement, ``extra`` the type of columns that the contract does not know.
    """

    name: str
    summary: str
    reference: str
    options: type[Any]
    kind: Callable[[Any], str]
    rows: Callable[[ForeignFile, Any], Iterator[Row | BadLine]]
    extra: Mapping[str, ColumnType] = field(default_factory=dict)
    contract_version: int | None = None

    @property
    def full_name(self) -> str:
        """The name of its entry point."""
        return f"import.{self.name}"


@dataclass(frozen=True, kw_only=True)
class Places:
    """N estimates to put on a map.

    ``columns`` holds all of their columns as Python values. ``x`` and ``y`` (N,) are longitude and latitude in degrees
    (metres of the plane where ``on_earth`` is false), NaN where there is no position. ``outline`` (N, V, 2) is the
    ellipse that holds ``probability`` of Gaussian errors, counter-clockwise, its first point again at the end, NaN
    where there is no covariance. ``semi_major_m``, ``semi_minor_m`` (N,) are its semi-axes, ``major_azimuth_rad`` (N,)
    the direction of its major axis, clockwise from true north.
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

    @property
    def size(self) -> int:
        """How many there are."""
        return int(self.x.shape[0])


class PlacesWriter(Protocol):
    """Writes a file of places."""

    def write(self, places: Places) -> None:
        """Write some."""

    def close(self) -> None:
        """End the file; the sink stays open."""


@dataclass(frozen=True, kw_only=True)
class ExporterSpec:
    """An exporter of estimates, frozen.

    ``start(sink, options)`` begins a file and returns what takes the places, in pieces that nothing may depend on, and
    ends the file when closed; the sink stays open. ``options`` are as in `ImporterSpec`; those named ``ellipse``,
    ``vertices`` and ``metres`` say what the places are to hold. ``name`` is the extension of such files too.
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
    """Return in words why a plugin written for a version can't be used here; empty where it can."""
    return version_fault(version, FORMATS_VERSION, OLDEST_FORMATS_VERSION, "spec")
