"""Trials simulated by a scenario of the package and solved by its methods: what most experiments sample."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from nlosctl.api import bound, localize
from nlosctl.arrays import FloatArray
from nlosctl.contract.options import parse_options
from nlosctl.contract.run_options import InputOptions
from nlosctl.contract.scene import Scene
from nlosctl.io.measurements.reader import MeasurementReader
from nlosctl.io.results.in_memory import input_of_table
from nlosctl.io.results.tables import measurement_table
from nlosctl.pipeline.solve.solve_chunk import dense_batch, dense_blocks
from nlosctl.reproduce.experiment import Chunk
from nlosctl.scenarios.catalogue import find_scenario

__all__ = ["Fixes", "Simulated", "batch_of", "bound_rms_m", "fixes", "simulated"]


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """The trials of a chunk, one snapshot each: flat columns (N,), the same as an Arrow table, and the scene.

    ``truth_m`` (T, 2) are the true positions.
    """

    kind: str
    columns: Mapping[str, npt.NDArray[Any]]
    table: Any
    scene: Scene
    truth_m: FloatArray


@dataclass(frozen=True, kw_only=True)
class Fixes:
    """One method's best estimate of each trial: position (T, 2), covariance (T, 3), cost (T,), status word (T,).

    NaN without an estimate; ``error_m`` (T,) is the distance from the truth.
    """

    position_m: FloatArray
    covariance_m2: FloatArray
    cost: FloatArray
    status: npt.NDArray[np.object_]
    error_m: FloatArray


def simulated(scenario: str, chunk: Chunk, **parameters: Any) -> Simulated:
    """Sample the chunk's trials from a scenario; raise UsageError for an unknown scenario or parameter."""
    spec = find_scenario(scenario)
    options = parse_options(spec.options, parameters, f"scenario {scenario!r}")
    columns = dict(spec.generate(options, chunk.generator(), chunk.size))
    columns["snapshot"] = columns["snapshot"] + chunk.first
    first = np.flatnonzero(np.diff(columns["snapshot"], prepend=chunk.first - 1))
    truth = np.stack([columns["truth_x_m"][first], columns["truth_y_m"][first]], axis=1)
    table = measurement_table(spec.kind, columns)
    return Simulated(kind=spec.kind, columns=columns, table=table, scene=spec.scene(options), truth_m=truth)


def fixes(trials: Simulated, chunk: Chunk, method: str, **arguments: Any) -> Fixes:
    """Solve every trial with a method of ``localize``; ``arguments`` are those of `nlosctl.api.localize`."""
    estimates = localize(
        trials.table, method=method, kind=trials.kind, scene=trials.scene, seed=chunk.seed, **arguments
    ).estimates

    def numbers(*names: str) -> FloatArray:
        columns = [estimates.column(name).to_numpy(zero_copy_only=False).astype(float) for name in names]
        return np.stack(columns, axis=-1)

    position = numbers("x_m", "y_m")
    return Fixes(
        position_m=position,
        covariance_m2=numbers("cov_xx_m2", "cov_xy_m2", "cov_yy_m2"),
        cost=numbers("cost")[:, 0],
        status=np.array(estimates.column("status").to_pylist(), dtype=object),
        error_m=np.hypot(*(position - trials.truth_m).T),
    )


def bound_rms_m(trials: Simulated, **arguments: Any) -> FloatArray:
    """Return the square root (T,) of the trace of each trial's Cramér-Rao bound at its truth, from its direct rows."""
    bounds = bound(trials.table, kind=trials.kind, scene=trials.scene, **arguments)
    values: FloatArray = bounds.column("rms_m").to_numpy(zero_copy_only=False).astype(float)
    return values


def batch_of(trials: Simulated) -> Any:
    """Return the trials as one dense batch; raise ValueError if they differ in their number of rows."""
    reader = MeasurementReader([input_of_table(trials.table)], InputOptions(kind=trials.kind, scene=trials.scene))
    (chunk,) = reader.chunks()
    ((_, row),) = dense_blocks(chunk.offsets, ~chunk.left_out, trials.truth_m.shape[0])
    return dense_batch(trials.kind, chunk.columns, row, scene=trials.scene)
