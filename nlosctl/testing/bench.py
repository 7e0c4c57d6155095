"""The bench on which a method is tried: it draws batches and runs the method on copies of them."""

from __future__ import annotations

import dataclasses
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Solution
from nlosctl.testing.draws import Draw, Trial
from nlosctl.testing.moves import copy_batch, replace_rows

__all__ = ["Bench", "LawBroken"]


class LawBroken(AssertionError):  # noqa: N818 (it reads "a law broken", as a test's assertion does)
    """A method broke a law; ``method`` and ``law`` are their names, ``complaint`` the violation."""

    def __init__(self, method: str, law: str, rule: str, complaint: str) -> None:
        super().__init__(f"{method} breaks the law '{law}' ({rule}): {complaint}")
        self.method = method
        self.law = law
        self.complaint = complaint


@dataclass(frozen=True, kw_only=True)
class Bench:
    """A method with its options, and what draws batches for it."""

    spec: MethodSpec
    options: Any
    draw: Draw
    generator: np.random.Generator

    @property
    def usual_measurements(self) -> tuple[int, ...]:
        """Numbers of measurements to try: the least, one more, and plenty."""
        least = max(1, self.spec.minimum_measurements)
        return (least, least + 1, max(8, least + 2))

    @property
    def plenty(self) -> int:
        """A number of measurements with which any method should do well."""
        return self.usual_measurements[-1]

    def ordinary(self, snapshots: int, measurements: int) -> Trial:
        """Draw a batch of ordinary snapshots."""
        return self.draw.trial(self.generator, snapshots, measurements, None)

    def mixed(self, snapshots: int, measurements: int) -> Any:
        """Draw a batch that has, among ordinary snapshots, one of each fault."""
        batch = self.ordinary(snapshots, measurements).batch
        for number, fault in enumerate(self.draw.faults):
            faulty = self.draw.trial(self.generator, 1, measurements, fault).batch
            batch = replace_rows(batch, np.array([number * snapshots // len(self.draw.faults)]), faulty)
        return batch

    def solve(self, batch: Any, *, want_flags: bool = True) -> Solution:
        """Run the method on a copy of a batch, without its warnings."""
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            copied = copy_batch(dataclasses.replace(batch, want_flags=want_flags), writeable=True)
            return self.spec.solve(copied, self.options)
