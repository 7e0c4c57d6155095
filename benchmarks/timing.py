"""Timing two programs in turn, so that a ratio holds when the machine's speed drifts."""

from __future__ import annotations

import time
from collections.abc import Callable

from nlosctl.pipeline.solve.solve_chunk import keep_freed_memory

keep_freed_memory()  # as the command does before its first block; all that is timed in this process has it


def best_of(runs: int, *programs: Callable[[], object]) -> list[float]:
    """Return the best time in seconds of each program over ``runs`` rounds, after one round to warm up."""
    best = [float("inf")] * len(programs)
    for round_number in range(runs + 1):
        for place, program in enumerate(programs):
            start = time.perf_counter()
            program()
            if round_number:
                best[place] = min(best[place], time.perf_counter() - start)
    return best
