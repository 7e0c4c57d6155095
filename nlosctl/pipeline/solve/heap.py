"""The heap of the C library, made to keep what is freed."""

from __future__ import annotations

import functools

import numpy as np

__all__ = ["keep_freed_memory"]

_LARGEST_KEPT = (32 << 20) - (64 << 10)
"""Just under the largest size that glibc lets its thresholds grow to."""


@functools.cache
def keep_freed_memory() -> None:
    """Make glibc keep freed memory for the next block of snapshots; elsewhere nothing happens.

    It gives a freed block back to the system when that is larger than any freed before, or when twice that much is free
    at the end of the heap: each block of snapshots would fault its pages in again, which takes a fifth of the time
    of the fast methods. Freeing one large array, whose pages are never touched, raises both thresholds for good.
    """
    np.empty(_LARGEST_KEPT, dtype=np.uint8)
