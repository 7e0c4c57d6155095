"""Fixes in space that are ok and absurd: `mixture-ml` on many draws of the eight-sensor scene.

    python benchmarks/space_draws.py [DRAWS] [OUTLIER_SHARE] [STD_DEG ...]

Sensors on a ring of 500 m at heights of 0 to 60 m, sources within 300 m and up to 200 m high, standard deviations of
half to twice STD_DEG, a share of the rows anywhere. A fix is absurd if it is ok and its normalized squared error is
above 100. One line for each standard deviation: the share of ok fixes, the number of absurd ones, the 95 % coverage and
the mean normalized squared error.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "support"))

from space_worlds import dense_covariance, ring_world

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_mixture_ml

_BLOCK = 8192
_ABSURD = 100.0
_CHI_SQUARE_95 = 7.815


def draw(generator: np.random.Generator, size: int, std_deg: float, share: float) -> tuple[BearingBatch, np.ndarray]:
    """Return snapshots with a share of outliers, and their sources."""
    batch, source = ring_world(generator, size, std_deg)
    bad = generator.random(batch.bearing_rad.shape) < share
    azimuth = np.where(bad, generator.uniform(-np.pi, np.pi, bad.shape), batch.bearing_rad)
    elevation = np.where(bad, generator.uniform(-0.5 * np.pi, 0.5 * np.pi, bad.shape), batch.elevation_rad)
    angles = {"bearing_rad": np.asfortranarray(azimuth), "elevation_rad": np.asfortranarray(elevation)}
    return replace(batch, want_flags=False, **angles), source


def squared_errors(batch: BearingBatch, source: np.ndarray) -> np.ndarray:
    """Return the normalized squared errors of the ok fixes of a block."""
    estimates = bearings_mixture_ml.solve(batch, bearings_mixture_ml.MixtureOptions()).estimates
    ok = np.flatnonzero((estimates.alternative == 0) & (estimates.status == Status.OK))
    away = estimates.position_m[ok] - source[estimates.row[ok]]
    inverse = np.linalg.inv(dense_covariance(estimates.covariance_m2[ok]))
    return np.einsum("bi,bij,bj->b", away, inverse, away)


def main(draws: int, share: float, stds_deg: list[float]) -> None:
    """Print a line for each standard deviation."""
    for std_deg in stds_deg:
        generator, squared, begun = np.random.default_rng(1), [], time.process_time()
        for first in range(0, draws, _BLOCK):
            squared.append(squared_errors(*draw(generator, min(_BLOCK, draws - first), std_deg, share)))
        found = np.concatenate(squared)
        sys.stdout.write(
            f"{std_deg:g} deg: {draws} draws, {100.0 * found.size / draws:.2f} % ok, {np.sum(found > _ABSURD)} absurd, "
            f"95 % hold {np.mean(found < _CHI_SQUARE_95):.4f}, NEES {found.mean():.3f}, "
            f"{1e6 * (time.process_time() - begun) / draws:.0f} us each\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    words = [float(word) for word in sys.argv[1:]]
    main(int(words[0]) if words else 1_000_000, words[1] if len(words) > 1 else 0.25, words[2:] or [0.1, 0.5])
