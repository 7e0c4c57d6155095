"""Progress within a block of snapshots: loops over thousands of rows report how far they are."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

__all__ = ["ignore_steps", "note_step", "watch_steps"]

_LONG = 500
"""Loops of fewer steps are over before anybody reads a figure."""

_listeners: list[Callable[[float], None]] = []


@contextmanager
def watch_steps(listener: Callable[[float], None]) -> Iterator[None]:
    """Call ``listener`` with the finished share of each long loop while the block runs, in this process."""
    _listeners.append(listener)
    try:
        yield
    finally:
        ignore_steps()


def ignore_steps() -> None:
    """Forget the listener: a forked process must not write to the terminal of its parent."""
    _listeners.clear()


def note_step(step: int, steps: int) -> None:
    """Note that ``step`` of ``steps`` are done."""
    if _listeners and steps >= _LONG and step % 32 == 0:
        _listeners[-1](step / steps)
