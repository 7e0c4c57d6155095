"""What is wrong with which rows of a batch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from nlosctl.contract.batches import BoolArray

__all__ = ["Describe", "Fault"]

Describe = Callable[[int], str]
"""Says what is wrong with a row."""


@dataclass(frozen=True, kw_only=True)
class Fault:
    """Rows of a batch at fault in one column: ``mask`` (N,), and what to say of a row."""

    mask: BoolArray
    column: str
    describe: Describe
