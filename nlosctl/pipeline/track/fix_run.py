"""Tracks through the fixes of tables of estimates."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from nlosctl.arrays import IntArray
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import EarthFrame, Scene, parse_frame
from nlosctl.errors import UsageError
from nlosctl.io.paths.inputs import Input
from nlosctl.io.results.fixes import FixTable, read_fixes
from nlosctl.io.results.layouts import EstimatesLayout, carried_columns
from nlosctl.pipeline.engine.writing import ChunkTables, describe_inputs, file_metadata
from nlosctl.pipeline.solve.method_runs import MethodTally
from nlosctl.pipeline.solve.report import RunReport
from nlosctl.pipeline.track.track_options import TrackOptions
from nlosctl.pipeline.track.track_table import (
    SnapshotStates,
    counted,
    density_note,
    optional_columns,
    track_estimates,
    with_tracks,
)
from nlosctl.solvers.tracking.assigned_fixes import AssociationRule, associate_fixes
from nlosctl.solvers.tracking.tracks_of_fixes import TracksOfFixes, track_fixes

__all__ = ["FixRun"]

_OWN_KEYS = ("method", "target", "snapshot")
"""Columns of estimates that may separate tracks, and are written in any case."""


class FixRun:
    """Tracks through the fixes of all inputs; ``schemas`` and ``report`` are as those of a run of methods."""

    def __init__(
        self, inputs: Sequence[Input], read: InputOptions, options: TrackOptions, carry: Sequence[str] = ()
    ) -> None:
        self._inputs, self._options = tuple(inputs), options
        self._by = tuple(read.by)
        self._tracks: list[IntArray] = []
        self._tables = [
            read_fixes(given, read.by, read.timezone, read.max_sort_rows, several=options.association is not None)
            for given in inputs
        ]
        self._refuse_mixed_dimensions()
        self._frame = self._common_frame()
        first = self._tables[0].table
        self._methods = tuple(dict.fromkeys(name for table in self._tables for name in table.methods))
        by = [name for name in self._by if name not in _OWN_KEYS]
        self._layout = EstimatesLayout(
            methods=self._methods,
            input_schema=first.schema,
            carried=carried_columns(first.column_names, carry, by),
            optional=optional_columns(self._tables[0].position_m.shape[1], options, self._frame),
            with_source=len(self._inputs) > 1,
            frame="" if self._frame is None else self._frame.words,
        )
        self.report = RunReport(kind="estimates", inputs=[], methods={name: MethodTally() for name in self._methods})
        self.report.settings = self.provenance()

    @property
    def schemas(self) -> Mapping[str, Any]:
        """The Arrow schema of the one table."""
        return {"estimates": self._layout.schema}

    def provenance(self) -> dict[str, Any]:
        """Return everything that determines the results, as plain values."""
        return {"methods": [{"name": "track"}], "track": {**self._options.as_dict(), "by": list(self._by)}}

    def metadata(self, *, with_hash: bool) -> dict[str, str]:
        """Return the metadata of the result files."""
        rows = {given.name: table.table.num_rows for given, table in zip(self._inputs, self._tables, strict=True)}
        described = describe_inputs(self._inputs, rows, with_hash=with_hash)
        return file_metadata("track", {**self.provenance(), "inputs": described}, Scene(frame=self._frame))

    def tables(self, jobs: int = 1) -> Iterator[ChunkTables]:
        """Yield the states of each input; one process finds them all."""
        paths, key = self._paths()
        start = 0
        for given, table in zip(self._inputs, self._tables, strict=True):
            mine = slice(start, start + len(table.time_s))
            start = mine.stop
            yield self._chunk(given, table, paths, mine)
        lost = sum(int(np.count_nonzero(track < 0)) for track in self._tracks)
        self._note(paths, int(key.max()) + 1 - lost, lost)

    def _paths(self) -> tuple[TracksOfFixes, Any]:
        keys, before = [], 0
        for table in self._tables:
            own = table.key if self._options.association is None else self._associated(table, self._options.association)
            keys.append(own + before)
            before += int(own.max()) + 1
        key = np.concatenate(keys)
        options = self._options
        return track_fixes(
            key,
            np.concatenate([table.elapsed_s for table in self._tables]),
            np.concatenate([table.position_m for table in self._tables]),
            np.concatenate([table.covariance_m2 for table in self._tables]),
            options.density,
            gap_s=options.gap_s,
            causal=options.causal,
        ), key

    def _associated(self, table: FixTable, rule: AssociationRule) -> IntArray:
        """Return the tracks (S,) of fixes, each group by itself; a fix without a position is a track of its own."""
        track, scan = np.full(len(table.time_s), -1, dtype=np.int64), table.scan
        for group in range(int(table.key.max()) + 1):
            rows = np.flatnonzero(table.key == group)
            found = associate_fixes(
                scan[rows], table.elapsed_s[rows], table.position_m[rows], table.covariance_m2[rows], rule
            )
            track[rows] = np.where(found < 0, -1, found + track.max(initial=-1) + 1)
        self._tracks.append(track)
        lost = np.flatnonzero(track < 0)
        key = track.copy()
        key[lost] = track.max(initial=-1) + 1 + np.arange(lost.size)
        return key

    def _chunk(self, given: Input, table: FixTable, paths: TracksOfFixes, mine: slice) -> ChunkTables:
        size = len(table.time_s)
        found = SnapshotStates.of(
            paths.states[mine],
            paths.covariance[mine],
            paths.origin_m[mine],
            paths.known[mine],
            paths.moving[mine],
            np.ones(size, dtype=bool),
            paths.part[mine],
        )
        fixed = paths.fixed[mine]
        number = {name: index for index, name in enumerate(self._methods)}
        estimates = track_estimates(
            found,
            table.time_s,
            table.integers("n_measurements", 1),
            np.where(fixed, table.integers("n_used", 1), 0),
            paths.misfit[mine],
            self._options,
            self._frame,
            method=np.array([number[name] for name in table.methods], dtype=np.int64),
            target=table.integers("target", 0),
        )
        if self._options.association is not None:
            estimates = with_tracks(estimates, self._tracks[len(self.report.inputs)])
        for name, index in number.items():
            self.report.methods[name].add_estimates(estimates, index)
        self.report.inputs.append({"name": given.name, "rows": size + table.further})
        self.report.rows += size + table.further
        self.report.snapshots += size
        lost = size - int(fixed.sum())
        if lost:
            self.report.notes.append(
                f"{given.name}: {counted(lost, 'snapshot')} without a position and a positive definite covariance: "
                "states without data"
            )
        if table.further:
            self.report.notes.append(
                f"{given.name}: {counted(table.further, 'alternative')} left out: the first counts"
            )
        return ChunkTables(named={"estimates": self._layout.table(estimates, table.chunk(given.name))}, rows=size)

    def _note(self, paths: TracksOfFixes, tracks: int, alone: int = 0) -> None:
        """Note the motion and the number of tracks; ``alone`` fixes are in none."""
        found, estimated = paths.density, self._options.density is None
        self.report.notes.append(density_note(found, estimated, tracks, paths.tracks - alone))
        self.report.settings = {
            **self.report.settings,
            "acceleration_psd": found.density,
            "tracks": paths.tracks - alone,
        }

    def _refuse_mixed_dimensions(self) -> None:
        dimensions = [table.position_m.shape[1] for table in self._tables]
        if len(set(dimensions)) > 1:
            flat = self._inputs[dimensions.index(2)].name
            raise UsageError(f"{flat}: no column 'z_m', but other inputs have one; track them one by one")

    def _common_frame(self) -> EarthFrame | None:
        """Return the local plane of the fixes on earth, if any; raise UsageError for several, or one not flat."""
        words = set[str]().union(*(table.frames for table in self._tables))
        if not words:
            return None
        if len(words) > 1:
            raise UsageError(
                f"the estimates are in several local planes ({', '.join(sorted(words))}); track them apart"
            )
        frame = parse_frame(words.pop(), "column 'frame'")
        if frame.on_ellipsoid:
            raise UsageError("tracks are of two dimensions on the earth, or in a frame of their own; leave out heights")
        return frame
