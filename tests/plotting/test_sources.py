"""The picture of unlabelled bearings: rays by their assigned source, in the plane and in space."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import nlosctl


def picture(dimensions: int) -> tuple[Any, list[dict[str, Any]]]:
    """Return the panels of the first snapshot of a draw, and its flags."""
    heard = nlosctl.simulate("bearing-field", trials=1, seed=3, dimensions=dimensions, false_bearings=0.5)
    found = nlosctl.identify_los(heard)
    plot = nlosctl.plot(found.flags, found.estimates)
    assert plot.view == "echoes"
    return plot.figure.axes, found.flags.to_pylist()


@pytest.mark.parametrize("dimensions", [2, 3])
def test_each_bearing_is_a_ray(dimensions: int) -> None:
    """Every row is a ray from its sensor in the direction of its bearing; the legend names sources and others."""
    panels, flags = picture(dimensions)
    lines = [line.get_xydata() for line in panels[0].get_lines()]
    rays = [line for line in lines if len(line) == 3 and (line[0] == line[1]).all()]
    ends = {tuple(np.round(ray[0], 6)): [] for ray in rays}
    for ray in rays:
        way = ray[2] - ray[0]
        ends[tuple(np.round(ray[0], 6))].append(np.arctan2(way[1], way[0]))
    assert len(rays) == len(flags)
    for row in flags:
        drawn = ends[round(row["sensor_x_m"], 6), round(row["sensor_y_m"], 6)]
        assert np.abs(np.sin(np.array(drawn) - row["bearing_rad"])).min() < 1e-6
    figure = panels[0].figure
    words = {text.get_text() for legend in [*figure.legends, panels[0].get_legend()] if legend for text in legend.texts}
    assert {f"bearing of target {row['target']}" for row in flags if row["los"]} <= words
    assert "other bearing" in words
