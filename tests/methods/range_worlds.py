"""Simulated ranges with their truth, for the tests of methods."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from batches import range_batch

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import BoxField, Field
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.results import Solution
from nlosctl.contract.statuses import Status
from nlosctl.models.ranges.predictions import predict_ranges

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

PAPER_FIELD = BoxField(xmin_m=-200.0, xmax_m=200.0, ymin_m=-200.0, ymax_m=200.0)


def exact_ranges(sensor_xy: Any, point: Any, height: float = 0.0) -> FloatArray:
    """Return the ranges (1, K) of a point from sensors (K, 2)."""
    sensors = np.asarray(sensor_xy, dtype=float)
    return predict_ranges(sensors, np.full(sensors.shape[0], height), np.asarray(point, dtype=float))[None]


def words(solution: Solution) -> list[str]:
    """Return the status words of the estimates."""
    return [Status(int(status)).word for status in solution.estimates.status]


def solve(method: MethodSpec, batch: RangeBatch, **options: Any) -> Solution:
    """Return the solution of a method with some options."""
    return method.solve(batch, method.options(**options))


@dataclass(frozen=True, kw_only=True)
class EchoWorld:
    """One snapshot of unlabelled echoes: its batch, the targets (T, 2), and each row's target or -1."""

    batch: RangeBatch
    targets: FloatArray
    label: IntArray

    def truth_sets(self) -> set[frozenset[int]]:
        """Return the rows of each target's direct echoes."""
        return {frozenset(np.flatnonzero(self.label == k).tolist()) for k in range(self.targets.shape[0])}


def found_sets(solution: Solution) -> set[frozenset[int]]:
    """Return the rows assigned to each target of a batch of one snapshot."""
    assert solution.flags is not None
    target = solution.flags.columns["target"][0]
    return {frozenset(np.flatnonzero(target == number).tolist()) for number in set(target[np.isfinite(target)])}


def echo_world(
    generator: np.random.Generator,
    sensors: FloatArray,
    targets: FloatArray,
    scatterers: FloatArray,
    std_m: float,
    field: Field,
    missed: tuple[tuple[int, int], ...] = (),
) -> EchoWorld:
    """Return the echoes of signal model (1), rows shuffled; ``missed`` (sensor, target) have no direct echo."""
    rows: list[tuple[int, float, int]] = []
    for n, sensor in enumerate(sensors):
        for k, target in enumerate(targets):
            direct = float(np.hypot(*(target - sensor)))
            if (n, k) not in missed:
                rows.append((n, direct, k))
            for scatterer in scatterers:
                detour = float(np.hypot(*(target - scatterer)) + np.hypot(*(scatterer - sensor)))
                rows.append((n, direct + detour, -1))
    order = generator.permutation(len(rows))
    number = np.array([rows[i][0] for i in order])
    ranges = np.array([rows[i][1] for i in order]) + std_m * generator.normal(size=len(rows))
    batch = range_batch(sensors[number][None], np.abs(ranges)[None], std_m, sensor=number[None], field=field)
    return EchoWorld(batch=batch, targets=targets, label=np.array([rows[i][2] for i in order]))


def paper_world(generator: np.random.Generator, sensors: int, std_m: float, scatterers: FloatArray) -> EchoWorld:
    """Return a trial of the paper's scene: sensors on a circle of 160 m, three targets in the 400 m square."""
    angle = 2.0 * np.pi * np.arange(sensors) / sensors
    places = 160.0 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    targets = generator.uniform(-200.0, 200.0, (3, 2))
    return echo_world(generator, places, targets, scatterers, std_m, PAPER_FIELD)


def perimeter(generator: np.random.Generator, count: int) -> FloatArray:
    """Return points uniform on the edge of the paper's square."""
    side, along = generator.integers(0, 4, count), generator.uniform(-200.0, 200.0, count)
    corners = {0: (along, np.full(count, -200.0)), 1: (np.full(count, 200.0), along)}
    corners |= {2: (along, np.full(count, 200.0)), 3: (np.full(count, -200.0), along)}
    return np.array([[corners[s][0][i], corners[s][1][i]] for i, s in enumerate(side)])


def irregular_world(generator: np.random.Generator, std_m: float = 0.3) -> EchoWorld:
    """Return a trial of an irregular layout: 4 to 7 sensors, 1 to 5 targets, 2 to 5 scatterers in 1000 x 600 m."""
    size = np.array([1000.0, 600.0])
    counts = [int(generator.integers(*span)) for span in ((4, 8), (1, 6), (2, 6))]
    sensors, targets, scatterers = (generator.uniform(0.0, 1.0, (count, 2)) * size for count in counts)
    field = BoxField(xmin_m=0.0, xmax_m=1000.0, ymin_m=0.0, ymax_m=600.0)
    return echo_world(generator, sensors, targets, scatterers, std_m, field)


def join_batches(batches: list[RangeBatch]) -> RangeBatch:
    """Return one batch of snapshots that have the same number of rows and the same field."""
    names = ("seed", "sensor", "sensor_xy_m", "range_m", "range_std_m", "path", "sensor_height_m")
    joined = {name: np.asfortranarray(np.concatenate([getattr(one, name) for one in batches])) for name in names}
    return RangeBatch(field=batches[0].field, **joined)
