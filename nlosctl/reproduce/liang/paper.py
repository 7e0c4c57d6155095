"""Liang, Zeng, Li: the paper, where its text is in error, and its trials: echoes of three targets, methods, counts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, cast

import numpy as np
import numpy.typing as npt

from nlosctl.api import identify_los
from nlosctl.arrays import FloatArray, IntArray
from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import parse_field
from nlosctl.evaluation.targets import EchoRows, TargetScores
from nlosctl.pipeline.solve.solve_chunk import dense_batch
from nlosctl.plotting.panels import LinesPanel, Panel, Series
from nlosctl.reproduce.experiment import Beside, Chunk, Claim, Erratum, Experiment, Paper
from nlosctl.reproduce.liang.candidate_sets import CandidateSets, candidate_sets
from nlosctl.reproduce.panels import curve
from nlosctl.reproduce.samples import Condition, Drawn, Samples, conditions, share
from nlosctl.reproduce.simulated import Simulated, simulated
from nlosctl.reproduce.verdicts import Expected, printed
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
    "echo_batch",
    "echo_trials",
    "identified",
    "table_experiment",
]


PAPER = Paper(
    name="liang",
    reference="Liang, Zeng, Li",
    errata=(
        Erratum(
            where="Section IV", printed="10 log10(sigma) dB", right="of sigma in metres, not of its square: 0 dB is 1 m"
        ),
        Erratum(
            where="(1)",
            printed="a direct range is one way, one by a scatterer a whole round trip",
            right="from delays times c / 2 the scattered one is half of that (nlos_range=half); (1) gives the tables",
        ),
        Erratum(
            where="(4), (5)",
            printed="candidates are compared with the unknown TIP sets, in no stated order",
            right="greedily by rising spread, each with those that were kept",
        ),
        Erratum(
            where="(4), (5)",
            printed="sets may share a circle as long as they share no point",
            right="a circle is of one target: unique=circles removes most false targets of N = 4",
        ),
        Erratum(
            where="(7)",
            printed="no rule where no difference exceeds eta; at least one target",
            right="all sets then; assignment may find none",
        ),
        Erratum(
            where="Section IV",
            printed='"more than a 71 % probability" at 0 dB',
            right="at least 71 %: the least is 710 of 1000",
        ),
        Erratum(
            where="abstract, Section IV",
            printed='"outstanding localization accuracy"',
            right="no figure or table tells it",
        ),
    ),
)

NOISES_DB = (-10.0, -7.5, -5.0, -2.5, 0.0, 2.5, 5.0)
SENSORS = (4, 5, 6)
TARGETS = 3
FIELD = "-200,200,-200,200"

CHUNK_TRIALS = 50
"""Each chunk has scatterers of its own; the paper's are one draw that is not told."""
_SCATTERERS_MATTER = {4: 0.02, 5: 0.01, 6: 0.01}
"""How much a draw of the scatterers moves the share of right trials (standard deviation, by sensors)."""
_PAPER_TRIALS = 1000


@dataclass(frozen=True, kw_only=True)
class Identified:
    """What a method found in each trial (T,): the number of targets, and whether all of them are exactly right."""

    found: FloatArray
    exact: FloatArray


def echo_trials(condition: Condition, chunk: Chunk) -> Simulated:
    """Draw the chunk's trials; a condition has ``noise_db``, the rest of it are parameters of ``liang``."""
    parameters: dict[str, Any] = dict(condition)
    std = 10.0 ** (float(parameters.pop("noise_db")) / 10.0)
    return simulated("liang", chunk, range_std_m=std, targets=TARGETS, scatterer_seed=chunk.number, **parameters)


def echo_batch(given: Simulated, size: int) -> RangeBatch:
    """Return the trials as a batch (size, K): all have the same number of echoes."""
    sensor = np.unique(given.columns["sensor"].astype(str), return_inverse=True)[1]
    columns = {**given.columns, "sensor": sensor, "path": np.full(sensor.shape, -1)}
    rows = np.arange(sensor.shape[0]).reshape(size, -1)
    return cast(RangeBatch, dense_batch(given.kind, columns, rows, scene=given.scene, field=parse_field(FIELD)))


def candidates(given: Simulated, size: int) -> list[CandidateSets]:
    """Return the structured candidate sets of every trial, with their cases."""
    batch = echo_batch(given, size)
    target = _numbers(given.columns["truth_target"]).reshape(size, -1)
    los = given.columns["truth_los"].reshape(size, -1)
    return [candidate_sets(batch, trial, target[trial], los[trial], ClusteringOptions()) for trial in range(size)]


def identified(given: Simulated, chunk: Chunk, method: str, **parameters: Any) -> Identified:
    """Identify the direct echoes of every trial, scored as the paper counts: all targets, each with all its echoes."""
    result = identify_los(given.table, method=method, field=FIELD, scene=given.scene, seed=chunk.seed, **parameters)
    target = result.flags.column("target").to_numpy(zero_copy_only=False).astype(float)
    los = result.flags.column("los").to_numpy(zero_copy_only=False).astype(bool)
    estimated = result.estimates.column("snapshot").to_numpy(zero_copy_only=False) - chunk.first
    position = np.stack(
        [result.estimates.column(name).to_numpy(zero_copy_only=False) for name in ("x_m", "y_m")], axis=1
    )
    columns = given.columns
    scores = TargetScores()
    for trial in range(chunk.size):
        rows = columns["snapshot"] == trial + chunk.first
        there = position[estimated == trial]
        scores.add(
            EchoRows(
                target=_numbers(target[rows]),
                true_target=_numbers(columns["truth_target"][rows]),
                los=los[rows],
                true_los=columns["truth_los"][rows],
                true_m=np.stack([columns["truth_x_m"][rows], columns["truth_y_m"][rows]], axis=1),
            ),
            there[np.isfinite(there[:, 0])],
            trial,
        )
    summaries = list(scores.result().values())
    return Identified(
        found=np.array([float(summary.found_targets) for summary in summaries]),
        exact=np.array([summary.exact for summary in summaries]),
    )


def _numbers(target: npt.NDArray[Any]) -> IntArray:
    values = target.astype(float)
    return np.where(np.isnan(values), -1, values).astype(np.int64)


def table_experiment(
    *, name: str, title: str, where: str, eta: float, counts: Mapping[int, tuple[int, ...]], notes: Mapping[int, str]
) -> Experiment:
    """Return Table I or II: trials of 1000 exactly right, ``counts`` over the noise by number of sensors."""
    cells = [(sensors, noise_db) for sensors in SENSORS for noise_db in NOISES_DB]
    claims = tuple(
        Claim(
            says=f"N = {sensors}, {noise_db:g} dB: trials of 1000 with all direct echoes right",
            where=where,
            ours=partial(_per_thousand, method="extended_tca", sensors=sensors, noise_db=noise_db),
            expected=_count(counts[sensors][NOISES_DB.index(noise_db)], sensors),
            note=notes.get(sensors, ""),
            per_trial=1000.0,
        )
        for sensors, noise_db in cells
    )
    beside = tuple(
        Beside(
            says=f"N = {sensors}, {noise_db:g} dB: the same by assignment",
            ours=partial(_per_thousand, method="assignment", sensors=sensors, noise_db=noise_db),
        )
        for sensors, noise_db in cells
    )
    return Experiment(
        name=name,
        paper=PAPER,
        title=title,
        conditions=conditions(sensors=SENSORS, noise_db=NOISES_DB),
        sample=partial(_table_samples, eta=eta),
        quantities={method: partial(_thousandths, method=method) for method in _METHODS},
        claims=claims,
        beside=beside,
        panels=partial(_table_panels, counts=counts),
        trials=1000,
        quick_trials=10,
        chunk_trials=CHUNK_TRIALS,
    )


_METHODS = {"extended_tca": "extended-tca", "assignment": "assignment (recommended)"}


def _table_samples(condition: Condition, chunk: Chunk, *, eta: float) -> Samples:
    given = echo_trials(condition, chunk)
    return {
        "extended_tca": identified(given, chunk, "extended-tca", eta=eta).exact,
        "assignment": identified(given, chunk, "assignment").exact,
    }


def _table_panels(drawn: Drawn, counts: Mapping[int, tuple[int, ...]]) -> Sequence[Panel]:
    return [
        LinesPanel(
            title=f"N = {sensors} sensors",
            x_label="noise, 10 log10(std / 1 m) [dB]",
            y_label="trials exactly right of 1000 [-]",
            lines=(
                Series(label="paper", x=np.array(NOISES_DB), y=np.array(counts[sensors], dtype=float), line=False),
                *(
                    curve(drawn, "noise_db", label, partial(_thousandths, method=method), sensors=sensors)
                    for method, label in _METHODS.items()
                ),
            ),
        )
        for sensors in SENSORS
    ]


def _per_thousand(drawn: Drawn, *, method: str, sensors: int, noise_db: float) -> float:
    return _thousandths(drawn.of(sensors=sensors, noise_db=noise_db), method=method)


def _thousandths(samples: Samples, *, method: str) -> float:
    return 1000.0 * share(samples[method])


def _count(count: int, sensors: int) -> Expected:
    """Return a count of 1000 trials, with the error of the trials and of the unknown scatterers."""
    probability = count / _PAPER_TRIALS
    of_trials = math.sqrt(probability * (1.0 - probability) / _PAPER_TRIALS)
    return printed(str(count), standard_error=1000.0 * math.hypot(of_trials, _SCATTERERS_MATTER[sensors]))
