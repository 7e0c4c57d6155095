"""Paths of walks among four corners against their truth: the table of docs/reliability.md.

    python benchmarks/tracks.py [WALKS]

For each case, over ``WALKS`` (default 60) walks of 60 snapshots, a second apart, with rows spread over .8 s and 10 % of
them missing, q = .05 m2/s3: mean NEES of positions (2 where covariances are right) with its standard error over walks,
share in 95 % ellipses, RMSE, median error, and the median error of the fixes one by one.
"""

from __future__ import annotations

import os
import sys

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

from dataclasses import dataclass

import numpy as np
import pyarrow as pa
import pyarrow.compute

import nlosctl

_STATES, _CHI2_95 = 60, 5.991
_BLOCK, _WHOLE = 1024, 17
"""`simulate` draws blocks of so many snapshots: so many whole walks, and one that is cut short, which is left out."""

_BEARING_STD = np.radians(2.0)


@dataclass(frozen=True)
class Case:
    """Measurements and how they are tracked; ``q`` is the density given to the tracker."""

    name: str
    kind: str = "ranges"
    outliers: float = 0.0
    method: str = "ml"
    q: float = 0.05
    causal: bool = False
    sensors: int = 4


CASES = (
    Case("ranges 1 m"),
    Case("the same, filtered", causal=True),
    Case("bearings 2 deg", kind="bearings"),
    Case("the same, filtered", kind="bearings", causal=True),
    Case("bearings 2 deg, two sensors", kind="bearings", sensors=2),
    Case("ranges, 15 % up to 20 m too long", outliers=0.15),
    Case("the same", outliers=0.15, method="mixture-ml"),
    Case("the same, filtered", outliers=0.15, method="mixture-ml", causal=True),
    Case("40 % too long", outliers=0.4, method="mixture-ml"),
    Case("bearings, 15 % of any direction", kind="bearings", outliers=0.15, method="mixture-ml"),
    Case("ranges 1 m, q 10 times too large", q=0.5),
    Case("ranges 1 m, q 10 times too small", q=0.005),
)


def measured(case: Case, walks: int) -> pa.Table:
    """The measurements of all walks, with their truth."""
    late = case.outliers if case.kind == "ranges" else 0.0
    table = nlosctl.simulate("walk", trials=-(-walks // _WHOLE) * _BLOCK, seed=1, outlier_fraction=late)
    names, of = np.unique(table["walk"].to_numpy(), return_inverse=True)
    first = np.unique(of, return_index=True)[1]
    states = np.bincount(np.unique(np.stack([of, table["snapshot"].to_numpy()]), axis=1)[0])
    whole = [number for number in np.argsort(first) if states[number] == _STATES][:walks]
    table = table.filter(pa.array(np.isin(of, whole)))
    if case.kind == "bearings":
        rng = np.random.default_rng(2)
        away = [table[f"truth_{axis}_m"].to_numpy() - table[f"sensor_{axis}_m"].to_numpy() for axis in "xy"]
        bearing = np.arctan2(away[1], away[0]) + _BEARING_STD * rng.normal(size=table.num_rows)
        other = rng.random(table.num_rows) < case.outliers
        bearing = np.where(other, rng.uniform(-np.pi, np.pi, other.size), bearing)
        table = table.drop_columns(["range_m", "range_std_m", "truth_los"])
        table = table.append_column("bearing_rad", pa.array(bearing))
        table = table.append_column("bearing_std_rad", pa.array(np.full(bearing.size, _BEARING_STD)))
    names = [f"a{number}" for number in range(case.sensors)]
    return table.filter(pa.compute.is_in(table["sensor"], pa.array(names)))


def values(table: pa.Table, *names: str) -> list[np.ndarray]:
    """Columns as numbers, NaN where they are null."""
    return [np.array(table[name].to_pylist(), dtype=float) for name in names]


def figures(case: Case, walks: int) -> str:
    """The case's row of the table."""
    table = measured(case, walks)
    found = nlosctl.track(
        table,
        method=case.method,
        acceleration_psd=case.q,
        by="walk",
        causal=case.causal,
        carry=("truth_x_m", "truth_y_m"),
    ).estimates
    fixes = nlosctl.localize(table, method=case.method, carry=("truth_x_m", "truth_y_m")).estimates
    x, y, xx, xy, yy, u, v = values(
        found, "x_m", "y_m", "cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "truth_x_m", "truth_y_m"
    )
    dx, dy = x - u, y - v
    nees = (yy * dx * dx - 2 * xy * dx * dy + xx * dy * dy) / (xx * yy - xy * xy)
    walk = np.unique(found["walk"].to_numpy(), return_inverse=True)[1]
    known = np.isfinite(nees)
    each = np.bincount(walk[known], nees[known]) / np.bincount(walk[known])
    off, (fx, fy, fu, fv) = np.hypot(dx, dy), values(fixes, "x_m", "y_m", "truth_x_m", "truth_y_m")
    numbers = [
        f"{nees[known].mean():.2f} +- {each.std() / np.sqrt(each.size):.2f}",
        f"{np.mean(nees[known] < _CHI2_95):.3f}",
        f"{np.sqrt(np.mean(off[known] ** 2)):.2f}",
        f"{np.median(off[known]):.2f} / {np.nanmedian(np.hypot(fx - fu, fy - fv)):.2f}",
        f"{known.mean():.3f}",
    ]
    return f"| {case.name} | `{case.method}` | {' | '.join(numbers)} |"


def main() -> None:
    """Print the table."""
    walks = int(sys.argv[1]) if len(sys.argv) > 1 else 60
    print("| rows | method | NEES | in 95 % | RMSE | median path / fix | known |\n|---|---|---|---|---|---|---|")
    for case in CASES:
        print(figures(case, walks), flush=True)


if __name__ == "__main__":
    main()
