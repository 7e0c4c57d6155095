"""How often a fix from ranges with status `ok` is absurd, and what its ellipse holds.

Prints the table of docs/reliability.md: ``python benchmarks/ranges.py [SNAPSHOTS]`` (default 100,000 for each row). It
uses the methods alone, so that another checkout can be measured: ``PYTHONPATH=CHECKOUT python ...``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from nlosctl.contract.batches import BearingBatch, RangeBatch
from nlosctl.contract.methods import MethodSpec
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.methods import bearings_ml, ranges_r_ls, ranges_sr_ls

_BLOCK = 4096
_ABSURD_NEES = 100.0
_LEVEL_95 = 5.991464547107979
"""The 95 % point of a chi-square of two degrees of freedom."""


@dataclass(frozen=True, kw_only=True)
class World:
    """Sensors anywhere in a square, a source in it or up to ``outside_m`` beyond; log-uniform stds of ranges.

    ``height_m`` are the limits of the sensors' heights, ``bearing_std_deg`` is None without bearings.
    """

    name: str
    sensors: int
    size_m: float
    std_m: tuple[float, float]
    outside_m: float = 0.0
    height_m: tuple[float, float] = (0.0, 0.0)
    bearing_std_deg: float | None = None

    def draw(self, generator: np.random.Generator, snapshots: int) -> tuple[BearingBatch | RangeBatch, np.ndarray]:
        """Return snapshots and the true positions."""
        shape = (snapshots, self.sensors)
        sensor = generator.uniform(0.0, self.size_m, (*shape, 2))
        source = generator.uniform(-self.outside_m, self.size_m + self.outside_m, (snapshots, 2))
        std = np.exp(generator.uniform(*np.log(self.std_m), shape))
        height = generator.uniform(*self.height_m, shape)
        away = source[:, None] - sensor
        range_m = np.hypot(np.hypot(away[..., 0], away[..., 1]), height) + std * generator.normal(size=shape)
        shared = {
            "seed": np.arange(snapshots, dtype=np.uint64),
            "want_flags": False,
            "sensor": np.asfortranarray(np.tile(np.arange(self.sensors), (snapshots, 1))),
            "sensor_xy_m": np.asfortranarray(sensor),
            "path": np.full(shape, -1, order="F"),
            "range_m": np.asfortranarray(np.maximum(range_m, 1e-3)),
            "range_std_m": np.asfortranarray(std),
        }
        if self.bearing_std_deg is None:
            return RangeBatch(sensor_height_m=np.asfortranarray(height), **shared), source
        bearing_std = np.radians(self.bearing_std_deg)
        bearing = np.arctan2(away[..., 1], away[..., 0]) + bearing_std * generator.normal(size=shape)
        batch = BearingBatch(
            bearing_rad=np.asfortranarray(np.angle(np.exp(1j * bearing))),
            bearing_std_rad=np.full(shape, bearing_std, order="F"),
            reflector=shared["path"],
            **shared,
        )
        return batch, source


def worlds() -> Iterator[tuple[World, tuple[MethodSpec, ...]]]:
    """Yield worlds with the methods to run in each."""
    both, wide = (ranges_r_ls.ML, ranges_sr_ls.METHOD), {"size_m": 1000.0, "outside_m": 500.0}
    for sensors in (3, 4, 6, 8):
        name = f"{sensors} sensors, 1 km, .1-10 m, source up to 500 m outside"
        yield World(name=name, sensors=sensors, std_m=(0.1, 10.0), **wide), both
    for sensors in (3, 4):
        name = f"{sensors} anchors, 20 m room, .05-.3 m"
        yield World(name=name, sensors=sensors, size_m=20.0, std_m=(0.05, 0.3)), both
    name = "3 sensors 14-29 m up, 20 m room, .3 m"
    yield World(name=name, sensors=3, size_m=20.0, std_m=(0.3, 0.3), height_m=(14.0, 29.0)), both
    for sensors in (3, 5):
        name = f"{sensors} sensors, 1 km, 10-100 m, source up to 500 m outside"
        yield World(name=name, sensors=sensors, std_m=(10.0, 100.0), **wide), both
    for bearing_std_deg, std_m in ((15.0, 1.0), (40.0, 0.1)):
        name = f"3 sensors, 1 km, {std_m:g} m, with bearings of {bearing_std_deg:g} deg"
        world = World(name=name, sensors=3, size_m=1000.0, std_m=(std_m, std_m), bearing_std_deg=bearing_std_deg)
        yield world, (bearings_ml.METHOD,)


def measure(world: World, method: MethodSpec, snapshots: int) -> str:
    """Return the cells of a row: share of `ok`; among them NEES over 100 a million, its mean, share in the ellipse."""
    generator = np.random.default_rng(1)
    answered, values = 0, []
    blocks = -(-snapshots // _BLOCK)
    for _ in range(blocks):
        batch, source = world.draw(generator, _BLOCK)
        estimates = method.solve(batch, method.options()).estimates
        ok = np.flatnonzero((estimates.alternative == 0) & (estimates.status == Status.OK))
        answered += ok.size
        error = estimates.position_m[ok] - source[estimates.row[ok]]
        values.append(squared_mahalanobis(error, estimates.covariance_m2[ok]))
    nees = np.concatenate(values)
    absurd = 1e6 * np.count_nonzero(~(nees <= _ABSURD_NEES)) / (blocks * _BLOCK)
    share = answered / (blocks * _BLOCK)
    return f"{share:.2%} | {absurd:.0f} | {nees.mean():.3g} | {np.mean(nees <= _LEVEL_95):.1%}"


def lines(snapshots: int) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| world | method | ok | NEES > 100, a million | mean NEES | 95 % ellipse holds |"
    yield "|---|---|---|---|---|---|"
    for world, methods in worlds():
        for method in methods:
            yield f"| {world.name} | `{method.name}` | {measure(world, method, snapshots)} |"


if __name__ == "__main__":
    for line in lines(int(sys.argv[1]) if len(sys.argv) > 1 else 100_000):
        print(line, flush=True)
