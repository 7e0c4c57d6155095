"""Several sources by bearings: how often `identify-los` finds them exactly, over four worlds of ``bearing-field``.

    python benchmarks/several_sources.py [SNAPSHOTS]

Prints the table of docs/reliability.md, for ``SNAPSHOTS`` (default 1000) snapshots of each world, seed 1.
"""

from __future__ import annotations

import os
import sys

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import nlosctl

_WORLDS: dict[str, dict[str, float]] = {
    "6 sensors, 1 deg, 3 sources": {},
    "6 sensors, 1 deg, 0 to 4 sources, clutter 1, P_D .9": {
        "targets": 4,
        "least_targets": 0,
        "false_bearings": 1.0,
        "detection_probability": 0.9,
    },
    "4 sensors, .5 deg, 1 to 3 sources, clutter .5": {
        "sensors": 4,
        "least_targets": 1,
        "angle_std_deg": 0.5,
        "false_bearings": 0.5,
    },
    "8 sensors, 1 deg, 5 sources, clutter .5, P_D .95": {
        "sensors": 8,
        "targets": 5,
        "false_bearings": 0.5,
        "detection_probability": 0.95,
    },
    "in space: 6 sensors, 1 deg, 0 to 4 sources, clutter 1, P_D .9": {
        "dimensions": 3,
        "targets": 4,
        "least_targets": 0,
        "false_bearings": 1.0,
        "detection_probability": 0.9,
    },
}
_HEAD = ("world", "exact", "number right", "precision", "recall", "GOSPA", "OSPA")


def main() -> None:
    """Draw, identify and score each world."""
    snapshots = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    print(f"| {' | '.join(_HEAD)} |\n|{'---|' * len(_HEAD)}")
    for world, parameters in _WORLDS.items():
        drawn = nlosctl.simulate("bearing-field", trials=snapshots, seed=1, **parameters)
        found = nlosctl.identify_los(drawn)
        scores = nlosctl.evaluate(found.flags, estimates=found.estimates, ospa_cutoff_m=50.0).overall
        shares = [f"{scores[name]:.3f}" for name in ("exact", "number_right", "los_precision", "los_recall")]
        metres = [f"{scores[name]:.2f} m" for name in ("gospa_m", "ospa_m")]
        print(f"| {' | '.join([world, *shares, *metres])} |", flush=True)


if __name__ == "__main__":
    main()
