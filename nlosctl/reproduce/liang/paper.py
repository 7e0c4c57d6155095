"""Liang, Zeng, Li: the paper with the errors in its text, and its trials, echoes of three targets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from nlosctl.api import identify_los
from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import parse_field
from nlosctl.pipeline.solve.solve_chunk import dense_batch
from nlosctl.reproduce.experiment import Chunk, Erratum, Paper
from nlosctl.reproduce.liang.candidate_sets import CandidateSets, candidate_sets
from nlosctl.reproduce.samples import Condition
from nlosctl.reproduce.simulated import Simulated, simulated
from nlosctl.solvers.echoes.structured_sets import ClusteringOptions

__all__ = [
    "CHUNK_TRIALS",
    "FIELD",
    "NOISES_DB",
    "PAPER",
    "SENSORS",
    "TARGETS",
    "Identified",
    "candidates",
    "direct_batch",
    "echo_batch",
    "echo_trials",
    "identified",
]

PAPER = Paper(
    name="liang",
    reference="Liang, Zeng, Li",
    ours=(
        "The positions of the scatterers: each 50 trials have their own, whose spread is in the errors of the tables.",
        "The two-stage search, which is in another paper of the authors: structured sets are seeded from crossings of "
        "the first two sensors (type (1, 2)), or from all pairs where a figure says so.",
        "What a correct trial is: the rows called direct are exactly the direct rows, as one set. Target by target, as "
        "this program scores otherwise, a fifth of the cells differ.",
    ),
    errata=(
        Erratum("Section IV", "10 log10(sigma) dB", "of sigma in metres, not of its square: 0 dB is 1 m"),
        Erratum(
            "(1)",
            "a direct range is one way, one by a scatterer a whole round trip",
            "from delays times c / 2 the scattered one is half of that (nlos_range=half); (1) gives the tables",
        ),
        Erratum(
            "(4), (5)",
            "candidates are compared with the unknown TIP sets, in no stated order",
            "greedily by rising spread, each with those that were kept",
        ),
        Erratum(
            "(4), (5)",
            "sets may share a circle as long as they share no point",
            "a circle is of one target: unique=circles removes most false targets of N = 4",
        ),
        Erratum(
            "(7)",
            "no rule where no difference exceeds eta; at least one target",
            "all sets then; assignment may find none",
        ),
        Erratum("Section IV", '"more than a 71 % probability" at 0 dB', "at least 71 %: the least is 710 of 1000"),
        Erratum("abstract, Section IV", '"outstanding localization accuracy"', "no figure or table shows it"),
    ),
)

NOISES_DB = (-10.0, -7.5, -5.0, -2.5, 0.0, 2.5, 5.0)
SENSORS = (4, 5, 6)
TARGETS = 3
FIELD = "-200,200,-200,200"

CHUNK_TRIALS = 50
"""Each chunk has its own scatterers; the paper has one set of scatterers, without their positions."""


@dataclass(frozen=True, kw_only=True)
class Identified:
    """Targets identified in each trial (T,): their number, and whether the rows called direct are the direct ones."""

    count: FloatArray
    exact: FloatArray


def echo_trials(condition: Condition, chunk: Chunk) -> Simulated:
    """Sample the chunk's trials; a condition has ``noise_db`` and parameters of the scenario ``liang``."""
    parameters: dict[str, Any] = dict(condition)
    std = 10.0 ** (float(parameters.pop("noise_db")) / 10.0)
    return simulated("liang", chunk, range_std_m=std, targets=TARGETS, scatterer_seed=chunk.number, **parameters)


def echo_batch(trials: Simulated, size: int) -> RangeBatch:
    """Return the trials, which all have the same number of echoes, as a batch (size, K)."""
    sensor = np.unique(trials.columns["sensor"].astype(str), return_inverse=True)[1]
    columns = {**trials.columns, "sensor": sensor, "path": np.full(sensor.shape, -1)}
    rows = np.arange(sensor.shape[0]).reshape(size, -1)
    return cast(RangeBatch, dense_batch(trials.kind, columns, rows, scene=trials.scene, field=parse_field(FIELD)))


def direct_batch(trials: Simulated, size: int) -> tuple[RangeBatch, FloatArray]:
    """Return the direct echoes of every target as a snapshot (size K, N) of its own, and the targets (size K, 2)."""
    columns = trials.columns
    sensor = np.unique(columns["sensor"].astype(str), return_inverse=True)[1]
    direct = np.flatnonzero(columns["truth_los"])
    keys = (sensor[direct], _numbers(columns["truth_target"])[direct], columns["snapshot"][direct])
    rows = direct[np.lexsort(keys)].reshape(size * TARGETS, -1)
    arrays = {**columns, "sensor": sensor, "path": np.full(sensor.shape, -1)}
    batch = cast(RangeBatch, dense_batch(trials.kind, arrays, rows, scene=trials.scene))
    return batch, np.stack([columns["truth_x_m"], columns["truth_y_m"]], axis=1)[rows[:, 0]]


def candidates(trials: Simulated, size: int) -> list[CandidateSets]:
    """Return the structured candidate sets of each trial, with their cases."""
    batch = echo_batch(trials, size)
    target = _numbers(trials.columns["truth_target"]).reshape(size, -1)
    los = trials.columns["truth_los"].reshape(size, -1)
    return [candidate_sets(batch, trial, target[trial], los[trial], ClusteringOptions()) for trial in range(size)]


def identified(trials: Simulated, chunk: Chunk, method: str, **parameters: Any) -> Identified:
    """Identify the direct echoes of each trial.

    In exact trials the rows called direct are the direct rows, as one set, whichever target they are assigned to.
    """
    result = identify_los(trials.table, method=method, field=FIELD, scene=trials.scene, seed=chunk.seed, **parameters)
    los = result.flags.column("los").to_numpy(zero_copy_only=False).astype(bool).reshape(chunk.size, -1)
    direct = trials.columns["truth_los"].reshape(chunk.size, -1)
    located = np.isfinite(result.estimates.column("x_m").to_numpy(zero_copy_only=False))
    estimated = result.estimates.column("snapshot").to_numpy(zero_copy_only=False) - chunk.first
    return Identified(
        count=np.bincount(estimated[located], minlength=chunk.size).astype(float),
        exact=(los == direct).all(axis=1).astype(float),
    )


def _numbers(target: npt.NDArray[Any]) -> IntArray:
    values = target.astype(float)
    return np.where(np.isnan(values), -1, values).astype(np.int64)
