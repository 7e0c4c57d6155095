"""A run of the bound over measurements, with the interface of a run of methods."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from nlosctl.contract.run_options import SolveOptions
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.io.paths.inputs import Input
from nlosctl.pipeline.bound.bounds import bounds_at_truth, bounds_on_map, first_chunk, map_sensors, result_schema
from nlosctl.pipeline.bound.map_grid import MapGrid
from nlosctl.pipeline.engine.writing import ChunkTables, describe_inputs, file_metadata, read_settings
from nlosctl.pipeline.solve.target_heights import height_settings, heights_remark

__all__ = ["BoundReport", "BoundRun"]


@dataclass
class BoundReport:
    """The number of positions, called ``what``, and how many of them have a bound."""

    kind: str
    map: str | None
    what: str
    positions: int = 0
    bounded: int = 0
    notes: list[str] = field(default_factory=list)
    windows: Counter[str] = field(default_factory=Counter)

    @property
    def snapshots(self) -> int:
        """The number of positions, under the name in other reports."""
        return self.positions

    def counts(self) -> dict[str, Any]:
        """Return all counts as plain values, for `take`."""
        return {"snapshots": self.positions, "bounded": self.bounded, "windows": dict(self.windows)}

    def take(self, counts: Mapping[str, Any]) -> None:
        """Add the counts of another part of the run."""
        self.positions += counts["snapshots"]
        self.bounded += counts["bounded"]
        self.windows.update(counts["windows"])

    def lines(self) -> list[str]:
        """Return the summary."""
        return [
            f"bound of {self.kind}: {self.bounded} of {self.positions} {self.what} have one",
            *(f"note: {note}" for note in self.notes),
        ]

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        notes = {"notes": self.notes} if self.notes else {}
        return {"kind": self.kind, "map": self.map, self.what: self.positions, "bounded": self.bounded, **notes}


class BoundRun:
    """Computes the bound of every snapshot at its truth, or over a map: ``grid``, whose text is ``map``."""

    def __init__(
        self, reader: MeasurementReader, options: SolveOptions, grid: MapGrid | None = None, map: str | None = None
    ) -> None:
        self.reader, self._options, self._grid, self._map = reader, options, grid, map
        what = "snapshots" if grid is None else "positions"
        self._scene = reader.scene
        self.report = BoundReport(kind=reader.kind, map=map, what=what)

    @property
    def schemas(self) -> dict[str, Any]:
        """The Arrow schema of the only table, ``bound``."""
        return {"bound": result_schema(self.reader, self._grid)}

    def provenance(self) -> dict[str, Any]:
        """Return the options that determine the results, as plain values."""
        content = {"map": self._map, "noise": self._options.noise, "use_ranges": self._options.use_ranges}
        content |= {"motion": "velocity"} if self.reader.options.keep_times else {}
        return content | height_settings(self._options) | read_settings(self.reader)

    def choices(self) -> dict[str, Any]:
        """Return the other options that two runs must share to write equal tables: none."""
        return {}

    def metadata(self, command: str, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result file."""
        described = describe_inputs(inputs, {}, with_hash=with_hash)
        return file_metadata(command, {**self.provenance(), "inputs": described}, self._scene)

    def tables(self, jobs: int = 1) -> Iterator[ChunkTables]:
        """Yield the bounds in input order; raises what reading raises."""
        if self._grid is None:
            tables = bounds_at_truth(self.reader, self._options)
        else:
            chunk = first_chunk(self.reader)
            if "sensor" in chunk.columns:
                self._scene = dataclasses.replace(self._scene, sensors=map_sensors(chunk, self.reader))
            tables = bounds_on_map(self.reader, chunk, self._grid, self._options)
        for table in tables:
            self.report.positions += table.num_rows
            self.report.bounded += table.num_rows - table.column("rms_m").null_count
            yield ChunkTables(named={"bound": table}, rows=table.num_rows)
        self.report.windows = self.reader.report.windows
        if not self.reader.reads_one_part:
            self.add_notes(self.reader.report.remarks)

    def add_notes(self, remarks: Sequence[str]) -> None:
        """Add the remarks of the reader, and those on columns that the bound does not use, to the report."""
        self.report.notes += [*remarks, *window_remarks(self.report.windows, self.reader.options.window)]
        names = self.reader.column_names
        self.report.notes += heights_remark(self.reader, self._options)
        if not self._options.use_ranges and (
            self.reader.kind != "bearings" or "range_m" not in self.reader.schema.names
        ):
            self.report.notes.append(f"ranges are not left out: these {self.reader.kind} have none beside bearings")
        if self.reader.kind == "bearings" and "prior_x_m" in names:
            self.report.notes.append("the column 'prior_x_m' is not used: the bound is that of the bearings alone")
