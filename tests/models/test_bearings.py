"""The bearing model, compared with two independent formulations and finite differences."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt
import pytest

from nlosctl.contract.batches import BearingBatch
from nlosctl.contract.scene import LineReflector, Scene
from nlosctl.models.bearing_predictions import predict_bearings
from nlosctl.models.bearings import sight_lines

FloatArray = npt.NDArray[np.float64]

SCENE = Scene(
    reflectors=(
        LineReflector(name="sloping", point=(0.0, 900.0), direction=(2.0, 1.0)),
        LineReflector(name="vertical", point=(1500.0, 3.0), direction=(0.0, -4.0)),
        LineReflector(name="level", point=(-7.0, -1200.0), direction=(-1.0, 0.0)),
    )
)


def mirror_image(point: tuple[float, float], mirror: LineReflector) -> tuple[float, float]:
    """Return a point's image by the projection on the mirror's normal (no angles, no slopes)."""
    length = math.hypot(*mirror.direction)
    normal = (-mirror.direction[1] / length, mirror.direction[0] / length)
    distance = (point[0] - mirror.point[0]) * normal[0] + (point[1] - mirror.point[1]) * normal[1]
    return point[0] - 2.0 * distance * normal[0], point[1] - 2.0 * distance * normal[1]


def bearing_by_target_image(sensor: tuple[float, float], source: tuple[float, float], mirror: LineReflector) -> float:
    """Return the bearing of the source's image (Appendix 6.2, target-image modelling)."""
    image = mirror_image(source, mirror)
    return math.atan2(image[1] - sensor[1], image[0] - sensor[0])


def bearing_by_sensor_image(sensor: tuple[float, float], source: tuple[float, float], mirror: LineReflector) -> float:
    """Return the mirrored direction from the sensor's image to the source (sensor-image modelling)."""
    image = mirror_image(sensor, mirror)
    seen = (source[0] - image[0], source[1] - image[1])
    tip = mirror_image((mirror.point[0] + seen[0], mirror.point[1] + seen[1]), mirror)
    return math.atan2(tip[1] - mirror.point[1], tip[0] - mirror.point[0])


def random_batch(snapshots: int, measurements: int, noise: float, seed: int = 1) -> tuple[FloatArray, BearingBatch]:
    """Return sources (B, 2) and a mixed batch of their bearings with ``noise`` radians of error."""
    generator = np.random.default_rng(seed)
    shape = (snapshots, measurements)
    source = generator.uniform(-800.0, 800.0, (snapshots, 2))
    sensor_xy = generator.uniform(-800.0, 800.0, (*shape, 2))
    reflector = generator.integers(-1, 3, shape)
    bearing = predict_bearings(sensor_xy, reflector, SCENE, np.broadcast_to(source[:, None], sensor_xy.shape))
    batch = BearingBatch(
        scene=SCENE,
        seed=np.zeros(snapshots, dtype=np.uint64),
        sensor=np.tile(np.arange(measurements), (snapshots, 1)),
        sensor_xy_m=np.asfortranarray(sensor_xy),
        bearing_rad=np.asfortranarray(bearing + noise * generator.normal(size=shape)),
        bearing_std_rad=np.asfortranarray(generator.uniform(0.005, 0.05, shape)),
        path=np.zeros(shape, dtype=np.int64),
        reflector=np.asfortranarray(reflector),
    )
    return source, batch


def angle_between(one: float, other: float) -> float:
    """Return the size of the angle between two directions."""
    return abs(math.remainder(one - other, 2.0 * math.pi))


def about_center(batch: BearingBatch, xy: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return points (B, 2) about the local origins of a batch's sight lines."""
    lines = sight_lines(batch)
    return xy[:, 0] - lines.center_x, xy[:, 1] - lines.center_y


def test_predicted_bearings_agree_with_both_image_models() -> None:
    """Target-image and sensor-image modelling agree to 1e-12 rad, vertical mirrors included."""
    source, batch = random_batch(300, 6, noise=0.0)
    worst = 0.0
    for (b, k), reflector in np.ndenumerate(batch.reflector):
        sensor, target = tuple(batch.sensor_xy_m[b, k]), tuple(source[b])
        if reflector < 0:
            expected = [math.atan2(target[1] - sensor[1], target[0] - sensor[0])]
        else:
            mirror = SCENE.reflectors[reflector]
            models = (bearing_by_target_image, bearing_by_sensor_image)
            expected = [model(sensor, target, mirror) for model in models]
        worst = max(worst, *(angle_between(one, float(batch.bearing_rad[b, k])) for one in expected))
    assert worst < 1e-12


def test_a_mirrored_bearing_by_hand() -> None:
    """From (0, 0), a source at (2, 2) is seen in the mirror x = 3 at its image (4, 2)."""
    scene = Scene(reflectors=(LineReflector(name="wall", point=(3.0, 0.0), direction=(0.0, 1.0)),))
    bearing = predict_bearings(np.zeros((1, 2)), np.array([0]), scene, np.array([[2.0, 2.0]]))
    assert bearing[0] == pytest.approx(math.atan2(2.0, 4.0), abs=1e-15)


def test_noise_free_bearings_have_no_residual() -> None:
    """The sight lines of noise-free bearings pass through the source, which is in front of each."""
    source, batch = random_batch(300, 6, noise=0.0)
    x, y = about_center(batch, source)
    assert np.abs(sight_lines(batch).residual_rad(x, y)).max() < 1e-12
    survey = sight_lines(batch).ray_residuals(x, y)
    assert not survey.behind.any()
    assert survey.chi_square.max() < 1e-18


def test_the_residual_is_measured_minus_predicted() -> None:
    """The residual is measured minus predicted, wrapped, at any point; bearings need not be wrapped."""
    _, batch = random_batch(200, 5, noise=0.3)
    batch = dataclasses.replace(batch, bearing_rad=batch.bearing_rad - 2.0 * np.pi * (batch.bearing_rad > 0.0))
    point = np.random.default_rng(3).uniform(-700.0, 700.0, (200, 2))
    everywhere = np.broadcast_to(point[:, None], batch.sensor_xy_m.shape)
    predicted = predict_bearings(batch.sensor_xy_m, batch.reflector, SCENE, everywhere)
    expected = np.angle(np.exp(1j * (batch.bearing_rad - predicted)))
    got = sight_lines(batch).bearing_residual_rad(*about_center(batch, point))
    assert np.abs(np.angle(np.exp(1j * (got - expected)))).max() < 1e-12
    assert np.abs(got).max() <= np.pi


def test_the_information_agrees_with_finite_differences() -> None:
    """The Fisher information is J^T J / std^2 with a Jacobian by finite differences."""
    source, batch = random_batch(100, 6, noise=0.0)
    jacobian = []
    for axis in np.eye(2):
        step = 1e-3 * axis
        ends = [np.broadcast_to((source + s * step)[:, None], batch.sensor_xy_m.shape) for s in (1, -1)]
        ahead, back = (predict_bearings(batch.sensor_xy_m, batch.reflector, SCENE, end) for end in ends)
        jacobian.append(np.angle(np.exp(1j * (ahead - back))) / 2e-3 / batch.bearing_std_rad)
    expected = [(jacobian[i] * jacobian[j]).sum(axis=1) for i, j in ((0, 0), (0, 1), (1, 1))]
    got = sight_lines(batch).information(*about_center(batch, source))
    trace = expected[0] + expected[2]
    for part, whole in zip((got.xx, got.xy, got.yy), expected, strict=True):
        assert (np.abs(part - whole) / trace).max() < 1e-5


def test_points_beyond_a_mirror() -> None:
    """A point is beyond if a row's mirror separates it from the sensor, or it is on it; direct rows have none."""
    scene = Scene(reflectors=(LineReflector(name="wall", point=(3.0, 0.0), direction=(0.0, 1.0)),))
    _, batch = random_batch(4, 2, noise=0.0)
    reflector = np.array([[0, -1], [0, -1], [0, -1], [-1, -1]])
    batch = dataclasses.replace(batch, scene=scene, reflector=reflector, sensor_xy_m=np.zeros((4, 2, 2)))
    points = np.array([[2.0, 5.0], [4.0, 5.0], [3.0, -2.0], [4.0, 5.0]])
    assert sight_lines(batch).outside_scene(*about_center(batch, points)).tolist() == [False, True, True, False]


def test_points_behind_a_ray() -> None:
    """A point is behind if it is behind any ray; nearest and farthest are its distances from the origins."""
    _, batch = random_batch(2, 2, noise=0.0)
    sensors = np.array([[[0.0, 0.0], [10.0, 0.0]]] * 2)
    direct = np.full((2, 2), -1)
    bearing = np.array([[np.pi / 4, 3 * np.pi / 4], [np.pi / 4, -np.pi / 4]])
    batch = dataclasses.replace(batch, sensor_xy_m=sensors, reflector=direct, bearing_rad=bearing)
    survey = sight_lines(batch).ray_residuals(*about_center(batch, np.array([[3.0, 4.0], [3.0, 4.0]])))
    assert survey.behind.tolist() == [False, True]
    assert survey.nearest_m == pytest.approx([5.0, 5.0])
    assert survey.farthest_m == pytest.approx([math.hypot(7.0, 4.0)] * 2)
