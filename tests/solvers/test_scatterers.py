"""Scatterers that explain echoes of targets."""

from __future__ import annotations

import numpy as np
import pytest
from batches import range_batch

from nlosctl.solvers.echoes import scatterers
from nlosctl.solvers.echoes.echoes import Echoes, read_echoes
from nlosctl.solvers.echoes.evidence import clutter_density

SENSORS = np.array([(-150.0, -120.0), (-130.0, 150.0), (10.0, -170.0), (140.0, -150.0), (160.0, 130.0)])
TARGETS = np.array([(40.0, 60.0), (-90.0, 20.0)])
AREA_M2 = 160_000.0


def distance(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """Return the distances (A, B) between points."""
    return np.hypot(*np.moveaxis(one[:, None] - two[None], -1, 0))


def world(points: np.ndarray, scale: float, std_m: float, seed: int = 0) -> tuple[Echoes, np.ndarray, np.ndarray]:
    """Return echoes of the targets via scatterers, which of them (N, M) are scattered, and the targets' positions."""
    generator = np.random.default_rng(seed)
    direct = distance(SENSORS, TARGETS)
    legs = direct[:, :, None] + distance(TARGETS, points)[None] + distance(SENSORS, points)[:, None]
    ranges = np.concatenate([direct, scale * legs.reshape(5, -1)], axis=1)
    ranges += std_m * generator.standard_normal(ranges.shape)
    number = np.repeat(np.arange(5), ranges.shape[1])
    echoes = read_echoes(range_batch(SENSORS[number][None], ranges.reshape(1, -1), std_m, sensor=number[None]), 0, 100)
    return echoes, echoes.row % ranges.shape[1] >= 2, TARGETS - SENSORS.mean(axis=0)


def everything(echoes: Echoes) -> np.ndarray:
    """Return that all echoes (N, M) are free."""
    return np.isfinite(echoes.range_m)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_scattered_echoes_are_explained_and_direct_ones_are_not(scale: float) -> None:
    """The density exceeds that of clutter at all scattered echoes, under both laws, and at none of the direct ones."""
    echoes, scattered, targets = world(np.array([(120.0, -60.0), (-30.0, 180.0)]), scale, 0.2)
    clutter = clutter_density(echoes, 40.0, scattered)
    density = scatterers.scattered_density(echoes, *targets.T, scattered, clutter, AREA_M2)
    np.testing.assert_array_equal(density > clutter, scattered)


def test_a_scatterer_at_a_target_does_not_explain_its_direct_echoes() -> None:
    """Direct echoes alone, whose ranges are those of half the legs via a scatterer at the target, are not explained."""
    echoes, _, targets = world(np.empty((0, 2)), 0.5, 0.1)
    density = scatterers.scattered_density(
        echoes, *targets.T, everything(echoes), clutter_density(echoes, 40.0), AREA_M2
    )
    assert not density.any()


def test_echoes_at_random_are_not_explained() -> None:
    """Random echoes besides the direct ones have no scatterer."""
    generator = np.random.default_rng(4)
    for _ in range(10):
        ranges = np.concatenate([distance(SENSORS, TARGETS), generator.uniform(50.0, 500.0, (5, 6))], axis=1)
        number = np.repeat(np.arange(5), 8)
        batch = range_batch(SENSORS[number][None], ranges.reshape(1, -1), 1.0, sensor=number[None])
        echoes = read_echoes(batch, 0, 100)
        targets = TARGETS - SENSORS.mean(axis=0)
        density = scatterers.scattered_density(
            echoes, *targets.T, everything(echoes), clutter_density(echoes, 40.0), AREA_M2
        )
        assert not density.any()


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_two_exact_ellipses_cross_at_the_scatterer(scale: float) -> None:
    """Of the crossings of exact ellipses, one of each pair of echoes of a scatterer is that scatterer."""
    point = np.array([(120.0, -60.0)])
    echoes, scattered, targets = world(point, scale, 1e-9)
    legs = scatterers._Legs(echoes, *targets.T, scale)
    x, y = scatterers._seeds(legs, scattered, AREA_M2)
    away = np.hypot(*(np.stack([x, y]).T - (point[0] - SENSORS.mean(axis=0))).T)
    assert (away < 1e-5).sum() == 10 * 2


def test_derivatives_are_finite_differences() -> None:
    """The derivatives of scattered ranges agree with central differences."""
    echoes, _, targets = world(np.array([(120.0, -60.0)]), 0.5, 0.1)
    legs = scatterers._Legs(echoes, *targets.T, 0.5)
    x, y, step = np.array([50.0, -20.0]), np.array([-70.0, 35.0]), 1e-4
    dx, dy = legs.gradient(x, y)
    np.testing.assert_allclose(dx, (legs.predict(x + step, y) - legs.predict(x - step, y)) / (2 * step), atol=1e-7)
    np.testing.assert_allclose(dy, (legs.predict(x, y + step) - legs.predict(x, y - step)) / (2 * step), atol=1e-7)


def test_too_many_echoes_are_not_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    """With more crossings than the limit there are no scatterers, and memory stays bounded."""
    echoes, scattered, targets = world(np.array([(120.0, -60.0)]), 0.5, 0.1)
    monkeypatch.setattr(scatterers, "_MOST_SEEDS", 10)
    clutter = clutter_density(echoes, 40.0, scattered)
    density = scatterers.scattered_density(echoes, *targets.T, scattered, clutter, AREA_M2)
    assert not density.any()
