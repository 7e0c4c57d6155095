"""Finite walls that mirror or block rows."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from shapely import LineString

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import CircleReflector, LineReflector, Scene, SegmentReflector
from nlosctl.contract.statuses import Status
from nlosctl.methods import bearings_ml
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import sight_lines
from nlosctl.models.obstacles import hidden_by_walls

_SENSORS = np.array([[[0.0, 0.0], [8.0, 0.0], [4.0, -3.0]]])
_SOURCE = np.array([4.0, 5.0])


def _batch(wall: SegmentReflector, reflector: list[int]) -> BearingBatch:
    scene, places = Scene(reflectors=(wall,)), np.array([reflector])
    bearing = predict_bearings(_SENSORS, places, scene, np.broadcast_to(_SOURCE, _SENSORS.shape))
    return BearingBatch(
        scene=scene,
        seed=np.zeros(1, dtype=np.uint64),
        sensor=np.arange(3)[None, :],
        sensor_xy_m=np.asfortranarray(_SENSORS),
        bearing_rad=np.asfortranarray(bearing),
        bearing_std_rad=np.full((1, 3), 0.01),
        path=np.full((1, 3), -1),
        reflector=places,
    )


@pytest.mark.parametrize(
    ("start", "end", "reflector", "unseen"),
    [
        ((-5.0, 8.0), (15.0, 8.0), [0, 0, 0], [False, False, False]),  # all specular points on the wall
        ((3.5, 8.0), (15.0, 8.0), [0, 0, 0], [True, False, False]),  # the first one is beyond its end
        ((3.0, 2.0), (5.0, 2.0), [-1, -1, -1], [False, False, True]),  # between the source and the third sensor
        ((-5.0, 8.0), (15.0, 8.0), [-1, 0, -1], [False, False, False]),
    ],
)
def test_walls_mirror_and_block_between_their_ends(
    start: tuple[float, float], end: tuple[float, float], reflector: list[int], unseen: list[bool]
) -> None:
    """A wall row needs a specular point on the wall, a direct row a clear path; otherwise infeasible."""
    batch = _batch(SegmentReflector(name="wall", start=start, end=end), reflector)
    lines = sight_lines(batch)
    x, y = _SOURCE[:1] - lines.center_x, _SOURCE[1:] - lines.center_y
    assert lines.unseen(x, y).tolist() == [unseen]
    assert lines.take(np.array([0, 0])).unseen(np.repeat(x, 2), np.repeat(y, 2)).tolist() == [unseen, unseen]
    estimates = bearings_ml.solve(
        dataclasses.replace(batch, want_flags=False), bearings_ml.MaximumLikelihoodOptions()
    ).estimates
    np.testing.assert_allclose(estimates.position_m[0], _SOURCE, atol=1e-6)
    assert estimates.status[0] == (Status.INFEASIBLE if any(unseen) else Status.OK)


def test_hidden_points_agree_with_shapely() -> None:
    """A point is hidden if every straight path from the sensors crosses a wall; circles hide nothing."""
    generator = np.random.default_rng(4)
    segment = SegmentReflector(name="wall", start=(-3.0, 2.0), end=(5.0, 3.0))
    line = LineReflector(name="fence", point=(0.0, -4.0), direction=(1.0, 0.3))
    circle = CircleReflector(name="ring", center=(0.0, 0.0), radius=50.0)
    sensors, points = generator.uniform(-8.0, 8.0, (20, 3, 2)), generator.uniform(-8.0, 8.0, (20, 30, 2))
    center = generator.uniform(-5.0, 5.0, (20, 2))
    hidden = hidden_by_walls(
        Scene(reflectors=(segment, line, circle)),
        *np.moveaxis(sensors - center[:, None], -1, 0),
        *np.moveaxis(points - center[:, None], -1, 0),
        *center.T,
    )
    walls = [LineString([(-3.0, 2.0), (5.0, 3.0)]), LineString([(-1e3, -304.0), (1e3, 296.0)])]
    for b in range(20):
        ways = [[LineString([sensor, point]) for sensor in sensors[b]] for point in points[b]]
        expected = [all(any(way.crosses(wall) for wall in walls) for way in three) for three in ways]
        assert hidden[b].tolist() == expected
    assert 0.1 < hidden.mean() < 0.9
