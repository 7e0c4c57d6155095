"""Rows per snapshot, to 10,000, for every method, against scipy on the same rows in the same run.

    python benchmarks/rows.py [ROWS ...]

One snapshot of a drive: a single moving sensor on a circle of 500 m, so that all rows have one name. Bearings: 5 deg,
30 % uniform over the circle. Ranges: 0.5 m, 20 % late. Triplets: receivers with 4 or 10 paths each in a room. Echoes:
sensors in a field, 3 targets. The peer is one ``scipy.optimize.least_squares`` of the rows of the drive, with a soft
loss, from an initial estimate near the source: it has no statuses, no flags and no search.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

ROWS = (100, 1000, 2400, 10_000)
_SOURCE = np.array([-60.0, 170.0])
_SLOW = 60.0
"""A method that takes more seconds is not run with more rows."""


def report(rows: tuple[int, ...] = ROWS) -> list[str]:
    """Return the lines of the table: seconds of one snapshot less those of start-up, memory, and ratios."""
    lines = [
        "## Growth with rows of a snapshot: one drive, whole processes, start-up subtracted",
        "",
        "Ratio: time over that of one `least_squares` of the same rows (bearings for triplets and echoes).",
        "",
        "| method | " + " | ".join(f"{count} rows" for count in rows) + " | memory (MB), most rows |",
        "|---|" + "---|" * (len(rows) + 1),
    ]
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        idle = _solve(folder, _drive(folder, "bearings", 8), "localize", "-m", "ls")[0]
        peers = {(kind, count): _peer(kind, count) for kind in ("bearings", "ranges") for count in rows}
        for kind, words in _runs():
            cells, memory, slow = [], 0.0, False
            for count in rows:
                if slow:
                    cells.append("not run: minutes")
                    continue
                seconds, memory = _solve(folder, _drive(folder, kind, count), *words)
                slow = seconds > _SLOW
                seconds = max(seconds - idle, 0.001)
                ratio = seconds / peers["ranges" if kind == "ranges" else "bearings", count]
                cells.append(f"{seconds:.2f} s ({ratio:.2g})")
            lines.append(f"| {kind} `{' '.join(words)}` | " + " | ".join(cells) + f" | {memory:.0f} |")
            print(lines[-1], flush=True)
    return [*lines, ""]


def _runs() -> list[tuple[str, tuple[str, ...]]]:
    bearings = ("ls", "stansfield", "stansfield-focused", "ml", "ml-grid", "sequential", "mixture-ml", "suppress")
    runs = [("bearings", ("localize", "-m", name)) for name in bearings]
    runs += [("bearings", ("localize", "-m", "suppress", "-p", "acceptance=likelihood"))]
    runs += [("ranges", ("localize", "-m", name)) for name in ("sr-ls", "r-ls", "ml", "mixture-ml")]
    runs += [("triplets", ("localize", "-m", "ml")), ("triplets", ("localize", "-m", "ml", "-p", "joint=true"))]
    runs += [("triplets", ("detect-ip", "-m", name)) for name in ("chi2", "tdaj", "joint")]
    runs += [("echoes", ("identify-los", "-m", name, "-p", "targets=3")) for name in ("tca", "extended-tca")]
    return [*runs, ("echoes", ("identify-los", "-m", "assignment"))]


def _measured(kind: str, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return sensor positions and what each row measures, in radians or metres."""
    generator = np.random.default_rng(count)
    around = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    sensors = 500.0 * np.stack([np.cos(around), np.sin(around)], axis=1)
    dx, dy = (_SOURCE - sensors).T
    if kind == "ranges":
        late = np.where(generator.random(count) < 0.2, generator.exponential(50.0, count), 0.0)
        return sensors, np.hypot(dx, dy) + 0.5 * generator.normal(size=count) + late
    bearing = np.arctan2(dy, dx) + np.radians(5.0) * generator.normal(size=count)
    return sensors, np.where(generator.random(count) < 0.3, generator.uniform(-np.pi, np.pi, count), bearing)


def _drive(folder: Path, kind: str, count: int) -> Path:
    """Return a file of one snapshot of ``count`` rows."""
    path = folder / f"{kind}{count}.csv"
    if path.exists():
        return path
    if kind in ("triplets", "echoes"):
        paths = 10 if count > 4000 else 4
        shape = (
            ("room", f"receivers={count // paths}", f"paths={paths}")
            if kind == "triplets"
            else ("echo-field", f"sensors={max(3, count // 12)}", "targets=3")
        )
        words = [word for parameter in shape[1:] for word in ("-p", parameter)]
        _program("simulate", shape[0], "-n", "1", "--seed", "1", *words, "-q", "-o", str(path))
        return path
    unit, std = ("range_m", 0.5) if kind == "ranges" else ("bearing_rad", np.radians(5.0))
    sensors, values = _measured(kind, count)
    rows = (f"0,car,{x},{y},{value},{std}\n" for (x, y), value in zip(sensors, values, strict=True))
    path.write_text(f"snapshot,sensor,sensor_x_m,sensor_y_m,{unit},{unit.replace('_', '_std_')}\n" + "".join(rows))
    return path


def _peer(kind: str, count: int) -> float:
    """Return the seconds of ``least_squares`` on the rows of a drive."""
    sensors, values = _measured(kind, count)
    std = 0.5 if kind == "ranges" else np.radians(5.0)

    def residual(point: np.ndarray) -> np.ndarray:
        dx, dy = (point - sensors).T
        if kind == "ranges":
            return (values - np.hypot(dx, dy)) / std
        error = values - np.arctan2(dy, dx)
        return (error - 2.0 * np.pi * np.round(error / (2.0 * np.pi))) / std

    best = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        fit = least_squares(residual, _SOURCE + 50.0, loss="cauchy")
        best = min(best, time.perf_counter() - start)
    assert np.hypot(*(fit.x - _SOURCE)) < 20.0, "the peer must find the source before it is timed"
    return best


def _solve(folder: Path, source: Path, *words: str) -> tuple[float, float]:
    """Return processor seconds and peak memory (MB) of a process of its own."""
    return _program(*words, str(source), "-o", str(folder / "solved.csv"), "--overwrite", "-q")


def _program(*words: str) -> tuple[float, float]:
    process = subprocess.Popen([sys.executable, "-m", "nlosctl", *words])
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise RuntimeError(f"nlosctl {' '.join(words)} failed")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024.0


if __name__ == "__main__":
    print("\n".join(report(tuple(int(word) for word in sys.argv[1:]) or ROWS)))
