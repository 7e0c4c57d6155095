"""Freed memory stays with the process, so that the next block of snapshots causes no page faults."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytestmark = pytest.mark.process

ROUNDS = 50
_COUNT_FAULTS = """
import resource
import numpy as np
from nlosctl.pipeline.solve.solve_chunk import keep_freed_memory
{call}

def allocate_and_free_blocks():
    blocks = [np.zeros((8192, 8)) + number for number in range(16)]
    del blocks

def page_faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

allocate_and_free_blocks()
before = page_faults()
for _ in range({rounds}):
    allocate_and_free_blocks()
print(page_faults() - before)
"""


def count_page_faults(call: str) -> int:
    """Return the page faults of all rounds of blocks in a new process, after ``call``."""
    command = [sys.executable, "-c", _COUNT_FAULTS.format(call=call, rounds=ROUNDS)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="the allocator of glibc")
def test_freed_blocks_cause_no_page_faults() -> None:
    """Fifty rounds of blocks cause nearly no page faults after the call; without it, at least one more each round."""
    kept, returned = count_page_faults("keep_freed_memory()"), count_page_faults("")
    assert kept < 200
    assert returned >= kept + ROUNDS
