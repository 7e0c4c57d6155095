"""Factors of unknown standard deviations of a file or of its sensors: passes over the input until they stay.

One factor f for the file is f^2 = sum Q_k / sum (n_k - p) over the snapshots k with a fix and spare scalars. Sensors
have f_j^2 = (Q_j + d F^2) / (D_j + d), Q_j the sum of their squared residuals over stated std, D_j that of 1 - h_i with
the leverages h_i at the current weights, F the file's factor and d prior degrees of freedom: the equations of
restricted maximum likelihood, kept from collapsing in short files. A robust method weighs rows by their probability to
be direct.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from nlosctl import registry
from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.results import Estimates
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.contract.statuses import Status
from nlosctl.geometry.blocks import sum_measurements
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.measurements.completion.sensor_keys import sensor_texts
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.engine.passes import InputPasses
from nlosctl.pipeline.solve.learned_options import MOST_PASSES, pass_batches
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.stds.row_squares import row_squares, weighted_rows, with_std_factors
from nlosctl.pipeline.solve.stds.unknown_std import StdEstimate, StdFactor

__all__ = ["estimate_stds"]

_PRIOR_DEGREES = 5.0
"""Degrees of freedom of the file's factor as a prior of each sensor's."""

_SETTLED = 1e-4
"""Factors have settled when none changes by more than this share."""

_SPARE = 1e-6
"""A sensor with fewer degrees of freedom than this is only in snapshots without spare rows."""

_START = StdFactor(value=1.0, degrees=1.0)
"""The first factor of a robust method where outliers leave `ml` without a fix."""

_POOLED = (Status.OK, Status.AMBIGUOUS)


def estimate_stds(
    runs: Sequence[MethodRun],
    pool: str,
    kind: str,
    scene: Scene,
    options: SolveOptions,
    passes: InputPasses,
    show: Callable[[str], None],
) -> list[MethodRun]:
    """Return the runs with the factors of the file, or of each sensor, by the residuals of the whole input.

    ``show`` receives a line a pass. Raises the errors of reading and of the methods.
    """
    iterations = [_Iteration(run, pool) for run in runs]
    for count in range(1, MOST_PASSES + 1):
        moving = tuple((number, step.run, step.by_sensor) for number, step in enumerate(iterations) if not step.settled)
        if not moving:
            break
        statistic = _Residuals(kind=kind, scene=scene, runs=moving, options=options)
        pooled = passes.pool(statistic, columns=("sensor",))
        for number, run, _ in moving:
            iterations[number].advance(_of_run(pooled, number))
            show(f"{run.label}: pass {count}: {iterations[number].described()}")
    return [step.finished() for step in iterations]


def _of_run(pooled: ExactSums, number: int) -> dict[str | None, list[float]]:
    """Return the sums of a run by the name of the sensor, None for those of the file."""
    keys = [key for key in pooled.totals if isinstance(key, tuple) and key[0] == number]
    return {key[1]: pooled.sums(key) for key in keys}


@dataclass
class _Iteration:
    """The iteration of one run: first the factor of the file, then those of its sensors if they are wanted."""

    run: MethodRun
    pool: str
    by_sensor: bool = False
    settled: bool = False
    passes: int = 0
    _std: StdEstimate = field(default_factory=lambda: StdEstimate(pool="snapshot"))

    def __post_init__(self) -> None:
        self._put(self._std)

    def _put(self, std: StdEstimate) -> None:
        self._std = std
        self.run = dataclasses.replace(self.run, std=std)

    def described(self) -> str:
        file = self._std.file
        sensors = ", ".join(f"{name} {factor.value:.6g}" for name, factor in sorted(self._std.sensors.items())[:10])
        return f"std_factor {'unknown' if file is None else f'{file.value:.6g}'}{': ' if sensors else ''}{sensors}"

    def advance(self, sums: Mapping[str | None, Sequence[float]]) -> None:
        """Take the sums of a pass with the current factors, and set the next ones."""
        self.passes += 1
        if self.by_sensor:
            self._advance_sensors({name: values for name, values in sums.items() if name is not None})
            return
        squares, degrees = sums.get(None, (0.0, 0.0))
        before, after = self._std.file, _factor(squares, degrees)
        if before is None and after is None and self.run.spec.direct_rows is not None:
            after = _START
        self._put(StdEstimate(pool="file", file=after))
        if after is None:
            self.settled = True
        elif before is not None and _change(before, after) <= self._tolerance:
            self.by_sensor, self.settled = self.pool == "sensor", self.pool != "sensor"

    @property
    def _tolerance(self) -> float:
        """The change of the file's factor at which it has settled: that of fits only changes with the statuses."""
        return _SETTLED if self.run.spec.direct_rows is not None else 1e-9

    def _advance_sensors(self, sums: Mapping[str, Sequence[float]]) -> None:
        file, before = self._std.file, self._std.sensors
        assert file is not None  # noqa: S101 - sensors follow the file
        after = {}
        for name, (squares, degrees) in sums.items():
            total = degrees + _PRIOR_DEGREES
            value = math.sqrt((squares + _PRIOR_DEGREES * file.value**2) / total)
            after[name] = StdFactor(value=value, degrees=total)
        alone = tuple(sorted(name for name, (_, degrees) in sums.items() if degrees < _SPARE))
        self._put(StdEstimate(pool="sensor", file=file, sensors=after, alone=alone))
        changes = [_change(before.get(name, file), factor) for name, factor in after.items()]
        self.settled = max(changes, default=0.0) <= _SETTLED

    def finished(self) -> MethodRun:
        """Return the run with its factors."""
        std = dataclasses.replace(self._std, pool=self.pool, passes=self.passes, settled=self.settled)
        return dataclasses.replace(self.run, std=std)


def _factor(squares: float, degrees: float) -> StdFactor | None:
    """Return the factor by a sum of squares and its degrees of freedom, None if they don't determine one."""
    if not (degrees > _SPARE and squares > 0.0):
        return None
    return StdFactor(value=math.sqrt(squares / degrees), degrees=degrees)


def _change(before: StdFactor, after: StdFactor) -> float:
    return abs(math.log(after.value / before.value))


@dataclass(frozen=True, kw_only=True)
class _Residuals:
    """The sums of squared residuals over stated std, and their degrees of freedom, over a chunk.

    Keys are the number of the run and the name of the sensor, None for the file.
    """

    kind: str
    scene: Scene
    runs: tuple[tuple[int, MethodRun, bool], ...]
    options: SolveOptions

    def __call__(self, chunk: Chunk) -> ExactSums:
        sums = ExactSums()
        codes, names = sensor_texts(chunk)
        factors = {number: _row_factors(run, chunk) for number, run, _ in self.runs}
        keys = {number: [(number, name) for name in names] if by_sensor else [] for number, _, by_sensor in self.runs}
        for own in keys.values():
            sums.add_groups(own, np.empty(0, dtype=np.int64), np.empty((0, 2)))
        for row, batch in pass_batches(chunk, self.kind, self.scene, self.options):
            for number, run, by_sensor in self.runs:
                if row.shape[1] < run.spec.minimum_measurements:
                    continue
                if not by_sensor:
                    sums.add((number, None), _file_sums(run, batch))
                    continue
                pairs = np.stack(_row_sums(run, batch, factors[number][row]), axis=-1).reshape(-1, 2)
                sums.add_groups(keys[number], codes[row].ravel(), pairs)
        return sums


def _row_factors(run: MethodRun, chunk: Chunk) -> FloatArray:
    """Return the current factors (N,) of the rows."""
    rows = run.std.row_factors(chunk) if run.std is not None else None
    file = None if run.std is None else run.std.file
    return np.full(chunk.left_out.shape, 1.0 if file is None else file.value) if rows is None else rows[0]


def _file_sums(run: MethodRun, batch: Any) -> FloatArray:
    """Return the squares and degrees of freedom (B, 2) of each snapshot with a fix and spare scalars, else zeros."""
    spec, std = run.spec, run.std
    file = None if std is None else std.file
    if spec.direct_rows is not None and file is not None:
        factors = np.full(next(iter(_stds(batch))).shape, file.value)
        squares, weight, _ = weighted_rows(spec, run.options, batch, factors)
        spare = np.maximum(sum_measurements(weight) - 2.0, 0.0)
        return np.stack([sum_measurements(squares), spare], axis=1)
    starts = spec.direct_rows is not None  # a starting value only: outliers make any status of `ml`
    if starts:
        spec = registry.resolve("ml", spec.kind, "localize")
    scaled = dataclasses.replace(batch, std="unknown") if file is None else with_std_factors(batch, file.value)
    estimates = spec.solve(scaled, run.options if spec is run.spec else spec.options()).estimates
    chosen = _with_spare_scalars(estimates) if starts else _pooled(estimates)
    return _in_batch(estimates, batch.size, _squares_of_fits(estimates, file), chosen)


def _squares_of_fits(estimates: Estimates, file: StdFactor | None) -> FloatArray:
    """Return the squared residuals over stated std of each estimate, by the factor that scaled them, None: its own."""
    assert estimates.chi_square is not None  # noqa: S101 - part of the contract of such methods
    if file is not None:
        return estimates.chi_square * file.value**2
    return estimates.columns["std_factor"] ** 2 * estimates.columns["std_dof"]


def _stds(batch: Any) -> Iterator[FloatArray]:
    return (getattr(batch, name) for name in batch.STDS)


def _in_batch(estimates: Estimates, size: int, squares: FloatArray, chosen: IntArray) -> FloatArray:
    assert estimates.degrees_of_freedom is not None  # noqa: S101 - part of the contract of such methods
    sums = np.zeros((size, 2))
    sums[estimates.row[chosen]] = np.stack([squares, estimates.degrees_of_freedom], axis=1)[chosen]
    return sums


def _pooled(estimates: Estimates) -> IntArray:
    """Return the indices of the usual fixes with spare scalars: a wrong minimum would ruin a pooled factor."""
    spare = _with_spare_scalars(estimates)
    return spare[np.isin(estimates.status[spare], _POOLED)]


def _with_spare_scalars(estimates: Estimates) -> IntArray:
    """Return the indices of the best fixes with spare scalars."""
    assert estimates.degrees_of_freedom is not None  # noqa: S101 - part of the contract of such methods
    best = np.isfinite(estimates.position_m[:, 0]) & (estimates.alternative == 0)
    return np.flatnonzero(best & (estimates.degrees_of_freedom > 0))


def _row_sums(run: MethodRun, batch: Any, factors: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the squared residual over stated std (B, K) of each row of fixes with spare scalars, and its degrees."""
    spec = run.spec
    if spec.direct_rows is not None:
        squares, weight, degrees = weighted_rows(spec, run.options, batch, factors)
        spare = (sum_measurements(weight) > 2.0)[:, None]
        return np.where(spare, squares, 0.0), np.where(spare, degrees, 0.0)
    scaled = with_std_factors(batch, factors)
    estimates = spec.solve(scaled, run.options).estimates
    chosen = _pooled(estimates)
    position = np.full((batch.size, estimates.position_m.shape[1]), np.nan)
    position[estimates.row[chosen]] = estimates.position_m[chosen]
    weight = np.asfortranarray(np.broadcast_to(np.isfinite(position[:, :1]), factors.shape).astype(np.float64))
    return row_squares(spec, run.options, scaled, position, weight, factors)[0::2]
