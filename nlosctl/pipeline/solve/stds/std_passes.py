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
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.pipeline.engine.passes import InputPasses
from nlosctl.pipeline.solve.learned_options import MOST_PASSES
from nlosctl.pipeline.solve.method_runs import MethodRun
from nlosctl.pipeline.solve.stds.residual_sums import ResidualSums
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
        statistic = ResidualSums(
            kind=kind, dimension=passes.survey.table.dimension, scene=scene, runs=moving, options=options
        )
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
    _earlier: list[StdFactor] = field(default_factory=list)

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
        elif any(_change(known, after) <= self._tolerance for known in self._earlier):
            self.by_sensor, self.settled = self.pool == "sensor", self.pool != "sensor"
        else:
            self._earlier = [after] if self.run.spec.direct_rows is not None else [*self._earlier, after]

    @property
    def _tolerance(self) -> float:
        """The change of the file's factor at which it has settled: that of fits only changes with the statuses.

        These can alternate where they depend on the factor; then it is one of those that it had before.
        """
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
