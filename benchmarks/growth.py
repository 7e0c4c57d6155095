"""Time and memory against the number of snapshots, sensors, paths and targets; start-up time and what it imports."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

from end_to_end import peak_memory_mb
from timing import best_of

from nlosctl.cli.main import run

_SENSORS = (3, 8, 30, 100)
_PATHS = (1, 4, 12, 25)
_TARGETS = (1, 3, 6)


def report(folder: Path, snapshots: list[int]) -> list[str]:
    """Return the lines of the tables."""
    lines = [
        "## Growth with snapshots: `localize -m ml --jobs 1`, 8 bearings each",
        "",
        "| snapshots | microseconds per snapshot | peak memory (MB) |",
        "|---|---|---|",
    ]
    for count in snapshots:
        source = _drawn(folder, "random", count, "sensors=8", "mirrors=0")
        seconds = _solved(source, folder, "localize", "-m", "ml")
        lines.append(
            f"| {count} | {seconds / count * 1e6:.2f} | {peak_memory_mb('ml', source, folder / 'e.parquet'):.0f} |"
        )
    lines += _table(folder, "sensors", "random", "sensors", _SENSORS, 400_000, ("mirrors=0",), ("localize", "-m", "ml"))
    lines += _table(
        folder, "paths of each of 3 receivers", "room", "paths", _PATHS, 40_000, (), ("detect-ip", "-m", "chi2")
    )
    lines += _table(folder, "targets", "echo-field", "targets", _TARGETS, 600, (), ("identify-los",))
    return [*lines, "", *_start_up()]


def _table(
    folder: Path,
    what: str,
    scenario: str,
    key: str,
    values: tuple[int, ...],
    size: int,
    fixed: tuple[str, ...],
    words: tuple[str, ...],
) -> list[str]:
    lines = [
        "",
        f"## Growth with {what} per snapshot: `{' '.join(words)} --jobs 1`, scenario `{scenario}`",
        "",
        f"| {what} | microseconds per snapshot |",
        "|---|---|",
    ]
    for value in values:
        count = max(1, size // value)
        source = _drawn(folder, scenario, count, f"{key}={value}", *fixed)
        lines.append(f"| {value} | {_solved(source, folder, *words) / count * 1e6:.2f} |")
    return lines


def _drawn(folder: Path, scenario: str, count: int, *parameters: str) -> Path:
    name = "_".join([scenario, str(count), *parameters]).replace("=", "")
    path = folder / f"{name}.parquet"
    words = [word for parameter in parameters for word in ("-p", parameter)]
    if not path.exists() and run(
        ["simulate", scenario, "-n", str(count), "--seed", "1", *words, "-o", str(path), "-q"]
    ):
        return None
    return path


def _solved(source: Path, folder: Path, *words: str) -> float:
    target = str(folder / "grown.parquet")

    def program() -> None:
        if run([*words, str(source), "-o", target, "--overwrite", "-q", "--jobs", "1"]) != 0:
            raise RuntimeError(f"nlosctl {' '.join(words)} failed")

    return best_of(2, program)[0]


def _start_up() -> list[str]:
    lines = [
        "## Start-up, whole processes",
        "",
        "| command | milliseconds | numpy, scipy, pyarrow imported |",
        "|---|---|---|",
    ]
    for words in (["--help"], ["--version"], ["localize", "--help"], ["methods"]):
        best = float("inf")
        for _ in range(5):
            start = time.perf_counter()
            subprocess.run([sys.executable, "-m", "nlosctl.cli", *words], check=True, capture_output=True)
            best = min(best, time.perf_counter() - start)
        script = (
            "import sys; sys.stdout = open('/dev/null', 'w'); from nlosctl.cli.main import run; "
            f"run({words!r}); print([m for m in ('numpy', 'scipy', 'pyarrow') if m in sys.modules], file=sys.stderr)"
        )
        done = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, text=True)
        imported = ", ".join(word for word in ("numpy", "scipy", "pyarrow") if word in done.stderr) or "none"
        lines.append(f"| `nlosctl {' '.join(words)}` | {best * 1e3:.0f} | {imported} |")
    return [*lines, ""]
