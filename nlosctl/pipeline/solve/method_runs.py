"""The methods of a run: their parameters, a run for each point of a sweep, their counts, the columns they leave out."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from nlosctl import registry
from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.learning import ESTIMATE
from nlosctl.contract.methods import Job, MethodSpec
from nlosctl.contract.options import parse_options
from nlosctl.contract.results import Solution, is_fix
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError, did_you_mean
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.results.layouts import ChunkEstimates
from nlosctl.pipeline.solve.sweeps import SweepWords, refuse_both, swept_options

if TYPE_CHECKING:
    from nlosctl.io.measurements.reader import Chunk
    from nlosctl.pipeline.solve.stds.unknown_std import StdEstimate

__all__ = [
    "STATUS_WORDS",
    "BlockSolver",
    "LearnedOptions",
    "MethodRun",
    "MethodTally",
    "leaves_options_open",
    "method_runs",
    "require_estimates",
]

BlockSolver = Callable[[Any, IntArray], Solution]
"""A method as a function of a dense batch and the chunk indices of its rows (B, K)."""

STATUS_WORDS = tuple(status.word for status in Status)
_READ_BY_SOME = {"bearings": ("prior_x_m",), "triplets": ("target_radius_m",)}
"""Columns of a kind that few methods use, the first of those that belong together."""

_BAD_FIT_P_VALUE = 1e-3
_BAD_FIT_SHARE = 0.05
_MOST = 0.5
_MOSTLY_INDIRECT = 0.8
_VERDICTS = {"ip": ("direct", "indirect"), "los": ("not line of sight", "line of sight")}
_ANSWERED = {status.word for status in Status if status.is_fix}


@dataclass(frozen=True, kw_only=True)
class LearnedOptions:
    """Options that were estimated from the input, None for too little information, and the number of passes.

    ``settled`` is whether the values were stable at the end.
    """

    values: Mapping[str, float | None]
    passes: int
    settled: bool


@dataclass(frozen=True, kw_only=True)
class MethodRun:
    """A method with the options of this run; ``sweep`` holds the swept options with their values.

    ``open_options`` are to be estimated from the input before the run, which makes them ``learned``. ``std`` are the
    factors of unknown standard deviations; None where they are stated.
    """

    spec: MethodSpec
    options: Any
    sweep: Mapping[str, Any] = dataclasses.field(default_factory=dict)
    open_options: tuple[str, ...] = ()
    learned: LearnedOptions | None = None
    std: StdEstimate | None = None

    @property
    def label(self) -> str:
        """The name of the method, with the swept values."""
        values = ", ".join(f"{key}={value}" for key, value in self.sweep.items())
        return f"{self.spec.name} ({values})" if values else self.spec.name

    def solver(self, chunk: Chunk) -> BlockSolver:
        """Return the method with its options as a function of the batches of a chunk."""
        if self.std is not None:
            return self.std.solver(self.spec, self.options, chunk)
        return lambda batch, row: self.spec.solve(batch, self.options)


@dataclass
class MethodTally:
    """Counts of one method: statuses, verdicts of its flags, and residuals larger than their stds explain.

    ``located`` snapshots have a fix; they have ``rows_of_fixes`` rows, of them ``rows_used``. Those of them with one
    path per sensor have ``lone_rows`` that take part, of them ``lone_rows_used``, where the method has `alpha`.
    ``tested`` fits have a p-value. ``judged`` rows have a flag with a p-value. In ``missed`` snapshots a random search
    may have had no right initial estimate, with probabilities whose sum is ``miss_probability``. ``further`` estimates
    are alternatives to a better one. ``residuals`` are the sums of flag columns by sensor, see
    `nlosctl.pipeline.solve.sensor_residuals`; None where they are not counted;
    ``lacks_residuals`` if some parts did not count them.
    """

    statuses: Counter[str] = field(default_factory=Counter)
    tested: int = 0
    badly_fitted: int = 0
    rows_used: int = 0
    rows_of_fixes: int = 0
    lone_rows: int = 0
    lone_rows_used: int = 0
    on_edge: int = 0
    located: int = 0
    judged: int = 0
    missed: int = 0
    miss_probability: float = 0.0
    further: int = 0
    verdicts: Counter[str] = field(default_factory=Counter)
    residuals: dict[str, ExactSums] | None = None
    lacks_residuals: bool = False

    _COUNTED: ClassVar[tuple[str, ...]] = (
        *("tested", "badly_fitted", "rows_used", "rows_of_fixes", "on_edge", "located", "judged"),
        *("missed", "miss_probability", "lone_rows", "lone_rows_used", "further"),
    )

    def add_verdicts(self, columns: Mapping[str, Any]) -> None:
        """Count the flag columns (N,) of a detector."""
        for name, (false_word, true_word) in _VERDICTS.items():
            if name in columns:
                flags = np.ma.MaskedArray(columns[name]).compressed().astype(bool)
                true = int(np.count_nonzero(flags))
                self.verdicts.update({false_word: flags.size - true, true_word: true})
        if "p_value" in columns:
            self.judged += int(np.count_nonzero(~np.isnan(columns["p_value"])))

    def add_estimates(self, estimates: ChunkEstimates, method: int) -> None:
        """Count the best alternatives of the method with this index."""
        mine = (estimates.alternative == 0) & (estimates.method == method)
        self.add(estimates.status[mine], estimates.fit_p_value[mine])
        self.further += int(np.count_nonzero((estimates.alternative > 0) & (estimates.method == method)))
        fixed = mine & is_fix(estimates.status)
        self.rows_used += int(estimates.n_used[fixed].sum())
        first = np.diff(estimates.snapshot[fixed], prepend=-1) > 0
        self.located += int(np.count_nonzero(first))
        self.rows_of_fixes += int(estimates.n_measurements[fixed][first].sum())
        self.on_edge += int(np.count_nonzero(estimates.on_edge[fixed]))
        failure = estimates.search_failure[mine]
        self.missed += int(np.count_nonzero(~np.isnan(failure)))
        self.miss_probability += float(np.nansum(failure))

    def add(self, status: npt.NDArray[np.uint8], p_value: FloatArray) -> None:
        """Count estimates (E,), best alternatives only; ``p_value`` is that of their fit, NaN without one."""
        numbers = np.bincount(status, minlength=len(STATUS_WORDS))
        self.statuses.update({STATUS_WORDS[code]: int(count) for code, count in enumerate(numbers) if count})
        self.tested += int(np.count_nonzero(~np.isnan(p_value)))
        self.badly_fitted += int(np.count_nonzero(p_value < _BAD_FIT_P_VALUE))

    def counts(self) -> dict[str, Any]:
        """Return all counts as plain values, for `take`."""
        counted = {name: getattr(self, name) for name in self._COUNTED}
        sums = None if self.residuals is None else {name: own.plain() for name, own in self.residuals.items()}
        return {**counted, "statuses": dict(self.statuses), "verdicts": dict(self.verdicts), "residuals": sums}

    def take(self, counts: Mapping[str, Any]) -> None:
        """Add the counts of another part of the run."""
        self.statuses.update(counts["statuses"])
        self.verdicts.update(counts["verdicts"])
        for name in self._COUNTED:
            setattr(self, name, getattr(self, name) + counts[name])
        if self.residuals is not None and counts["residuals"] is None:
            self.residuals, self.lacks_residuals = None, True
        elif self.residuals is not None:
            for name, sums in counts["residuals"].items():
                self.residuals.setdefault(name, ExactSums()).merge(ExactSums.of_plain(sums))

    @property
    def total(self) -> int:
        """The number of snapshots and targets."""
        return sum(self.statuses.values())

    @property
    def answered(self) -> int:
        """The number of snapshots and targets with a fix."""
        return sum(count for word, count in self.statuses.items() if word in _ANSWERED)

    @property
    def mostly_bad(self) -> bool:
        """Whether most snapshots have no fix or a bad one, or nearly all paths are called indirect."""
        flagged = self.verdicts["indirect"] + self.verdicts["direct"]
        if flagged:
            return self.verdicts["indirect"] > _MOSTLY_INDIRECT * flagged or self.badly_fitted > _MOST * self.tested
        total = self.total - self.statuses[Status.TOO_FEW.word]
        return total - self.answered + self.badly_fitted > _MOST * total

    @property
    def used_share(self) -> float | None:
        """The share of rows used, of the snapshots with a fix; None without one."""
        return self.rows_used / self.rows_of_fixes if self.rows_of_fixes else None

    @property
    def fits_badly(self) -> bool:
        """Whether more than one in twenty estimates has a chi-square p-value below 0.001."""
        return self.badly_fitted > _BAD_FIT_SHARE * self.tested


def method_runs(
    names: Sequence[str], kind: str, job: Job, parameters: Mapping[str, Any], sweep: SweepWords | None = None
) -> list[MethodRun]:
    """Return the methods ``names`` of a kind of measurement with their options: one run for each point of the sweep.

    Parameters and swept parameters are named ``key`` (for every method that has it) or ``METHOD:key``; a method without
    a swept parameter runs once. Raises UsageError for an unknown method, a duplicate method, a parameter that no
    method has, or an invalid value.
    """
    specs = [registry.resolve(name, kind, job) for name in names]
    own = [spec.name for spec in specs]
    for name in own:
        if own.count(name) > 1:
            raise UsageError(f"method {name!r} is given twice")
    given = _by_method(specs, parameters, "`parameters`")
    swept = _by_method(specs, sweep or {}, "`sweep`")
    runs = []
    for spec in specs:
        parse = partial(parse_options, spec.options, owner=f"method {spec.name!r}")
        left_open, fixed = _open_options(spec, given[spec.name])
        if left_open:
            refuse_both(left_open, swept[spec.name])
        points = swept_options(swept[spec.name], fixed, parse) if swept[spec.name] else [({}, parse(fixed))]
        for values, options in points:
            fault = "" if spec.learning is None or not left_open else spec.learning.refusal(options, left_open)
            if fault:
                raise UsageError(f"method {spec.name!r}: {fault}")
            runs.append(MethodRun(spec=spec, options=options, sweep=values, open_options=left_open))
    return runs


def leaves_options_open(parameters: Mapping[str, Any]) -> bool:
    """Return whether a parameter is to be estimated from the input."""
    return any(isinstance(value, str) and value == ESTIMATE for value in parameters.values())


def _open_options(spec: MethodSpec, given: Mapping[str, Any]) -> tuple[tuple[str, ...], dict[str, Any]]:
    """Return the names of the parameters to be estimated, and the others."""
    learnable = () if spec.learning is None else spec.learning.options
    left_open = tuple(name for name in learnable if isinstance(given.get(name), str) and given[name] == ESTIMATE)
    return left_open, {name: value for name, value in given.items() if name not in left_open}


def require_estimates(runs: Sequence[MethodRun]) -> None:
    """Raise UsageError if no method makes estimates."""
    if not any(run.spec.estimates for run in runs):
        names = ", ".join(run.spec.name for run in runs)
        raise UsageError(f"`estimates_out`: {names} makes no estimates; chi2 and joint do")


def _by_method(specs: Sequence[MethodSpec], parameters: Mapping[str, Any], option: str) -> dict[str, dict[str, Any]]:
    keys = {spec.name: {field.name for field in dataclasses.fields(spec.options)} for spec in specs}
    given: dict[str, dict[str, Any]] = {spec.name: {} for spec in specs}
    for parameter, value in parameters.items():
        method, colon, key = parameter.rpartition(":")
        if colon and method not in keys:
            raise UsageError(f"{option} {parameter}: no method {method!r} in this run{did_you_mean(method, keys)}")
        owners = [method] if colon else [name for name in keys if key in keys[name]]
        if not owners and len(specs) > 1:
            known = sorted(set().union(*keys.values()))
            raise UsageError(f"none of the methods has a parameter {key!r}{did_you_mean(key, known)}")
        for name in owners or keys:
            given[name] = {**given[name], key: value} if colon else {key: value, **given[name]}
    return given


def unused_columns(runs: Sequence[MethodRun], kind: str, columns: Sequence[str]) -> list[str]:
    """Return notes on columns of the input that some method, or any, does not use."""
    notes = _unused_ranges(runs, kind, columns)
    for column in _READ_BY_SOME.get(kind, ()):
        names = dict.fromkeys(run.spec.name for run in runs if column not in run.spec.reads)
        if column in columns and names:
            notes.append(f"the column {column!r} is not used by {', '.join(names)}")
    if kind == "triplets" and "reflector" in columns:
        notes.append(
            "the column 'reflector' is not used: a direct triplet goes over the target alone, all others are indirect"
        )
    return notes


def _unused_ranges(runs: Sequence[MethodRun], kind: str, columns: Sequence[str]) -> list[str]:
    names = dict.fromkeys(run.spec.name for run in runs if "range_m" not in run.spec.reads)
    if "range_m" not in columns or kind == "ranges":
        return []
    if "range_std_m" not in columns:
        return ["the column 'range_m' is not used: its standard deviations are missing, in a column 'range_std_m'"]
    if not names:
        return []
    return [f"the column 'range_m' is not used by {', '.join(names)}"]
