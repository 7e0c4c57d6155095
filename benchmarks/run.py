"""Run all benchmarks and write their ratios, with versions, to benchmarks/results.md.

    python benchmarks/run.py [--snapshots 1000000] [--keep FOLDER]

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
import kernels
import numpy
import outliers
import pyarrow
import scipy
import triplets

import nlosctl


def main() -> None:
    """Run and write."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--snapshots", type=int, default=1_000_000)
    parser.add_argument("--keep", type=Path, help="folder for the generated files; a temporary one unless given")
    arguments = parser.parse_args()
    pyarrow.set_cpu_count(1)
    pyarrow.set_io_thread_count(1)
    lines = [
        "# Benchmarks",
        "",
        f"nlosctl {nlosctl.__version__}, Python {platform.python_version()}, numpy {numpy.__version__}, "
        f"scipy {scipy.__version__}, pyarrow {pyarrow.__version__}; one thread; written by `benchmarks/run.py`.",
        "",
    ]
    lines += kernels.report()
    lines += circles.report()
    lines += outliers.report()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.keep or Path(scratch)
        lines += end_to_end.report(folder, arguments.snapshots)
        lines += triplets.report(folder, arguments.snapshots)
    text = "\n".join(lines) + "\n"
    (Path(__file__).parent / "results.md").write_text(text, encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
