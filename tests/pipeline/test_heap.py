"""Freed memory stays with the process, so that blocks of snapshots don't fault their pages in again."""

from __future__ import annotations

import subprocess
import sys

import pytest

_COUNT_FAULTS = """
import resource
import numpy as np
from nlosctl.pipeline.solve.heap import keep_freed_memory
{call}

def use():
    blocks = [np.zeros((8192, 8)) + number for number in range(16)]
    del blocks

def faults():
    return resource.getrusage(resource.RUSAGE_SELF).ru_minflt

use()
before = faults()
for _ in range(50):
    use()
print(faults() - before)
"""


def _faults(call: str) -> int:
    command = [sys.executable, "-c", _COUNT_FAULTS.format(call=call)]
    return int(subprocess.run(command, check=True, capture_output=True, text=True).stdout)


@pytest.mark.skipif(sys.platform != "linux", reason="tells of glibc")
def test_freed_blocks_are_not_faulted_in_again():
    """Fifty rounds of blocks cost no page faults, and without the call no fewer."""
    kept = _faults("keep_freed_memory()")
    assert kept < 200
    assert kept <= _faults("")
