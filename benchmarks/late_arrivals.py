"""Late arrivals: what `ok` of `mixture-ml` is worth, and its throughput against a Cauchy loss from the best of a grid.

Prints the table of docs/arrivals.md: ``python benchmarks/late_arrivals.py [SNAPSHOTS]`` (default 4000 for each row).
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.stats import chi2
from timing import best_of

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.statuses import Status
from nlosctl.evaluation.consistency import squared_mahalanobis
from nlosctl.methods import arrivals_mixture_ml

_LOOPED = 100
_GRID = 7
_DESCENTS = 4


@dataclass(frozen=True, kw_only=True)
class World:
    """Sensors on a ring of 500 m, or anywhere in a box of these ``sides_m``; arrivals of 1 to 3 m, some late."""

    name: str
    sensors: int
    share: float
    sides_m: tuple[float, ...] | None = None

    def draw(
        self, snapshots: int, seed: int, *, want_flags: bool = True
    ) -> tuple[ArrivalBatch, np.ndarray, np.ndarray]:
        """Return snapshots, the true positions, and which rows are direct."""
        generator = np.random.default_rng(seed)
        shape = (snapshots, self.sensors)
        if self.sides_m is None:
            turn, angle = (
                2.0 * np.pi * np.arange(self.sensors) / self.sensors,
                generator.uniform(-np.pi, np.pi, snapshots),
            )
            radius = 400.0 * np.sqrt(generator.random(snapshots))
            sensor = np.broadcast_to(500.0 * np.stack([np.cos(turn), np.sin(turn)], axis=1), (*shape, 2))
            source = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
        else:
            sensor = generator.random((*shape, len(self.sides_m))) * self.sides_m
            source = generator.random((snapshots, len(self.sides_m))) * self.sides_m
        std, direct = generator.uniform(1.0, 3.0, shape), generator.random(shape) >= self.share
        arrival = np.linalg.norm(source[:, None] - sensor, axis=2) + std * generator.normal(size=shape)
        arrival += np.where(direct, 0.0, generator.exponential(60.0, shape))
        batch = ArrivalBatch(
            seed=np.arange(snapshots, dtype=np.uint64),
            dimension=source.shape[1],
            sensor=np.asfortranarray(np.tile(np.arange(self.sensors), (snapshots, 1))),
            sensor_xy_m=np.asfortranarray(sensor[..., :2]),
            sensor_z_m=np.asfortranarray(sensor[..., 2]) if source.shape[1] > 2 else None,
            want_flags=want_flags,
            arrival_m=np.asfortranarray(arrival - arrival.min(axis=1)[:, None]),
            arrival_std_m=np.asfortranarray(std),
            origin_m=np.zeros(snapshots),
        )
        return batch, source, direct


WORLDS = (
    World(name="8 on a ring", sensors=8, share=0.25),
    World(name="5 in a square", sensors=5, share=0.25, sides_m=(1000.0, 1000.0)),
    World(name="8 in a square", sensors=8, share=0.25, sides_m=(1000.0, 1000.0)),
    World(name="12 in a square", sensors=12, share=0.25, sides_m=(1000.0, 1000.0)),
    World(name="12 in a square", sensors=12, share=0.0, sides_m=(1000.0, 1000.0)),
    World(name="6 in a box", sensors=6, share=0.2, sides_m=(1000.0, 1000.0, 300.0)),
    World(name="8 in a box", sensors=8, share=0.2, sides_m=(1000.0, 1000.0, 300.0)),
    World(name="10 in a box", sensors=10, share=0.2, sides_m=(1000.0, 1000.0, 300.0)),
)


def measure(world: World, snapshots: int) -> str:
    """Return the cells of a row."""
    batch, source, direct = world.draw(snapshots, seed=1)
    solution = arrivals_mixture_ml.solve(batch, arrivals_mixture_ml.METHOD.options())
    estimates = solution.estimates
    best = estimates.alternative == 0
    status, position = estimates.status[best], estimates.position_m[best]
    ok, fix = status == Status.OK, status <= Status.AMBIGUOUS
    nees = squared_mahalanobis(position[ok] - source[ok], estimates.covariance_m2[best][ok])
    error = np.linalg.norm(position - source, axis=1)
    assert solution.flags is not None
    probability, right = solution.flags.columns["los_probability"][ok].ravel(), direct[ok].ravel()
    bins = np.minimum((10.0 * probability).astype(int), 9)
    gaps = sum(abs(probability[bins == i].sum() - right[bins == i].sum()) for i in range(10)) / right.size
    median, most = np.percentile(error[fix], (50, 95))
    held = np.mean(nees < chi2(source.shape[1]).ppf(0.95))
    return (
        f"{ok.mean():.0%}, {fix.mean():.0%} | {median:.2g}, {most:.2g} m | {held:.3f} | "
        f"{np.mean(nees > 100.0):.2%} | {gaps:.3f}"
    )


def cauchy_loop(batch: ArrivalBatch, snapshots: int, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the fixes of ``least_squares(loss="cauchy")`` with analytic Jacobian, from the best four of a grid."""
    dimension = batch.dimension
    axes = [np.linspace(*ends, _GRID if axis < 2 else 3) for axis, ends in enumerate(zip(low, high, strict=True))]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, dimension)
    fixes = np.empty((snapshots, dimension))
    for row in range(snapshots):
        parts = (
            [batch.sensor_xy_m[row]]
            if batch.sensor_z_m is None
            else [batch.sensor_xy_m[row], batch.sensor_z_m[row, :, None]]
        )
        sensor = np.ascontiguousarray(np.concatenate(parts, axis=1))
        arrival, weight = (
            np.ascontiguousarray(batch.arrival_m[row]),
            1.0 / np.ascontiguousarray(batch.arrival_std_m[row]),
        )

        def residual(state, sensor=sensor, arrival=arrival, weight=weight):
            return (arrival - np.linalg.norm(state[:dimension] - sensor, axis=1) - state[dimension]) * weight

        def jacobian(state, sensor=sensor, weight=weight):
            away = state[:dimension] - sensor
            along = away / np.maximum(np.linalg.norm(away, axis=1), 1e-9)[:, None]
            return -np.concatenate([along, np.ones((len(sensor), 1))], axis=1) * weight[:, None]

        excess = arrival - np.linalg.norm(grid[:, None] - sensor, axis=2)
        offset = np.median(excess, axis=1)
        cost = np.log1p(((excess - offset[:, None]) * weight) ** 2).sum(axis=1)
        starts = [np.append(grid[index], offset[index]) for index in np.argsort(cost)[:_DESCENTS]]
        fits = [least_squares(residual, start, jacobian, loss="cauchy") for start in starts]
        fixes[row] = min(fits, key=lambda fit: fit.cost).x[:dimension]
    return fixes


def throughput(world: World) -> str:
    """Return the cells of a row: microseconds of the loop, times its throughput, quantiles of the errors of both."""
    batch, source, _ = world.draw(4096, seed=2, want_flags=False)
    first, last = np.zeros(source.shape[1]), np.array(world.sides_m or ())
    low, high = (first, last) if world.sides_m else (first - 500.0, first + 500.0)
    found: dict[str, np.ndarray] = {}

    def loop() -> None:
        found["loop"] = cauchy_loop(batch, _LOOPED, low, high)

    def ours(covariance: str) -> None:
        options = arrivals_mixture_ml.METHOD.options(covariance=covariance)
        estimates = arrivals_mixture_ml.solve(batch, options).estimates
        found["ours"] = estimates.position_m[estimates.alternative == 0]

    times = best_of(3, loop, lambda: ours("posterior"), lambda: ours("inliers"))
    each = [times[0] / _LOOPED, times[1] / len(source), times[2] / len(source)]
    loops, mine = (np.linalg.norm(found[name] - source[: len(found[name])], axis=1) for name in ("loop", "ours"))
    quantiles = ["/".join(f"{value:.3g}" for value in np.nanpercentile(part, (50, 90, 95))) for part in (loops, mine)]
    return f"{each[0] * 1e6:.0f} | {each[0] / each[1]:.1f} | {each[0] / each[2]:.1f} | {quantiles[0]} | {quantiles[1]}"


def lines(snapshots: int) -> Iterator[str]:
    """Yield the lines of both tables."""
    yield "| sensors | late | `ok`, fix | errors of fixes: median, 95 % | 95 % hold | NEES > 100 | calibration error |"
    yield "|---|---|---|---|---|---|---|"
    for world in WORLDS:
        yield f"| {world.name} | {world.share:.0%} | {measure(world, snapshots)} |"
    yield ""
    yield "| sensors | loop, us a snapshot | `mixture-ml` times it | `covariance=inliers` | errors of the loop | ours |"
    yield "|---|---|---|---|---|---|"
    for world in (WORLDS[0], WORLDS[-1]):
        yield f"| {world.name} | {throughput(world)} |"


if __name__ == "__main__":
    for line in lines(int(sys.argv[1]) if len(sys.argv) > 1 else 4000):
        print(line, flush=True)
