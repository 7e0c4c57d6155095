"""Parquet bearings to Parquet estimates, against pyarrow reading and writing the same alone."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
from timing import best_of

from nlosctl.cli.main import run

_METHODS = ("ls", "stansfield", "ml")


def make_file(path: Path, snapshots: int) -> None:
    """Write a file of 8 bearings per snapshot, positions random per snapshot."""
    path.parent.mkdir(parents=True, exist_ok=True)
    parameters = ("-p", "sensors=8", "-p", "bearing_std_deg=0.5,2", "-p", "mirrors=0")
    words = ["simulate", "random", "-n", str(snapshots), "--seed", "1", *parameters, "-o", str(path), "-q"]
    if run(words) != 0:
        raise RuntimeError(f"nlosctl {' '.join(words)} failed")


def localize(method: str, source: Path, target: Path) -> None:
    """Run the command in this process, so that start-up does not count."""
    words = ["localize", "-m", method, str(source), "-o", str(target), "--overwrite", "-q", "--jobs", "1"]
    if run(words) != 0:
        raise RuntimeError(f"nlosctl {' '.join(words)} failed")


def read_and_write(source: Path, estimates: pa.Table, target: Path) -> None:
    """What no tool can beat: pyarrow alone reads the file and writes the result."""
    for _ in pq.ParquetFile(source).iter_batches(131_072, use_threads=False):
        pass
    pq.write_table(estimates, target, compression="zstd", row_group_size=131_072, use_dictionary=False)


_TELL_PEAK = """
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
    told = subprocess.run([sys.executable, "-c", _TELL_PEAK, *words], check=True, capture_output=True, text=True)
    return int(told.stdout) / 1024.0


def report(folder: Path, snapshots: int) -> list[str]:
    """Return the lines of the table."""
    source, target = folder / f"bearings_{snapshots}.parquet", folder / "estimates.parquet"
    if not source.exists():
        make_file(source, snapshots)
    lines = [
        f"## End to end: {snapshots:,} snapshots of 8 bearings, Parquet to Parquet",
        "",
        "| program | seconds | times pyarrow's read + write |",
        "|---|---|---|",
    ]
    for method in _METHODS:
        localize(method, source, target)
        estimates = pq.read_table(target, use_threads=False)
        alone, ours = best_of(
            5,
            lambda estimates=estimates: read_and_write(source, estimates, folder / "alone.parquet"),
            lambda method=method: localize(method, source, target),
        )
        if method == _METHODS[0]:
            lines.append(f"| pyarrow alone | {alone:.2f} | 1 |")
        lines.append(f"| `nlosctl localize -m {method}` | {ours:.2f} | {ours / alone:.1f} |")
    longer = folder / f"bearings_{10 * snapshots}.parquet"
    if not longer.exists():
        make_file(longer, 10 * snapshots)
    short, long = (peak_memory_mb("stansfield", file, target) for file in (source, longer))
    return [
        *lines,
        "",
        f"Peak memory of a process of its own: {short:.0f} MB; with ten times as many snapshots: {long:.0f} MB.",
        "",
    ]
