"""Initial states of a source that moves within a snapshot, from bearings or from ranges."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from nlosctl.arrays import FloatArray, IntArray, Point, ignoring_overflow
from nlosctl.contract.batches import RangeBatch
from nlosctl.geometry.blocks import sum_measurements, sum_products
from nlosctl.geometry.symmetric import SymmetricMatrix
from nlosctl.models.bearings import SightLines
from nlosctl.models.ranges.spheres import range_rows
from nlosctl.models.space.lines import SpaceLines
from nlosctl.solvers.optimization.two_optima import End
from nlosctl.solvers.ranges.optima import optimize_ranges
from nlosctl.solvers.tracking.moving_rows import MovingRows

__all__ = ["bearing_starts", "range_starts", "ray_origins"]

_RANGES_IN_EXTENTS = (0.5, 2.0, 8.0)
"""Ranges of initial positions at the first and at the last bearing, in extents of the array of sensors."""

_NO_RIVAL_NATS = 4.0


def ray_origins(lines: SightLines | SpaceLines) -> Point:
    """Return the origins of rays about the local origin, D arrays (B, K)."""
    return lines.origin if isinstance(lines, SpaceLines) else (lines.origin_x, lines.origin_y)


def bearing_starts(
    lines: SightLines | SpaceLines, moving: MovingRows, measured_m: FloatArray | None
) -> Iterator[Point]:
    """Yield states (B,), NaN where one is missing: the pseudo-linear fit, that through ranges, lines of two ranges.

    The pseudo-linear fit (Nardone, Lindgren, Gong 1984) is biased, never the answer (Dogancay 2005).
    """
    yield _pseudo_linear(lines, moving)
    origin = moving.origin
    direction = lines.directions() if isinstance(lines, SpaceLines) else (lines.cosine, lines.sine)
    if measured_m is not None:
        yield _line_through([own + measured_m * ray for own, ray in zip(origin, direction, strict=True)], moving.share)
    first, last = (np.argmin(sign * moving.share, axis=1) for sign in (1.0, -1.0))
    extent = moving.extent_m
    for near, far in product(_RANGES_IN_EXTENTS, repeat=2):
        ends = [
            [_pick(own, row) + share * extent * _pick(ray, row) for own, ray in zip(origin, direction, strict=True)]
            for row, share in ((first, near), (last, far))
        ]
        yield _through(ends[0], ends[1], _pick(moving.share, first), _pick(moving.share, last))


def range_starts(batch: RangeBatch, moving: MovingRows, center: Point, max_iterations: int) -> Iterator[Point]:
    """Yield states (B,), NaN where one is missing: at rest at the fix and at its image, and between those of two parts.

    The parts are both halves, and the first and the last two thirds, which determine fixes of few rows better.
    """
    order = np.argsort(moving.share, axis=1, kind="stable")
    for end in _range_fixes(batch, center, max_iterations):
        yield (*end.point, *(np.zeros_like(part) for part in end.point))
    sizes = (moving.count // 2, moving.count - moving.count // 3)
    for size in sizes if moving.count > 1 else ():
        parts = [order[:, :size], order[:, -size:]]
        times = [sum_measurements(np.take_along_axis(moving.share, part, axis=1)) / size for part in parts]
        before, after = (_range_fixes(_with_rows(batch, part), center, max_iterations) for part in parts)
        for one, other in product(before, after):
            yield _through(one.point, other.point, times[0], times[1])


def _range_fixes(batch: RangeBatch, center: Point, max_iterations: int) -> tuple[End, End]:
    """Return the two best fixes of the rows of a batch at rest, about other local origins."""
    rows = range_rows(batch)
    ends = optimize_ranges(rows, max_iterations, _NO_RIVAL_NATS)
    best, other = (
        dataclasses.replace(
            end, point=tuple(part - middle for part, middle in zip(rows.absolute(*end.point), center, strict=True))
        )
        for end in ends
    )
    return best, other


def _with_rows(batch: RangeBatch, row: IntArray) -> RangeBatch:
    """Return a batch of the rows (B, C) of each snapshot."""
    changed: dict[str, Any] = {}
    for field in dataclasses.fields(batch):
        array = getattr(batch, field.name)
        if isinstance(array, np.ndarray) and array.ndim > 1:
            index = row.reshape(*row.shape, *[1] * (array.ndim - 2))
            changed[field.name] = np.asfortranarray(np.take_along_axis(array, index, axis=1))
    return dataclasses.replace(batch, **changed)


def _pick(values: FloatArray, row: IntArray) -> FloatArray:
    """Return the values (B,) of one row (B,) of each snapshot."""
    return np.asarray(np.take_along_axis(values, row[:, None], axis=1)[:, 0])


def _through(one: Sequence[FloatArray], other: Sequence[FloatArray], before: FloatArray, after: FloatArray) -> Point:
    """Return the states of sources at two points at two shares of the duration."""
    with ignoring_overflow():
        movement = [(last - first) / (after - before) for first, last in zip(one, other, strict=True)]
        return (*(first - before * move for first, move in zip(one, movement, strict=True)), *movement)


def _line_through(ends: Sequence[FloatArray], share: FloatArray) -> Point:
    """Return the least-squares states of sources that are seen at points (B, K), NaN where they are not."""
    known = np.isfinite(ends[0])
    times = np.where(known, share, 0.0)
    normal = SymmetricMatrix.gram(known.astype(np.float64), times)
    fits = [
        normal.solve(sum_measurements(np.where(known, end, 0.0)), sum_products(times, np.where(known, end, 0.0)))
        for end in ends
    ]
    return (*(at for at, _ in fits), *(move for _, move in fits))


def _pseudo_linear(lines: SightLines | SpaceLines, moving: MovingRows) -> Point:
    """Return the states that miss the lines, or planes, of measured angles by the least weighted squares.

    First all weighted by 1 / std^2, then by the distances of the first fit too.
    """
    parts = lines.std.shape[1] // moving.count
    share = np.tile(moving.share, (1, parts))
    weight = 1.0 / lines.std
    with ignoring_overflow():
        for again in (True, False):
            normals, offset = lines.planes(slice(None), weight)
            columns = (*normals, *(share * part for part in normals))
            fit = SymmetricMatrix.gram(*columns).solve(*(sum_products(part, offset) for part in columns))
            if again:
                weight = 1.0 / (lines.std * np.tile(moving.distance_m(fit), (1, parts)))
    return fit
