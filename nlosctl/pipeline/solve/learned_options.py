"""Options that methods estimate from the whole input before the run, by passes over it until the values settle.

Each pass is a step of a fixed-point iteration, such as of the EM algorithm, in the logarithms of the values. Steps
after the first two are extrapolated (Anderson, 1965, with one earlier step), which takes a few passes where the plain
iteration takes dozens.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.learning import Learning
from nlosctl.contract.options import within_bounds
from nlosctl.contract.random_streams import snapshot_seeds
from nlosctl.contract.run_options import SolveOptions
from nlosctl.contract.scene import Scene
from nlosctl.errors import MethodError, NlosctlError, in_one_line
from nlosctl.geometry.exact_sums import ExactSums
from nlosctl.io.measurements.reader import Chunk
from nlosctl.pipeline.engine.passes import InputPasses
from nlosctl.pipeline.solve.method_runs import LearnedOptions, MethodRun
from nlosctl.pipeline.solve.reference_rows import alike_blocks
from nlosctl.pipeline.solve.solve_chunk import dense_batch, dense_blocks, keep_freed_memory
from nlosctl.pipeline.solve.target_heights import with_target_heights

__all__ = ["MOST_PASSES", "learn_options", "pass_batches"]

MOST_PASSES = 25
"""An iteration that has not settled by then stops; the summary states it."""

_SETTLED = 1e-3
"""Values have settled when a step changes their logarithms by no more than this."""

_MOST_GAIN = 50.0
_LONGEST = math.log(100.0)
"""An extrapolated step is at most so many times the plain one, and no longer than this if the plain one is shorter."""

_DIGITS = 6
"""Significant digits of the values: so short that a run can be repeated by typing them."""


def learn_options(
    runs: Sequence[MethodRun],
    kind: str,
    scene: Scene,
    options: SolveOptions,
    passes: InputPasses,
    show: Callable[[str], None],
) -> list[MethodRun]:
    """Return the runs with the options that they leave open estimated from the input; ``show`` receives a line a pass.

    Raises UsageError for options that can't be estimated, and the errors of reading and of the methods.
    """
    iterations = {number: _Iteration(run) for number, run in enumerate(runs) if run.open_options}
    for count in range(1, MOST_PASSES + 1):
        moving = {number: step for number, step in iterations.items() if not step.settled}
        if not moving:
            break
        current = tuple((number, step.run) for number, step in moving.items())
        pooled = passes.pool(
            _ChunkStatistics(
                kind=kind, dimension=passes.survey.table.dimension, scene=scene, runs=current, options=options
            )
        )
        for number, step in moving.items():
            step.advance(pooled.sums(number))
            show(f"{step.run.label}: pass {count}: {step.described()}")
    return [iterations[number].finished() if number in iterations else run for number, run in enumerate(runs)]


@dataclass
class _Iteration:
    """The iteration of one run: its options so far, and the earlier point and step for the extrapolation."""

    run: MethodRun
    passes: int = 0
    settled: bool = False
    _earlier: tuple[list[float], list[float]] | None = None

    @property
    def _learning(self) -> Learning:
        assert self.run.spec.learning is not None  # noqa: S101 - it has open options
        return self.run.spec.learning

    def described(self) -> str:
        return ", ".join(f"{name}={getattr(self.run.options, name)}" for name in self.run.open_options)

    def advance(self, sums: Sequence[float]) -> None:
        """Take the sums of a pass with the current options, and set the next options."""
        self.passes += 1
        names, options = self.run.open_options, self.run.options
        target = self._learning.update(sums, options) if sums else {}
        after = {name: target.get(name) for name in names}
        changes = {name: (getattr(options, name), value) for name, value in after.items()}
        pairs = {name: (old, new) for name, (old, new) in changes.items() if old is not None and new is not None}
        known = list(pairs)
        point = [math.log(old) for old, _ in pairs.values()]
        step = [math.log(new) - math.log(old) for old, new in pairs.values()]
        if all((old is None) == (new is None) for old, new in changes.values()):
            moved = self._extrapolate(known, point, step)
            self.settled = max(map(abs, moved), default=0.0) <= _SETTLED
            self._earlier = point, step
        else:
            moved, self._earlier = step, None
        steps = zip(known, point, moved, strict=True)
        self._set({**after, **{name: math.exp(at + by) for name, at, by in steps}})

    def _extrapolate(self, names: list[str], point: list[float], step: list[float]) -> list[float]:
        """Return the step to the fixed point if steps are linear between this point and the earlier one, else ``step``.

        With one value that is the secant method for a step of zero. A step back, or out of the bounds, is not taken.
        """
        if self._earlier is None:
            return step
        moved = [at - earlier for at, earlier in zip(point, self._earlier[0], strict=True)]
        change = [new - old for new, old in zip(step, self._earlier[1], strict=True)]
        squared = math.fsum(value * value for value in change)
        if squared == 0.0:
            return step
        share = math.fsum(a * b for a, b in zip(change, step, strict=True)) / squared
        longer = [by - share * (at + more) for by, at, more in zip(step, moved, change, strict=True)]
        length, plain = math.hypot(*longer), math.hypot(*step)
        limit = min(_MOST_GAIN * plain, max(plain, _LONGEST))
        if length > limit:
            longer = [by * (limit / length) for by in longer]
        values = [math.exp(at + by) for at, by in zip(point, longer, strict=True)]
        forward = math.fsum(a * b for a, b in zip(longer, step, strict=True)) >= 0.0
        inside = all(within_bounds(self.run.spec.options, *pair) for pair in zip(names, values, strict=True))
        return longer if forward and inside else step

    def _set(self, values: Mapping[str, float | None]) -> None:
        self.run = dataclasses.replace(self.run, options=dataclasses.replace(self.run.options, **values))

    def finished(self) -> MethodRun:
        """Return the run with its final options, rounded."""
        values = {name: getattr(self.run.options, name) for name in self.run.open_options}
        values = {name: None if value is None else float(f"{value:.{_DIGITS}g}") for name, value in values.items()}
        self._set(values)
        learned = LearnedOptions(values=values, passes=self.passes, settled=self.settled)
        return dataclasses.replace(self.run, open_options=(), learned=learned)


@dataclass(frozen=True, kw_only=True)
class _ChunkStatistics:
    """The sums of the runs' statistics over a chunk, by the number of the run."""

    kind: str
    dimension: int
    scene: Scene
    runs: tuple[tuple[int, MethodRun], ...]
    options: SolveOptions

    def __call__(self, chunk: Chunk) -> ExactSums:
        sums = ExactSums()
        for row, batch in pass_batches(chunk, self.kind, self.scene, self.options, self.dimension):
            for number, run in self.runs:
                if row.shape[1] >= run.spec.minimum_measurements:
                    sums.add(number, _statistics(run, batch))
        return sums


def pass_batches(
    chunk: Chunk, kind: str, scene: Scene, options: SolveOptions, dimension: int = 2
) -> Iterator[tuple[IntArray, Any]]:
    """Yield the rows (B, K) and the dense batch of each block of a chunk, for the statistics of a pass."""
    keep_freed_memory()
    chunk = with_target_heights(chunk, dimension, options)
    seed = snapshot_seeds(options.seed, chunk.snapshot_ids())
    made: dict[str, Any] = {"scene": scene, "dimension": dimension, "field": options.field, "flags": False}
    for block in dense_blocks(chunk.offsets, ~chunk.left_out, options.block_size):
        for snapshot, row in alike_blocks(chunk, *block):
            batch = dense_batch(kind, chunk.columns, row, seed=seed[snapshot], **made)
            if scene.frame is not None and scene.frame.on_ellipsoid:
                from nlosctl.pipeline.solve.earth_centred import placed_on_earth  # only for places on earth

                batch = placed_on_earth(batch, scene.frame)
            yield row, batch


def _statistics(run: MethodRun, batch: Any) -> FloatArray:
    """Return the statistics (B, n) of a batch; raises MethodError if the method fails or returns something else."""
    assert run.spec.learning is not None  # noqa: S101 - it has open options
    try:
        values = run.spec.learning.statistics(batch, run.options)
    except NlosctlError:
        raise
    except (Exception, SystemExit) as error:
        raise MethodError(f"method {run.spec.name!r} failed: {in_one_line(error)}") from error
    if np.ndim(values) != 2 or len(values) != batch.size or not np.isfinite(values).all():
        raise MethodError(f"method {run.spec.name!r} returned statistics that are not finite numbers of each snapshot")
    return values


def learned_remarks(learned_options: Mapping[str, LearnedOptions]) -> list[str]:
    """Return the lines of the summary on the options that were estimated, by the label of the run."""
    notes = []
    for label, learned in learned_options.items():
        passes = f"in {learned.passes} passes over the input"
        for name, value in learned.values.items():
            found = (
                f"{name} = {value}, estimated" if value is not None else f"the input is too short to estimate {name}"
            )
            notes.append(f"{label}: {found}" + (f" {passes}" if value is not None else ""))
        if not learned.settled:
            notes.append(f"{label}: these values had not settled {passes}: they may be inaccurate")
    return notes
