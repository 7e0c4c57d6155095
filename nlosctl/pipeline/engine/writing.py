"""The tables of a run, their sinks, and the provenance in their metadata.

The provenance is identical in equal runs: it contains no time, and no path other than the names given.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from nlosctl.contract.calibration import Calibration
from nlosctl.contract.scene import Scene
from nlosctl.io.calibrations.calibration_file import calibration_digest
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.measurements.windows.chunk_windows import WindowRows
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.input_order import InputOrder, row_indices
from nlosctl.io.scenes.scene_file import SCENE_KEY, scene_to_toml
from nlosctl.io.writers.table_writer import provenance_text
from nlosctl.version import __version__

__all__ = [
    "PROVENANCE_KEY",
    "ChunkTables",
    "Report",
    "Run",
    "Sink",
    "describe_inputs",
    "file_metadata",
    "read_settings",
    "track_columns",
    "write_tables",
]

PROVENANCE_KEY = "nlosctl"


class Sink(Protocol):
    """Receives one of the tables of a run."""

    def write(self, table: Any) -> None:
        """Receive rows."""

    def set_metadata(self, metadata: Mapping[str, str]) -> None:
        """Receive the metadata of the whole table."""


class Report(Protocol):
    """Counts of a run that can be added up, and the summary."""

    notes: list[str]

    @property
    def snapshots(self) -> int:
        """The number of snapshots."""

    def counts(self) -> dict[str, Any]:
        """Return all counts as plain values, for `take`."""

    def take(self, counts: Mapping[str, Any]) -> None:
        """Add the counts of another part of the run."""

    def lines(self) -> list[str]:
        """Return the summary."""

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""


class Run(Protocol):
    """Measurements to tables: a run of methods, or of the bound."""

    @property
    def reader(self) -> MeasurementReader:
        """The reader of the measurements."""

    @property
    def report(self) -> Report:
        """The report of the run; complete when ``tables`` has ended."""

    @property
    def schemas(self) -> Mapping[str, Any]:
        """The Arrow schema of each wanted table by its name."""

    def provenance(self) -> dict[str, Any]:
        """Return everything that determines the results, as plain values."""

    def choices(self) -> dict[str, Any]:
        """Return the other options that two runs must share to write equal tables, as plain values."""

    def metadata(self, command: str, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result files."""

    def tables(self, jobs: int = 1) -> Iterator[ChunkTables]:
        """Yield the results chunk by chunk, in input order, solved by ``jobs`` processes."""

    def add_notes(self, remarks: Sequence[str]) -> None:
        """Add the notes on the counts to the report, after the ``remarks`` of the reader."""


def write_tables(
    tables: Iterable[ChunkTables],
    sinks: Mapping[str, Sink],
    metadata: Callable[[], Mapping[str, str]],
    progress: Callable[[int], None],
) -> None:
    """Pass each table to the sink of its name, and at the end the metadata.

    Flags of windows of time are brought into the order of the input. ``progress`` receives the number of rows of the
    input done so far.
    """
    rows, order = 0, None
    for chunk in tables:
        for name, sink in sinks.items():
            table = chunk.named[name]
            if name != "flags" or chunk.windows is None:
                sink.write(table)
                continue
            windows = chunk.windows
            order = order or InputOrder()
            indices = row_indices(windows, table.num_rows // windows.origin.shape[0])
            for ordered in order.add(table, indices, windows.settled, windows.source):
                sink.write(ordered)
        rows += chunk.rows
        progress(rows)
    for ordered in () if order is None else order.rest():
        sinks["flags"].write(ordered)
    final_metadata = metadata()
    for sink in sinks.values():
        sink.set_metadata(final_metadata)


@dataclass(frozen=True, kw_only=True)
class ChunkTables:
    """The wanted Arrow tables of one chunk by name; ``rows`` is the number of rows of the chunk.

    ``windows`` are those of the chunk, if its snapshots are windows of time.
    """

    named: Mapping[str, Any]
    rows: int
    windows: WindowRows | None = None


def read_settings(reader: MeasurementReader) -> dict[str, Any]:
    """Return the settings of reading that determine the results, without those that have their defaults."""
    options = reader.options
    settings: dict[str, Any] = {"columns": options.columns, "constants": reader.constants}
    settings["all_rows"] = options.all_rows
    settings["dimensions"] = reader.dimension if reader.dimension == 3 else None
    settings |= {name: list(getattr(options, name)) for name in ("wide", "missing", "where")}
    if isinstance(options.calibration, Calibration):
        settings["calibration"] = calibration_digest(options.calibration)
    if options.declination_deg is not None:
        settings["declination_deg"] = options.declination_deg
    if reader.kind == "arrivals":
        settings |= {"speed_m_s": options.speed_m_s, "speed_std_m_s": options.speed_std_m_s}
    if options.window is not None:
        settings |= {"window": options.window, "by": list(options.by), "timezone": options.timezone}
        settings["window_keep"] = options.window_keep
    elif options.timezone is not None:
        settings["timezone"] = options.timezone
    return {name: value for name, value in settings.items() if value}


def file_metadata(command: str, content: Mapping[str, Any], scene: Scene) -> dict[str, str]:
    """Return the metadata of a result file: the provenance as JSON, and the scene as TOML if there is one."""
    provenance = {"version": __version__, "command": command, **content}
    metadata = {PROVENANCE_KEY: provenance_text(provenance)}
    if scene != Scene():
        metadata[SCENE_KEY.decode()] = scene_to_toml(scene)
    return metadata


def track_columns(metadata: Mapping[str, str]) -> tuple[str, ...]:
    """Return the columns that separate the tracks of a file, by the provenance in its metadata."""
    try:
        content = json.loads(metadata.get(PROVENANCE_KEY, "{}"))
        names = content["track"]["by"]
    except (ValueError, KeyError, TypeError):
        return ()
    return tuple(map(str, names)) if isinstance(names, list) else ()


def describe_inputs(inputs: Sequence[Input], rows: Mapping[str, int], *, with_hash: bool) -> list[dict[str, Any]]:
    """Return name, size, number of rows (if known) and, if wanted, SHA-256 of every input file."""
    described = []
    for part in (part for given in inputs for part in given.parts):
        entry: dict[str, Any] = {"name": part.name}
        if part.path is not None:
            entry["bytes"] = part.path.stat().st_size
            if with_hash:
                with part.path.open("rb") as file:
                    entry["sha256"] = hashlib.file_digest(file, "sha256").hexdigest()
        if part.name in rows:
            entry["rows"] = rows[part.name]
        described.append(entry)
    return described
