"""Triplets: chi2 against a loop over scipy.optimize.least_squares, difference rules against pyarrow alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
from scipy.optimize import least_squares
from timing import best_of

from nlosctl.cli.main import run
from nlosctl.contract.batches import TripletBatch
from nlosctl.methods import triplets_chi2
from nlosctl.pipeline.simulate.simulation import Simulation
from nlosctl.scenarios.catalogue import find_scenario

_PATHS = 8192
_LOOPED = 200
_RULES = ("lambda5", "fusion")


def make_batch(paths: int) -> TripletBatch:
    """Return direct and indirect paths of scenario 3 of Shen and Molisch."""
    spec = find_scenario("shen")
    columns = spec.generate(spec.options(), np.random.default_rng(1), paths)
    arrays = {}
    for name, parts in TripletBatch.SOURCES.items():
        values = [np.asfortranarray(columns[part][:, None]) for part in parts]
        arrays[name] = values[0] if len(values) == 1 else np.asfortranarray(np.stack(values, axis=-1))
    return TripletBatch(seed=np.zeros(paths, dtype=np.uint64), **arrays)


def scipy_loop(batch: TripletBatch, paths: int) -> np.ndarray:
    """Return half the chi-squares that a loop finds from the two ellipse points and their middle, as chi2 does.

    From one start it is a third of the work, and worse answers.
    """
    costs = np.empty(paths)
    for row in range(paths):
        (tx, rx), length = (batch.tx_xy_m[row, 0], batch.rx_xy_m[row, 0]), batch.path_length_m[row, 0]
        angles = np.array([batch.dod_rad[row, 0], batch.doa_rad[row, 0]])
        std = np.array([batch.dod_std_rad[row, 0], batch.doa_std_rad[row, 0], batch.path_length_std_m[row, 0]])
        baseline = float(np.hypot(*(rx - tx)))
        reach = 0.5 * (length**2 - baseline**2) / (length - baseline * np.cos(angles * [1.0, 1.0] + [0.0, np.pi]))
        ends = [node + r * np.array([np.cos(a), np.sin(a)]) for node, r, a in zip((tx, rx), reach, angles, strict=True)]

        def residual(point, tx=tx, rx=rx, angles=angles, length=length, std=std):
            from_tx, from_rx = point - tx, point - rx
            error = angles - [np.arctan2(from_tx[1], from_tx[0]), np.arctan2(from_rx[1], from_rx[0])]
            error -= 2.0 * np.pi * np.round(error / (2.0 * np.pi))
            return np.array([*error, length - np.hypot(*from_tx) - np.hypot(*from_rx)]) / std

        starts = (0.5 * (ends[0] + ends[1]), *ends)
        costs[row] = min(least_squares(residual, start, method="lm").cost for start in starts)
    return costs


def report(folder: Path, paths: int) -> list[str]:
    """Return the lines of both tables; no fit of ours may be worse than the loop's."""
    batch = make_batch(_PATHS)
    ours = triplets_chi2.solve(batch, triplets_chi2.METHOD.options()).estimates.cost[:_LOOPED]
    looped = scipy_loop(batch, _LOOPED)
    assert np.nanmax(ours - looped) < 1e-6 * (1.0 + np.nanmax(looped)), "chi2 must not be worse than the loop"
    loop, kernel = best_of(
        5, lambda: scipy_loop(batch, _LOOPED), lambda: triplets_chi2.solve(batch, triplets_chi2.METHOD.options())
    )
    per_loop, per_kernel = loop / _LOOPED, kernel / _PATHS
    lines = [
        '## Triplets: `chi2` against a loop of `least_squares(method="lm")` from the same three starts',
        "",
        "| program | microseconds per path | times the loop's throughput |",
        "|---|---|---|",
        f"| scipy loop | {per_loop * 1e6:.1f} | 1 |",
        f"| `chi2` (estimates and flags) | {per_kernel * 1e6:.2f} | {per_loop / per_kernel:.0f} |",
        "",
        f"## Triplets end to end: {paths:,} paths, Parquet to Parquet",
        "",
        "| program | seconds | times pyarrow's read + write of the input |",
        "|---|---|---|",
    ]
    return [*lines, *_end_to_end(folder, paths), ""]


def _end_to_end(folder: Path, paths: int) -> list[str]:
    source, target = folder / f"triplets_{paths}.parquet", folder / "flags.parquet"
    if not source.exists():
        simulation = Simulation("shen", {}, seed=1, trials=paths)
        folder.mkdir(parents=True, exist_ok=True)
        with pq.ParquetWriter(source, simulation.schema) as writer:
            for table in simulation.tables():
                writer.write_table(table)

    def detect(rule: str) -> None:
        words = ["detect-ip", "-m", "tdaj", "-p", f"rule={rule}", str(source), "-o", str(target)]
        if run([*words, "--overwrite", "-q", "--jobs", "1"]) != 0:
            raise RuntimeError(f"detect-ip with {rule} failed")

    def alone() -> None:
        pq.write_table(pq.read_table(source, use_threads=False), folder / "alone.parquet")

    times = best_of(5, alone, *((lambda rule=rule: detect(rule)) for rule in _RULES))
    lines = [f"| pyarrow alone | {times[0]:.2f} | 1 |"]
    for rule, seconds in zip(_RULES, times[1:], strict=True):
        lines.append(f"| `nlosctl detect-ip -m tdaj -p rule={rule}` | {seconds:.2f} | {seconds / times[0]:.1f} |")
    return lines
