"""Random worlds that fit the caption of Figure 10 of Ananthasubramaniam and Madhow."""

from __future__ import annotations

import math

import numpy as np

from nlosctl.contract.scene import SegmentReflector
from nlosctl.reproduce.experiment import Chunk
from nlosctl.reproduce.madhow.fig10 import EXPERIMENT
from nlosctl.reproduce.madhow.random_worlds import random_worlds, worlds_of_caption
from nlosctl.scenarios.madhow_walls import trace_paths

CHUNK = Chunk(seed=3, number=0, first=0, size=60, total=60)


def test_worlds_fit_the_caption() -> None:
    """Traced path by path: R1 and R2 direct, R3 direct and reflected, R4 reflected only, as at A in our world."""
    points, _ = worlds_of_caption(CHUNK.generator(), CHUNK.size)
    bearing = np.asarray(random_worlds(CHUNK).columns["bearing_rad"]).reshape(-1, 4)
    for (source, *receivers, b1, b2, r1, r2), seen in zip(points.tolist(), bearing, strict=True):
        walls = [
            SegmentReflector(name="blocking", start=tuple(b1), end=tuple(b2)),
            SegmentReflector(name="reflecting", start=tuple(r1), end=tuple(r2)),
        ]
        paths = [trace_paths(tuple(source), tuple(receiver), walls) for receiver in receivers]
        assert [[path.wall for path in each] for each in paths] == [
            [None],
            [None],
            [None, "reflecting"],
            ["reflecting"],
        ]
        for each, angle in zip(paths, seen, strict=True):
            power = [(0.5 if path.wall else 1.0) / path.length_m**2 for path in each]
            total = sum(p * np.exp(1j * path.bearing_rad) for p, path in zip(power, each, strict=True))
            shift = abs(np.angle(np.exp(1j * angle) / total))
            # five standard deviations; a sum of opposed paths turns by more, as the sum is shorter
            assert shift < math.radians(2.5) * sum(power) / abs(total)


def test_suppression_eliminates_r4_in_most_random_worlds() -> None:
    """R4 is eliminated in most worlds of the caption; not in ours, where pairs of rows are equally likely."""
    chunk = Chunk(seed=1, number=0, first=0, size=200, total=200)
    worlds, ours = (EXPERIMENT.sample({"source": source}, chunk) for source in ("A, random worlds", "A"))
    assert np.mean(worlds["r4_eliminated"]) > 0.65
    assert np.mean(ours["r4_eliminated"]) < 0.6
    assert np.all(worlds["r1_r2_kept"] <= worlds["r4_eliminated"])
    assert not np.any(EXPERIMENT.sample({"source": "B"}, chunk)["r4_eliminated"])
