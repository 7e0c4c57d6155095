"""The report of a run: its counts, the summary in lines or as JSON, and notes on what the counts mean."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np
from scipy.special import erfc, gammaincc

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.fields import Field, PolygonField, SensorsField
from nlosctl.contract.results import Estimates, has_covariance
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.statuses import Status
from nlosctl.io.measurements.windows.window_tally import window_remarks
from nlosctl.pipeline.solve.method_runs import STATUS_WORDS, LearnedOptions, MethodRun, MethodTally, unused_columns
from nlosctl.version import __version__

__all__ = ["MethodTally", "RunReport", "bad_fit_remarks", "chi_square_p_value", "fit_p_values", "method_remarks"]

_NEARLY_ALL = 0.9995
_CLOSED_FORM_DEGREES = 40
_CERTAIN = 800.0  # half a chi-square at which every p-value of few degrees is below the smallest number


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
            **self._sensors(),
            "notes": self.notes,
        }

    def _sensors(self) -> dict[str, Any]:
        if all(tally.residuals is None for tally in self.methods.values()):
            return {}
        from nlosctl.pipeline.solve.sensor_residuals import sensor_entries

        return {"sensors": sensor_entries(self.methods)}


def fit_p_values(estimates: Estimates) -> FloatArray:
    """Return the p-value (E,) of each fit by its chi-square; NaN without spare scalars or without a covariance.

    A fix on the boundary has none: it is not the optimum that the degrees of freedom are those of. An infeasible one
    is the free optimum, whose residuals do not depend on where it is.
    """
    if estimates.chi_square is None or estimates.degrees_of_freedom is None:
        return np.full(estimates.status.shape, np.nan)
    p_value = chi_square_p_value(estimates.chi_square, estimates.degrees_of_freedom)
    return np.where(has_covariance(estimates.status), p_value, np.nan)


def chi_square_p_value(chi_square: FloatArray, degrees: IntArray) -> FloatArray:
    """Return the probability (E,) that a chi-square with ``degrees`` is at least so large; NaN for less than one.

    In closed form up to 40 degrees of freedom: exp(-z) times a sum of powers of z, half the chi-square, and
    erfc(sqrt(z)) for odd degrees (Abramowitz, Stegun, 26.4.4 and 26.4.5): ten times as fast as the incomplete gamma
    function.
    """
    p_value = np.full(chi_square.shape, np.nan)
    for count in np.flatnonzero(np.bincount(np.clip(degrees, 0, _CLOSED_FORM_DEGREES + 1))):
        mine = degrees == count if count <= _CLOSED_FORM_DEGREES else degrees > _CLOSED_FORM_DEGREES
        half = np.maximum(0.5 * chi_square[mine], 0.0)  # a fit by rounding may be better than perfect
        if count > _CLOSED_FORM_DEGREES:
            p_value[mine] = gammaincc(0.5 * degrees[mine], half)
        elif count > 0:
            p_value[mine] = _closed_form(int(count), np.minimum(half, _CERTAIN))
    return p_value


def _closed_form(degrees: int, half: FloatArray) -> FloatArray:
    root = np.sqrt(half)
    tail = erfc(root) if degrees % 2 else 0.0
    power = 2.0 * root / np.sqrt(np.pi) if degrees % 2 else np.ones(half.shape)
    total = np.zeros(half.shape)
    for term in range(degrees // 2):
        total += power
        power = power * (half / (term + (1.5 if degrees % 2 else 1.0)))
    return np.asarray(np.minimum(tail + np.exp(-half) * total, 1.0))


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
        *(_estimated_options(report) if report.learned else ()),
        *(line for run in runs if run.std is not None for line in run.std.remarks(run, report, columns)),
        *_half_ranges(runs),
        *_outlier_shares(runs, report),
        *bad_fit_remarks(runs, report),
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
    from nlosctl.pipeline.solve.learned_options import learned_remarks

    return learned_remarks(report.learned)


def _half_ranges(runs: Sequence[MethodRun]) -> list[str]:
    """Return a note on the law of scattered ranges, on which the accuracy of ``identify-los`` depends."""
    if not any((run.spec.job, run.spec.kind) == ("identify-los", "ranges") for run in runs):
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
    if not any(tally.residuals or tally.lacks_residuals for tally in report.methods.values()):
        return []
    from nlosctl.pipeline.solve.sensor_residuals import sensor_remarks

    return sensor_remarks(report.kind, report.methods)


def bad_fit_remarks(runs: Sequence[MethodRun], report: RunReport) -> list[str]:
    """Return a note for each method whose residuals are larger than their stds in more than 5 % of the fits."""
    bad = [(name, tally) for name, tally in report.methods.items() if tally.fits_badly]
    if bad:
        from nlosctl.pipeline.solve.advice import offers_mixture
    advice = "; try `method` mixture-ml" if bad and offers_mixture(runs, report) else ""
    fits = "fits" if report.kind == "triplets" else "snapshots"
    return [
        f"{name} fits badly: in {tally.badly_fitted} of {tally.tested} {fits} the residuals are larger than "
        f"their standard deviations explain{advice}"
        for name, tally in bad
    ]
