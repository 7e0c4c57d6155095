"""The report of a run: its counts, the summary in lines or as JSON, and notes on what the counts mean."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from nlosctl.contract.fields import Field, PolygonField, SensorsField
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.statuses import Status
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.pipeline.solve.method_runs import STATUS_WORDS, LearnedOptions, MethodRun, MethodTally, unused_columns
from nlosctl.version import __version__

__all__ = ["MethodTally", "RunReport", "method_remarks"]

_NEARLY_ALL = 0.9995


@dataclass
class RunReport:
    """Counts of a run over measurements. Snapshots of bad rows only are in ``snapshots_lost``, not in ``snapshots``.

    ``flat_plane`` is the largest error of a plane on earth by unit, see `nlosctl.pipeline.solve.flat_plane`; ``refits``
    counts paths that fit after a change, see `nlosctl.pipeline.solve.likely_causes`; ``rejoined`` are
    snapshots across parts, see `nlosctl.io.measurements.returned_ids`; ``largest_snapshot`` is its number of rows that
    take part; ``competing_rows`` are several paths of one sensor; ``windows`` counts windows of time
    (`nlosctl.io.measurements.windows.window_tally`); ``learned`` are the options estimated from the input.
    """

    kind: str
    inputs: list[dict[str, Any]]
    rows: int = 0
    rows_left_out: int = 0
    bad_rows: int = 0
    snapshots: int = 0
    snapshots_lost: int = 0
    competing_rows: int = 0
    largest_snapshot: int = 0
    methods: dict[str, MethodTally] = field(default_factory=dict)
    flat_plane: dict[str, tuple[float, ...]] = field(default_factory=dict)
    refits: Counter[str] = field(default_factory=Counter)
    rejoined: list[str] = field(default_factory=list)
    windows: Counter[str] = field(default_factory=Counter)
    learned: dict[str, LearnedOptions] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    settings: dict[str, Any] = field(default_factory=dict)

    _COUNTED: ClassVar[tuple[str, ...]] = ("rows", "rows_left_out", "bad_rows", "snapshots", "snapshots_lost")

    def counts(self) -> dict[str, Any]:
        """Return all counts as plain values, for `take`."""
        methods = {name: tally.counts() for name, tally in self.methods.items()}
        counted = {name: getattr(self, name) for name in self._COUNTED}
        further: dict[str, Any] = {"inputs": self.inputs, "flat_plane": self.flat_plane, "refits": dict(self.refits)}
        further |= {"rejoined": self.rejoined, "windows": dict(self.windows)}
        further["largest_snapshot"] = self.largest_snapshot
        further["competing_rows"] = self.competing_rows
        return {**counted, "methods": methods, **further}

    def take(self, counts: Mapping[str, Any]) -> None:
        """Add the counts of the next part of the run."""
        for name in self._COUNTED:
            setattr(self, name, getattr(self, name) + counts[name])
        for name, tally in self.methods.items():
            tally.take(counts["methods"][name])
        for unit, worst in counts["flat_plane"].items():
            self.flat_plane[unit] = max(tuple(worst), self.flat_plane.get(unit, tuple(worst)))
        self.refits.update(counts["refits"])
        self.windows.update(counts["windows"])
        self.rejoined += counts["rejoined"]
        self.competing_rows += counts["competing_rows"]
        self.largest_snapshot = max(self.largest_snapshot, counts["largest_snapshot"])
        for entry in counts["inputs"]:
            if self.inputs and self.inputs[-1]["name"] == entry["name"]:
                self.inputs[-1] = {**entry, "rows": self.inputs[-1]["rows"] + entry["rows"]}
            else:
                self.inputs.append(dict(entry))

    @property
    def unanswered(self) -> int:
        """The number of estimates, over all methods, without a fix; includes the lost snapshots."""
        return self.snapshots_lost + sum(tally.total - tally.answered for tally in self.methods.values())

    def lines(self) -> list[str]:
        """Return the summary, a line per input, method and note."""
        rows = f"{self.rows} rows"
        if self.rows_left_out:
            rows += f" ({self.rows_left_out} left out: flagged by an earlier step)"
        if self.bad_rows:
            rows += f", {self.bad_rows} bad row{'s' if self.bad_rows > 1 else ''} set aside"
        names = ", ".join(str(entry["name"]) for entry in self.inputs[:3])
        more = f" and {len(self.inputs) - 3} more" if len(self.inputs) > 3 else ""
        snapshots = "1 snapshot" if self.snapshots == 1 else f"{self.snapshots} snapshots"
        lines = [f"{names}{more}: {snapshots} of {self.kind}, {rows}"]
        for name, tally in self.methods.items():
            statuses = sorted(tally.statuses.items(), key=lambda item: STATUS_WORDS.index(item[0]))
            counts = ", ".join(f"{count} {word}" for word, count in [*tally.verdicts.items(), *statuses])
            share = tally.used_share
            used = f"; {100.0 * share:.3g} % of the rows used" if share is not None and share < _NEARLY_ALL else ""
            lines.append(f"{name}: {counts or 'nothing to solve'}{used}")
        return [*lines, *(f"note: {note}" for note in self.notes)]

    def as_dict(self) -> dict[str, Any]:
        """Return the report as plain values for JSON."""
        return {
            **({"version": __version__, "settings": self.settings} if self.settings else {}),
            "kind": self.kind,
            "inputs": self.inputs,
            **{name: getattr(self, name) for name in self._COUNTED},
            "methods": {
                name: {
                    "statuses": dict(tally.statuses),
                    "answered": tally.answered,
                    "fits_badly": tally.fits_badly,
                    "tested": tally.tested,
                    "badly_fitted": tally.badly_fitted,
                    "used_share": tally.used_share,
                    "verdicts": dict(tally.verdicts),
                    **({"estimated": dataclasses.asdict(self.learned[name])} if name in self.learned else {}),
                }
                for name, tally in self.methods.items()
            },
            **({} if self._sensors is None else {"sensors": self._sensors}),
            "notes": self.notes,
        }

    @property
    def _sensors(self) -> list[dict[str, Any]] | None:
        """The mean residuals of the sensors by each method; None where they are not counted."""
        tallies = {name: tally.residuals for name, tally in self.methods.items() if tally.residuals is not None}
        if len(tallies) < len(self.methods) or not tallies:
            return None
        from nlosctl.pipeline.solve.sensor_residuals import sensor_entries

        return [entry for name, sums in tallies.items() for entry in sensor_entries(name, sums)]


def method_remarks(
    runs: Sequence[MethodRun], report: RunReport, columns: Sequence[str], options: SolveOptions, *, advised: bool
) -> list[str]:
    """Return the notes on the methods after a run, a line each; ``columns`` are those of the input.

    ``advised``: a line of advice states already why there is no fix.
    """
    return [
        *(window_remarks(report.windows, report.settings.get("window")) if report.windows else ()),
        *unused_columns(runs, report.kind, columns),
        *_edge_remarks(runs, report, options.field, advised=advised),
        *_misses(report),
        *_own_remarks(runs),
        *_estimated_options(report),
        *(line for run in runs if run.std is not None for line in run.std.remarks(run, report, columns)),
        *_half_ranges(runs),
        *_outlier_shares(runs, report),
        *_bad_fits(runs, report),
        *_sensors_off(report),
        *_without_effect(runs, report, options),
    ]


def _without_effect(runs: Sequence[MethodRun], report: RunReport, options: SolveOptions) -> list[str]:
    if not report.competing_rows and options == dataclasses.replace(
        options, seed=0, alternatives=1, field=SensorsField(), worker_timeout=SolveOptions().worker_timeout
    ):
        return []
    from nlosctl.pipeline.solve.ineffective_options import competing_paths, ineffective_options

    return [*competing_paths(runs, report.competing_rows), *ineffective_options(runs, report, options)]


def _edge_remarks(runs: Sequence[MethodRun], report: RunReport, field: Field, *, advised: bool) -> list[str]:
    region = f"polygon of {len(field.vertices_m)} vertices" if isinstance(field, PolygonField) else field
    notes = []
    for name, tally in ((run.label, report.methods[run.label]) for run in runs if run.spec.searches):
        notes.append(
            f"search region of {name}: {region}; {tally.on_edge} of {tally.answered} estimates are at its edge"
        )
        outside = tally.statuses[Status.OUTSIDE_FIELD.word]
        if outside:
            notes.append(
                f"{name}: in {outside} of {tally.total} snapshots a point outside the search region is more likely "
                "than any inside; enlarge it by `field`"
            )
        nowhere = tally.statuses[Status.NO_CANDIDATE.word]
        if nowhere and not advised:
            notes.append(
                f"{name}: in {nowhere} of {tally.total} snapshots no candidate is in the search region; if sources may "
                "be outside, enlarge it by `field`"
            )
    return notes


def _misses(report: RunReport) -> list[str]:
    return [
        f"{name}: in {tally.missed} of {tally.total} snapshots the probability that no pair of two direct paths was "
        f"tried, or exists, is {tally.miss_probability / tally.missed:.2g} on average, more than failure_probability"
        for name, tally in report.methods.items()
        if tally.missed
    ]


def _own_remarks(runs: Sequence[MethodRun]) -> list[str]:
    """Return what the methods state of their options."""
    return [f"{run.label}: {run.spec.remark(run.options)}" for run in runs if run.spec.remark is not None]


def _estimated_options(report: RunReport) -> list[str]:
    notes = []
    for label, learned in report.learned.items():
        passes = f"in {learned.passes} passes over the input"
        for name, value in learned.values.items():
            found = (
                f"{name} = {value}, estimated" if value is not None else f"the input is too short to estimate {name}"
            )
            notes.append(f"{label}: {found}" + (f" {passes}" if value is not None else ""))
        if not learned.settled:
            notes.append(f"{label}: these values had not settled {passes}: they may be inaccurate")
    return notes


def _fits(report: RunReport) -> str:
    return "fits" if report.kind == "triplets" else "snapshots"


def _half_ranges(runs: Sequence[MethodRun]) -> list[str]:
    """Return a note on the law of scattered ranges, on which the accuracy of ``identify-los`` depends."""
    if not any(run.spec.job == "identify-los" for run in runs):
        return []
    return [
        "the documented accuracy is that of scattered ranges that are the sum of all legs; ranges that are delays "
        "times c / 2 are harder: fewer snapshots are identified exactly"
    ]


def _outlier_shares(runs: Sequence[MethodRun], report: RunReport) -> list[str]:
    counted = [(run, report.methods[run.label]) for run in runs if report.methods[run.label].lone_rows]
    if not counted:
        return []
    from nlosctl.pipeline.solve.outlier_shares import share_remark

    return [line for run, tally in counted for line in share_remark(run, tally)]


def _sensors_off(report: RunReport) -> list[str]:
    counted = {name: tally.residuals for name, tally in report.methods.items() if tally.residuals is not None}
    if any(tally.lacks_residuals for tally in report.methods.values()):
        return ["no mean residuals of sensors: a part of the results is of an earlier run, without `report`"]
    if not counted:
        return []
    from nlosctl.pipeline.solve.sensor_residuals import sensor_remark

    return [line for name, sums in counted.items() for line in sensor_remark(name, report.kind, sums)]


def _bad_fits(runs: Sequence[MethodRun], report: RunReport) -> list[str]:
    bad = [(name, tally) for name, tally in report.methods.items() if tally.fits_badly]
    if bad:
        from nlosctl.pipeline.solve.advice import offers_mixture
    advice = "; try `method` mixture-ml" if bad and offers_mixture(runs, report) else ""
    return [
        f"{name} fits badly: in {tally.badly_fitted} of {tally.tested} {_fits(report)} the residuals are larger than "
        f"their standard deviations explain{advice}"
        for name, tally in bad
    ]
