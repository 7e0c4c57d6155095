"""Unknown standard deviations in a run: the factors of a method, applied to dense batches and to their solutions."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl import registry
from nlosctl.arrays import BoolArray, FloatArray, IntArray, ignoring_division
from nlosctl.contract.batches import Batch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Estimates, Flags, Solution, has_covariance
from nlosctl.contract.statuses import Status
from nlosctl.errors import UsageError
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.io.measurements.completion.sensor_keys import sensor_texts
from nlosctl.io.measurements.reader import Chunk
from nlosctl.models.scaled_residuals import SCALED_RESIDUALS
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.stds.row_squares import snapshot_factors, uses_ranges, with_std_factors, with_unknown_factor
from nlosctl.solvers.optimization.split_batches import take_snapshots

__all__ = ["StdEstimate", "StdFactor", "with_unknown_std"]


@dataclass(frozen=True, kw_only=True)
class StdFactor:
    """A factor of standard deviations and its degrees of freedom."""

    value: float
    degrees: float


@dataclass(frozen=True, kw_only=True)
class StdEstimate:
    """The factors of the standard deviations of one method's run.

    ``pool`` is what has a factor of its own: each snapshot, each sensor or the whole file. ``file`` is the factor of
    the file, None if it can't be estimated (or for snapshots, whose factors come with their fixes). ``sensors`` are
    those of sensors by name, ``alone`` the sensors that have the file's for want of spare rows. They were found in
    ``passes`` over the input and did not change at the end if ``settled``.
    """

    pool: str
    file: StdFactor | None = None
    sensors: Mapping[str, StdFactor] = field(default_factory=dict)
    alone: tuple[str, ...] = ()
    passes: int = 0
    settled: bool = True

    def remarks(self, run: MethodRun, report: Any, columns: Sequence[str]) -> list[str]:
        """Return what the summary states of a run with these factors; ``columns`` are those of the input."""
        from nlosctl.pipeline.solve.stds.std_remarks import std_remarks

        return std_remarks(run, report.methods[run.label], report.kind, columns)

    def as_dict(self) -> dict[str, Any]:
        """Return the factors as plain values."""
        file = None if self.file is None else dataclasses.asdict(self.file)
        sensors = {name: dataclasses.asdict(factor) for name, factor in sorted(self.sensors.items())}
        return {"pool": self.pool, "file": file, "sensors": sensors, "passes": self.passes, "settled": self.settled}

    def row_factors(self, chunk: Chunk) -> tuple[FloatArray, FloatArray] | None:
        """Return the factors (N,) of a chunk's rows and their degrees of freedom; None if all rows have the same."""
        if not self.sensors or self.file is None:
            return None
        codes, names = sensor_texts(chunk)
        known = [self.sensors.get(name, self.file) for name in names]
        value, degrees = np.array([part.value for part in known]), np.array([part.degrees for part in known])
        return value[codes], degrees[codes]

    def solver(self, spec: MethodSpec, options: Any, chunk: Chunk) -> Callable[[Any, IntArray], Solution]:
        """Return a method as a function of dense batches of a chunk and the indices of their rows (B, K)."""
        factors = self.row_factors(chunk)

        def solve(batch: Batch, row: IntArray) -> Solution:
            mine = None if factors is None else (factors[0][row], factors[1][row])
            return self.solve(spec, batch, options, mine)

        return solve

    def solve(
        self, spec: MethodSpec, batch: Batch, options: Any, rows: tuple[FloatArray, FloatArray] | None
    ) -> Solution:
        """Solve a batch; ``rows`` are the `row_factors` (B, K) of its rows, None without."""
        if self.pool == "snapshot" and spec.direct_rows is not None:
            factors, degrees, determined = snapshot_factors(spec, batch, options)
            solution = spec.solve(with_std_factors(batch, factors[:, None]), options)
            row = solution.estimates.row
            solution = _with_columns(solution, factors[row], degrees[row])
            return dataclasses.replace(solution, estimates=_without_covariance(solution.estimates, ~determined[row]))
        if self.pool == "snapshot":
            return spec.solve(with_unknown_factor(batch), options)
        if self.file is None:
            solution = spec.solve(with_unknown_factor(batch), options)
            return dataclasses.replace(solution, estimates=_without_covariance(solution.estimates))
        if rows is None:
            solution = spec.solve(with_std_factors(batch, self.file.value), options)
            return _with_columns(solution, np.float64(self.file.value), np.float64(self.file.degrees))
        factors, degrees = rows
        solution = spec.solve(with_std_factors(dataclasses.replace(batch, want_flags=True), factors), options)
        return _with_sensor_columns(solution, spec, batch, options, factors, degrees)


def with_unknown_std(runs: Sequence[MethodRun], kind: str, pool: str) -> list[MethodRun]:
    """Return the runs with a factor of the standard deviations for each snapshot.

    Raises UsageError for a kind or method that can't have one, or an option that is to be estimated, too.
    """
    for run in runs:
        spec = run.spec
        if not (spec.scales_std or spec.direct_rows is not None):
            raise UsageError(f"`estimate_std` is not for {spec.name} on {kind}; it is for {_capable()}")
        fault = "" if spec.std_fault is None else spec.std_fault(run.options, pool)
        if fault:
            raise UsageError(f"method {spec.name!r}: {fault}")
        if run.open_options:
            raise UsageError(
                f"`estimate_std` can't be combined with {run.open_options[0]}=estimate of {spec.name}: either explains "
                f"large residuals; set a number for one of them"
            )
    return [dataclasses.replace(run, std=StdEstimate(pool="snapshot")) for run in runs]


def _capable() -> str:
    """Return the methods that can estimate standard deviations, by kind, as text."""
    names: dict[str, list[str]] = {}
    for entry in registry.entries():
        spec = registry.load(entry)
        if spec.scales_std or (spec.direct_rows is not None and spec.std_fault is None):
            names.setdefault(spec.kind, []).append(spec.name)
    return "; ".join(f"{kind}: {', '.join(sorted(known))}" for kind, known in sorted(names.items()))


def _without_covariance(estimates: Estimates, which: BoolArray | None = None) -> Estimates:
    """Return the estimates, ``which`` (all) of those with a covariance as ones whose std can't be estimated."""
    undone = has_covariance(estimates.status) if which is None else which & has_covariance(estimates.status)

    def without(values: Any) -> Any:
        return None if values is None else np.where(undone, np.nan, values)

    nothing = np.full(undone.shape, np.nan)
    stds = {name: without(estimates.columns.get(name, nothing)) for name in ("std_factor", "std_dof")}
    return dataclasses.replace(
        estimates,
        status=np.where(undone, np.uint8(Status.STD_NOT_ESTIMABLE), estimates.status),
        covariance_m2=np.where(undone[:, None], np.nan, estimates.covariance_m2),
        chi_square=without(estimates.chi_square),
        columns={**estimates.columns, **stds},
    )


def _with_columns(solution: Solution, factor: Any, degrees: Any, flags: Flags | None = None) -> Solution:
    estimates = solution.estimates
    certain = has_covariance(estimates.status)
    columns = {"std_factor": np.where(certain, factor, np.nan), "std_dof": np.where(certain, degrees, np.nan)}
    estimates = dataclasses.replace(estimates, columns={**estimates.columns, **columns})
    return dataclasses.replace(solution, estimates=estimates, flags=flags or solution.flags)


def _with_sensor_columns(
    solution: Solution, spec: MethodSpec, batch: Batch, options: Any, factors: FloatArray, degrees: FloatArray
) -> Solution:
    """Return the solution with the row's factors as flags, and for each estimate the factor of its covariance's size.

    That is (det C / det C_stated)^(1 / 2 D), with the least degrees of freedom among the rows used.
    """
    assert solution.flags is not None  # noqa: S101 - they were wanted
    used = np.asarray(solution.flags.used)
    flags = dataclasses.replace(solution.flags, columns={**solution.flags.columns, "std_factor": factors})
    row: IntArray = solution.estimates.row
    least = np.where(used, degrees, np.inf).min(axis=1, initial=np.inf)[row]
    position = solution.estimates.position_m
    scalars = SCALED_RESIDUALS[spec.kind](take_snapshots(batch, row), position, with_ranges=uses_ranges(spec, options))
    weight = np.asfortranarray(used[row].astype(np.float64))
    stated, scaled = (
        _summed([SymmetricMatrix.gram(*scalar.slopes, weight=part) for scalar in scalars])
        for part in (weight, weight / factors[row] ** 2)
    )
    coordinates = 2 if batch.dimension == 2 or batch.height_held else 3
    with ignoring_division():
        size = (_volume(stated, coordinates) / _volume(scaled, coordinates)) ** (0.5 / coordinates)
    return _with_columns(solution, size, least, flags)


def _volume(information: SymmetricMatrix, coordinates: int) -> FloatArray:
    """Return the determinants (B,) of the information of the position; a further unknown, the offset, is eliminated."""
    offset = information.entry(coordinates, coordinates) if information.dimension > coordinates else 1.0
    return information.determinant / offset


def _summed(parts: list[SymmetricMatrix]) -> SymmetricMatrix:
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total
