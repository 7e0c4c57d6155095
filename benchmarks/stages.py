"""Where the time of a command goes: a sample of its stack each millisecond, by stage.

python benchmarks/stages.py FILE [--method ml] [--rounds 5]
"""

from __future__ import annotations

import argparse
import os
import signal
import tempfile
import time
from collections import Counter
from pathlib import Path
from types import FrameType

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import pyarrow

from nlosctl.cli.main import run

_PERIOD_S = 0.001
_STAGES = {
    "methods": ("nlosctl/methods/",),
    "blocks and estimates": ("nlosctl/pipeline/solve/solve_chunk.py",),
    "estimates as a table": (
        "nlosctl/io/results/layouts.py",
        "nlosctl/io/answers.py",
        "nlosctl/pipeline/solve/solution_check.py",
    ),
    "encoding and writing": (
        "nlosctl/io/writers/table_writer.py",
        "nlosctl/io/writers/text_encoders.py",
        "nlosctl/pipeline/engine/writing.py",
    ),
    "reading, checks, columns": ("nlosctl/io/measurements/reader.py", "nlosctl/pipeline/engine/parts.py"),
}
"""The stages and the modules that they are known by; the innermost frame of any decides."""


def sampled_shares(words: list[str]) -> tuple[float, Counter[str]]:
    """Return the seconds that a command takes in this process, and the samples by stage."""
    samples: Counter[str] = Counter()

    def sample(_: int, frame: FrameType | None) -> None:
        while frame is not None:
            name = frame.f_code.co_filename
            stage = next((stage for stage, parts in _STAGES.items() if any(part in name for part in parts)), None)
            if stage is not None:
                samples[stage] += 1
                return
            frame = frame.f_back
        samples["else"] += 1

    signal.signal(signal.SIGALRM, sample)
    begin = time.perf_counter()
    signal.setitimer(signal.ITIMER_REAL, _PERIOD_S, _PERIOD_S)
    try:
        code = run(words)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
    if code != 0:
        raise RuntimeError(f"nlosctl {' '.join(words)} ended with {code}")
    return time.perf_counter() - begin, samples


def main() -> None:
    """Print the shares of the fastest of several rounds, after one to warm up."""
    parser = argparse.ArgumentParser()
    parser.add_argument("file", type=Path)
    parser.add_argument("--method", default="ml")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    pyarrow.set_cpu_count(1)
    pyarrow.set_io_thread_count(1)
    with tempfile.TemporaryDirectory() as scratch:
        target = str(Path(scratch) / "estimates.parquet")
        words = ["localize", "-m", arguments.method, str(arguments.file), "-o", target, "--overwrite", "-q"]
        rounds = [sampled_shares([*words, "--jobs", "1"]) for _ in range(arguments.rounds + 1)][1:]
    seconds, samples = min(rounds, key=lambda timed: timed[0])
    print(f"{arguments.method}: {seconds:.3f} s")
    for stage in (*_STAGES, "else"):
        print(f"  {stage}: {samples[stage] / samples.total():.0%}")


if __name__ == "__main__":
    main()
