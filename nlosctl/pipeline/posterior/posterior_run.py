"""A run that makes posterior maps of measurements, with the interface of a run of methods."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.fields import SensorsField
from nlosctl.contract.run_options import SolveOptions
from nlosctl.errors import DataError, UsageError
from nlosctl.io.measurements.reader import Chunk, MeasurementReader
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.tables import posterior_schema, posterior_table
from nlosctl.pipeline.engine.writing import ChunkTables, describe_inputs, file_metadata, read_settings
from nlosctl.pipeline.posterior.cell_grids import Bounds, CellGrid
from nlosctl.pipeline.posterior.cell_masses import hpd_shares
from nlosctl.pipeline.posterior.combined_map import CombinedCosts
from nlosctl.pipeline.posterior.snapshot_maps import SnapshotMaps
from nlosctl.pipeline.solve.advice import Measured, report_alone
from nlosctl.pipeline.solve.likely_causes import cause_remarks, some_snapshots
from nlosctl.pipeline.solve.method_runs import MethodRun, unused_columns
from nlosctl.pipeline.solve.report import bad_fit_remarks
from nlosctl.pipeline.solve.target_heights import height_settings, heights_remark, refuse_dimension, with_target_heights
from nlosctl.solvers.sequential.priors import PriorOptions

__all__ = ["PosteriorOptions", "PosteriorReport", "PosteriorRun"]

_COARSE = 0.5
"""A cell with so much of the probability is too large to show the posterior."""


@dataclass(frozen=True, kw_only=True)
class PosteriorOptions:
    """Which maps are made: of one ``snapshot``, of all or of all combined, and their cells in metres."""

    of: Literal["snapshot", "all", "combine"]
    snapshot: str | None = None
    cell_m: float | None = None
    max_cells: int = 1_000_000


@dataclass
class PosteriorReport:
    """The number of snapshots, of those without a map, and of maps with a cell that has most of the probability."""

    kind: str
    method: str
    combined: bool
    snapshots: int = 0
    without: int = 0
    coarse: int = 0
    grid: CellGrid | None = None
    notes: list[str] = field(default_factory=list)

    def counts(self) -> dict[str, Any]:
        """Return all counts as plain values, for `take`."""
        return {"snapshots": self.snapshots, "without": self.without, "coarse": self.coarse}

    def take(self, counts: Mapping[str, Any]) -> None:
        """Add the counts of another part of the run."""
        for name, value in counts.items():
            setattr(self, name, getattr(self, name) + value)

    def lines(self) -> list[str]:
        """Return the summary."""
        cells = "" if self.grid is None else f", {self.grid.columns} x {self.grid.rows} cells of {self.grid.cell_m:g} m"
        of = f"{self.snapshots} snapshots combined" if self.combined else _counted(self.snapshots, "snapshot")
        lines = [f"posterior of {self.kind} by {self.method}: {of}{cells}"]
        if self.without:
            lines.append(f"note: {_counted(self.without, 'snapshot')} without a row that is used, or a possible cell")
        if self.coarse:
            where = "" if self.combined else f" of {_counted(self.coarse, 'map')}"
            lines.append(
                f"note: one cell{where} has more than half of the probability: the posterior is narrower than a cell; "
                "choose a smaller `cell`"
            )
        return lines + [f"note: {note}" for note in self.notes]

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        cells = {} if self.grid is None else {"grid": dataclasses.asdict(self.grid)}
        notes = {"notes": self.notes} if self.notes else {}
        return {"kind": self.kind, "method": self.method, "combined": self.combined, **self.counts(), **cells, **notes}


def _counted(number: int, what: str) -> str:
    return f"{number} {what}" if number == 1 else f"{number} {what}s"


class PosteriorRun:
    """Makes the maps of what a reader yields, by a method with ``prior``.

    ``open_again`` returns another reader of the same input.
    """

    def __init__(
        self,
        reader: MeasurementReader,
        run: MethodRun,
        prior: PriorOptions,
        options: SolveOptions,
        maps: PosteriorOptions,
        open_again: Callable[[], MeasurementReader],
    ) -> None:
        self.reader, self._run, self._prior, self._options, self._maps = reader, run, prior, options, maps
        self._open_again = open_again
        self._judged, self._misfits = False, list[str]()
        refuse_dimension([run], reader.dimension, options.field)
        if reader.scene.frame is not None and reader.scene.frame.on_ellipsoid:
            raise UsageError(
                "a map is in a plane, and these are places on earth in three dimensions; set `dimensions` to 2"
            )
        read: dict[str, Any] = {"kind": reader.kind, "scene": reader.scene, "dimension": reader.dimension}
        cells: dict[str, Any] = {"cell_m": maps.cell_m, "max_cells": maps.max_cells}
        self._makes = SnapshotMaps(**read, **cells, run=run, prior=prior, field=options.field)
        self.report = PosteriorReport(kind=reader.kind, method=run.spec.name, combined=maps.of == "combine")

    @property
    def schemas(self) -> dict[str, Any]:
        """The Arrow schema of the only table, ``posterior``."""
        return {"posterior": posterior_schema(self.reader.table_schema if self._maps.of == "all" else None)}

    def provenance(self) -> dict[str, Any]:
        """Return the options that determine the results, as plain values."""
        method = {"name": self._run.spec.full_name, "parameters": dataclasses.asdict(self._run.options)}
        prior = {name: value for name, value in dataclasses.asdict(self._prior).items() if value is not None}
        content = {"method": method, "prior": prior, "field": str(self._options.field)}
        return content | dataclasses.asdict(self._maps) | read_settings(self.reader) | height_settings(self._options)

    def choices(self) -> dict[str, Any]:
        """Return the other options that two runs must share to write equal tables: none."""
        return {}

    def metadata(self, command: str, inputs: Sequence[Input], *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result file."""
        described = describe_inputs(inputs, {}, with_hash=with_hash)
        return file_metadata(command, {**self.provenance(), "inputs": described}, self.reader.scene)

    def tables(self, jobs: int = 1) -> Iterator[ChunkTables]:
        """Yield the maps in input order; raises what reading raises, and DataError without any map."""
        makes = {"snapshot": self._one_map, "all": self._all_maps, "combine": self._combined_map}
        yield from makes[self._maps.of]()
        self.add_notes(self.reader.report.remarks)

    def add_notes(self, remarks: Sequence[str]) -> None:
        """Add the remarks of the reader, and on rows that do not fit, to the report."""
        reader = self.reader
        self.report.notes += [
            *remarks,
            *heights_remark(reader, self._options),
            *(window_remarks(reader.report.windows, reader.options.window) if reader.report.windows else ()),
            *unused_columns([self._run], reader.kind, [*reader.schema.names, *reader.constants]),
            *self._misfits,
        ]

    def _judge(self, chunk: Chunk, snapshots: IntArray) -> None:
        """Keep the remarks on snapshots of a chunk whose rows do not fit, if it is the first to be judged."""
        if self._judged:
            return
        self._judged = True
        alone = report_alone(some_snapshots(chunk, snapshots), self.reader, self._run, self._options.field)
        self._misfits = bad_fit_remarks([self._run], alone)
        if alone.refits:
            self._misfits += cause_remarks(alone.refits, Measured.of(self.reader))

    def _chunks(self, reader: MeasurementReader) -> Iterator[Chunk]:
        for chunk in reader.chunks():
            chunk = with_target_heights(chunk, reader.dimension, self._options)
            if reader.scene.reflectors:
                from nlosctl.pipeline.solve.reflected_ranges import refuse_reflected_ranges

                refuse_reflected_ranges(chunk, reader.kind, reader.scene, [self._run])
            yield chunk

    def _one_map(self) -> Iterator[ChunkTables]:
        wanted, seen, source = self._maps.snapshot, 0, ""
        for chunk in self._chunks(self.reader):
            ids = [str(name) for name in chunk.snapshot.to_pylist()]
            seen += len(ids)
            if wanted not in ids:
                continue
            if source:
                raise _in_two_inputs(wanted, source, chunk.source)
            source, index = chunk.source, ids.index(wanted)
            yield from self._tables(chunk, index, index + 1)
            if self.report.without:
                raise DataError(f"{chunk.source}: snapshot {wanted!r} has nothing to show: {_NO_MAP}")
            if not self.reader.has_several_sources:
                return
        if not source:
            raise DataError(f"no snapshot {wanted!r} among the {seen} of the input")

    def _all_maps(self) -> Iterator[ChunkTables]:
        sources: dict[str, str] = {}
        for chunk in self._chunks(self.reader):
            for name in chunk.snapshot.to_pylist() if self.reader.has_several_sources else ():
                if sources.setdefault(str(name), chunk.source) != chunk.source:
                    raise _in_two_inputs(str(name), sources[str(name)], chunk.source)
            yield from self._tables(chunk, 0, len(chunk.snapshot))
        if self.report.without == self.report.snapshots:
            raise DataError(f"no snapshot has anything to show: each has {_NO_MAP}")

    def _tables(self, chunk: Chunk, first: int, last: int) -> Iterator[ChunkTables]:
        rows = int(chunk.offsets[last] - chunk.offsets[first])
        self.report.snapshots += last - first
        self.report.without += last - first
        for found in self._makes.maps(chunk, first, last):
            if np.isnan(found.probability[0]):
                continue
            self.report.without -= 1
            self._judge(chunk, np.arange(first, last))
            yield self._table(found.grid, found.probability, rows, chunk.snapshot[found.snapshot])
            rows = 0

    def _combined_map(self) -> Iterator[ChunkTables]:
        grid = CellGrid.over(self._all_bounds(), self._maps.cell_m, self._maps.max_cells, "the combined map")
        costs, rows = CombinedCosts(grid), 0
        for chunk in self._chunks(self.reader):
            self.report.snapshots += len(chunk.snapshot)
            rows += int(chunk.offsets[-1])
            self._judge(chunk, np.arange(len(chunk.snapshot)))
            for _, batch in self._makes.batches(chunk, 0, len(chunk.snapshot)):
                costs.add(self._makes.cost(batch, with_prior=False), self._makes.cost(batch).priors())
        self.report.without = self.report.snapshots - costs.snapshots
        probability = costs.probability(grid.inside_share(self._options.field))
        if probability is None or not costs.snapshots:
            raise DataError(f"the combined map has nothing to show: {_NO_MAP}")
        yield self._table(grid, probability, rows)

    def _all_bounds(self) -> Bounds:
        """Return the bounds of the search regions of all snapshots, from a first pass where they differ."""
        bounds = [np.inf, -np.inf, np.inf, -np.inf]
        reader = self._open_again()
        for chunk in self._chunks(reader):
            low, high = _extremes(self._makes.bounds(chunk))
            bounds = [min(bounds[0], low[0]), max(bounds[1], high[1]), min(bounds[2], low[2]), max(bounds[3], high[3])]
            if not isinstance(self._options.field, SensorsField):
                break
        reader.close()
        return bounds[0], bounds[1], bounds[2], bounds[3]

    def _table(self, grid: CellGrid, probability: FloatArray, rows: int, snapshot: Any = None) -> ChunkTables:
        x, y = grid.centers()
        self.report.coarse += bool(probability.max() > _COARSE)
        self.report.grid = grid
        arrays = {"x_m": x, "y_m": y, "probability": probability, "hpd": hpd_shares(probability[None])[0]}
        return ChunkTables(named={"posterior": posterior_table(arrays, self.schemas["posterior"], snapshot)}, rows=rows)


def _in_two_inputs(snapshot: str, first: str, second: str) -> DataError:
    return DataError(
        f"snapshot {snapshot!r} is in {first} and in {second}, and a map has no column for its input; make the maps of "
        "one input at a time, or make the ids unique"
    )


_NO_MAP = "no row that is used, or no possible cell in the search region"


def _extremes(bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    known = bounds[~np.isnan(bounds[:, 0])]
    if not known.shape[0]:
        return np.full(4, np.inf), np.full(4, -np.inf)
    return known.min(axis=0), known.max(axis=0)
