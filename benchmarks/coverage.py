"""Is a fix with status `ok` worth its covariance? Every method that estimates positions, over random geometry.

Prints the table of docs/reliability.md: ``python benchmarks/coverage.py [SNAPSHOTS]`` (default 2000 for each row), and
the tables of docs/outliers.md on a wrong ``alpha`` and std (``python benchmarks/coverage.py prices``) and on estimated
shares (``python benchmarks/coverage.py shares``; SNAPSHOTS times two rows). It uses the functions of the package alone,
so that another checkout can be measured: ``PYTHONPATH=CHECKOUT python ...``.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pyarrow as pa

import nlosctl

_SQUARE = "-500,500,-500,500"
_ABSURD_NEES = 100.0
_LEVEL_95 = 5.991464547107979
"""The 95 % point of a chi-square of two degrees of freedom."""


@dataclass(frozen=True)
class World:
    """A scenario with its parameters, and the settings of the methods for it: search region and alternatives."""

    name: str
    scenario: str
    parameters: dict[str, Any]
    region: str = _SQUARE
    options: dict[str, Any] = field(default_factory=dict)


def bearings_worlds() -> Iterator[tuple[World, tuple[str, ...]]]:
    """Yield worlds of bearings with the methods to run in each."""
    every = ("ls", "stansfield", "ml", "mixture-ml", "suppress", "sequential")
    robust = ("mixture-ml", "suppress")
    clean = {"mirrors": 0, "bearing_std_deg": (1.0, 1.0)}
    for sensors in (3, 5, 8, 15, 30):
        yield World(f"{sensors} sensors, 1 deg", "random", clean | {"sensors": sensors}), every
    for std_deg in (0.1, 3.0, 10.0):
        yield (
            World(f"8 sensors, {std_deg:g} deg", "random", clean | {"sensors": 8, "bearing_std_deg": (std_deg,) * 2}),
            every,
        )
    mirrored = {"sensors": 8, "mirrors": 3, "reflected_fraction": 0.5, "bearing_std_deg": (0.5, 4.0)}
    yield (
        World("8 sensors, 0.5 to 4 deg, half via mirrors", "random", mirrored),
        ("ml", "mixture-ml", "suppress", "sequential"),
    )
    yield (
        World("6 sensors, 1 deg, direct, mirror and circle", "mixed", {}, "sensors:1"),
        ("ml", "mixture-ml", "suppress", "sequential"),
    )
    yield (
        World("5 sensors, 1 deg, circles", "over-the-horizon", {}, "sensors:1"),
        ("ml", "mixture-ml", "suppress", "sequential"),
    )
    for sensors in (5, 8, 15, 30):
        for share in (0.1, 0.25, 0.4, 0.5):
            world = clean | {"sensors": sensors, "outlier_fraction": share}
            yield (
                World(f"{sensors} sensors, 1 deg, outliers {share:g}", "random", world, options={"alpha": share}),
                robust,
            )
    for sensors in (8, 15):
        for share, alpha in ((0.1, 0.3), (0.25, 0.1), (0.4, 0.1), (0.4, 0.2)):
            world = clean | {"sensors": sensors, "outlier_fraction": share}
            yield (
                World(
                    f"{sensors} sensors, 1 deg, outliers {share:g}, alpha {alpha:g}",
                    "random",
                    world,
                    options={"alpha": alpha},
                ),
                robust,
            )
    for share in (0.1, 0.25):
        world = clean | {"sensors": 8, "bearing_std_deg": (4.0, 4.0), "outlier_fraction": share}
        yield World(f"8 sensors, 4 deg, outliers {share:g}", "random", world, options={"alpha": share}), robust


def measure(world: World, method: str, snapshots: int, std_factor: float = 1.0) -> dict[str, float]:
    """Return share of `ok`, coverage and share of NEES over 100 among `ok`, median error and 95 % point.

    The stds of the input are ``std_factor`` times the true ones.
    """
    table = nlosctl.simulate(world.scenario, trials=snapshots, seed=1, **world.parameters)
    if std_factor != 1.0:
        index = table.column_names.index("bearing_std_rad")
        table = table.set_column(index, "bearing_std_rad", pa.compute.multiply(table["bearing_std_rad"], std_factor))
    options = {"field_of_view_deg": 360.0, **world.options} if method in ("mixture-ml", "suppress") else {}
    estimates = nlosctl.localize(table, method=method, field=world.region, **options).estimates
    estimates = pa.table(estimates)
    first = (
        estimates.filter(pa.compute.equal(estimates["alternative"], 0))
        if "alternative" in estimates.column_names
        else estimates
    )
    ok = np.asarray(first["status"].to_pylist()) == "ok"

    def values(name: str) -> np.ndarray:
        return np.asarray(first[name].cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=float)[ok]

    dx, dy = values("x_m") - values("truth_x_m"), values("y_m") - values("truth_y_m")
    xx, xy, yy = (values(f"cov_{name}_m2") for name in ("xx", "xy", "yy"))
    nees = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    error = np.hypot(dx, dy)
    return {
        "ok": ok.mean(),
        "coverage": np.mean(nees <= _LEVEL_95),
        "absurd": np.mean(~(nees <= _ABSURD_NEES)),
        "median": float(np.median(error)),
        "p95": float(np.quantile(error, 0.95)),
    }


def lines(snapshots: int) -> Iterator[str]:
    """Yield the lines of the table."""
    yield "| world | method | ok | in the 95 % ellipse | NEES > 100 | median error m | 95 % point m |"
    yield "|---|---|---|---|---|---|---|"
    for world, methods in bearings_worlds():
        for method in methods:
            got = measure(world, method, snapshots)
            yield (
                f"| {world.name} | `{method}` | {got['ok']:.1%} | {got['coverage']:.3f} | {got['absurd']:.2%} "
                f"| {got['median']:.3g} | {got['p95']:.3g} |"
            )


def price_lines(snapshots: int) -> Iterator[str]:
    """Yield rows of `ok` share / 95 % point of the error in m / coverage: by ``alpha``, then by factors of the stds."""
    clean = {"sensors": 8, "mirrors": 0, "bearing_std_deg": (2.0, 2.0)}

    def cells(share: float, alpha: float, std_factor: float) -> str:
        options = {"alpha": alpha, "covariance": "posterior"}
        world = World("", "random", clean | {"outlier_fraction": share}, options=options)
        got = measure(world, "mixture-ml", snapshots, std_factor)
        return f"{got['ok']:.2f} / {got['p95']:.0f} / {got['coverage']:.2f}"

    for share in (0.0, 0.1, 0.25, 0.4):
        yield f"| {share:g} | " + " | ".join(cells(share, alpha, 1.0) for alpha in (0.05, 0.1, 0.25, 0.4, 0.5)) + " |"
    for share in (0.1, 0.25):
        yield f"| {share:g} | " + " | ".join(cells(share, 0.25, factor) for factor in (0.25, 0.5, 1.0, 2.0, 4.0)) + " |"


def share_lines(snapshots: int) -> Iterator[str]:
    """Yield rows of shares by ``alpha=estimate``, first with the region given, then with the default region."""
    for share in (0.0, 0.1, 0.25, 0.4, 0.5):
        cells = []
        for sensors in (3, 4, 5, 8, 15):
            world = {"sensors": sensors, "mirrors": 0, "bearing_std_deg": (2.0, 2.0), "outlier_fraction": share}
            table = nlosctl.simulate("random", trials=2 * snapshots // sensors, seed=1, **world)
            true = 1.0 - np.mean(table["truth_los"].to_pylist())
            found = (
                nlosctl.localize(table, method="mixture-ml", alpha="estimate", field=region).report.learned
                for region in (_SQUARE, "sensors:1")
            )
            given, default = (learned["mixture-ml"].values["alpha"] for learned in found)
            cells.append(f"{true:.3f}: {given:.3f} / {default:.3f}")
        yield f"| {share:g} | " + " | ".join(cells) + " |"


if __name__ == "__main__":
    wanted = price_lines if "prices" in sys.argv else share_lines if "shares" in sys.argv else lines
    number = next((int(word) for word in sys.argv[1:] if word.isdigit()), 2000)
    for line in wanted(number):
        print(line, flush=True)
