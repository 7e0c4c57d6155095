"""Parquet bearings to Parquet estimates, against pyarrow reading and writing the same alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from timing import best_of

from nlosctl.cli.main import run

_METHODS = ("ls", "stansfield", "ml", "mixture-ml")
_SLOW = ("mixture-ml",)


def make_file(path: Path, snapshots: int) -> None:
    """Write a file of 8 bearings per snapshot, positions random per snapshot."""
    path.parent.mkdir(parents=True, exist_ok=True)
    parameters = ("-p", "sensors=8", "-p", "bearing_std_deg=0.5,2", "-p", "mirrors=0")
    words = ["simulate", "random", "-n", str(snapshots), "--seed", "1", *parameters, "-o", str(path), "-q"]
    if run(words) != 0:
        raise RuntimeError(f"nlosctl {' '.join(words)} failed")


def make_outliers(path: Path, snapshots: int) -> None:
    """Write a file of 8 bearings per snapshot, 2 of them uniform over the circle, positions random per snapshot."""
    settings = ("radius_m=500", "sources=disc", "bearing_std_deg=2", "nlos_receivers=2", "nlos_span_deg=360")
    parameters = [word for setting in settings for word in ("-p", setting)]
    words = ["simulate", "madhow-ring", "-n", str(snapshots), "--seed", "1", *parameters, "-o", str(path), "-q"]
    if run(words) != 0:
        raise RuntimeError(f"nlosctl {' '.join(words)} failed")


def localize(method: str, source: Path, target: Path, *extra: str, jobs: int = 1) -> None:
    """Run the command in this process, so that start-up does not count."""
    words = ["localize", "-m", method, str(source), "-o", str(target), "--overwrite", "-q", "--jobs", str(jobs), *extra]
    if run(words) != 0:
        raise RuntimeError(f"nlosctl {' '.join(words)} failed")


def read_and_write(source: Path, estimates: pa.Table, target: Path) -> None:
    """What no tool can beat: pyarrow alone reads the file and writes the result."""
    for _ in pq.ParquetFile(source).iter_batches(131_072, use_threads=False):
        pass
    pq.write_table(estimates, target, compression="zstd", row_group_size=131_072, use_dictionary=False)


_PRINT_PEAK = """
import sys
from nlosctl.cli.main import run
code = run()
with open("/proc/self/status") as status:
    print(next(line.split()[1] for line in status if line.startswith("VmHWM")))
sys.exit(code)
"""


def peak_memory_mb(method: str, source: Path, target: Path) -> float:
    """Return the peak memory of a process of its own that runs the command (Linux)."""
    words = ["localize", "-m", method, str(source), "-o", str(target), "--overwrite", "-q", "--jobs", "1"]
    done = subprocess.run([sys.executable, "-c", _PRINT_PEAK, *words], check=True, capture_output=True, text=True)
    return int(done.stdout) / 1024.0


def unknown_std(source: Path, target: Path) -> list[str]:
    """Return the lines of the table: `ml` with standard deviations from each snapshot's residuals over `ml` without."""
    seconds = best_of(
        5, lambda: localize("ml", source, target), lambda: localize("ml", source, target, "--estimate-std", "snapshot")
    )
    lines = ["## Unknown standard deviations: `ml`, the same file", "", "| options | seconds | times without |"]
    lines.append("|---|---|---|")
    for options, time in zip(("none", "`--estimate-std snapshot`"), seconds, strict=True):
        lines.append(f"| {options} | {time:.2f} | {time / seconds[0]:.2f} |")
    return [*lines, ""]


def report(folder: Path, snapshots: int, slow_snapshots: int, memory: list[int]) -> list[str]:
    """Return the lines of the tables: ratios to pyarrow, gain by a second process, peak memory by length."""
    plain, outliers = folder / f"bearings_{snapshots}.parquet", folder / f"outliers_{slow_snapshots}.parquet"
    target = folder / "estimates.parquet"
    if not plain.exists():
        make_file(plain, snapshots)
    if not outliers.exists():
        make_outliers(outliers, slow_snapshots)
    lines = [
        "## End to end: snapshots of 8 bearings, Parquet to Parquet, one thread each",
        "",
        f"{snapshots:,} snapshots; `mixture-ml`: {slow_snapshots:,}, a quarter of the bearings outliers.",
        "",
        "| program | seconds | pyarrow's read + write alone | times pyarrow |",
        "|---|---|---|---|",
    ]
    gains = [
        "",
        "## A second process: `--jobs 2`",
        "",
        "| method | seconds, jobs 1 | seconds, jobs 2 | jobs 1 / jobs 2 |",
    ]
    gains.append("|---|---|---|---|")
    for method in _METHODS:
        source = outliers if method in _SLOW else plain
        localize(method, source, target)
        estimates = pq.read_table(target, use_threads=False)
        alone, ours, shared = best_of(
            5,
            lambda estimates=estimates, source=source: read_and_write(source, estimates, folder / "alone.parquet"),
            lambda method=method, source=source: localize(method, source, target),
            lambda method=method, source=source: localize(method, source, target, jobs=2),
        )
        lines.append(f"| `nlosctl localize -m {method}` | {ours:.2f} | {alone:.2f} | {ours / alone:.1f} |")
        gains.append(f"| `{method}` | {ours:.2f} | {shared:.2f} | {ours / shared:.2f} |")
    lines += [*gains, "", *unknown_std(plain, target)]
    lines += ["## Peak memory of a process of its own, `stansfield`", "", "| snapshots | MB |", "|---|---|"]
    for count in memory:
        source = folder / f"bearings_{count}.parquet"
        if not source.exists():
            make_file(source, count)
        lines.append(f"| {count} | {peak_memory_mb('stansfield', source, target):.0f} |")
    return [*lines, ""]
