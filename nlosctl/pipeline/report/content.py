"""The content of the page as plain values: what is drawn and listed of each file."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import EarthFrame, Scene, parse_frame
from nlosctl.errors import DataError
from nlosctl.io.results.plot_inputs import PlotInput, SampledRows, read_sampled
from nlosctl.io.results.sampled_snapshots import SampledSnapshots, read_sampled_snapshots
from nlosctl.io.results.status_counts import count_statuses
from nlosctl.io.row_steps.conditions import parse_condition
from nlosctl.pipeline.engine.writing import PROVENANCE_KEY
from nlosctl.pipeline.report import statistics
from nlosctl.pipeline.report.estimate_rows import ESTIMATE_COLUMNS, EstimateRows
from nlosctl.pipeline.report.measured_rows import MeasuredRows
from nlosctl.pipeline.report.plane_map import PlaneMap
from nlosctl.pipeline.report.posterior_maps import POSTERIOR_COLUMNS, PosteriorMaps

__all__ = ["ReportContent", "report_content"]

_TAKEN = ("measurements", "flags", "estimates", "scores", "bound", "posterior")
_MOST_SCORES = 1000
_MOST_CELLS = 1_000_000


@dataclass
class ReportContent:
    """The ``page`` as plain values, and ``notes`` on what it does not show, which name settings in backquotes."""

    page: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)


def report_content(
    files: Sequence[PlotInput], read: InputOptions, *, title: str, max_rows: int, wording: Callable[[str], str] = str
) -> ReportContent:
    """Return the content of the page of some files, each with about ``max_rows`` rows at most.

    Memory is that of the sampled rows, and of the errors of all estimates that have a truth. Raises DataError for a
    file that has no place on the page, and for places on different planes.
    """
    for file in files:
        if file.content not in _TAKEN:
            raise DataError(f"{file.name}: a page has no place for a {file.content}; 'nlosctl plot' draws it")
    work = _Work(files=files, read=read, max_rows=max_rows)
    work.read_files()
    page = {"title": title, **work.page(), "notes": [wording(note) for note in work.notes]}
    return ReportContent(page=page, notes=work.notes)


@dataclass
class _Work:
    """Files on their way to the page."""

    files: Sequence[PlotInput]
    read: InputOptions
    max_rows: int
    notes: list[str] = field(default_factory=list)
    plane: PlaneMap = field(default_factory=PlaneMap)
    described: list[dict[str, Any]] = field(default_factory=list)
    measured: list[tuple[SampledSnapshots, MeasuredRows]] = field(default_factory=list)
    estimates: list[EstimateRows] = field(default_factory=list)
    maps: list[PosteriorMaps] = field(default_factory=list)
    tables: list[dict[str, Any]] = field(default_factory=list)
    scenes: dict[Scene, None] = field(default_factory=dict)
    frames: dict[EarthFrame | None, str] = field(default_factory=dict)

    def read_files(self) -> None:
        """Read every file once for the map, and again for its statistics."""
        estimates = [file for file in self.files if file.content == "estimates"]
        counts = {file.name: count_statuses(file) for file in estimates}
        if counts:
            self.tables.append(statistics.status_table(counts))
        errors = statistics.error_table(estimates)
        self.tables += [errors] if errors else []
        flagged = {file.kind for file in self.files if file.content == "flags"}
        for file in self.files:
            if file.content == "estimates":
                self._read_estimates(file, named=len(estimates) > 1)
            elif file.content == "posterior":
                self._read_posterior(file)
            elif file.content in ("scores", "bound"):
                rows = read_sampled(file, ("*",), _MOST_SCORES)
                self._describe(file, rows.total, "", rows.step)
                self.tables.append(statistics.score_table(file, rows))
            else:
                self._read_measured(file, is_drawn=file.content == "flags" or file.kind not in flagged)
        if errors is None and not flagged and estimates:
            self.notes.append(
                "no truth, so no errors; residuals by sensor are those of flags (`flags_out` of localize)"
            )
        self.plane.settle()

    def page(self) -> dict[str, Any]:
        """Return what was read as plain values."""
        index: dict[str, int] = {}
        shown = [sample.ids for sample, _ in self.measured]
        shown += [rows.ids for rows in self.estimates] + [maps.ids for maps in self.maps]
        for names in shown:
            for name in names:
                index.setdefault(name, len(index))
        frame = next(iter(self.frames), None)
        measured = [rows.content(np.array([index[name] for name in sample.ids])) for sample, rows in self.measured]
        for _, drawn in self.measured:
            self.notes += drawn.notes
        return {
            "files": self.described,
            "frame": "" if frame is None else frame.words,
            "snapshots": list(index),
            "map": self.plane.content(list(self.scenes)),
            "measured": measured,
            "estimates": [
                rows.content([index[name] for name in rows.ids], self.plane, frame) for rows in self.estimates
            ],
            "posterior": [one for maps in self.maps for one in maps.content(index, self.plane)],
            "tables": self.tables,
        }

    def _read_estimates(self, file: PlotInput, *, named: bool) -> None:
        rows = read_sampled(file, ESTIMATE_COLUMNS, self.max_rows)
        self._describe(file, rows.total, "", rows.step)
        if rows.step > 1:
            self._note_thinning(file, rows.step, f"{rows.count} of {rows.total} estimates")
        self._place(file.scene, file.scene.frame or _frame_of(rows) or self.read.frame, file)
        self.estimates.append(EstimateRows(file.name, rows, self.plane, named=named))

    def _read_posterior(self, file: PlotInput) -> None:
        rows = read_sampled(file, POSTERIOR_COLUMNS, _MOST_CELLS)
        self._describe(file, rows.total, "", rows.step)
        if rows.step > 1:
            self.notes.append(f"{file.name}: 1 of {rows.step} maps is shown, {rows.count} of {rows.total} cells")
        self._place(file.scene, file.scene.frame or self.read.frame, file)
        self.maps.append(PosteriorMaps(file.name, rows, self.plane))

    def _read_measured(self, file: PlotInput, *, is_drawn: bool) -> None:
        read = self.read
        if file.content == "flags":
            table, note = statistics.residual_table(file, read.speed_m_s)
            self.tables += [table] if table else []
            self.notes += [note] if note else []
            scored = statistics.flag_table(file)
            self.tables += [scored] if scored else []
            chosen = [parse_condition(condition).column for condition in read.where]
            if "method" in file.names and "method" not in chosen:
                method = str(read_sampled(file, ("method",), 1000).columns["method"][0])
                read = replace(read, where=(*read.where, f"method == {method}"))
                self.notes.append(f"{file.name}: the rays are those of the rows of {method}; `where` selects others")
        if not is_drawn:
            self._describe(file, None, file.kind, 1)
            return
        sample = read_sampled_snapshots(file, read, self.max_rows)
        self._describe(file, sample.rows, sample.kind, sample.step, sample.snapshots)
        if sample.step > 1:
            self._note_thinning(file, sample.step, f"{len(sample.ids)} of {sample.snapshots} snapshots")
        self._place(sample.scene, sample.scene.frame, file)
        self.measured.append((sample, MeasuredRows(sample, self.plane)))

    def _place(self, scene: Scene, frame: EarthFrame | None, file: PlotInput) -> None:
        """Add the scene of a file; raise DataError if its plane is not that of the files before."""
        self.frames.setdefault(frame, file.name)
        if len(self.frames) > 1:
            (first, name), (second, other) = list(self.frames.items())[:2]
            raise DataError(
                f"{name} and {other}: places in different planes ({_words(first)}; {_words(second)}); give `crs` or "
                "`origin` for files of x and y in metres, or make a page of each"
            )
        self.scenes.setdefault(scene)
        self.plane.add_scene(scene)

    def _describe(self, file: PlotInput, rows: int | None, kind: str, step: int, snapshots: int | None = None) -> None:
        described = {"name": file.name, "content": file.content, "kind": kind, "rows": rows, "snapshots": snapshots}
        self.described.append({**described, "step": step, "provenance": _provenance(file)})

    def _note_thinning(self, file: PlotInput, step: int, counts: str) -> None:
        self.notes.append(f"{file.name}: 1 of {step} snapshots is shown, {counts} (`max_rows`)")


def _provenance(file: PlotInput) -> list[list[str]]:
    """Return the provenance in the metadata of a file as names and texts."""
    try:
        found = json.loads(file.metadata.get(PROVENANCE_KEY.encode(), b"{}"))
    except ValueError:
        return []
    if not isinstance(found, dict):
        return []
    return [[str(name), value if isinstance(value, str) else json.dumps(value)] for name, value in found.items()]


def _frame_of(rows: SampledRows) -> EarthFrame | None:
    """Return the frame in the column of estimates that names it."""
    words = next((word for word in rows.columns.get("frame", ()) if word), None)
    return None if words is None else parse_frame(str(words), "column 'frame'")


def _words(frame: EarthFrame | None) -> str:
    return "metres without a place on earth" if frame is None else frame.words
