"""Tests of arrival times from sources far outside of an array: a distance that is not determined is not ok."""

from __future__ import annotations

import numpy as np
import pytest

from nlosctl.contract.batches import ArrivalBatch
from nlosctl.contract.statuses import Status
from nlosctl.methods import arrivals_ml, arrivals_srd_ls

METHODS = {module.METHOD.name: module.METHOD for module in (arrivals_ml, arrivals_srd_ls)}


def from_afar(runs: int, dimension: int, least: float, most: float, seed: int):
    """Return arrivals at 7 sensors in a box of 20 m from sources at distances between two powers of ten."""
    generator = np.random.default_rng(seed)
    sensor = generator.uniform(-10.0, 10.0, (runs, 7, dimension))
    unit = generator.standard_normal((runs, dimension))
    unit /= np.linalg.norm(unit, axis=1)[:, None]
    source = unit * 10.0 ** generator.uniform(least, most, runs)[:, None]
    arrival = np.linalg.norm(source[:, None] - sensor, axis=-1) + 0.1 * generator.standard_normal((runs, 7))
    batch = ArrivalBatch(
        dimension=dimension,
        seed=np.zeros(runs, dtype=np.uint64),
        sensor=np.broadcast_to(np.arange(7), (runs, 7)),
        sensor_xy_m=np.asfortranarray(sensor[..., :2]),
        sensor_z_m=np.asfortranarray(sensor[..., 2]) if dimension == 3 else None,
        arrival_m=np.asfortranarray(arrival),
        arrival_std_m=np.full((runs, 7), 0.1, order="F"),
        origin_m=np.zeros(runs),
    )
    return batch, source


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("name", METHODS)
def test_distances_that_are_not_determined_are_not_ok(name: str, dimension: int) -> None:
    """Of sources 1 km to 100 km from an array of 20 m at .1 m hardly any is ok; inside the array nearly all are."""
    batch, _ = from_afar(300, dimension, 3.0, 5.0, 1)
    estimates = METHODS[name].solve(batch, METHODS[name].options()).estimates
    assert (estimates.status == Status.OK).mean() < 0.01
    batch, _ = from_afar(300, dimension, 0.0, 0.8, 2)
    estimates = METHODS[name].solve(batch, METHODS[name].options()).estimates
    assert (estimates.status == Status.OK).mean() > 0.9


def test_few_ok_fixes_are_absurd() -> None:
    """Of ok fixes at 10 m to 1 km from an array of 20 m none has a NEES above 100, by ml in the plane."""
    batch, source = from_afar(1500, 2, 1.0, 3.0, 3)
    estimates = arrivals_ml.METHOD.solve(batch, arrivals_ml.METHOD.options()).estimates
    ok = (estimates.status == Status.OK) & (estimates.alternative == 0)
    assert ok.sum() > 300
    error = estimates.position_m[ok] - source[estimates.row[ok]]
    xx, xy, yy = estimates.covariance_m2[ok].T
    nees = (yy * error[:, 0] ** 2 - 2.0 * xy * error[:, 0] * error[:, 1] + xx * error[:, 1] ** 2) / (xx * yy - xy**2)
    assert (nees > 100.0).sum() == 0
    assert (nees <= 5.991).mean() > 0.88
