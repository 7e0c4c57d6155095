"""Identifying targets among echoes: time against the circles of a sensor, K (1 + L), for 4 to 8 sensors.

    python benchmarks/echoes.py

Writes benchmarks/echoes.md and draws benchmarks/echoes.svg. One thread; the scene of Liang, Zeng, Li at 0 dB, K = L.
"""

from __future__ import annotations

import os
import resource
from pathlib import Path

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import numpy as np
from timing import best_of

from nlosctl.contract.batches import RangeBatch
from nlosctl.contract.fields import BoxField
from nlosctl.methods import ranges_assignment, ranges_extended_tca
from nlosctl.scenarios import liang

_SENSORS = range(4, 9)
_TARGETS = range(1, 6)
_SNAPSHOTS = 40
_FIELD = BoxField(xmin_m=-200.0, xmax_m=200.0, ymin_m=-200.0, ymax_m=200.0)
_COLORS = ("#1b9e77", "#d95f02", "#7570b3", "#e7298a", "#66a61e")


def make_batch(sensors: int, targets: int) -> RangeBatch:
    """Return snapshots of that many targets and as many scatterers."""
    options = liang.LiangOptions(sensors=sensors, targets=targets, scatterers=targets)
    columns = liang.generate(options, np.random.default_rng(1), _SNAPSHOTS)

    def dense(values: np.ndarray) -> np.ndarray:
        return np.asfortranarray(values.reshape(_SNAPSHOTS, -1))

    number = np.unique(columns["sensor"].astype(str), return_inverse=True)[1]
    return RangeBatch(
        seed=np.zeros(_SNAPSHOTS, dtype=np.uint64),
        field=_FIELD,
        sensor=dense(number),
        sensor_xy_m=np.stack([dense(columns["sensor_x_m"]), dense(columns["sensor_y_m"])], axis=-1),
        range_m=dense(columns["range_m"]),
        range_std_m=dense(columns["range_std_m"]),
        path=dense(np.full(number.shape, -1)),
        sensor_height_m=dense(np.zeros(number.shape)),
    )


def measure() -> dict[str, dict[int, list[float]]]:
    """Return milliseconds a snapshot by method and number of sensors, for K = L = 1 to 5."""
    tca, assignment = ranges_extended_tca.METHOD, ranges_assignment.METHOD
    runs = {"extended-tca": (tca, tca.options(eta=35.0)), "assignment": (assignment, assignment.options())}
    times: dict[str, dict[int, list[float]]] = {name: {} for name in runs}
    for sensors in _SENSORS:
        batches = [make_batch(sensors, targets) for targets in _TARGETS]
        for name, (method, options) in runs.items():
            programs = [lambda b=batch, m=method, o=options: m.solve(b, o) for batch in batches]
            times[name][sensors] = [1e3 * seconds / _SNAPSHOTS for seconds in best_of(3, *programs)]
    return times


def growth(times: dict[int, list[float]]) -> tuple[float, float]:
    """Return the exponents of M = K (1 + L) and N between the two largest of each."""
    circles = [k * (1 + k) for k in _TARGETS]
    largest = times[max(_SENSORS)]
    by_circles = np.log(largest[-1] / largest[-2]) / np.log(circles[-1] / circles[-2])
    by_sensors = np.log(largest[-1] / times[max(_SENSORS) - 2][-1]) / np.log(max(_SENSORS) / (max(_SENSORS) - 2))
    return float(by_circles), float(by_sensors)


def report(times: dict[str, dict[int, list[float]]]) -> str:
    """Return the tables as Markdown."""
    circles = [k * (1 + k) for k in _TARGETS]
    lines = [
        "# Targets among echoes",
        "",
        "Milliseconds per snapshot, one thread, K = L; M = K (1 + L) circles per sensor.",
    ]
    for name, by_sensors in times.items():
        lines += ["", f"## `{name}`", "", "| N | " + " | ".join(f"M = {m}" for m in circles) + " |"]
        lines += ["|--" * (len(circles) + 1) + "|"]
        lines += [f"| {n} | " + " | ".join(f"{t:.2f}" for t in row) + " |" for n, row in by_sensors.items()]
        by_circles, by_number = growth(by_sensors)
        lines += ["", f"Growth at the upper end: M^{by_circles:.1f}, N^{by_number:.1f} (the search is O(N^3 M^3))."]
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    lines += [
        "",
        f"Peak memory of the process, up to N = 8 and K = L = 5: {memory:.0f} MB.",
        "",
        "![times](echoes.svg)",
    ]
    return "\n".join(lines) + "\n"


def draw(times: dict[str, dict[int, list[float]]]) -> str:
    """Return a picture of the times, both axes logarithmic, with a line of slope 3 for comparison."""
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" width="860" height="400" font-family="sans-serif" font-size="12">'
    ]
    parts.append('<rect width="860" height="400" fill="white"/>')
    for panel, (name, by_sensors) in enumerate(times.items()):
        left = 60 + 420 * panel
        parts += _panel(left, name, by_sensors)
    return "\n".join([*parts, "</svg>"]) + "\n"


def _panel(left: int, name: str, by_sensors: dict[int, list[float]]) -> list[str]:
    circles = [k * (1 + k) for k in _TARGETS]

    def point(m: float, ms: float) -> str:
        x = left + 340 * (np.log(m) - np.log(2)) / (np.log(30) - np.log(2))
        y = 350 - 310 * (np.log10(ms) + 1.0) / 3.5
        return f"{x:.1f},{y:.1f}"

    parts = [f'<text x="{left}" y="24" font-weight="bold">{name}: ms a snapshot against M = K (1 + L)</text>']
    parts.append(f'<rect x="{left}" y="40" width="340" height="310" fill="none" stroke="#888"/>')
    for m in circles:
        x = point(m, 0.1).split(",")[0]
        parts.append(f'<text x="{x}" y="368" text-anchor="middle">{m}</text>')
    for ms in (0.1, 1.0, 10.0, 100.0):
        y = point(2, ms).split(",")[1]
        parts.append(f'<text x="{left - 6}" y="{y}" text-anchor="end">{ms:g}</text>')
    for color, (n, row) in zip(_COLORS, by_sensors.items(), strict=True):
        line = " ".join(point(m, ms) for m, ms in zip(circles, row, strict=True))
        end_x, end_y = point(circles[-1], row[-1]).split(",")
        parts.append(f'<polyline points="{line}" fill="none" stroke="{color}" stroke-width="2"/>')
        parts.append(f'<text x="{float(end_x) + 4:.1f}" y="{end_y}" fill="{color}">N={n}</text>')
    cubic = f"{point(8, 0.5)} {point(30, 0.5 * (30 / 8) ** 3)}"
    parts.append(f'<polyline points="{cubic}" fill="none" stroke="#888" stroke-dasharray="5 4"/>')
    end_x, end_y = point(30, 0.5 * (30 / 8) ** 3).split(",")
    parts.append(f'<text x="{float(end_x) - 60:.1f}" y="{float(end_y) + 26:.1f}" fill="#888">M^3</text>')
    return parts


def main() -> None:
    """Measure, write and draw."""
    times = measure()
    folder = Path(__file__).parent
    (folder / "echoes.md").write_text(report(times), encoding="utf-8")
    (folder / "echoes.svg").write_text(draw(times), encoding="utf-8")
    print(report(times))


if __name__ == "__main__":
    main()
