"""Calibrations of simulated sessions: errors of offsets, what their covariance is worth, and time.

Prints the tables of docs/calibration.md: ``python benchmarks/calibration.py [SESSIONS]`` (default 100 for each row).
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet
from scipy.stats import chi2

import nlosctl

_FRESH = 25
"""Fresh snapshots of each session."""


@dataclass(frozen=True, kw_only=True)
class World:
    """Sensors (J, D) with offsets of three stds, and sources uniform in the box around them, at least 2 % inside."""

    name: str
    kind: str
    sensors: np.ndarray
    std: float

    def draw(self, snapshots: int, seed: int, offsets: np.ndarray, outliers: float = 0.0) -> dict[str, Any]:
        """Return a session: outliers are uniform bearings, or ranges and arrivals too long by 15 stds on average."""
        rng = np.random.default_rng(seed)
        low, high = self.sensors.min(axis=0), self.sensors.max(axis=0)
        source = low + (high - low) * rng.uniform(0.02, 0.98, (snapshots, low.size))
        away = source[:, None] - self.sensors
        shape = away.shape[:2]
        out, noise = rng.random(shape) < outliers, offsets + self.std * rng.normal(size=shape)
        columns = {"snapshot": np.arange(snapshots), "sensor": [f"s{number}" for number in range(shape[1])]}
        if self.kind == "bearings":
            values = np.arctan2(away[..., 1], away[..., 0]) + noise
            values = np.angle(np.exp(1j * np.where(out, rng.uniform(-np.pi, np.pi, shape), values)))
            names = "bearing_rad", "bearing_std_rad"
        else:
            values = np.linalg.norm(away, axis=2) + noise + out * rng.exponential(15.0 * self.std, shape)
            values = np.maximum(values, 1e-3)
            names = {"ranges": ("range_m", "range_std_m"), "arrivals": ("arrival_m", "arrival_std_m")}[self.kind]
        table = {
            "snapshot": np.repeat(columns["snapshot"], shape[1]),
            "sensor": np.tile(columns["sensor"], snapshots),
            names[0]: values.ravel(),
            names[1]: np.full(values.size, self.std),
        }
        for axis, name in enumerate("xyz"[: low.size]):
            table[f"sensor_{name}_m"] = np.tile(self.sensors[:, axis], snapshots)
            table[f"truth_{name}_m"] = np.repeat(source[:, axis], shape[1])
        if self.kind == "bearings" and low.size == 3:
            rise = np.arctan2(away[..., 2], np.hypot(away[..., 0], away[..., 1])) + self.std * rng.normal(size=shape)
            table |= {"elevation_rad": rise.ravel(), "elevation_std_rad": np.full(rise.size, self.std)}
        return table

    @property
    def options(self) -> dict[str, Any]:
        """What makes a file one of space."""
        return {"dimensions": self.sensors.shape[1]}


_TURN = 2.0 * np.pi * np.arange(6) / 6.0
_ROOM = np.array([[0, 0, 1], [100, 0, 30], [100, 80, 4], [0, 80, 25], [50, -20, 12], [55, 100, 35]], dtype=float)
WORLDS = {
    world.name: world
    for world in (
        World(
            name="bearings, 6 sensors, 1 deg",
            kind="bearings",
            sensors=200.0 * np.stack([np.cos(_TURN), np.sin(_TURN)], axis=1),
            std=np.radians(1.0),
        ),
        World(
            name="ranges, 4 anchors in a hall, .1 m",
            kind="ranges",
            sensors=np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]]),
            std=0.1,
        ),
        World(name="arrivals, 6 sensors, .1 m", kind="arrivals", sensors=_ROOM[:, :2], std=0.1),
        World(name="arrivals in space", kind="arrivals", sensors=np.vstack([_ROOM, [-15, 40, 18]]), std=0.1),
        World(name="azimuths and elevations, 1 deg", kind="bearings", sensors=_ROOM, std=np.radians(1.0)),
        World(name="ranges in space", kind="ranges", sensors=_ROOM, std=0.1),
    )
}
BEARINGS, RANGES, ARRIVALS = list(WORLDS)[:3]


@dataclass(frozen=True, kw_only=True)
class Score:
    """Of sessions: RMSE of the offsets in deg or m, mean chi-square per offset, mean square of error over std.

    With fresh snapshots their mean NEES, the share in 95 % ellipses, and its standard error.
    """

    rmse: float
    chi_square: float
    ratio: float
    nees: float = np.nan
    held: float = np.nan
    error: float = np.nan


def score(
    world: World,
    snapshots: int,
    sessions: int,
    method: str = "ml",
    *,
    outliers: float = 0.0,
    fresh: bool = False,
    **more: Any,
) -> Score:
    """Return the score of sessions."""
    errors, squares, ratios, nees, held = [], [], [], [], []
    for seed in range(sessions):
        given = 3.0 * world.std * np.random.default_rng([seed, 1]).normal(size=len(world.sensors))
        done = nlosctl.calibrate(
            world.draw(snapshots, 2 * seed, given, outliers), method=method, **world.options, **more
        )
        calibration = done.calibration
        unit = calibration.quantity.scale
        error = np.array([entry.offset for entry in calibration.entries]) - given / unit
        lost = world.kind == "arrivals" and not more
        error -= error.mean() if lost else 0.0
        inverse = np.linalg.pinv(calibration.covariance, rcond=1e-8, hermitian=True)
        errors.append(error)
        squares.append(error @ inverse @ error / (error.size - lost))
        ratios.append(error**2 / np.diag(calibration.covariance))
        if fresh:
            table = world.draw(_FRESH, 2 * seed + 1, given, outliers)
            fixes = nlosctl.localize(
                table, method=method, calibration=calibration, add=["nees"], **world.options
            ).estimates
            values = np.array(fixes["nees"].to_pylist(), dtype=float)
            values = values[np.isfinite(values) & (np.array(fixes["alternative"].to_pylist()) == 0)]
            nees.append(values.mean())
            held.append(np.mean(values < chi2(len(world.sensors[0])).ppf(0.95)))
    fits = float(np.sqrt(np.mean(np.square(errors)))), float(np.mean(squares)), float(np.mean(ratios))
    if not fresh:
        return Score(rmse=fits[0], chi_square=fits[1], ratio=fits[2])
    deviation = float(np.std(held) / np.sqrt(sessions))
    return Score(
        rmse=fits[0],
        chi_square=fits[1],
        ratio=fits[2],
        nees=float(np.mean(nees)),
        held=float(np.mean(held)),
        error=deviation,
    )


def seconds(method: str, snapshots: int = 100_000) -> float:
    """Return the time of a calibration of snapshots of 8 bearings in a Parquet file, by one process."""
    turn = 2.0 * np.pi * np.arange(8) / 8.0
    sensors = 200.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    world = World(name="", kind="bearings", sensors=sensors, std=np.radians(1.0))
    given = 3.0 * world.std * np.random.default_rng(1).normal(size=8)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "m.parquet"
        pyarrow.parquet.write_table(pa.table(world.draw(snapshots, 1, given)), path)
        start = time.perf_counter()
        nlosctl.calibrate(str(path), method=method, jobs=1)
        return time.perf_counter() - start


def lines(sessions: int) -> Iterator[str]:
    """Yield the lines of the tables."""
    yield "| RMSE of offsets, chi-square per offset, mean square of error / std | 10 snapshots | 30 | 100 |"
    yield "|---|---|---|---|"
    for world in WORLDS.values():
        cells = []
        for count in (10, 30, 100):
            found = score(world, count, sessions if count < 100 else max(sessions // 2, 1))
            cells.append(f"{found.rmse:.3g}, {found.chi_square:.2f}, {found.ratio:.2f}")
        yield f"| {world.name} | {' | '.join(cells)} |"
    yield ""
    yield "| 60 snapshots, `mixture-ml` | no outliers | 15 % | 30 % |"
    yield "|---|---|---|---|"
    for name in (BEARINGS, RANGES, ARRIVALS):
        scores = [score(WORLDS[name], 60, sessions // 2, "mixture-ml", outliers=share) for share in (0.0, 0.15, 0.3)]
        yield f"| {name} | {' | '.join(f'{found.rmse:.3g}, {found.chi_square:.2f}' for found in scores)} |"
    yield ""
    yield "| fresh snapshots: mean NEES, share in 95 % ellipses | 12 snapshots | 30 |"
    yield "|---|---|---|"
    for name, method in ((BEARINGS, "ml"), (RANGES, "ml"), (RANGES, "mixture-ml"), (ARRIVALS, "ml")):
        scores = [score(WORLDS[name], count, sessions, method, fresh=True) for count in (12, 30)]
        cells = [f"{found.nees:.2f}, {found.held:.3f} +- {found.error:.3f}" for found in scores]
        yield f"| {name}, `{method}` | {' | '.join(cells)} |"
    yield ""
    times = [f"`{method}` {seconds(method):.1f} s" for method in ("ml", "mixture-ml")]
    yield f"100,000 snapshots of 8 bearings on one core: {', '.join(times)}."


if __name__ == "__main__":
    for line in lines(int(sys.argv[1]) if len(sys.argv) > 1 else 100):
        print(line, flush=True)
