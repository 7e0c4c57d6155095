"""The scenario of ranges by direct paths, a mirror and a circle."""

from __future__ import annotations

import numpy as np
from scenario_draws import draw_columns

from nlosctl.models.ranges.predictions import predict_ranges
from nlosctl.scenarios.mixed_ranges import MixedRangesOptions, scene


def test_ranges_are_path_lengths_with_the_stated_errors() -> None:
    """Rows that follow their path have standard normal errors; the others are late by up to the baseline."""
    columns = draw_columns("mixed-ranges", 1000, seed=3, outlier_fraction=0.2)
    world = scene(MixedRangesOptions())
    number = {name: index for index, name in enumerate(world.reflector_names)} | {None: -1}
    reflector = np.array([number[name] for name in columns["reflector"]])
    assert [np.mean(reflector == part).round(1) for part in (-1, 0, 1)] == [0.4, 0.3, 0.3]
    sensor, source = (
        np.stack([columns[f"{part}_x_m"], columns[f"{part}_y_m"]], axis=1) for part in ("sensor", "truth")
    )
    error = columns["range_m"] - predict_ranges(sensor, np.zeros(reflector.size), source, reflector, world)
    los = columns["truth_los"]
    assert abs(np.mean(los) - 0.8) < 0.02
    scaled = error[los] / columns["range_std_m"][los]
    assert abs(scaled.mean()) < 0.06
    assert abs(scaled.std() - 1.0) < 0.04
    assert abs(error[~los].mean() - 5e3) < 300.0
    assert error[~los].max() < 10.2e3
