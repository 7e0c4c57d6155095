"""How many `ok` fixes of `suppress` are wrong where sensors have several paths in unknown order?

Prints the table of docs/outliers.md: ``python benchmarks/paths.py [SNAPSHOTS]`` (default 1000 for each row).
"""

from __future__ import annotations

import sys

import numpy as np

import nlosctl

_FAR_M = 200.0
_RADIUS_M = 1000.0


def measure(method: str, sensors: int, paths: int, alpha: float, layout: str, snapshots: int) -> tuple[float, ...]:
    """Return the shares of `ok`, of wrong ones among them, and of best positions near the source."""
    table = nlosctl.simulate(
        "madhow-ring",
        trials=snapshots,
        seed=1,
        sensors=sensors,
        paths=paths,
        alpha=alpha,
        layout=layout,
        radius_m=_RADIUS_M,
        sources="disc",
        bearing_std_deg=1.0,
        nlos_span_deg=360.0,
    )
    found = nlosctl.localize(
        table, method=method, field=f"circle:0,0,{_RADIUS_M:g}", alpha=alpha, field_of_view_deg=360.0
    ).estimates
    error = np.hypot(
        *(
            np.asarray(found.column(f"{axis}_m").to_numpy(zero_copy_only=False), dtype=float)
            - np.asarray(found.column(f"truth_{axis}_m").to_numpy(zero_copy_only=False), dtype=float)
            for axis in "xy"
        )
    )
    ok = np.array(found.column("status").to_pylist()) == "ok"
    return ok.mean(), np.mean(error[ok] > _FAR_M), np.mean(error < _FAR_M)


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print("| sensors x paths, alpha | layout | method | ok | of these wrong | best within 200 m |")
    print("|---|---|---|---|---|---|")
    for sensors, paths, alpha in ((4, 2, 0.1), (6, 3, 0.1), (10, 4, 0.25)):
        for layout in ("ring", "random"):
            for method in ("suppress", "mixture-ml"):
                ok, wrong, near = measure(method, sensors, paths, alpha, layout, count)
                world = f"{sensors} x {paths}, {alpha} | {layout}"
                print(f"| {world} | `{method}` | {ok:.2f} | {wrong:.4f} | {near:.3f} |", flush=True)
