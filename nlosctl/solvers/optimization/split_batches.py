"""A batch solved in two parts: snapshots whose sensors have several paths, and the others."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from nlosctl.arrays import BoolArray, IntArray
from nlosctl.contract.batches import Batch
from nlosctl.contract.results import Estimates, Flags, Solution

__all__ = ["solve_parts", "split_batch", "take_snapshots"]

BatchT = TypeVar("BatchT", bound=Batch)


def solve_parts(batch: BatchT, chosen: BoolArray, solve: Callable[[BatchT], Solution]) -> Solution:
    """Return the solution of a batch whose ``chosen`` (B,) snapshots and whose others are solved apart.

    So a kernel may treat the two differently, and a snapshot's bits still don't depend on its company.
    """
    parts = split_batch(batch, chosen)
    if len(parts) == 1:
        return solve(batch)
    rows = [indices for indices, _ in parts]
    solutions = [solve(part) for _, part in parts]
    index = np.concatenate([part[solution.estimates.row] for part, solution in zip(rows, solutions, strict=True)])
    order = np.argsort(index, kind="stable")
    joined: dict[str, Any] = {}
    for field in dataclasses.fields(Estimates):
        values = [getattr(solution.estimates, field.name) for solution in solutions]
        joined[field.name] = np.concatenate(values)[order] if isinstance(values[0], np.ndarray) else values[0]
    joined["row"] = index[order]
    flags = None
    if solutions[0].flags is not None and solutions[1].flags is not None:
        both = (solutions[0].flags, solutions[1].flags)
        flags = Flags(
            used=_scatter(rows, [part.used for part in both]),
            columns={
                name: _scatter(rows, [np.asarray(part.columns[name]) for part in both]) for name in both[0].columns
            },
        )
    return Solution(estimates=Estimates(**joined), flags=flags)


def split_batch(batch: BatchT, chosen: BoolArray) -> list[tuple[IntArray, BatchT]]:
    """Return the snapshots that are not ``chosen`` (B,) and those that are, with their indices, if there are any."""
    if chosen.all() or not chosen.any():
        return [(np.arange(chosen.shape[0]), batch)]
    return [(rows, take_snapshots(batch, rows)) for rows in (np.flatnonzero(~chosen), np.flatnonzero(chosen))]


def take_snapshots(batch: BatchT, rows: IntArray) -> BatchT:
    """Return the given snapshots of a batch, in any order and with repetitions."""
    changed: dict[str, Any] = {}
    for field in dataclasses.fields(batch):
        array = getattr(batch, field.name)
        if isinstance(array, np.ndarray):
            changed[field.name] = np.asfortranarray(array[rows])
    return dataclasses.replace(batch, **changed)


def _scatter(rows: list[IntArray], parts: list[npt.NDArray[Any]]) -> npt.NDArray[Any]:
    whole = np.empty((sum(part.shape[0] for part in rows), *parts[0].shape[1:]), dtype=parts[0].dtype)
    for index, part in zip(rows, parts, strict=True):
        whole[index] = part
    return whole
