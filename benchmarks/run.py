"""Run all benchmarks, write their ratios, with versions, to benchmarks/results.md, and the figures to history/.

    python benchmarks/run.py [--quick] [--snapshots 1000000] [--keep FOLDER]

``--quick`` runs what the limits are on (kernels, end to end, two processes, memory) and prints it alone.

Every figure is a ratio against another program in the same run, one thread each; both sides are warm, the best of
five counts. Absolute times are this machine's and say little.
"""

from __future__ import annotations

import argparse
import os
import platform
import tempfile
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import circles
import end_to_end
import growth
import history
import kernels
import kernels_in_space
import numpy
import outliers
import peers
import pyarrow
import rows
import scipy
import triplets

import nlosctl


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--snapshots", type=int, default=1_000_000)
    parser.add_argument("--quick", action="store_true", help="only what the limits are on; writes no file")
    parser.add_argument("--keep", type=Path, help="folder for the generated files; default: a temporary one")
    arguments = parser.parse_args()
    pyarrow.set_cpu_count(1)
    pyarrow.set_io_thread_count(1)
    versions = {
        "nlosctl": nlosctl.__version__,
        "Python": platform.python_version(),
        **{module.__name__: module.__version__ for module in (numpy, scipy, pyarrow)},
    }
    named = ", ".join(f"{name} {version}" for name, version in versions.items())
    lines = ["# Benchmarks", "", f"{named}; one thread except where stated; written by `benchmarks/run.py`.", ""]
    lines += kernels.report()
    lines += kernels_in_space.report()
    lines += outliers.report()
    if not arguments.quick:
        lines += peers.report()
    count, most = arguments.snapshots, 10 * arguments.snapshots
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.keep or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        slow = count // 5 if arguments.quick else count
        lines += end_to_end.report(folder, count, slow, [count // 10, count, most])
        lines += triplets.report(folder, count)
        if not arguments.quick:
            lines += circles.report()
            lines += growth.report(folder, [1_000, 10_000, 100_000, count, most])
            lines += rows.report()
    text = "\n".join(lines) + "\n"
    print(text)
    if not arguments.quick:
        (Path(__file__).parent / "results.md").write_text(text, encoding="utf-8")
        print(f"figures: {history.keep(lines, versions)}")


if __name__ == "__main__":
    main()
