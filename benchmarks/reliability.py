"""How often a fix with status `ok` is absurd: far outside its covariance, or far outside the field.

Prints the table of docs/reliability.md: ``python benchmarks/reliability.py [SNAPSHOTS]`` (default 10,000,000; slow
methods, and all worlds except the first, get a part of them).
"""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.fields import BoxField
from nlosctl.contract.results import Estimates
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.methods import bearings_ls, bearings_mixture_ml, bearings_ml, bearings_stansfield

_FIELD_M = 1000.0
_BLOCK = 4096
_ABSURD_NEES = 100.0
_ABSURD_MARGIN_M = 0.5 * _FIELD_M


@dataclass(frozen=True, kw_only=True)
class World:
    """Sensors and a source anywhere in a square field of 1 km, however close; a share of rows points anywhere."""

    sensors: int = 8
    std_deg: tuple[float, float] = (0.05, 1.0)
    outliers: float = 0.0

    def draw(self, generator: np.random.Generator, snapshots: int) -> tuple[BearingBatch, np.ndarray]:
        """Return snapshots of direct bearings and the true positions."""
        shape = (snapshots, self.sensors)
        sensor, source = (generator.uniform(0.0, _FIELD_M, (*size, 2)) for size in (shape, (snapshots,)))
        std = np.radians(np.exp(generator.uniform(*np.log(self.std_deg), shape)))
        offset = source[:, None] - sensor
        bearing = np.arctan2(offset[..., 1], offset[..., 0]) + std * generator.normal(size=shape)
        wrong = generator.random(shape) < self.outliers
        bearing = np.where(wrong, generator.uniform(-np.pi, np.pi, shape), bearing)
        nothing = np.full(shape, -1, order="F")
        batch = BearingBatch(
            seed=np.arange(snapshots, dtype=np.uint64),
            want_flags=False,
            field=BoxField(xmin_m=0.0, xmax_m=_FIELD_M, ymin_m=0.0, ymax_m=_FIELD_M),
            sensor=np.asfortranarray(np.tile(np.arange(self.sensors), (snapshots, 1))),
            sensor_xy_m=np.asfortranarray(sensor),
            bearing_rad=np.asfortranarray(bearing),
            bearing_std_rad=np.asfortranarray(std),
            path=nothing,
            reflector=nothing,
        )
        return batch, source


@dataclass(frozen=True)
class Tally:
    """Of so many snapshots: ok ones, those of NEES over 100, those half a field outside it, and the sum of all NEES."""

    snapshots: int = 0
    answered: int = 0
    absurd: int = 0
    outside: int = 0
    nees: float = 0.0

    def add(self, estimates: Estimates, source: np.ndarray) -> Tally:
        """Return the tally with a batch more."""
        best = np.flatnonzero(estimates.alternative == 0)
        best = best[estimates.status[best] == Status.OK]
        position = estimates.position_m[best]
        nees = squared_mahalanobis(position - source[estimates.row[best]], estimates.covariance_m2[best])
        outside = (np.abs(position - 0.5 * _FIELD_M) > 0.5 * _FIELD_M + _ABSURD_MARGIN_M).any(axis=1)
        return Tally(
            self.snapshots + source.shape[0],
            self.answered + best.size,
            self.absurd + int(np.count_nonzero(~(nees <= _ABSURD_NEES))),
            self.outside + int(np.count_nonzero(outside)),
            self.nees + float(np.nansum(nees)),
        )


def tally(world: World, module: ModuleType, options: object, snapshots: int, seed: int) -> Tally:
    """Return the tally of a method over at least so many snapshots of a world."""
    generator, total = np.random.default_rng(seed), Tally()
    while total.snapshots < snapshots:
        batch, source = world.draw(generator, _BLOCK)
        total = total.add(module.solve(batch, options).estimates, source)
    return total


def _lines(snapshots: int) -> list[str]:
    fine = World()
    worlds = {
        "8 sensors, .05-1 deg": (fine, 1),
        "8 sensors, 1-8 deg": (replace(fine, std_deg=(1.0, 8.0)), 10),
        "4 sensors, 1-8 deg": (replace(fine, sensors=4, std_deg=(1.0, 8.0)), 10),
        "3 sensors, .05-1 deg": (replace(fine, sensors=3), 10),
        "8 sensors, .05-1 deg, 10 % of the rows random": (replace(fine, outliers=0.1), 20),
        "8 sensors, .05-1 deg, 25 % of the rows random": (replace(fine, outliers=0.25), 20),
    }
    full_circle = bearings_mixture_ml.METHOD.options(field_of_view_deg=360.0)
    trusting = [(module, module.METHOD.options(), 10) for module in (bearings_stansfield, bearings_ls)]
    likely = (bearings_ml, bearings_ml.METHOD.options(), 1)
    robust = (bearings_mixture_ml, full_circle, 10)
    calibrated = (bearings_mixture_ml, replace(full_circle, covariance="posterior"), 50)
    lines = [
        "| world | method | snapshots | ok | mean NEES | NEES > 100, a million | outside the field, a million |",
        "|---|---|---|---|---|---|---|",
    ]
    for name, (world, fewer) in worlds.items():
        methods = [likely, robust, calibrated] if world.outliers else [likely, *trusting, robust]
        for module, options, slower in methods:
            found = tally(world, module, options, snapshots // fewer // slower, seed=1)
            posterior = getattr(options, "covariance", "") == "posterior"
            label = f"`{module.METHOD.name}`" + (" (`covariance=posterior`)" if posterior else "")
            million, nees = 1e6 / max(found.answered, 1), found.nees / max(found.answered, 1)
            lines.append(
                f"| {name} | {label} | {found.snapshots:,} | {found.answered / found.snapshots:.3%} "
                f"| {nees:{'.2f' if nees < 1000.0 else '.1g'}} | {found.absurd * million:.2f} "
                f"| {found.outside * million:.2f} |"
            )
    return lines


if __name__ == "__main__":
    print("\n".join(_lines(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000_000)))
